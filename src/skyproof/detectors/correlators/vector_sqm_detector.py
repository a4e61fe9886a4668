"""Test if a vector receiver's channels fit one position, over `vector_parity`.

It works on correlators as they come, at any spacing and behind any front end: the noise of code and phase is what they
show from look to look. Beside it each code may be off by what multipath and the models leave, as ranges may.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy import special

from skyproof.arrays import Indices, Reals
from skyproof.detectors.base import NotTested, Reporter, leave_open
from skyproof.detectors.correlators.correlator_laws import phase_discriminator
from skyproof.detectors.correlators.policy import POLICY
from skyproof.detectors.correlators.vector_cusum import BankFound, BankState, run_bank
from skyproof.detectors.correlators.vector_parity import (
    Whitener,
    build_whitener,
    parity_test,
    parity_vector,
    select_likely_sets,
    separability,
)
from skyproof.detectors.correlators.vector_sqm import satellite_geometry
from skyproof.errors import SettingsError, require_probability
from skyproof.gnss.time import timedelta_from_s
from skyproof.navigation.directions import Directions, compute_directions
from skyproof.records import (
    Cause,
    Datum,
    Finding,
    Hypothesis,
    NavigationData,
    Need,
    Observations,
    Records,
    SignalId,
    Taps,
    list_refs,
)

__all__ = ["VectorSqm", "VectorSqmSettings"]

MOST_NAMED: Final = 6
"""Sets of signals that would explain a misfit, whose signals are named."""


@dataclass(frozen=True)
class VectorSqmSettings:
    """Settings of `VectorSqm`.

    false_alarm_probability : of each receiver's window.
    wrong_name_probability : that of the sets of signals that explain a misfit, as few as possible, those given do not
        hold the true one.
    min_satellites : five can be tested, six are needed to name one.
    multipath_sigma_m : error of a code that stays over the window, one sigma.
    ionosphere_share : of the ionosphere's delay, one sigma of what the model leaves.
    elevation_mask_deg : channels of satellites below are not tested.
    """

    false_alarm_probability: float = 1e-3
    wrong_name_probability: float = 0.01
    min_satellites: int = 5
    multipath_sigma_m: float = 1.0
    ionosphere_share: float = 0.25
    elevation_mask_deg: float = 5.0

    def __post_init__(self) -> None:
        for name in ("false_alarm_probability", "wrong_name_probability"):
            require_probability("vector_sqm", name, getattr(self, name))
        if self.min_satellites < 5:
            raise SettingsError(f"vector_sqm: min_satellites is {self.min_satellites}; four always fit, take 5 or more")
        for name in ("multipath_sigma_m", "ionosphere_share"):
            if getattr(self, name) < 0.0:
                raise SettingsError(f"vector_sqm: {name} is {getattr(self, name):g}, expected 0 or more")


def select_pair(taps: Taps) -> tuple[float, int, int, int] | None:
    """Select the pair of taps about the prompt nearest to half a chip, of those within a chip; None without any.

    Half a chip detects the largest offsets. Returned are the spacing in chips, and the places of early, prompt and
    late. Early is the replica ahead.
    """
    delays = taps.delays_chips
    prompt = np.flatnonzero(np.abs(delays) < 1e-6)
    for early in np.argsort(np.abs(delays - 0.5), kind="stable"):
        late = np.flatnonzero(np.abs(delays + delays[early]) < 1e-6)
        if prompt.size and late.size and 1e-6 < delays[early] < 1.0:
            return float(delays[early]), int(early), int(prompt[0]), int(late[0])
    return None


def code_offset_chips(early: Reals, late: Reals, spacing_chips: float) -> Reals:
    """Estimate by how much the code is ahead of its replica, of |early| and |late| of any shape.

    They are `spacing_chips` off the prompt. It is exact for a triangle and offsets up to the spacing. For half a chip
    it is the paper's discriminator.
    """
    return np.asarray((1.0 - spacing_chips) * (early - late) / (early + late))


def t_squared_survival(statistic: float, dof: int, samples: int) -> float:
    """Compute the probability that Hotelling's T^2 of `dof` means exceeds a value.

    The means' covariance is that of `samples` draws.

    (samples - dof) / (dof (samples - 1)) T^2 has the F law with dof and samples - dof degrees: H. Hotelling, "The
    generalization of Student's ratio", 1931. Where only the variances are estimated, or a part of them is known, the
    statistic is smaller: it alarms more rarely.
    """
    return float(special.fdtrc(dof, samples - dof, (samples - dof) / (dof * (samples - 1)) * statistic))


class VectorSqm:
    """Make one finding of each receiver and window, from `vector_taps`: a tuple of `Taps` whose channels one solution
    steers.

    Code and phase discriminators of the window's looks are taken into the parity space of the geometry. Half of the
    false-alarm probability goes to the squared length of their means, over the variances that the looks show: it
    exceeds the law of T^2 with 2 (n - 4) degrees at most as often as stated. Half goes to cumulative sums over the
    looks (`vector_cusum`), which continue from window to window in the state and show when an offset began.

    Signals that do not fit one position are found, with those that would explain it. A reflection that is followed
    alone, or a fault of a satellite, displaces a channel just as a false signal does (`code_doppler` tells some apart).
    Taps of scalar tracking show nothing here: each channel follows its own signal.
    """

    name = "vector_sqm"
    needs = (Need.OBSERVATIONS, Need.NAVIGATION, Need.VECTOR_TAPS)

    def __init__(self, settings: VectorSqmSettings | None = None) -> None:
        self.settings = settings or VectorSqmSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.ONE_POSITION)
        lacking = report.name_missing()
        if lacking or records.navigation is None:
            return lacking, state
        by_receiver = {o.receiver: o for o in records.observations}
        before: Mapping[str, BankState] = state or {}
        banks: dict[str, BankState] = {}
        found = []
        for taps in records.vector_taps:
            looks = self._measure_looks(records.navigation, by_receiver.get(taps.receiver), taps)
            if isinstance(looks, _Looks):
                finding, banks[taps.receiver] = self._test_looks(report, looks, taps, before.get(taps.receiver))
            else:
                finding = report.pass_over(list_refs(taps.receiver, taps.signals), looks)
            found.append(finding)
        return found, banks

    def _measure_looks(
        self, navigation: NavigationData, observations: Observations | None, taps: Taps
    ) -> "_Looks | NotTested":
        """Return discriminators of one receiver's channels that can be tested together, or what they lack."""
        data: dict[str, Datum] = {"receiver": taps.receiver, "needed": self.settings.min_satellites}
        pair = select_pair(taps)
        if pair is None:
            return NotTested("no_pair", data)
        geometry = None
        if observations is not None and observations.gpst.size:
            asked = self.settings
            geometry = compute_directions(
                observations,
                navigation,
                taps.signals,
                multipath_sigma_m=asked.multipath_sigma_m,
                ionosphere_share=asked.ionosphere_share,
                elevation_mask_deg=asked.elevation_mask_deg,
            )
        spacing_chips, early, prompt, late = pair
        value = taps.value[:, :, int(np.argmin(np.abs(taps.dopplers_hz)))].astype(np.complex128)
        kept = _select_guided(value, geometry)
        n = kept.size
        rows = np.isfinite(value[:, kept]).all(axis=(1, 2))
        if geometry is None:
            return NotTested("no_position", data)
        needed = 2 * (n - 4) + POLICY.looks_more
        data |= {"channels": n, "looks": int(rows.sum()), "needed_looks": needed}
        if n < self.settings.min_satellites:
            return NotTested("few_satellites", data)
        if np.linalg.matrix_rank(geometry.design[kept]) < 4:
            return NotTested("weak_geometry", data)
        if rows.sum() < needed:
            return NotTested("few_looks", data)
        chosen = value[rows][:, kept]
        return _Looks(
            signals=tuple(taps.signals[k] for k in kept),
            elapsed_s=taps.elapsed_s[rows],
            code_chips=code_offset_chips(np.abs(chosen[..., early]), np.abs(chosen[..., late]), spacing_chips),
            phase_rad=phase_discriminator(chosen[..., prompt]),
            design=geometry.design[kept],
            lasting_chips=geometry.sigma_m[kept] / [taps.signals[k].plan.chip_m for k in kept],
        )

    def _test_looks(
        self, report: Reporter, looks: "_Looks", taps: Taps, before: BankState | None
    ) -> tuple[Finding, BankState]:
        """Return whether one position and clock explain the channels, and what the sums remember."""
        asked = self.settings.false_alarm_probability
        parity = satellite_geometry(looks.design).parity
        noise_chips, noise_rad = (x.std(axis=0, ddof=1) for x in (looks.code_chips, looks.phase_rad))
        bank = run_bank(
            looks.signals,
            looks.code_chips,
            looks.phase_rad,
            build_whitener(parity, noise_chips, noise_rad),
            looks.lasting_chips,
            0.5 * asked,
            before,
        )
        n_looks = len(looks.code_chips)
        statistic, y, _ = looks.mean_over(slice(None), parity, 0.0)
        p_value = min(2.0 * min(t_squared_survival(statistic, y.size, n_looks), bank.p_value), 1.0)
        data: dict[str, Datum] = {"statistic": statistic, "channels": len(looks.signals)}
        failed = p_value < asked
        if failed:
            from_look = min(max(bank.began or 0, 0), n_looks - y.size - POLICY.looks_more)
            _, y, white = looks.mean_over(slice(from_look, None), parity, POLICY.bent_share)
            sets = select_likely_sets(y, white, self.settings.wrong_name_probability)
            data |= {
                "sets": len(sets),
                "set_size": len(sets[0].satellites) if sets else 0,
                "suspects": tuple(str(looks.signals[k]) for each in sets[:MOST_NAMED] for k in each.satellites),
                "separability": float(separability(parity, 1)),
                **_date_in_recording(bank, looks),
            }
        finding = report.find(
            list_refs(taps.receiver, looks.signals),
            "does_not_fit" if failed else "fits",
            {Cause.CLEAN: p_value, **leave_open((Cause.REFLECTIONS, Cause.FAULT))},
            data=data,
            dated_gpst=_began_gpst(bank, looks, report.records, taps.receiver) if failed else None,
        )
        return finding, bank.state


@dataclass(frozen=True, eq=False, kw_only=True)
class _Looks:
    """Discriminators (looks, n) of channels that are tested together, with rows of the geometry (n, 4) and lasting
    errors (n,)."""

    signals: tuple[SignalId, ...]
    elapsed_s: Reals
    code_chips: Reals
    phase_rad: Reals
    design: Reals
    lasting_chips: Reals

    def mean_over(self, rows: slice, parity: Reals, bent: float) -> tuple[float, Reals, Whitener]:
        """Average some looks: return the statistic, y and its whitener.

        Each code may be off by `bent` of its offset besides.
        """
        u, q = self.code_chips[rows], self.phase_rad[rows]
        noise_chips, noise_rad = u.std(axis=0, ddof=1), q.std(axis=0, ddof=1)
        code, phase = u.mean(axis=0), q.mean(axis=0)
        sigma_chips = np.sqrt(noise_chips**2 / len(u) + self.lasting_chips**2 + (bent * code) ** 2)
        white = build_whitener(parity, sigma_chips, noise_rad / np.sqrt(len(u)))
        y = parity_vector(code, phase, white, scores=False)
        return float(parity_test(y).statistic), y, white


def _date_in_recording(bank: BankFound, looks: _Looks) -> dict[str, Datum]:
    """Return when the sums showed an offset and since when it is there, seconds of the recording, as far as known."""
    if bank.seen is None:
        return {}
    seen: dict[str, Datum] = {"seen_s": float(looks.elapsed_s[bank.seen - 1])}
    return seen if bank.began is None or bank.began < 0 else {**seen, "began_s": float(looks.elapsed_s[bank.began])}


def _began_gpst(bank: BankFound, looks: _Looks, records: Records, receiver: str) -> np.datetime64 | None:
    """Return the time of the look at which an offset began, if it is in this window."""
    receiver_records = [o for o in records.observations if o.receiver == receiver and o.gpst.size]
    if not receiver_records or bank.seen is None or bank.began is None or bank.began < 0:
        return None
    since_s = float(looks.elapsed_s[bank.began] - receiver_records[0].elapsed_s[0])
    began: np.datetime64 = receiver_records[0].gpst[0] + timedelta_from_s(since_s)
    return began


def _select_guided(value: Any, geometry: Directions | None) -> Indices:
    """Select channels whose position is known and that were guided nearly all the time that any was."""
    if geometry is None:
        return np.empty(0, np.intp)
    tracked = np.isfinite(value).all(axis=2)
    share = tracked.sum(axis=0) / max(int(tracked.any(axis=1).sum()), 1)
    return np.flatnonzero((share >= POLICY.guided_looks_share) & np.isfinite(geometry.sigma_m))
