"""Detect two skies in signals that overlap, by `bursts` and `inverse_raim`.

Each satellite's correlation over a burst of intervals is decomposed into one or two signals, by a test of their number.
A reflection is later and weaker. A second signal before the stronger one, or as strong, is no simple reflection, and is
counted. A blocked direct path, a lossless mirror, or several reflections may still cause one. If they do so
independently, the number of satellites with one is binomial. If five have one, the signals outside the best consistent
set are searched for a second sky, of five satellites at least. Ranges that agree are independent evidence, for those of
reflections do not. A sky of later and weaker signals is no attack here: a mirror's image fits a position too.

The correlation does not show which sky is true: that is chosen where all skies of a receiver are held against what was
expected of it (`detectors.prediction.choice`), from the fixes handed on in `Finding.overlapping`.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from skyproof.arrays import Integers, Reals
from skyproof.detectors.base import NotTested, Reporter
from skyproof.detectors.dccaf.delays import (
    DccafSettings,
    Delays,
    estimate_delays,
    last_burst,
    select_second_signals,
    split_bursts,
)
from skyproof.detectors.dccaf.inverse_raim import find_passing_sets, find_second_subset, set_states
from skyproof.detectors.dccaf.policy import POLICY
from skyproof.detectors.dccaf.skies_fit import FittedSkies, fit_skies
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.chance import bound_chance_p_value, count_set_combinations
from skyproof.navigation.least_squares import compute_line_of_sight, fit_position
from skyproof.navigation.ranges import compute_atmosphere, correct_ranges
from skyproof.records import (
    Asked,
    Cause,
    Ccaf,
    CcafAsked,
    ConsistentSet,
    Datum,
    Finding,
    Hypothesis,
    NavigationData,
    Need,
    OverlappingSkies,
    Records,
    list_refs,
)
from skyproof.statistics.distributions import binomial_survival, chi_square_survival, chi_square_threshold

__all__ = ["GRIDS", "Dccaf"]

GRIDS = CcafAsked(reach_chips=1.5, every_s=2.0, soon_s=1.0)
"""What it is made for, and counted with. A window needs one burst in which all channels are there: of five, or of ten
where fading signals lose some."""


class _Sky(NamedTuple):
    """Satellites of one epoch around a fix: unit vectors in ECEF (n, 3) to them, misfits (n, 2) of their signals,
    sigmas (n,), of them what all intervals share (n,), channels (n,), chips (n,); the fix: place (3,) and clock."""

    unit: Reals
    misfit_m: Reals
    sigma_m: Reals
    systematic_m: Reals
    rows: Any
    chip_m: Reals
    place_ecef_m: Reals
    clock_m: float


class Dccaf:
    """The detector: of each receiver and window a finding of the last burst in which most channels are there.

    It is about the receiver as a whole. p-values are upper bounds, for a sky with reflections as for one without.
    """

    name = "dccaf"
    needs = (Need.CCAF, Need.NAVIGATION)
    asks = Asked(ccaf=GRIDS)

    def __init__(self, settings: DccafSettings | None = None) -> None:
        self.settings = settings or DccafSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.ONE_SKY)
        lacking = report.name_missing()
        if lacking or records.navigation is None:
            return lacking, state
        return [self._test_receiver(report, records.navigation, ccaf) for ccaf in records.ccaf], state

    def _test_receiver(self, report: Reporter, navigation: NavigationData, ccaf: Ccaf) -> Finding:
        """Count the second signals that no reflection explains, and search them for a second sky."""
        every = list_refs(ccaf.receiver, sorted(ccaf.signals))
        epochs = last_burst(ccaf)
        bursts = (
            [(int(run[-1]), estimate_delays(ccaf, run, self.settings)) for run in split_bursts(ccaf)]
            if epochs.size
            else []
        )
        found = next((delays for epoch, delays in bursts if epoch == epochs[-1]), None)
        first = _select_first(ccaf, found)
        if found is None or first.size < POLICY.sky_satellites:
            few: dict[str, Datum] = {
                "receiver": ccaf.receiver,
                "satellites": first.size,
                "needed": POLICY.sky_satellites,
            }
            return report.pass_over(every, NotTested("few_grids", few))
        unlike = first[found.unlike_p_value[first] < POLICY.signal_probability]
        chance = self.settings.no_reflection_probability + POLICY.signal_probability
        p_value = float(binomial_survival(unlike.size, first.size, chance))
        other_bursts = [delays for _, delays in bursts if delays is not found]
        doubles = int(select_second_signals(found, other_bursts, self.settings)[first].sum())
        data: dict[str, Datum] = {
            "satellites": first.size,
            "unlike": unlike.size,
            "doubles": doubles,
            "reflected_db": POLICY.reflected_weaker_db,
        }
        if unlike.size >= POLICY.sky_satellites:
            sky = self._compute_sky(navigation, ccaf, int(epochs[-1]), found, first)
            p_sky, of_sky = (1.0, {}) if sky is None else self._find_second_sky(sky, unlike)
            data |= of_sky
            product = p_value * p_sky
            p_value = min(1.0, 2.0 * min(p_value, product * (1.0 - float(np.log(product)))))
        skies = self._list_overlapping(navigation, ccaf, bursts)
        seen = (
            "as_reflections" if doubles >= POLICY.sky_satellites else "few_second_signals"
        )  # a few are under most skies
        return report.find(
            every,
            "unlike_reflections" if p_value < self.settings.false_alarm_probability else seen,
            {Cause.CLEAN: p_value, Cause.REFLECTIONS: p_value},
            data=data,
            estimates={"overlapping": skies} if skies else {},
        )

    def _list_overlapping(
        self, navigation: NavigationData, ccaf: Ccaf, bursts: Sequence[tuple[int, Delays]]
    ) -> tuple[OverlappingSkies, ...]:
        """List the two skies of each burst that shows them, even reflections: the true one may be the weaker."""
        skies: list[OverlappingSkies] = []
        for epoch, found in bursts:
            first = _select_first(ccaf, found)
            sky = self._compute_sky(navigation, ccaf, epoch, found, first)
            if sky is None:
                continue
            from_zero_chips = found.delay_chips[sky.rows, 0] - found.moved_chips[sky.rows]
            two = fit_skies(
                [found.decomposed[row] for row in sky.rows.tolist()],
                sky.unit,
                sky.misfit_m[:, 0] - from_zero_chips * sky.chip_m,
                sky.systematic_m,
                sky.chip_m,
                window_chips=self.settings.window_chips,
                set_probability=self.settings.set_probability,
                most_doubt=self.settings.wrong_choice_probability,
            )
            if two is not None:
                reflected = _reflection_probabilities(two, self.settings.no_reflection_probability)
                skies.append(
                    OverlappingSkies(sets=_build_sets(ccaf, epoch, sky, two), doubt=two.doubt, reflected=reflected)
                )
        return tuple(skies)

    def _find_second_sky(self, sky: _Sky, unlike: Integers) -> tuple[float, dict[str, Datum]]:
        """Return the chance that ranges of the channels `unlike` agree without a second sky, and what that sky is."""
        probability = self.settings.set_probability
        best = find_passing_sets(sky.unit, sky.misfit_m, sky.sigma_m, false_alarm_probability=probability)
        if not best.statistic.size:
            return 1.0, {"without_position": True}
        misfit_m = sky.misfit_m.copy()
        like = np.flatnonzero(~np.isin(sky.rows, unlike))
        misfit_m[like, 1 - best.choice[0][like]] = np.nan
        second = find_second_subset(
            sky.unit, misfit_m, sky.sigma_m, best.choice[0], false_alarm_probability=probability
        )
        if second is None:
            return 1.0, {}
        rows, _ = second
        p_value = float(
            bound_chance_p_value(
                sky.sigma_m[rows],
                window_m=2.0 * self.settings.window_chips * float(sky.chip_m.max()),
                largest_statistic=chi_square_threshold(probability, len(rows) - 4),
                combinations=count_set_combinations(np.isfinite(misfit_m).sum(axis=1) - 1, len(rows)),
            )
        )
        left_over = 1 - best.choice[0][rows]
        first, _ = set_states(sky.unit, sky.misfit_m, sky.sigma_m, best.choice[0][None, :])
        other, _ = set_states(sky.unit[rows], sky.misfit_m[rows], sky.sigma_m[rows], left_over[None, :])
        apart = other[0] - first[0]
        return p_value, {
            "sky_satellites": len(rows),
            "apart_m": float(np.linalg.norm(apart[:3])),
            "time_apart_m": float(apart[3]),
        }

    def _compute_sky(
        self, navigation: NavigationData, ccaf: Ccaf, epoch: int, found: Delays, first: Integers
    ) -> _Sky | None:
        """Compute the sky around the fix of the strongest signals of the channels `first`.

        None with fewer than five satellites.
        """
        gpst = ccaf.gpst[epoch]
        chip_m = np.array([signal.plan.chip_m for signal in ccaf.signals])
        measured_m = ccaf.reference_m[epoch][:, None] + found.delay_chips * chip_m[:, None]
        ranges = correct_ranges(ccaf.signals, np.array([gpst]), measured_m[None, :, 0], navigation)
        rows = first[np.isfinite(ranges.range_m[0, first])]
        rows = rows[np.argsort([ccaf.signals[row].sat for row in rows], kind="stable")]
        if rows.size < POLICY.sky_satellites:
            return None
        satellite, range_m = ranges.satellite_ecef_m[0, rows], ranges.range_m[0, rows]
        sigma_m = np.hypot(chip_m[rows] * np.nanmax(found.sigma_chips[rows], axis=1), self.settings.multipath_sigma_m)
        tow_s = np.asarray(week_and_tow(gpst)[1])
        state_m = fit_position(satellite, range_m, sigma_m, np.zeros(4), tolerance_m=10.0).state_m
        for _ in range(2):
            turned, _, _ = compute_line_of_sight(satellite, state_m[:3])
            delays = compute_atmosphere(
                state_m[:3], turned, tow_s, navigation.ionosphere, ionosphere_share=self.settings.ionosphere_share
            )
            total_m = np.hypot(sigma_m, delays.sigma_m)
            state_m = fit_position(satellite, range_m - delays.delay_m, total_m, state_m).state_m
        if not np.all(np.isfinite(state_m)):
            return None
        _, unit, distance_m = compute_line_of_sight(satellite, state_m[:3])
        first = range_m - delays.delay_m - distance_m - state_m[3]
        second = first + (measured_m[rows, 1] - measured_m[rows, 0])
        return _Sky(
            unit,
            np.stack((first, second), axis=1),
            total_m,
            np.hypot(self.settings.multipath_sigma_m, delays.sigma_m),
            rows,
            chip_m[rows],
            state_m[:3],
            float(state_m[3]),
        )


def _select_first(ccaf: Ccaf, found: Delays | None) -> Integers:
    """Select the rows of channels that were decomposed, one per satellite: that of the signal found first."""
    if found is None:
        return np.empty(0, np.int64)
    rows: dict[str, int] = {}
    for row in np.flatnonzero(np.isfinite(found.p_value)):
        signal = ccaf.signals[row]
        if signal.sat not in rows or signal.copy < ccaf.signals[rows[signal.sat]].copy:
            rows[signal.sat] = int(row)
    return np.array(sorted(rows.values()), np.int64)


def _reflection_probabilities(two: FittedSkies, chance: float) -> tuple[float, ...]:
    """Compute how probably reflections explain each sky: as reflections of the other one, or the other way round.

    How many signals of a sky are before the other one's, or not weak enough, is binomial if they are its reflections;
    `chance` : that one is. Satellites whose signals nearly coincide show neither. A mirror's image fits a position; but
    where the receiver is expected only those of several walls are, which fit by chance.
    """
    n = int(two.apart.sum())
    if n < POLICY.sky_satellites:
        return 1.0, 1.0
    late_m, weaker_db, sigma_m = two.late_m[two.apart], two.weaker_db[two.apart], two.sigma_m[two.apart]
    second = int(((late_m < 0.0) | (weaker_db < POLICY.reflected_weaker_db)).sum())
    first = int(((late_m > 0.0) | (weaker_db > -POLICY.reflected_weaker_db)).sum())
    made = np.array([float(binomial_survival(count, n, chance)) for count in (second, first)])
    fits = [
        float(bound_chance_p_value(sigma_m[:, k], window_m=np.abs(late_m).max(), largest_statistic=statistic))
        for k, statistic in enumerate(two.statistic)
    ]
    return tuple((made + made[::-1] * fits).tolist())


def _build_sets(ccaf: Ccaf, epoch: int, sky: _Sky, two: FittedSkies) -> tuple[ConsistentSet, ...]:
    """Build consistent sets of both skies of an epoch, of the channels that they were found in."""
    signals = tuple(sorted(ccaf.signals[row] for row in sky.rows))
    return tuple(
        ConsistentSet(
            receiver=ccaf.receiver,
            signals=signals,
            gpst=ccaf.gpst[epoch],
            position_ecef_m=sky.place_ecef_m + state_m[:3],
            clock_bias_s=float(sky.clock_m + state_m[3]) / SPEED_OF_LIGHT_M_S,
            covariance_m2=covariance_m2,
            statistic=float(statistic),
            dof=two.dof,
            p_value=float(chi_square_survival(statistic, two.dof)),
        )
        for state_m, covariance_m2, statistic in zip(two.state_m, two.covariance_m2, two.statistic, strict=True)
    )
