"""Test if one receiver's measurements fit one position (RAIM), or two (an attack beside the true sky).

A failed RAIM test alone is no sign of an attack. Its exclusion never decides which signals are authentic: it trusts the
majority, and the attacker may be the majority. It names a signal that does not fit the others, and blames it only as
far as nothing else indicates false signals. A second set of signals that agree on another position or time does
indicate an attack: echoes and false correlation peaks do not agree with each other.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from skyproof.arrays import Indices
from skyproof.detectors.base import NotTested, Reporter, leave_open, signals_of
from skyproof.detectors.residual_causes import POLICY, RangeFit, find_reflected, fit_groups
from skyproof.detectors.second_signals.late_copies import remove_late_copies
from skyproof.detectors.second_signals.second_sky import second_sky_p_value
from skyproof.errors import SettingsError, require_probability
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.navigation.elevation_mask import RECEIVED_FROM_DEG, find_low
from skyproof.navigation.raim import GlobalTest, check_residuals, exclude_one
from skyproof.navigation.search import WindowRanges, compute_misfits
from skyproof.navigation.sets import measure_window
from skyproof.navigation.skies import group_by_kind
from skyproof.records import (
    Cause,
    ConsistentSet,
    Datum,
    Finding,
    Hypothesis,
    Kind,
    NavigationData,
    Need,
    Observations,
    Records,
    SignalId,
    SignalRef,
    list_refs,
)

__all__ = ["PlainFix", "Residual", "ResidualSettings", "fit_layers"]


@dataclass(frozen=True)
class ResidualSettings:
    """Settings of `Residual`.

    false_alarm_probability : of each test of each receiver and window.
    min_satellites : of a set that counts as a sky.
    multipath_sigma_m : error of a track that stays over the window, one sigma.
    ionosphere_share : of the ionosphere's delay, one sigma of what the model leaves.
    elevation_mask_deg : satellites below, as seen from where all of them put the receiver, are in no fit.
    unrelated_spread_m : delays of signals that have nothing to do with each other spread over at least this.
    """

    false_alarm_probability: float = 1e-3
    min_satellites: int = 5
    multipath_sigma_m: float = 1.0
    ionosphere_share: float = 0.25
    elevation_mask_deg: float = 5.0
    unrelated_spread_m: float = 300.0

    def __post_init__(self) -> None:
        require_probability("residual", "false_alarm_probability", self.false_alarm_probability)
        if self.min_satellites < 5:
            raise SettingsError(f"residual: min_satellites is {self.min_satellites}; four always fit, take 5 or more")


class PlainFix(NamedTuple):
    """What a receiver without protection makes of a window.

    signals : the first-found one of each transmission, at most one per satellite, in the order of the fit's rows.
    test : of all of them together. excluded : the one that has to go to make the others fit, None if none does or none
    has to. p_value : of the test, by the union bound over the window's fits.
    """

    signals: tuple[SignalId, ...]
    fit: RangeFit
    test: GlobalTest
    excluded: SignalId | None
    p_value: float

    def signals_of(self, rows: Sequence[int]) -> tuple[SignalId, ...]:
        """Return the signals of these rows of the window's measurements."""
        return tuple(signal for signal, row in zip(self.signals, self.fit.rows, strict=True) if row in rows)


def fit_layers(
    window: Observations, navigation: NavigationData, settings: ResidualSettings, *, reflected: bool = False
) -> tuple[PlainFix, ...]:
    """Fit one position, with a clock for each kind of signal, to each layer of the signals in a window.

    The first layer holds the first-found signals of the first kind of each system, the second those of the second kind,
    and so on. A layer without a signal to spare is left out.

    Under the null (one sky, errors as in `settings`) each statistic is chi-square. Its degrees of freedom are the
    number of satellites less three and less one per kind. No satellite is in a fit twice, since the errors of its bands
    are shared. Fits of several bands are not independent. `settings.false_alarm_probability` is that of all fits.

    reflected : whether errors are also those of reflections that discriminators show.
    """
    mean, measurements, usable = measure_window(
        window,
        navigation,
        multipath_sigma_m=settings.multipath_sigma_m,
        ionosphere_share=settings.ionosphere_share,
        reflected=reflected,
    )
    rank: dict[str, list[Kind]] = {}
    layers: dict[int, list[Indices]] = {}
    for kind, rows in group_by_kind(mean.signals, np.flatnonzero(usable)).items():
        of_scale = rank.setdefault(kind[0], [])
        first: dict[str, int] = {}
        for row in sorted(rows, key=lambda row: mean.signals[row]):
            first.setdefault(mean.signals[row].sat, int(row))
        layers.setdefault(len(of_scale), []).append(np.array(list(first.values()), np.intp))
        of_scale.append(kind)
    fitted = [groups for groups in layers.values() if fit_groups(measurements, groups).spare > 0]
    fixes = [_fit_plain(mean.signals, measurements, groups, len(fitted), settings) for groups in fitted]
    return tuple(fix for fix in fixes if fix is not None)


def _fit_plain(
    signals: Sequence[SignalId],
    measurements: WindowRanges,
    groups: Sequence[Indices],
    tests: int,
    settings: ResidualSettings,
) -> PlainFix | None:
    """Fit the rows, in groups with a clock each; None if no position results, or too few are above the mask.

    tests : fits of the window, which share the false-alarm probability.
    """
    fit, alpha = fit_groups(measurements, groups, tests), settings.false_alarm_probability / tests
    if np.all(np.isfinite(fit.state_m)):
        low = find_low(fit.state_m[:3], measurements.satellite_ecef_m, settings.elevation_mask_deg)
        fit = fit_groups(measurements, [high for rows in groups if (high := rows[~low[rows]]).size], tests)
    if fit.spare <= 0 or not np.all(np.isfinite(fit.state_m)):
        return None
    test, worst = _test_residuals(fit, alpha)
    used, p_value = tuple(signals[row] for row in fit.rows), min(1.0, tests * float(test.p_value))
    if test.consistent or worst < 0:
        return PlainFix(used, fit, test, None, p_value)
    # Solved anew: from a fit that a fault drew off by kilometres, what one row would change is not linear.
    fits = bool(_test_residuals(fit.without([int(fit.rows[worst])]), alpha)[0].consistent)
    return PlainFix(used, fit, test, used[worst] if fits else None, p_value)


def _test_residuals(fit: RangeFit, alpha: float) -> tuple[GlobalTest, int]:
    """Test the residuals of a fit, and find the row that fits worst, -1 where none can be left out."""
    misfit_m, sigma_m, design = fit.misfits()
    test = check_residuals(misfit_m, sigma_m, false_alarm_probability=alpha, unknowns=fit.state_m.size)
    return test, int(exclude_one(design, misfit_m, sigma_m, false_alarm_probability=alpha).excluded)


class Residual:
    """The detector: one finding per receiver and window."""

    name = "residual"
    needs = (Need.OBSERVATIONS, Need.NAVIGATION)

    def __init__(self, settings: ResidualSettings | None = None) -> None:
        self.settings = settings or ResidualSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.ONE_POSITION)
        lacking = report.name_missing()
        if lacking or records.navigation is None:
            return lacking, state
        return [self._test_receiver(report, records.navigation, o) for o in records.observations], state

    def _test_receiver(self, report: Reporter, navigation: NavigationData, o: Observations) -> Finding:
        every = signals_of((o,))
        if o.gpst.size == 0:
            return report.pass_over(every, NotTested("no_epochs"))
        received = [s for s in report.records.sets if s.receiver == o.receiver]
        sets = tuple(s for s in remove_late_copies(o, received) if len(s.signals) >= self.settings.min_satellites)
        several = self._test_several_skies(report, o, sets) if len(sets) >= 2 else None
        if several is not None and several.p:
            return several
        plain = fit_layers(o, navigation, self.settings)
        if several is not None and all(fix.test.consistent for fix in plain):
            return several
        if not plain:
            return report.pass_over(every, _explain_no_fit(o, navigation, self.settings))
        finding = self._test_one_sky(report, o, plain)
        if finding.p.get(Cause.REFLECTIONS, 0.0) < self.settings.false_alarm_probability or _count_doubled(o):
            return finding
        shown = fit_layers(o, navigation, self.settings, reflected=True)
        explained = self._test_one_sky(report, o, shown) if shown else finding
        return finding if explained.failed else explained

    def _test_several_skies(self, report: Reporter, o: Observations, sets: tuple[ConsistentSet, ...]) -> Finding:
        """Return two skies or more, or that unrelated signals form as many sets by chance."""
        p_value = second_sky_p_value(
            o,
            sets,
            unrelated_spread_m=self.settings.unrelated_spread_m,
            multipath_sigma_m=self.settings.multipath_sigma_m,
        )
        signals = tuple(SignalRef(o.receiver, signal) for s in sets for signal in s.signals)
        kinds = {signal.kind for signal in sets[0].signals}
        off_s = [float(s.clock_of_s(kind) - sets[0].clock_of_s(kind)) for kind in kinds for s in sets[1:]]
        data: dict[str, Datum] = {
            "sizes": tuple(float(len(s.signals)) for s in sets),
            "apart_m": max(float(np.linalg.norm(s.position_ecef_m - sets[0].position_ecef_m)) for s in sets[1:]),
        }
        if known_s := [abs(value) for value in off_s if np.isfinite(value)]:
            data["times_apart_s"] = max(known_s)
        if p_value >= self.settings.false_alarm_probability:
            return report.pass_over(signals, NotTested("sets_by_chance", data))
        return report.find(signals, "several_skies", {Cause.CLEAN: p_value, Cause.REFLECTIONS: p_value}, data=data)

    def _test_one_sky(self, report: Reporter, o: Observations, plain: Sequence[PlainFix]) -> Finding:
        worst = min(plain, key=lambda fix: float(fix.test.p_value))
        data: dict[str, Datum] = {"statistic": float(worst.test.statistic), "threshold": float(worst.test.threshold)}
        if worst.test.consistent:
            signals = [signal for fix in plain for signal in fix.signals]
            return report.find(list_refs(o.receiver, signals), "fits", {Cause.CLEAN: worst.p_value}, data=data)
        if far := _list_far_off(report.records, o, self.settings):
            data |= {"far": tuple(sat for sat, _ in far), "least_m": min(abs(m) for _, m in far)}
            p = {Cause.CLEAN: worst.p_value, **leave_open((Cause.ORBITS, Cause.FAULT))}
            return report.find(list_refs(o.receiver, worst.signals), "orbits_off", p, data=data)
        doubled = _count_doubled(o)
        reflected = None if doubled else self._find_reflected(report, o, worst, data)
        return reflected or self._explain_misfit(report, o, worst, doubled, data)

    def _find_reflected(
        self, report: Reporter, o: Observations, plain: PlainFix, data: dict[str, Datum]
    ) -> Finding | None:
        """Return that one or two satellites are received by reflections, and that the others fit; None if they do not.

        Their signals are no sign of an attack, and none of a clean sky.
        """
        alpha = self.settings.false_alarm_probability
        late = find_reflected(plain.fit, spread_m=self.settings.unrelated_spread_m, alpha=alpha)
        if late.p_value < alpha:
            return None
        signals = plain.signals_of(late.rows)
        p = {Cause.CLEAN: plain.p_value, Cause.REFLECTIONS: late.p_value}
        return report.find(list_refs(o.receiver, signals), "reflected", p, singled_out=True, data=data)

    def _explain_misfit(
        self, report: Reporter, o: Observations, plain: PlainFix, doubled: int, data: dict[str, Datum]
    ) -> Finding:
        """Return a misfit. A single signal is to blame only if nothing speaks for more."""
        fit, spread_m = plain.fit, self.settings.unrelated_spread_m
        p = {
            Cause.CLEAN: plain.p_value,
            Cause.FAULT: fit.p_value_without_two(self.settings.false_alarm_probability),
            Cause.REFLECTIONS: fit.p_value_with_errors(0.0, spread_m),
            Cause.INTERFERENCE: fit.p_value_with_errors(-spread_m, spread_m),
            **dict.fromkeys((Cause.OSCILLATOR, Cause.MISSING_SAMPLES), plain.p_value),  # the clock is free
            **leave_open((Cause.ORBITS,)),
        }
        code = "misfit_with_second_signals" if doubled else "misfit"
        data |= {"doubled": doubled} if doubled else {}
        if not doubled and plain.excluded is not None:
            code, data["excluded"] = "single_misfit", str(plain.excluded)
        ranked = dict(sorted(p.items(), key=lambda each: -each[1]))
        return report.find(list_refs(o.receiver, plain.signals), code, ranked, data=data)


def _explain_no_fit(observations: Observations, navigation: NavigationData, settings: ResidualSettings) -> NotTested:
    """Return which of ranges, orbits, satellites above the mask and satellites of one system there are too few of."""
    measured = np.isfinite(observations.pseudorange_m).mean(axis=0) >= 0.5
    ranged = {signal.sat for signal, kept in zip(observations.signals, measured, strict=True) if kept}
    known = {sat for sat in ranged if navigation.best(sat, observations.gpst[observations.gpst.size // 2]) is not None}
    if len(ranged) < 5:
        return NotTested("few_ranges", {"ranged": len(ranged)})
    if len(known) < 5:
        return NotTested("few_orbits", {"known": len(known), "ranged": len(ranged)})
    if fit_layers(observations, navigation, replace(settings, elevation_mask_deg=RECEIVED_FROM_DEG)):
        return NotTested("few_above_mask", {"known": len(known), "mask_deg": settings.elevation_mask_deg})
    return NotTested("no_position", {"known": len(known)})


def _list_far_off(
    records: Records, observations: Observations, settings: ResidualSettings
) -> tuple[tuple[str, float], ...]:
    """List satellites whose signals miss the majority's position by more than any echo, and by how many metres.

    A wrong orbit or clock does this to all signals of its satellite, however many they are.
    """
    sets = [s for s in records.sets if s.receiver == observations.receiver]
    if records.navigation is None or len(sets) != 1:
        return ()
    (chosen,) = sets
    mean, measurements, usable = measure_window(
        observations,
        records.navigation,
        multipath_sigma_m=settings.multipath_sigma_m,
        ionosphere_share=settings.ionosphere_share,
    )
    fitting = {signal.sat for signal in chosen.signals}
    by_sat: dict[str, list[float]] = {}
    for row in np.flatnonzero(usable):
        signal = mean.signals[row]
        clock_m = SPEED_OF_LIGHT_M_S * chosen.clock_of_s(signal.kind)
        if signal.sat in fitting or not np.isfinite(clock_m):
            continue
        misfit_m, _, _ = compute_misfits(measurements, np.array([row]), np.append(chosen.position_ecef_m, clock_m))
        by_sat.setdefault(signal.sat, []).append(float(misfit_m[0]))
    alike = {sat: float(np.median(m)) for sat, m in by_sat.items() if np.ptp(m) <= POLICY.one_orbit_m}
    return tuple(sorted((sat, m) for sat, m in alike.items() if abs(m) > POLICY.no_echo_m))


def _count_doubled(observations: Observations) -> int:
    """Count satellites that have several signals of one transmission with a pseudorange in the window."""
    measured = np.flatnonzero(np.isfinite(observations.pseudorange_m).any(axis=0))
    sent = Counter(observations.signals[column].transmission for column in measured)
    return len({sat for (sat, *_), count in sent.items() if count > 1})
