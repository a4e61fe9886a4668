"""The state of the position filter: what it holds, how it ages, what is forgotten."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from skyproof.arrays import Instants, Reals
from skyproof.errors import SettingsError, require_probability
from skyproof.navigation.vector_filter import CLOCK, CORE, DRIFT, POSITION, VELOCITY
from skyproof.records import SignalId

__all__ = [
    "FilterSettings",
    "FilterState",
    "drop_old",
    "predict",
]


@dataclass(frozen=True)
class FilterSettings:
    """Settings of `step`; noises are densities of random walks.

    mode : "static": the velocity is zero; "kinematic": it walks by `acceleration_m2_s3`.
    acceleration_m2_s3 : 1 m/s of change in a second: cars, ships and walkers; take 100 for flight with turns.
    clock_m2_s, drift_m2_s3 : a quartz oscillator (h0 = 2e-19, h-2 = 2e-20; R. G. Brown and P. Y. C. Hwang,
        "Introduction to Random Signals and Applied Kalman Filtering", 4th ed., table 9.3).
    offset_m2_s : of one time scale against another, with the receiver's delays: centimetres in an hour.
    ambiguity_m2_s : 20 cm in 100 s: an ordinary 1 mm/s of the ionosphere, twice, for code against carrier.
    multipath_sigma_m, ionosphere_share, elevation_mask_deg : as in `fix`; they make the sigma of b.
    error_time_s : after which b is another one, between multipath (a minute) and orbits (hours).
    carrier_sigma_m : at the zenith, beside the thermal noise; grows by 1/sin(elevation).
    range_rate_sigma_m_s : of a Doppler, beside the thermal noise.
    false_alarm_probability : of the test, at each epoch, by which measurements that do not fit are left out.
    max_gap_s : an arc does not last over a gap of the carrier longer than this.
    """

    mode: Literal["static", "kinematic"] = "kinematic"
    acceleration_m2_s3: float = 1.0
    clock_m2_s: float = 0.009
    drift_m2_s3: float = 0.036
    offset_m2_s: float = 1e-6
    ambiguity_m2_s: float = 4e-4
    multipath_sigma_m: float = 0.5
    ionosphere_share: float = 0.25
    elevation_mask_deg: float = 5.0
    error_time_s: float = 600.0
    carrier_sigma_m: float = 0.003
    range_rate_sigma_m_s: float = 0.05
    false_alarm_probability: float = 1e-4
    max_gap_s: float = 60.0

    def __post_init__(self) -> None:
        if self.mode not in ("static", "kinematic"):
            raise SettingsError(f"filter: mode is {self.mode!r}, expected 'static' or 'kinematic'; give one of them")
        require_probability("filter", "false_alarm_probability", self.false_alarm_probability)
        if self.error_time_s <= 0.0:
            raise SettingsError(f"filter: error_time_s is {self.error_time_s}, expected more than 0; give seconds")


@dataclass(frozen=True, eq=False, kw_only=True)
class FilterState:
    """What is known after an epoch. `None` in its place means that nothing is known yet.

    gpst : the epoch's label. scales : the time scales, the clock's own first.
    mean (n,), covariance (n, n) : core of 8, an offset for each scale but the first, b of each signal, n of each.
    signals : (k). seen, carried : (k,) label of the last code and the last carrier. error_sigma_m : (k,) of b.
    """

    gpst: np.datetime64
    scales: tuple[str, ...]
    mean: Reals
    covariance: Reals
    signals: tuple[SignalId, ...]
    seen: Instants
    carried: Instants
    error_sigma_m: Reals


def predict(state: FilterState, gpst: np.datetime64, settings: FilterSettings) -> FilterState:
    """Predict the state at a later epoch: F x and F P F' + Q, F of blocks."""
    dt_s = float((gpst - state.gpst) / np.timedelta64(1, "ns")) * 1e-9
    mean, k = state.mean.copy(), len(state.signals)
    first_error = mean.size - 2 * k
    errors, ambiguities = slice(first_error, first_error + k), slice(first_error + k, None)
    fade = np.exp(-dt_s / settings.error_time_s)
    transition = np.eye(mean.size)
    transition[POSITION, VELOCITY] = dt_s * np.eye(3)
    transition[CLOCK, DRIFT] = dt_s
    transition[errors, errors] *= fade
    noise = np.zeros(mean.size)
    noise[CORE:first_error] = settings.offset_m2_s * dt_s
    noise[errors] = (1.0 - fade**2) * state.error_sigma_m**2
    noise[ambiguities] = settings.ambiguity_m2_s * dt_s
    covariance = transition @ state.covariance @ transition.T + np.diag(noise)
    walk = np.array([[dt_s**3 / 3.0, dt_s**2 / 2.0], [dt_s**2 / 2.0, dt_s]])
    covariance[np.ix_([CLOCK, DRIFT], [CLOCK, DRIFT])] += settings.drift_m2_s3 * walk
    covariance[CLOCK, CLOCK] += settings.clock_m2_s * dt_s
    if settings.mode == "kinematic":
        for axis in range(3):
            covariance[np.ix_([axis, axis + 3], [axis, axis + 3])] += settings.acceleration_m2_s3 * walk
    return replace(state, gpst=gpst, mean=transition @ mean, covariance=covariance)


def drop_old(state: FilterState, settings: FilterSettings) -> FilterState:
    """Drop signals that were not seen for so long that nothing of theirs is worth keeping."""
    last_s = max(settings.max_gap_s, 2.0 * settings.error_time_s)
    kept = (state.gpst - state.seen) / np.timedelta64(1, "s") <= last_s
    if np.all(kept):
        return state
    core = np.ones(state.mean.size - 2 * kept.size, np.bool_)
    which = np.concatenate((core, kept, kept))
    return replace(
        state,
        mean=state.mean[which],
        covariance=state.covariance[np.ix_(which, which)],
        signals=tuple(signal for signal, keep in zip(state.signals, kept, strict=True) if keep),
        seen=state.seen[kept],
        carried=state.carried[kept],
        error_sigma_m=state.error_sigma_m[kept],
    )
