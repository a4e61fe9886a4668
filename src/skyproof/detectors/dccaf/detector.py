"""Two skies in signals that overlap: the detector over `bursts` and `inverse_raim`.

Each satellite's correlation over a burst of intervals is taken apart into one or two signals, as many as its count test
says. A reflection is later and weaker. So a second signal that no reflection explains - before the stronger one, or as
strong - is counted: how many satellites have one is binomial if that happens to each by itself, by a direct way that is
blocked, a mirror that takes nothing, or several reflections that look like one such signal. Where five have one, what
the best consistent set leaves over of these is searched for a second sky, of five satellites at least; that its ranges
agree is evidence of its own, for reflections do not. A sky of later and weaker signals is no attack here: a mirror's
image fits a position too.

The correlation does not show which sky is true. An inertial unit that has navigated alone since before the attack does,
by `navigation.exclusion`: where its state is among the records, with its covariance, the signals of the satellites that
show both skies are named, or it is reported that they cannot be.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from skyproof.arrays import Integers, Reals
from skyproof.detectors.base import missing, undecided
from skyproof.detectors.dccaf.bursts import REFLECTED_DB
from skyproof.detectors.dccaf.delays import (
    CHIP_M,
    DccafSettings,
    Delays,
    bursts_of,
    delays_of,
    last_burst,
    second_signals,
)
from skyproof.detectors.dccaf.inverse_raim import passing_sets, second_subset, set_states
from skyproof.detectors.dccaf.two_skies import TwoSkies, two_skies
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.chance import chance_p_value, set_combinations
from skyproof.navigation.exclusion import choose_fix, wrong_choice_rule
from skyproof.navigation.least_squares import gauss_newton, line_of_sight
from skyproof.navigation.nav_state import covered, state_at
from skyproof.navigation.ranges import atmosphere, corrected_ranges
from skyproof.records import (
    Asked,
    Ccaf,
    CcafAsked,
    ConsistentSet,
    Evidence,
    NavigationData,
    Need,
    OverlappingSkies,
    Records,
    Says,
    SignalRef,
)
from skyproof.statistics.distributions import binomial_survival, chi_square_survival, chi_square_threshold

__all__ = ["GRIDS", "SIGNAL_LEVEL", "Dccaf"]

SIGNAL_LEVEL = 1e-4
"""By chance a satellite counts as one with a second signal that no reflection explains so often."""
GRIDS = CcafAsked(reach_chips=1.5, every_s=2.0, soon_s=1.0)
"""What it is made for, and counted with. A window needs one burst in which all channels are there: of five, or of ten
where fading signals lose some."""
OF_A_SKY = 5
"""So many satellites make a sky: ranges of four fit any position."""


class _Sky(NamedTuple):
    """Satellites of one epoch around a fix: unit vectors in ECEF (n, 3) to them, misfits (n, 2) of their signals,
    sigmas (n,), channels (n,), and the fix: place (3,) and clock."""

    unit: Reals
    misfit_m: Reals
    sigma_m: Reals
    rows: Any
    place_ecef_m: Reals
    clock_m: float


class _Fixes(NamedTuple):
    """Place and clock (2, 4) from `_Sky.place_ecef_m`, their covariances (2, 4, 4), and for each satellite the signals
    (n, 2) that make them; -1 where a satellite is not in the second."""

    state_m: Reals
    covariance_m2: Reals
    signal: Any


class Dccaf:
    """The detector: of each receiver and window an Evidence of the last burst in which most channels are there.

    An attack is reported of the receiver as a whole. With `nav_state`, a `NavState` with covariance of a unit
    that has had no fix since before the attack, there is more evidence, on the signals nearest to the references, which
    are those that the receiver follows. p-values are upper bounds.
    """

    name = "dccaf"
    needs = (Need.CCAF, Need.NAVIGATION)
    asks = Asked(ccaf=GRIDS)

    def __init__(self, settings: DccafSettings | None = None) -> None:
        self.settings = settings or DccafSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Evidence], Any]:
        """Evidence of one window; `ccaf` is a sequence of `Ccaf`."""
        lacking = missing(self, records)
        if lacking or records.navigation is None:
            return lacking, state
        said = [self._receiver(records, records.navigation, ccaf) for ccaf in records.ccaf]
        return [evidence for each in said for evidence in each], state

    def _receiver(self, records: Records, navigation: NavigationData, ccaf: Ccaf) -> list[Evidence]:
        every = tuple(SignalRef(ccaf.receiver, signal) for signal in sorted(ccaf.signals))
        epochs = last_burst(ccaf)
        bursts = [(int(run[-1]), delays_of(ccaf, run, self.settings)) for run in bursts_of(ccaf)] if epochs.size else []
        found = next((own for epoch, own in bursts if epoch == epochs[-1]), None)
        first = _first_of_each(ccaf, found)
        if found is None or first.size < OF_A_SKY:
            return [
                undecided(
                    self,
                    records,
                    every,
                    because="fewer than five satellites with a correlation grid and a time of week",
                    would_need="correlation grids of five or more satellites with their times of week",
                )
            ]
        unlike = first[found.unlike_p_value[first] < SIGNAL_LEVEL]
        chance = self.settings.no_reflection_probability + SIGNAL_LEVEL
        p_count = float(binomial_survival(unlike.size, first.size, chance))
        others = [own for _, own in bursts if own is not found]
        doubles = int(second_signals(found, others, self.settings)[first].sum())
        words = (
            f"of {first.size} satellites in {ccaf.receiver}, {unlike.size} have a second signal within a chip that no "
            f"reflection explains: before the stronger one, or not {REFLECTED_DB:g} dB weaker"
        )
        skies = self._overlapping(navigation, ccaf, bursts) if doubles >= OF_A_SKY else ()
        if unlike.size < OF_A_SKY:
            return [self._of_receiver(records, every, p_count, words, doubles, skies)]
        epoch = int(epochs[-1])
        sky = self._sky(navigation, ccaf, epoch, found, first)
        fixes, p_sky, beside = (None, 1.0, "") if sky is None else self._second_sky(sky, unlike)
        both = p_count * p_sky
        p_value = min(1.0, 2.0 * min(p_count, both * (1.0 - np.log(both))))
        chosen: list[Evidence] = []
        if p_value < self._alpha and sky is not None and fixes is not None:
            chosen = self._chosen(records, ccaf, epoch, found, sky, fixes)
        return [self._of_receiver(records, every, p_value, words + beside, doubles, skies), *chosen]

    def _overlapping(
        self, navigation: NavigationData, ccaf: Ccaf, bursts: Sequence[tuple[int, Delays]]
    ) -> tuple[OverlappingSkies, ...]:
        """The two skies of each burst that shows them, reflections or not: the true one may be later and weaker."""
        shown: list[OverlappingSkies] = []
        for epoch, found in bursts:
            first = _first_of_each(ccaf, found)
            sky = self._sky(navigation, ccaf, epoch, found, first[found.apart[first]])
            two = None
            if sky is not None:
                two = two_skies(
                    sky.unit,
                    sky.misfit_m,
                    sky.sigma_m,
                    window_m=2.0 * self.settings.window_chips * CHIP_M,
                    set_probability=self.settings.set_probability,
                    most_doubt=self.settings.wrong_choice_probability,
                )
            if sky is not None and two is not None:
                reflected = _reflected(sky, two, found.weaker_db[sky.rows], self.settings.no_reflection_probability)
                shown.append(OverlappingSkies(sets=_sets(ccaf, epoch, sky, two), doubt=two.doubt, reflected=reflected))
        return tuple(shown)

    def _second_sky(self, sky: _Sky, unlike: Integers) -> tuple[_Fixes | None, float, str]:
        """Both skies, the second one of the channels `unlike`; the chance that its ranges agree without one; words."""
        probability = self.settings.set_probability
        best = passing_sets(sky.unit, sky.misfit_m, sky.sigma_m, false_alarm_probability=probability)
        if not best.statistic.size:
            return None, 1.0, "; no choice of one signal per satellite fits one position"
        misfit_m = sky.misfit_m.copy()
        like = np.flatnonzero(~np.isin(sky.rows, unlike))
        misfit_m[like, 1 - best.choice[0][like]] = np.nan
        second = second_subset(sky.unit, misfit_m, sky.sigma_m, best.choice[0], false_alarm_probability=probability)
        if second is None:
            return None, 1.0, ""
        rows, _ = second
        p_value = float(
            chance_p_value(
                sky.sigma_m[rows],
                window_m=2.0 * self.settings.window_chips * CHIP_M,
                largest_statistic=chi_square_threshold(probability, len(rows) - 4),
                combinations=set_combinations(np.isfinite(misfit_m).sum(axis=1) - 1, len(rows)),
            )
        )
        fixes = _fixes(sky, best.choice[0], rows)
        apart = fixes.state_m[1] - fixes.state_m[0]
        return (
            fixes,
            p_value,
            f"; signals of {len(rows)} fit a second position, {np.linalg.norm(apart[:3]):.0f} m away, and a time "
            f"{apart[3]:.0f} m off",
        )

    @property
    def _alpha(self) -> float:
        return self.settings.false_alarm_probability

    def _of_receiver(
        self,
        records: Records,
        every: tuple[SignalRef, ...],
        p_value: float,
        because: str,
        doubles: int,
        skies: tuple[OverlappingSkies, ...],
    ) -> Evidence:
        attack = p_value < self._alpha
        sky = doubles >= OF_A_SKY  # a reflection here and there is under most skies
        if not attack and doubles:
            because += f"; {doubles} have a second signal of any kind"
        return Evidence(
            detector=self.name,
            start_gpst=records.start_gpst,
            end_gpst=records.end_gpst,
            subject=every,
            says="attack" if attack else "undecided" if sky else "clean",
            because=because,
            p_value=p_value,
            false_alarm_probability=self._alpha,
            would_need="second signals of more satellites, or farther apart" if sky and not attack else None,
            overlapping=skies,
        )

    def _chosen(
        self, records: Records, ccaf: Ccaf, epoch: int, found: Delays, sky: _Sky, fixes: _Fixes
    ) -> list[Evidence]:
        """Which of two skies is true, by the inertial unit; nothing where there is none.

        The p-value is that of the other sky's fix by its chi-square test: uniform if that were the true one.
        """
        inertial = _inertial_place(records, ccaf.gpst[epoch])
        if inertial is None:
            return []
        place_m, place_m2 = inertial[0] - sky.place_ecef_m, inertial[1]
        choice = choose_fix(
            place_m,
            place_m2,
            fixes.state_m[:, :3],
            fixes.covariance_m2[:, :3, :3],
            false_alarm_probability=self.settings.set_probability,
            wrong_probability=self.settings.wrong_choice_probability,
        )
        refs = [SignalRef(ccaf.receiver, ccaf.signals[row]) for row in sky.rows]
        both = fixes.signal[:, 1] >= 0
        true = int(choice.chosen)
        if true < 0:
            apart_m = fixes.state_m[1, :3] - fixes.state_m[0, :3]
            chance = float(wrong_choice_rule(apart_m, place_m2 + fixes.covariance_m2[:, :3, :3].mean(axis=0)))
            neither = bool(np.all(choice.p_value < self.settings.set_probability))
            return [
                undecided(
                    self,
                    records,
                    tuple(ref for ref, there in zip(refs, both, strict=True) if there),
                    because=f"neither of two positions in {ccaf.receiver} fits the inertial unit"
                    if neither
                    else f"the inertial unit cannot tell which of two positions in {ccaf.receiver} is true: "
                    f"the nearer one would be wrong with probability {chance:.2g}",
                    would_need="an inertial unit that drifts less, or a clean fix less than a minute before",
                )
            ]
        near, far = np.sqrt(choice.distance2[[true, 1 - true]])
        followed = np.argmin(np.where(np.isnan(found.delay_chips), np.inf, np.abs(found.delay_chips)), axis=1)[sky.rows]
        kinds: tuple[tuple[Says, str, int], ...] = (("authentic", "show", true), ("spoofed", "do not show", 1 - true))
        said = []
        for says, verb, sky_number in kinds:
            mine = both & (fixes.signal[:, sky_number] == followed)
            if mine.any():
                said.append(
                    Evidence(
                        detector=self.name,
                        start_gpst=records.start_gpst,
                        end_gpst=records.end_gpst,
                        subject=tuple(ref for ref, named in zip(refs, mine, strict=True) if named),
                        says=says,
                        because=f"the inertial unit is {near:.1f} sigma from the position that these signals {verb}, "
                        f"and {far:.1f} from the other",
                        statistic=float(choice.distance2[1 - true]),
                        threshold=float(chi_square_threshold(self.settings.set_probability, 3)),
                        p_value=float(choice.p_value[1 - true]),
                        false_alarm_probability=self.settings.set_probability,
                    )
                )
        return said

    def _sky(self, navigation: NavigationData, ccaf: Ccaf, epoch: int, found: Delays, first: Integers) -> _Sky | None:
        """Around the fix of the strongest signals of the channels `first`; None with fewer than five satellites."""
        gpst = ccaf.gpst[epoch]
        measured_m = ccaf.reference_m[epoch][:, None] + found.delay_chips * CHIP_M
        ranges = corrected_ranges(ccaf.signals, np.array([gpst]), measured_m[None, :, 0], navigation)
        rows = first[np.isfinite(ranges.range_m[0, first])]
        rows = rows[np.argsort([ccaf.signals[row].sat for row in rows], kind="stable")]
        if rows.size < OF_A_SKY:
            return None
        satellite, range_m = ranges.satellite_ecef_m[0, rows], ranges.range_m[0, rows]
        sigma_m = np.hypot(CHIP_M * np.nanmax(found.sigma_chips[rows], axis=1), self.settings.multipath_sigma_m)
        tow_s = np.asarray(week_and_tow(gpst)[1])
        state_m = gauss_newton(satellite, range_m, sigma_m, np.zeros(4), tolerance_m=10.0).state_m
        for _ in range(2):
            turned, _, _ = line_of_sight(satellite, state_m[:3])
            delays = atmosphere(
                state_m[:3], turned, tow_s, navigation.ionosphere, ionosphere_share=self.settings.ionosphere_share
            )
            total_m = np.hypot(sigma_m, delays.sigma_m)
            state_m = gauss_newton(satellite, range_m - delays.delay_m, total_m, state_m).state_m
        if not np.all(np.isfinite(state_m)):
            return None
        _, unit, distance_m = line_of_sight(satellite, state_m[:3])
        first = range_m - delays.delay_m - distance_m - state_m[3]
        second = first + (measured_m[rows, 1] - measured_m[rows, 0])
        return _Sky(unit, np.stack((first, second), axis=1), total_m, rows, state_m[:3], float(state_m[3]))


def _first_of_each(ccaf: Ccaf, found: Delays | None) -> Integers:
    """Rows of the channels that were taken apart, one per satellite: that of its signal that was found first."""
    if found is None:
        return np.empty(0, np.int64)
    rows: dict[str, int] = {}
    for row in np.flatnonzero(np.isfinite(found.p_value)):
        signal = ccaf.signals[row]
        if signal.sat not in rows or signal.copy < ccaf.signals[rows[signal.sat]].copy:
            rows[signal.sat] = int(row)
    return np.array(sorted(rows.values()), np.int64)


def _reflected(sky: _Sky, two: TwoSkies, weaker_db: Reals, chance: float) -> tuple[float, ...]:
    """Of each sky, how probably it made the other one by reflections, or was made by those of the other one.

    How many signals of a sky are before the other one's, or not weak enough, is binomial if they are its reflections;
    `chance` : that one is. A mirror's image fits a position; but where the receiver is expected only those of several
    walls are, which fit by chance.
    """
    n = len(two.choice)
    late_m = sky.misfit_m[:, 1] - sky.misfit_m[:, 0]
    unlike = np.stack((np.ones(n, np.bool_), (late_m < 0.0) | (weaker_db < REFLECTED_DB)), axis=1)
    counts = [int(unlike[np.arange(n), other].sum()) for other in (1 - two.choice, two.choice)]
    made = np.array([float(binomial_survival(count, n, chance)) for count in counts])
    fits = [
        float(chance_p_value(sky.sigma_m, window_m=np.abs(late_m).max(), largest_statistic=statistic))
        for statistic in two.statistic
    ]
    return tuple((made + made[::-1] * fits).tolist())


def _sets(ccaf: Ccaf, epoch: int, sky: _Sky, two: TwoSkies) -> tuple[ConsistentSet, ...]:
    """Both skies of an epoch as sets of the channels that they were found in."""
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


def _fixes(sky: _Sky, choice: Any, rows: Any) -> _Fixes:
    """Of the set `choice` (n,) and of what it leaves over of the satellites `rows`."""
    signal = np.stack((choice, np.full(len(choice), -1)), axis=1)
    signal[rows, 1] = 1 - choice[rows]
    one = set_states(sky.unit, sky.misfit_m, sky.sigma_m, choice[None, :])
    other = set_states(sky.unit[rows], sky.misfit_m[rows], sky.sigma_m[rows], signal[rows, 1][None, :])
    return _Fixes(np.concatenate((one[0], other[0])), np.stack((one[1], other[1])), signal)


def _inertial_place(records: Records, gpst: np.datetime64) -> tuple[Reals, Reals] | None:
    """Place (3,) and covariance (3, 3) in ECEF at a time within the navigator's own; None without them.

    A place that is only what the signals show (infinite variance) cannot choose between them.
    """
    path, at = records.nav_state, np.array([gpst])
    if path is None or path.covariance is None or not covered(path, at).all():
        return None
    here = state_at(path, at)
    if here.covariance is None or not np.isfinite(here.covariance[0, :3, :3]).all():
        return None
    return here.position_ecef_m[0], here.covariance[0, :3, :3]
