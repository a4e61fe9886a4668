"""Test if position and clock by codes alone move, epoch by epoch, as a platform and an oscillator can.

A receiver that writes neither carrier nor Doppler, or whose signals are torn at the moment of an attack, still has
codes. `laws` compares the position of each epoch with that of the two before. What reflections do to ranges shows in
the residuals, which set the scale of what is expected; so only a change in which all ranges agree is found.

A position that jumps farther than any platform moves is an attack where no two satellites left out explain it. If two
may explain it, or only the clock jumps (a receiver sets its clock as it likes), the test fails and the cause stays
open.

Signals may be false in one time scale, or one band, alone. So position and clock by each scale, and by the second band
of each, are tested as well. Wrong orbits of a whole system may move such a part alone, so its cause stays open.

Each epoch is compared with the last two that had a position, whatever lies between: a gap, a time of few satellites, or
of other bands.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np

from skyproof.arrays import Indices, Instants, Reals
from skyproof.detectors.base import NotTested, Reporter, leave_open
from skyproof.detectors.code_motion.laws import (
    CodeMotionLimits,
    chance_of_clock,
    chance_of_motion,
    chance_without_two,
    compute_code_steps,
)
from skyproof.detectors.code_motion.policy import POLICY
from skyproof.errors import SettingsError, require_probability
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.navigation.fix import FixGeometry, fix_and_geometry
from skyproof.navigation.reflections import estimate_reflection_sigma_m
from skyproof.records import (
    Cause,
    Datum,
    Finding,
    Fix,
    FixStatus,
    Hypothesis,
    NavigationData,
    Need,
    Observations,
    Records,
    SignalId,
    SignalRef,
    list_refs,
)
from skyproof.statistics.distributions import chi_square_survival

__all__ = ["CodeMotion", "CodeMotionSettings"]

_TAIL: Final = 2  # epochs with a position that are remembered: the law looks back so far
_TESTS: Final = 2  # position and clock
_DOF_LEFT: Final = 1  # with two satellites left out


@dataclass(frozen=True)
class CodeMotionSettings:
    """Settings of `CodeMotion`.

    false_alarm_probability : of each receiver and window, for all epochs and both tests together.
    multipath_sigma_m : of one pseudorange at the zenith, one sigma.
    acceleration_max_m_s2 : no platform exceeds it. speed_max_m_s : no platform exceeds it, if it is known.
    clock_jump, clock_pace_s : what an oscillator's rate may step by, and change by in a second.
    elevation_mask_deg : satellites lower than this are not used.
    """

    false_alarm_probability: float = 1e-3
    multipath_sigma_m: float = 1.0
    acceleration_max_m_s2: float = 50.0
    speed_max_m_s: float | None = None
    clock_jump: float = 1e-8
    clock_pace_s: float = 1e-8
    elevation_mask_deg: float = 5.0

    def __post_init__(self) -> None:
        require_probability("code_motion", "false_alarm_probability", self.false_alarm_probability)
        if not self.acceleration_max_m_s2 > 0.0:
            raise SettingsError(
                f"code_motion: acceleration_max_m_s2 is {self.acceleration_max_m_s2}, expected more than 0"
            )

    @property
    def limits(self) -> CodeMotionLimits:
        """Return what platform and oscillator can do."""
        return CodeMotionLimits(
            acceleration_m_s2=self.acceleration_max_m_s2,
            speed_m_s=np.inf if self.speed_max_m_s is None else self.speed_max_m_s,
            clock_jump=self.clock_jump,
            clock_pace_s=self.clock_pace_s,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Series:
    """The fixes of a receiver's epochs that have one, and the linear problem at each."""

    fix: Fix
    geometry: FixGeometry
    gpst: Instants  # as the receiver's clock shows them
    elapsed_s: Reals
    clock_m: Reals
    misfit: Reals  # sum of squared normalised residuals of each epoch
    dof: Indices
    rows: Indices  # of the epochs that they were made of


_Part = tuple[str, str]
_WHOLE: Final[_Part] = ("", "")
"""A part of the signals that gives a position alone: a time scale, and which of its bands; all of the first."""


class CodeMotion:
    """The detector: see the module's text. It remembers two epochs of each receiver and part of its signals."""

    name = "code_motion"
    share = 0.05  # a jump that counts is as improbable as can be: a whole share would be lost on it
    needs = (Need.OBSERVATIONS, Need.NAVIGATION)

    def __init__(self, settings: CodeMotionSettings | None = None) -> None:
        self.settings = settings or CodeMotionSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.CONTINUOUS)
        lacking = report.name_missing()
        if lacking or records.navigation is None:
            return lacking, state
        tails: dict[str, Mapping[_Part, Observations]] = dict(state or {})
        found = []
        for o in records.observations:
            tail = tails.get(o.receiver, {})
            if any(part.elapsed_s[-1] >= o.elapsed_s[0] for part in tail.values()):
                tail = {}  # another recording
            findings, tails[o.receiver] = self._test_receiver(report, records.navigation, o, tail)
            found += findings
        return found, tails

    def _test_receiver(
        self, report: Reporter, navigation: NavigationData, o: Observations, tails: Mapping[_Part, Observations]
    ) -> tuple[list[Finding], Mapping[_Part, Observations]]:
        """Test position and clock of all signals and of each part; return the epochs that are remembered of them."""
        signals = select_primary_signals(o)
        if signals is None:
            every = list_refs(o.receiver, o.signals)
            return [report.pass_over(every, NotTested("received_twice"))], tails
        parts = _divide_into_parts(o, signals)
        after = dict(tails)
        found = []
        for part, chosen in parts.items():
            now = _select_signals(o, chosen)
            tail = tails.get(part)
            joined = now if tail is None else Observations.join((tail, now))
            begin = joined.gpst.size - now.gpst.size
            series = self._series(joined, navigation, begin)
            after[part] = _keep_tail(joined, series)
            refs = list_refs(o.receiver, chosen)
            if series is None or series.elapsed_s.size <= _TAIL:
                why = NotTested("few_fixes", {"receiver": o.receiver, "needed": _TAIL + 1})
                found += [] if part != _WHOLE else [report.pass_over(refs, why)]
                continue
            findings = self._test_motion(report, refs, series, begin, part, len(parts))
            if any(e.failed and e.code != "jumps_by_all" for e in findings) and np.isfinite(joined.quadrature_m).any():
                shown = self._series(joined, navigation, begin, reflected=True)
                explained = self._test_motion(report, refs, shown or series, begin, part, len(parts))
                findings = findings if any(e.failed for e in explained) else explained
            found += findings
        return found, after

    def _series(
        self, o: Observations, navigation: NavigationData, begin: int, *, reflected: bool = False
    ) -> _Series | None:
        """Return the fixes that have redundancy; None without any.

        begin : the first epoch that is not remembered. reflected : whether reflections that discriminators show count.
        """
        if not o.signals:
            return None
        fix, geometry = fix_and_geometry(
            o,
            navigation,
            multipath_sigma_m=self.settings.multipath_sigma_m,
            elevation_mask_deg=self.settings.elevation_mask_deg,
            false_alarm_probability=POLICY.fault_probability,
            reflected_sigma_m=estimate_reflection_sigma_m(o.quadrature_m, o.pseudorange_sigma_m) if reflected else None,
        )
        used = np.isfinite(geometry.sigma_m) & np.isfinite(geometry.misfit_m)
        normalised = np.where(used, geometry.misfit_m / np.where(used, geometry.sigma_m, 1.0), 0.0)
        clocks = np.any(used[..., None] & (geometry.design[..., 3:] != 0.0), axis=1).sum(axis=1)
        dof = used.sum(axis=1) - 3 - clocks
        good = np.flatnonzero((fix.status == FixStatus.OK) & (dof > 0) & np.isfinite(fix.covariance_m2).all((1, 2)))
        if not good.size:
            return None
        scales = fix.inter_system_s
        clock_s = {scale: fix.clock_bias_s + offset_s for scale, offset_s in scales.items()}
        chosen = max(clock_s, key=lambda scale: int(np.isfinite(clock_s[scale][good]).sum()))
        clock_m = SPEED_OF_LIGHT_M_S * clock_s[chosen]
        if _list_kinds(o, chosen, slice(0, begin)) != _list_kinds(o, chosen, slice(begin, None)):
            clock_m = np.where(np.arange(o.gpst.size) < begin, np.nan, clock_m)  # another way through the receiver
        return _Series(
            fix=fix.select(good),
            geometry=FixGeometry(
                design=geometry.design[good], misfit_m=geometry.misfit_m[good], sigma_m=geometry.sigma_m[good]
            ),
            gpst=o.gpst[good],
            elapsed_s=o.elapsed_s[good],
            clock_m=clock_m[good],
            misfit=(normalised[good] ** 2).sum(axis=1),
            dof=dof[good],
            rows=good,
        )

    def _test_motion(
        self,
        report: Reporter,
        signals: tuple[SignalRef, ...],
        series: _Series,
        begin: int,
        part: _Part,
        n_parts: int,
    ) -> list[Finding]:
        """Test position and clock of a part's signals. begin : as of `_series`."""
        motion = compute_code_steps(
            series.elapsed_s, series.fix.position_ecef_m, series.clock_m, series.fix.covariance_m2
        )
        new = series.rows[motion.row] >= begin
        if not new.any() and part != _WHOLE:
            return []
        three = motion.row[:, None] - np.arange(3)
        dof = series.dof[three].min(axis=1).astype(np.float64)
        misfit, degrees = series.misfit[three].sum(axis=1), series.dof[three].sum(axis=1)
        # Residuals as small as the model says leave it as it is; else they give its scale.
        fits = chi_square_survival(misfit, degrees) >= POLICY.misfit_probability
        factor, dof = np.where(fits, 1.0, misfit / degrees), np.where(fits, np.inf, dof)
        limits, n_new = self.settings.limits, int(new.sum())
        places = np.where(new, chance_of_motion(motion, limits, factor, dof), 1.0)
        clocks = np.where(new, chance_of_clock(motion, limits, factor, dof), 1.0)
        alpha = self.settings.false_alarm_probability / (_TESTS * n_parts)
        found = []
        for p_values, quantity in ((places, "position"), (clocks, "clock")):
            k = int(np.argmin(p_values))
            p = {Cause.CLEAN: min(1.0, n_new * float(p_values[k]))}
            jumps = p[Cause.CLEAN] < alpha
            code = "jumps" if jumps else "goes_on"
            data: dict[str, Datum] = {"what": quantity, "alone": () if part == _WHOLE else _name_kinds(signals)}
            if quantity == "position":
                data["moved_m"] = float(np.linalg.norm(motion.position_m[k]))
            else:
                data["clock_s"] = float(abs(motion.clock_m[k])) / SPEED_OF_LIGHT_M_S
            if part != _WHOLE:
                p |= leave_open((Cause.ORBITS, Cause.FAULT))
            elif quantity == "clock":
                p |= leave_open((Cause.OSCILLATOR,))
            elif not jumps:
                p |= leave_open((Cause.FAULT,))
            else:
                p |= dict.fromkeys((Cause.OSCILLATOR, Cause.MISSING_SAMPLES), p[Cause.CLEAN])  # the clock is free
                p[Cause.FAULT] = min(1.0, n_new * self._chance_without_two(series, motion.row[k] - np.arange(3)))
                code = "jumps_by_two" if p[Cause.FAULT] >= alpha else "jumps_by_all"
            at = series.gpst[motion.row[k]] if jumps else None
            found.append(report.find(signals, code, p, alpha=alpha, data=data, dated_gpst=at))
        return found

    def _chance_without_two(self, series: _Series, rows: Indices) -> float:
        """Return the largest chance of a position at the last of three epochs, any two satellites being faulty."""
        return chance_without_two(
            series.geometry,
            rows,
            series.fix.position_ecef_m[rows],
            series.elapsed_s[rows],
            self.settings.limits,
            _DOF_LEFT,
        )


@lru_cache(16)  # several tests look at the same windows
def select_primary_signals(o: Observations) -> tuple[SignalId, ...] | None:
    """Select the kind of signal of each time scale that most satellites have; None if one is received twice."""
    measured = np.isfinite(o.pseudorange_m)
    counts: Counter[tuple[str, str, str]] = Counter()
    for signal, count in zip(o.signals, measured.sum(axis=0).tolist(), strict=True):
        counts[signal.kind] += count
    chosen: dict[str, tuple[str, str, str]] = {}
    for kind, _ in sorted(counts.items(), key=lambda item: (-item[1], item[0])):
        chosen.setdefault(kind[0], kind)
    kinds = set(chosen.values())
    columns = [int(k) for k in np.flatnonzero(measured.any(axis=0)) if o.signals[k].kind in kinds]
    sats = Counter(o.signals[k].sat for k in columns)
    for sat in (sat for sat, count in sats.items() if count > 1):
        if (measured[:, [k for k in columns if o.signals[k].sat == sat]].sum(axis=1) > 1).any():
            return None
    return tuple(o.signals[k] for k in columns)


def _divide_into_parts(o: Observations, signals: tuple[SignalId, ...]) -> dict[_Part, tuple[SignalId, ...]]:
    """Divide the signals into the whole, and each part with enough satellites for a position of its own."""
    parts: dict[_Part, tuple[SignalId, ...]] = {_WHOLE: signals}
    scales = sorted({signal.kind[0] for signal in signals})
    first = {signal.kind for signal in signals}
    counts: dict[tuple[str, str, str], list[SignalId]] = {}
    for column in np.flatnonzero(np.isfinite(o.pseudorange_m).any(axis=0)).tolist():
        counts.setdefault(o.signals[column].kind, []).append(o.signals[column])
    for scale in scales:
        of_scale = tuple(signal for signal in signals if signal.kind[0] == scale)
        if len(scales) > 1 and len({signal.sat for signal in of_scale}) >= POLICY.part_satellites:
            parts[scale, "first"] = of_scale
        bands = {kind[1] for kind in first if kind[0] == scale}
        other_kinds = [kind for kind in counts if kind[0] == scale and kind[1] not in bands]
        if other_kinds:
            second = max(sorted(other_kinds), key=lambda kind: len({signal.sat for signal in counts[kind]}))
            if len({signal.sat for signal in counts[second]}) == len(counts[second]) >= POLICY.part_satellites:
                parts[scale, "second"] = tuple(counts[second])
    return parts


def _select_signals(o: Observations, signals: tuple[SignalId, ...]) -> Observations:
    """Select the measurements of some signals."""
    return o.select_channels(np.array([o.column_of[signal] for signal in signals], np.intp))


def _list_kinds(o: Observations, scale: str, rows: slice) -> set[tuple[str, str, str]]:
    """List the kinds of a time scale that some epochs have."""
    measured = np.isfinite(o.pseudorange_m[rows]).any(axis=0)
    return {o.signals[k].kind for k in np.flatnonzero(measured) if o.signals[k].kind[0] == scale}


def _name_kinds(signals: tuple[SignalRef, ...]) -> tuple[str, ...]:
    """Name the kinds of signals of a part."""
    return tuple(sorted({f"{ref.signal.sat[0]} {ref.signal.band}" for ref in signals}))


def _keep_tail(joined: Observations, series: _Series | None) -> Observations:
    """Keep the epochs to remember: the last that have a position, else the last."""
    n = joined.gpst.size
    rows = np.arange(max(n - _TAIL, 0), n) if series is None else series.rows[-_TAIL:]
    return Observations.join([joined.read(int(row), int(row) + 1) for row in rows])
