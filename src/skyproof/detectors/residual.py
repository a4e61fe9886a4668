"""Do the measurements of one receiver fit one position (RAIM), or two (an attack beside the true sky)?

Failing RAIM is no sign of an attack by itself, and its exclusion never decides who is authentic: it believes the
majority, and the attacker may be the majority. It names a signal that does not fit the others, and blames it only as
far as nothing else speaks for false signals. A second set of signals that
agree on another position or time is a sign: echoes and false correlation peaks do not agree with each other.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.detectors.base import Untested, missing, undecided
from skyproof.detectors.second_signals.late_copies import without_late_copies
from skyproof.detectors.second_signals.second_sky import second_sky_p_value
from skyproof.errors import SettingsError, require_probability
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.navigation.elevation_mask import RECEIVED_FROM_DEG, find_low
from skyproof.navigation.least_squares import design_matrix
from skyproof.navigation.raim import GlobalTest, exclude_one, global_test
from skyproof.navigation.search import WindowRanges, below, misfits, solve
from skyproof.navigation.sets import window_measurements
from skyproof.navigation.skies import Kind, by_kind
from skyproof.records import ConsistentSet, Evidence, NavigationData, Need, Observations, Records, SignalId, SignalRef

__all__ = ["PlainFix", "Residual", "ResidualSettings", "plain_fixes"]

_NO_ECHO_M: Final = 1e4
"""By which no reflection is late: what comes a detour of ten kilometres is far below what is tracked."""
_ALIKE_M: Final = 200.0
"""Within which all signals of a satellite miss a place that its orbit alone is to blame for: the ionosphere, delays."""
_MOST_NAMED: Final = 8


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

    signals : the first-found one of each transmission, at most one per satellite. test : of all of them together.
    excluded : the one that has to go to make the others fit, None if none does or none has to.
    """

    signals: tuple[SignalId, ...]
    test: GlobalTest
    excluded: SignalId | None


def plain_fixes(window: Observations, navigation: NavigationData, settings: ResidualSettings) -> tuple[PlainFix, ...]:
    """Fit one position, with a clock for each kind of signal, to the first-found signals of the first kind of each
    system, then to those of the second, and so on; those left out that have no signal to spare.

    Under the null (one sky, errors as in `settings`) each statistic is chi-square with as many degrees as there are
    satellites beyond three and one per kind. So no satellite is in a fit twice, by two bands whose errors are one; fits
    of several bands are not independent. `settings.false_alarm_probability` is that of all.
    """
    mean, measurements, usable = window_measurements(
        window, navigation, multipath_sigma_m=settings.multipath_sigma_m, ionosphere_share=settings.ionosphere_share
    )
    rank: dict[str, list[Kind]] = {}
    layers: dict[int, list[Indices]] = {}
    for kind, rows in by_kind(mean.signals, np.flatnonzero(usable)).items():
        of_scale = rank.setdefault(kind[0], [])
        first: dict[str, int] = {}
        for row in sorted(rows, key=lambda row: mean.signals[row]):
            first.setdefault(mean.signals[row].sat, int(row))
        layers.setdefault(len(of_scale), []).append(np.array(list(first.values()), np.intp))
        of_scale.append(kind)
    fitted = [groups for groups in layers.values() if _spare(groups) > 0]
    alpha = settings.false_alarm_probability / max(len(fitted), 1)
    fixes = [_plain_fix(mean.signals, measurements, groups, alpha, settings.elevation_mask_deg) for groups in fitted]
    return tuple(fix for fix in fixes if fix is not None)


def _spare(groups: Sequence[Indices]) -> int:
    """How many satellites are beyond those that a position and a clock for each group need."""
    return sum(rows.size for rows in groups) - len(groups) - 3


def _plain_fix(
    signals: Sequence[SignalId], measurements: WindowRanges, groups: Sequence[Indices], alpha: float, mask_deg: float
) -> PlainFix | None:
    """Of rows in groups with a clock each; None where no position comes out, or too few stand above the mask."""
    state_m = _state(measurements, groups)
    if np.all(np.isfinite(state_m)):
        low = find_low(state_m[:3], measurements.satellite_ecef_m, mask_deg)
        groups = [high for rows in groups if (high := rows[~low[rows]]).size]
        if _spare(groups) <= 0:
            return None
        state_m = _state(measurements, groups)
    if not np.all(np.isfinite(state_m)):
        return None
    rows = np.concatenate(groups)
    test, worst = _tested(measurements, groups, state_m, alpha)
    used = tuple(signals[row] for row in rows)
    if test.consistent or worst < 0:
        return PlainFix(used, test, None)
    # Solved anew: from a fit that a fault drew off by kilometres, what one row would change is not linear.
    others = [left for group in groups if (left := group[group != rows[worst]]).size]
    fits = bool(_tested(measurements, others, _state(measurements, others), alpha)[0].consistent)
    return PlainFix(used, test, used[worst] if fits else None)


def _tested(
    measurements: WindowRanges, groups: Sequence[Indices], state_m: Reals, alpha: float
) -> tuple[GlobalTest, int]:
    """Test the residuals of rows in groups, and find the row that fits worst, -1 where none can be left out."""
    rows, clocks = np.concatenate(groups), _clocks(groups)
    misfit_m, sigma_m, unit = misfits(measurements, rows, np.append(state_m[:3], 0.0))
    misfit_m = misfit_m - clocks @ state_m[3:]
    test = global_test(misfit_m, sigma_m, false_alarm_probability=alpha, unknowns=3 + len(groups))
    exclusion = exclude_one(design_matrix(unit, clocks), misfit_m, sigma_m, false_alarm_probability=alpha)
    return test, int(exclusion.excluded)


def _state(measurements: WindowRanges, groups: Sequence[Indices]) -> Reals:
    """Solve for the position and a clock for each group of rows, (3 + groups,)."""
    rows = np.concatenate(groups)
    start_m = np.concatenate((below(measurements, rows), np.zeros(len(groups))))
    return np.asarray(solve(measurements, rows[None], start_m[None], rounds=3, clocks=_clocks(groups)).state_m[0])


def _clocks(groups: Sequence[Indices]) -> Reals:
    """Say which clock is whose: (rows, groups), ones and zeros."""
    return np.repeat(np.eye(len(groups)), [own.size for own in groups], axis=0)


class Residual:
    """The detector: one Evidence per receiver and window."""

    name = "residual"
    needs = (Need.OBSERVATIONS, Need.NAVIGATION)

    def __init__(self, settings: ResidualSettings | None = None) -> None:
        self.settings = settings or ResidualSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Evidence], Any]:
        """Evidence of one window; never raises for what the data lack."""
        lacking = missing(self, records)
        if lacking or records.navigation is None:
            return lacking, state
        return [self._receiver(records, records.navigation, o) for o in records.observations], state

    def _receiver(self, records: Records, navigation: NavigationData, observations: Observations) -> Evidence:
        every = tuple(SignalRef(observations.receiver, signal) for signal in observations.signals)
        own = [s for s in records.sets if s.receiver == observations.receiver]
        sets = tuple(
            s for s in without_late_copies(observations, own) if len(s.signals) >= self.settings.min_satellites
        )
        if observations.gpst.size == 0:
            return undecided(
                self,
                records,
                every,
                code="no_epochs",
                because=f"no epoch of {observations.receiver} lies in the window",
                would_need="measurements over the window",
            )
        several = self._several_skies(records, observations, sets) if len(sets) >= 2 else None
        if several is not None and several.says == "attack":
            return several
        plain = plain_fixes(observations, navigation, self.settings)
        if several is not None and all(fix.test.consistent for fix in plain):
            return several
        if not plain:
            return undecided(self, records, every, **_explain_no_fit(observations, navigation, self.settings)._asdict())
        return self._one_sky(records, observations, plain)

    def _several_skies(self, records: Records, observations: Observations, sets: tuple[ConsistentSet, ...]) -> Evidence:
        p_value = second_sky_p_value(
            observations,
            sets,
            unrelated_spread_m=self.settings.unrelated_spread_m,
            multipath_sigma_m=self.settings.multipath_sigma_m,
        )
        subject = tuple(SignalRef(observations.receiver, signal) for s in sets for signal in s.signals)
        sizes = " and ".join(str(len(s.signals)) for s in sets)
        far_m = max(float(np.linalg.norm(s.position_ecef_m - sets[0].position_ecef_m)) for s in sets[1:])
        because = f"{sizes} signals in {observations.receiver} fit positions up to {far_m:.0f} m apart"
        kinds = {signal.kind for signal in sets[0].signals}
        off_s = [s.clock_of_s(kind) - sets[0].clock_of_s(kind) for kind in sorted(kinds) for s in sets[1:]]
        if late := [abs(value) for value in off_s if np.isfinite(value)]:
            because += f", and times {max(late) * 1e6:.2f} us ({max(late) * SPEED_OF_LIGHT_M_S:.0f} m) apart"
        if p_value >= self.settings.false_alarm_probability:
            return undecided(
                self,
                records,
                subject,
                code="sets_by_chance",
                because=f"{because}, which unrelated signals do as well by chance",
                would_need="more satellites with a second signal",
            )
        return Evidence(
            detector=self.name,
            start_gpst=records.start_gpst,
            end_gpst=records.end_gpst,
            subject=subject,
            says="attack",
            because=because,
            p_value=p_value,
            false_alarm_probability=self.settings.false_alarm_probability,
        )

    def _one_sky(self, records: Records, observations: Observations, plain: Sequence[PlainFix]) -> Evidence:
        receiver, worst = observations.receiver, min(plain, key=lambda fix: float(fix.test.p_value))
        test, fits = worst.test, bool(worst.test.consistent)
        signals = [signal for fix in (plain if fits else [worst]) for signal in fix.signals]
        n = len({signal.sat for signal in signals})
        because = f"{n} satellites in {receiver} {'fit' if fits else 'do not fit'} one position"
        far = () if fits else _far_off(records, observations, self.settings)
        if not fits:
            because += _orbits(far) if far else _blame(worst, _doubled(observations))
        return Evidence(
            detector=self.name,
            start_gpst=records.start_gpst,
            end_gpst=records.end_gpst,
            subject=tuple(SignalRef(receiver, signal) for signal in signals),
            says="clean" if fits else "undecided",
            because=because,
            statistic=float(test.statistic),
            threshold=float(test.threshold),
            false_alarm_probability=self.settings.false_alarm_probability,
            p_value=min(1.0, len(plain) * float(test.p_value)),
            would_need=None if fits else "another receiver, or both signals of the satellites that have two",
            may_also_be=() if fits else ("orbits", "fault") if far else ("fault", "orbits", "reflections"),
        )


def _explain_no_fit(observations: Observations, navigation: NavigationData, settings: ResidualSettings) -> Untested:
    """Say which of ranges, orbits, satellites above the mask and satellites of one system there are too few of."""
    receiver = observations.receiver
    there = np.isfinite(observations.pseudorange_m).mean(axis=0) >= 0.5
    ranged = {signal.sat for signal, kept in zip(observations.signals, there, strict=True) if kept}
    known = {sat for sat in ranged if navigation.best(sat, observations.gpst[observations.gpst.size // 2]) is not None}
    needed = "a position with a satellite to spare takes five, and one more for each further kind of signal"
    if len(ranged) < 5:
        return Untested(
            code="few_ranges",
            because=f"{len(ranged)} satellites in {receiver} have pseudoranges for half of the window: {needed}",
            would_need="five or more satellites with pseudoranges",
        )
    if len(known) < 5:
        return Untested(
            code="few_orbits",
            because=f"the orbits of {len(known)} of {len(ranged)} satellites in {receiver} are known: {needed}",
            would_need="orbits of these satellites at this time: a navigation file of the day",
        )
    if plain_fixes(observations, navigation, replace(settings, elevation_mask_deg=RECEIVED_FROM_DEG)):
        return Untested(
            code="few_above_mask",
            because=f"too few of {len(known)} satellites in {receiver} stand above the elevation mask of "
            f"{settings.elevation_mask_deg:g} degrees: {needed}",
            would_need="a lower elevation_mask_deg",
        )
    return Untested(
        code="no_position",
        because=f"the {len(known)} satellites in {receiver} give no position: {needed}",
        would_need="more satellites of one system",
    )


def _far_off(records: Records, observations: Observations, settings: ResidualSettings) -> tuple[tuple[str, float], ...]:
    """The satellites whose signals miss the place that most others show by more than any echo, and by how much, metres.

    That is what a wrong orbit or clock does: of all its signals alike, however many they are.
    """
    own = [s for s in records.sets if s.receiver == observations.receiver]
    if records.navigation is None or len(own) != 1:
        return ()
    (chosen,) = own
    mean, measurements, usable = window_measurements(
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
        misfit_m, _, _ = misfits(measurements, np.array([row]), np.append(chosen.position_ecef_m, clock_m))
        by_sat.setdefault(signal.sat, []).append(float(misfit_m[0]))
    alike = {sat: float(np.median(m)) for sat, m in by_sat.items() if np.ptp(m) <= _ALIKE_M}
    return tuple(sorted((sat, m) for sat, m in alike.items() if abs(m) > _NO_ECHO_M))


def _orbits(far: Sequence[tuple[str, float]]) -> str:
    sats = ", ".join(sat for sat, _ in far[:_MOST_NAMED]) + (" and others" if len(far) > _MOST_NAMED else "")
    least_m = min(abs(m) for _, m in far)
    return f"; {sats} miss that of the others by {least_m / 1e3:.0f} km or more, as with a wrong orbit or clock"


def _blame(plain: PlainFix, doubled: int) -> str:
    """What may be wrong where measurements do not fit: of one signal only if nothing speaks for more."""
    if doubled:
        have = "has" if doubled == 1 else "have"
        return f", and {doubled} of them {have} more than one signal: true and false ones may be mixed"
    if plain.excluded is not None:
        return f"; without {plain.excluded} they do: a fault of it, unless the others are false"
    return ", and no single one is to blame: several faults, or true and false signals mixed"


def _doubled(observations: Observations) -> int:
    """How many satellites have more than one signal of a transmission with a pseudorange in the window."""
    measured = np.flatnonzero(np.isfinite(observations.pseudorange_m).any(axis=0))
    sent = Counter(observations.signals[column].transmission for column in measured)
    return len({sat for (sat, *_), count in sent.items() if count > 1})
