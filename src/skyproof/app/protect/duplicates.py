"""Which recordings are one receiver: those that hold the same noise, all the time and as late as their signals.

Two receivers on one antenna, and copies of one file, prove nothing by being two: of course their signals have the same
delays. A transmitter's noise may be in both as well; but then the satellites' signals, unless it drowns them all, do
not come as late as the noise does. Noise that has nothing in common comes from two antennas.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from skyproof.app.common.settings import Settings
from skyproof.app.receive.reception import Reception
from skyproof.app.receive.tracker import carrier_at_hz
from skyproof.arrays import Booleans, Floats, Reals
from skyproof.fusion.policy import POLICY
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.gnss.time import seconds_between
from skyproof.recording.same_noise import LEAST_ROWS, N_ROWS, SharedNoise, correlate_noise, cut_rows, find_usable_hz
from skyproof.records import ObservationLog, Observations, Samples
from skyproof.statistics.distributions import chi_square_survival

__all__ = ["find_shared_noise", "leave_out_duplicates"]

_PLACES: Final = (0.5, 0.05, 0.95)  # of the common time
_PLACE_EPOCHS: Final = 1024
_MARGIN: Final = np.timedelta64(2, "s")


def leave_out_duplicates(receptions: Sequence[Reception], settings: Settings) -> list[Reception]:
    """Leave out receptions that hold the same noise as another one with more measurements.

    The others say whose noise has nothing in common with theirs.
    """
    n = len(receptions)
    alpha = settings.false_alarm_probability_per_hour / max(n * (n - 1) // 2, 1)
    kept: list[Reception] = []
    left_out: dict[str, Reception] = {}
    apart: dict[str, set[str]] = {r.source.name: set() for r in receptions}
    for reception in sorted(receptions, key=_measurements, reverse=True):
        name = reception.source.name
        for other in kept:
            found = _compare_noise(other, reception, alpha=alpha, code_sigma_m=settings.multipath_sigma_m)
            if found.shared is not None:
                left_out[name] = _leave_out(reception, other, found.shared)
                break
            if found.apart:
                apart[name].add(other.source.name)
                apart[other.source.name].add(name)
        else:
            kept.append(reception)
    return [
        left_out.get(r.source.name) or replace(r, apart_from=frozenset(apart[r.source.name] - left_out.keys()))
        for r in receptions
    ]


def _leave_out(reception: Reception, other: Reception, found: SharedNoise) -> Reception:
    why = (
        f"holds the same noise as {other.source.name} (correlation {found.coefficient:.2f}): one antenna or one file "
        "recorded twice, or one transmitter that drowns all else in both; taken as one receiver"
    )
    return replace(
        reception,
        observations=None,
        left_out=why,
        same_as=other.source.name,
    )


def _measurements(reception: Reception) -> int:
    o = reception.observations
    return 0 if o is None else int(o.measured.sum())


class _Compared(NamedTuple):
    """What noise shows of two receptions. shared : if they are one receiver's. apart : whether they have two antennas;
    they may be neither, as where a transmitter's noise is in both."""

    shared: SharedNoise | None = None
    apart: bool = False


def find_shared_noise(first: Reception, second: Reception, *, alpha: float, code_sigma_m: float) -> SharedNoise | None:
    """Find the noise that two receptions share if they are one receiver's; else None: see `_compare_noise`."""
    return _compare_noise(first, second, alpha=alpha, code_sigma_m=code_sigma_m).shared


def _compare_noise(first: Reception, second: Reception, *, alpha: float, code_sigma_m: float) -> _Compared:
    """Compare the noise of two receptions.

    The middle is compared first. If it agrees both ends are compared too, since a transmitter's noise has a beginning.
    What is shared is that of the place that shares least. Of snapshots, whose time is open by milliseconds, noise that
    differs shows nothing.

    alpha : probability that two antennas are called one, and that one is not because its signals seem to differ.
    code_sigma_m : by how much a signal's code may differ between two receivers on one antenna, one sigma, in each.
    """
    if first.observations is None or second.observations is None or first.samples is None or second.samples is None:
        return _Compared()
    lags = _compute_lags(*_read_places(first.observations, second.observations))
    known = np.flatnonzero(np.isfinite(lags.later_s).any(axis=0))
    if first.codes and second.codes:
        later_s = float(np.nanmedian(lags.later_s)) if known.size else 0.0
        return _Compared(_compare_snapshots(first, second, later_s, alpha=alpha, code_sigma_m=code_sigma_m))
    found: list[tuple[int, SharedNoise]] = []
    for place in _PLACES if known.size else ():
        at = int(known[int(place * (known.size - 1))])
        noise = _correlate_noise(first.samples, second.samples, lags, at)
        if noise is None or noise.p_value >= alpha:
            return _Compared(apart=noise is not None and noise.of_two_antennas)
        found.append((at, noise))
    if not found or _test_agreement(lags, found, code_sigma_m) < alpha:
        return _Compared()
    return _Compared(min((noise for _, noise in found), key=lambda noise: noise.coefficient))


def _compare_snapshots(
    first: Reception, second: Reception, later_s: float, *, alpha: float, code_sigma_m: float
) -> SharedNoise | None:
    """Find the noise that two snapshots share from their beginning on; None unless their codes are as late as it.

    later_s : by which the first began after the second, to half a code period; where no ranges tell, they are taken to
        have begun together.
    """
    a, b, period_s = first.samples, second.samples, GPS_L1_CA.period_s
    assert a is not None
    assert b is not None
    begin_a_s, begin_b_s = max(-later_s, 0.0), max(later_s, 0.0)
    n_rows = min(N_ROWS, int(min(a.duration_s - begin_a_s, b.duration_s - begin_b_s) / period_s))
    if n_rows < LEAST_ROWS:
        return None
    pairs = [(code, other) for code in first.codes for other in second.codes if code.sat == other.sat]
    if not pairs:
        return None
    higher_hz = float(np.median([other.doppler_hz - code.doppler_hz for code, other in pairs]))
    noise = _correlate_parts((a, begin_a_s), (b, begin_b_s), n_rows * period_s, higher_hz=higher_hz)
    if noise is None or noise.p_value >= alpha:
        return None
    code_variance = 2.0 * (code_sigma_m / SPEED_OF_LIGHT_M_S) ** 2
    nearest: dict[str, tuple[float, float]] = {}
    for code, other in pairs:
        pace = 1.0 + code.doppler_hz / GPS_L1_CA.carrier_hz
        after_s = code.code_s - other.code_s + pace * (other.elapsed_s - code.elapsed_s) - noise.lag_s
        after_s -= period_s * np.rint(after_s / period_s)
        if code.sat not in nearest or abs(after_s) < abs(nearest[code.sat][0]):
            nearest[code.sat] = after_s, code.code_sigma_s**2 + other.code_sigma_s**2 + code_variance
    return noise if _test_scatter(list(nearest.values())) >= alpha else None


def _read_places(a: ObservationLog, b: ObservationLog) -> tuple[Observations, Observations]:
    """Read the measurements around the places that are compared; all of a short recording."""
    n = a.gpst.size
    if n <= len(_PLACES) * _PLACE_EPOCHS:
        return a.read(0, n), b.read(0, b.gpst.size)
    ours = [
        a.read(first, first + _PLACE_EPOCHS) for first in np.linspace(0, n - _PLACE_EPOCHS, len(_PLACES)).astype(int)
    ]
    theirs = []
    for part in ours:
        first, stop = np.searchsorted(b.gpst, [part.gpst[0] - _MARGIN, part.gpst[-1] + _MARGIN])
        theirs.append(b.read(int(first), int(stop)))
    return Observations.join(ours), Observations.join(theirs)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Lags:
    """By each pair of signals of one transmission: when the second receiver got what the first one had at an epoch.

    elapsed_s : (n_epochs,) of the first. later_s : (n_pairs, n_epochs) the second's elapsed time minus it; NaN where
        one of the two was not measured. higher_hz : the same of the carrier. sigma_s : thermal, one sigma.
    sats : (n_pairs,)
    """

    sats: tuple[str, ...]
    elapsed_s: Reals
    later_s: Reals
    higher_hz: Reals
    sigma_s: Reals

    def select_near(self, at: int) -> Booleans:
        """Select the epochs around one."""
        return np.asarray(np.abs(self.elapsed_s - self.elapsed_s[at]) < POLICY.noise_beside_s)

    def clock_rate(self, near: Booleans) -> float:
        """Estimate how much faster the second one's clock runs, by most signals."""
        steps = np.diff(self.later_s[:, near], axis=1) / np.diff(self.elapsed_s[near])
        return float(np.nanmedian(steps)) if np.isfinite(steps).any() else 0.0


def _compute_lags(a: Observations, b: Observations) -> _Lags:
    sent_a, sent_b = (
        seconds_between(o.gpst, a.gpst[0])[:, None] - o.pseudorange_m / SPEED_OF_LIGHT_M_S for o in (a, b)
    )
    sats, later_s, higher_hz, sigma_s = [], [], [], []
    for i, signal in enumerate(a.signals):
        for j, other in enumerate(b.signals):
            known = np.isfinite(sent_b[:, j])
            if signal.transmission != other.transmission or not known.any():
                continue
            there_b = [
                np.interp(sent_a[:, i], sent_b[known, j], column[known], left=np.nan, right=np.nan)
                for column in (b.elapsed_s, b.doppler_hz[:, j], b.pseudorange_sigma_m[:, j])
            ]
            sats.append(signal.sat)
            later_s.append(there_b[0] - a.elapsed_s)
            higher_hz.append(there_b[1] - a.doppler_hz[:, i])
            sigma_s.append(np.hypot(there_b[2], a.pseudorange_sigma_m[:, i]) / SPEED_OF_LIGHT_M_S)
    shape = (len(sats), a.elapsed_s.size)
    return _Lags(
        sats=tuple(sats),
        elapsed_s=a.elapsed_s,
        later_s=np.reshape(later_s, shape),
        higher_hz=np.reshape(higher_hz, shape),
        sigma_s=np.reshape(sigma_s, shape),
    )


def _correlate_noise(first: Samples, second: Samples, lags: _Lags, at: int) -> SharedNoise | None:
    """Correlate the noise of two recordings from epoch `at` of the first one on.

    Its lag is in the second's elapsed time.

    None where a recording does not hold the stretch.
    """
    near = lags.select_near(at)
    later_s = float(np.nanmedian(lags.later_s[:, at]))
    return _correlate_parts(
        (first, float(lags.elapsed_s[at])),
        (second, float(lags.elapsed_s[at]) + later_s),
        N_ROWS * GPS_L1_CA.period_s,
        higher_hz=float(np.nanmedian(lags.higher_hz[:, near])),
        clock_rate=lags.clock_rate(near),
    )


def _correlate_parts(
    one: tuple[Samples, float],
    other: tuple[Samples, float],
    length_s: float,
    *,
    higher_hz: float,
    clock_rate: float = 0.0,
) -> SharedNoise | None:
    """Correlate the noise of parts of two recordings, each from so many seconds on; None where one is not held.

    length_s : whole code periods. higher_hz, clock_rate : of the second's carrier and clock.
    """
    (first, begin_a_s), (second, begin_b_s) = one, other
    n_rows = round(length_s / GPS_L1_CA.period_s)
    start_a, planes_a = _read_part(first, begin_a_s, length_s)
    start_b, planes_b = _read_part(second, begin_b_s, (1.0 + clock_rate) * length_s)
    if planes_a is None or planes_b is None:
        return None
    carrier_a_hz = carrier_at_hz(first)
    carrier_b_hz = carrier_at_hz(second) + higher_hz
    band_hz = min(
        find_usable_hz(first.rate_hz, carrier_a_hz, real=not planes_a[1].any()),
        find_usable_hz(second.rate_hz, carrier_b_hz, real=not planes_b[1].any()),
    )
    cells = int(band_hz * GPS_L1_CA.period_s)
    if cells < POLICY.noise_cells:
        return None
    noise = correlate_noise(
        cut_rows(planes_a, carrier_a_hz / first.rate_hz, cells, n_rows),
        cut_rows(planes_b, carrier_b_hz / second.rate_hz, cells, n_rows),
        period_s=GPS_L1_CA.period_s,
    )
    return replace(noise, lag_s=noise.lag_s + start_b / second.rate_hz - start_a / first.rate_hz)


def _read_part(samples: Samples, start_s: float, length_s: float) -> tuple[int, Floats | None]:
    """Read a part of a recording and the number of its first sample; None where it ends before."""
    start, count = round(start_s * samples.rate_hz), round(length_s * samples.rate_hz)
    inside = 0 <= start <= samples.n_samples - count
    return start, samples.read(start, count) if inside else None


def _test_agreement(lags: _Lags, found: Sequence[tuple[int, SharedNoise]], code_sigma_m: float) -> float:
    """Return the p-value that all satellites' signals are as late as the noise, but for a common delay.

    Chi-square of their scatter, one degree less than satellites. Of several pairs of signals the one that is nearest.
    """
    code_variance = 2.0 * (code_sigma_m / SPEED_OF_LIGHT_M_S) ** 2
    delays = list[tuple[float, float]]()
    for sat in sorted(set(lags.sats)):
        best = min(
            (_delay_after_noise(lags, pair, found) for pair, other in enumerate(lags.sats) if other == sat),
            key=lambda one: abs(one[0]),
        )
        if np.isfinite(best[0]):
            delays.append((best[0], best[1] + code_variance))
    return _test_scatter(delays)


def _test_scatter(delays: Sequence[tuple[float, float]]) -> float:
    """Return the p-value that delays are equal, each with its variance; 1 of fewer than two."""
    if len(delays) < 2:
        return 1.0
    off_s, variance = np.array(delays).T
    weight = 1.0 / variance
    apart_s = off_s - float(weight @ off_s / weight.sum())
    return float(chi_square_survival(weight @ apart_s**2, len(off_s) - 1))


def _delay_after_noise(lags: _Lags, pair: int, found: Sequence[tuple[int, SharedNoise]]) -> tuple[float, float]:
    """Estimate how much later than the noise a pair's signals are, and the thermal variance.

    Infinite if nowhere measured.
    """
    off_s, variance = [], []
    for at, noise in found:
        near = lags.select_near(at)
        since_s = lags.elapsed_s[near] - lags.elapsed_s[at]
        values_s = lags.later_s[pair, near] - noise.lag_s - lags.clock_rate(near) * since_s
        known = np.isfinite(values_s)
        off_s += values_s[known].tolist()
        variance += (lags.sigma_s[pair, near][known] ** 2).tolist()
    return (float(np.mean(off_s)), float(np.mean(variance)) / len(off_s)) if off_s else (np.inf, 0.0)
