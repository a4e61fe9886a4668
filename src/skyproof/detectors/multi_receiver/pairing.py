"""Hold one candidate group: a consistent set from each receiver, and the p-values of what it could be.

A group holds one kind of signal (time scale, band, code), as an attacker may imitate one kind alone: the others are no
evidence for it. If no kind is received from enough satellites, all kinds are one group.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from skyproof.arrays import Booleans, Reals
from skyproof.detectors.multi_receiver.along_baselines import span_test
from skyproof.detectors.multi_receiver.carriers import (
    CarrierTest,
    Fractions,
    estimate_fractions,
    evaluate_one_antenna_carriers,
    sky_carriers,
)
from skyproof.detectors.multi_receiver.common_epochs import CommonRanges, align_ranges, count_common_kinds
from skyproof.detectors.multi_receiver.known_geometry import Fit, geometry_survival
from skyproof.detectors.multi_receiver.one_antenna import (
    ContrastLevels,
    MeanTest,
    TableContrasts,
    TrackNoise,
    average_contrasts,
    average_stretches,
    baseline_design,
    compute_contrasts,
    distance_p_value,
    estimate_baselines,
    mix_sigmas,
    one_antenna_test,
    ratio_test,
)
from skyproof.detectors.multi_receiver.policy import POLICY
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.orbits import compute_satellite_positions_m
from skyproof.gnss.sky import compute_unit_vectors, rotate_to_reception
from skyproof.gnss.time import seconds_between, timedelta_from_s
from skyproof.navigation.search import compute_misfits
from skyproof.navigation.sets import measure_window
from skyproof.records import Baseline, ConsistentSet, Kind, NavigationData, Observations, Records, SignalRef
from skyproof.statistics.autoregression import correlation_grid
from skyproof.statistics.distributions import chi_square_survival
from skyproof.statistics.lines import fit_line, line_columns

__all__ = ["Comparison", "Pairing", "compare_pairings", "evaluate_sky_by_carriers", "list_groups", "pair_up"]

_TRAVEL_S = 0.075  # to 10 ms: 40 m along the orbit, 2 microradians
_THINNER = 2.9e-4
"""By which the delay of a zenith's signal falls for each metre upwards: n - 1 of air at the ground."""


@dataclass(frozen=True, eq=False)
class Pairing:
    """Sets, one per receiver, whose common transmissions are looked at together. observed : of the first receiver."""

    sets: tuple[ConsistentSet, ...]
    observed: Observations
    ranges: CommonRanges
    noise: TrackNoise
    navigation: NavigationData | None
    start_gpst: np.datetime64
    end_gpst: np.datetime64

    @property
    def receivers(self) -> tuple[str, ...]:
        return tuple(chosen.receiver for chosen in self.sets)

    @cached_property
    def kinds(self) -> frozenset[Kind]:
        """Return the kinds of signals, as the first receiver names them."""
        return frozenset(signal.kind for signal in self.ranges.signals)

    @property
    def takes(self) -> set[tuple[int, Kind]]:
        """Return the signals that this pairing uses, by set and kind."""
        return {(id(chosen), kind) for chosen in self.sets for kind in self.kinds}

    @cached_property
    def subject(self) -> tuple[SignalRef, ...]:
        """Return the signals of the transmissions that all receivers have, receiver by receiver."""
        pairs = zip(self.receivers, self.ranges.tracks, strict=True)
        return tuple(SignalRef(receiver, signal) for receiver, tracks in pairs for signal in sorted(tracks))

    @cached_property
    def one_antenna(self) -> MeanTest:
        """Test of "all from one antenna"; along baselines, where the orbits are known."""
        return one_antenna_test(self._levels[0], along=self._design)

    @cached_property
    def _design(self) -> Reals | None:
        """Return the effect of baselines on the contrasts.

        None without orbits, or if the contrasts hold nothing else.
        """
        matrix = self._levels[1]
        if self.unit_enu is None or matrix.shape[1] <= 3 * (len(self.sets) - 1):
            return None
        return baseline_design(matrix, self.unit_enu)

    @cached_property
    def one_antenna_each_p_value(self) -> float:
        """Return the p-value of "the signals of some kind all come from one antenna": the largest of all kinds.

        It is 1 if a kind has one satellite only, which shows nothing.
        """
        kinds = self.ranges.kinds
        if kinds.max(initial=0) == 0:
            return float(self.one_antenna.p_value)
        p_values = []
        for kind in range(int(kinds.max()) + 1):
            rows = np.flatnonzero(kinds == kind)
            of_kind = replace(self, ranges=self.ranges.take(rows)) if rows.size > 1 else None
            p_values.append(1.0 if of_kind is None else float(of_kind.one_antenna.p_value))
        return max(p_values)

    def threshold(self, false_alarm_probability: float) -> float:
        """Return the value that `one_antenna.statistic` has to exceed."""
        levels, matrix = self._levels
        degrees = matrix.shape[1] if self._design is None else self._design.shape[1]
        return float(levels.threshold(false_alarm_probability, degrees, self.one_antenna.decides))

    @cached_property
    def scatter_m(self) -> float:
        """Return how much the range differences between receivers vary from satellite to satellite, rms."""
        return float(np.sqrt(np.mean(self.ranges.apart_m**2)))

    @cached_property
    def noise_m(self) -> float:
        """Return the rms of a track about a line over the window, metres: a signal dragged off shows it as well."""
        rms_of_sigma = float(np.sqrt(np.mean(fit_line(self.contrasts[0]).residual ** 2)))
        return rms_of_sigma * float(np.sqrt(np.mean(self.ranges.sigma_m**2)))

    @cached_property
    def swing_p_value(self) -> float:
        """Return the p-value of "errors within their bound": that AR(1) errors so large, however slow, swing so.

        Sums of squares with weights lie above a limit no more often than with all weights as large as the largest, and
        the same mean (Szekely and Bakirov, Probability Theory and Related Fields 126, 2003).
        """
        bound_m = self.noise.bound_m
        n, tracks = self.contrasts[0].shape[-2:]
        if not np.isfinite(bound_m):
            return 1.0
        line, apart = line_columns(n), np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
        rest, worst = np.eye(n) - line @ line.T, 0.0
        for coefficient in correlation_grid(self.noise.correlation_max):
            weights = np.linalg.eigvalsh(rest @ coefficient**apart @ rest)
            sum_of_squares = n * tracks * (self.noise_m / bound_m) ** 2
            dof = tracks * weights.sum() / weights[-1]
            worst = max(worst, float(chi_square_survival(sum_of_squares / weights[-1], dof)))
        return worst

    @cached_property
    def unit_enu(self) -> Reals | None:
        """Return by how much a step of the antenna shortens the ranges (K, 3).

        None without all orbits, or if the satellites are so few that some step changes nothing, however many signals
        they have.

        Directions hold at the first set's position in the middle of the epochs: half a second off they are wrong by 0.1
        mrad, 10 mm at 100 m. Upwards the change of the air's delay is included.
        """
        time_s = self.ranges.time_s
        if self.navigation is None or time_s.size == 0:
            return None
        place, when = self.sets[0].position_ecef_m, self.start_gpst + timedelta_from_s(time_s.mean())
        orbits = [self.navigation.best(sat, when) for sat in self.ranges.sats]
        known = [orbit for orbit in orbits if orbit is not None]
        if len(known) < len(orbits):
            return None
        lat_rad, lon_rad, _ = geodetic_from_ecef(place)
        sat_ecef_m = compute_satellite_positions_m(known, when - timedelta_from_s(_TRAVEL_S))
        units = compute_unit_vectors(place, rotate_to_reception(sat_ecef_m, _TRAVEL_S))
        unit_enu = np.asarray(units @ rot_enu_ecef(lat_rad, lon_rad).T)
        unit_enu[:, 2] += _THINNER / np.maximum(unit_enu[:, 2], POLICY.least_elevation_sine)
        _, _, matrix = compute_contrasts(self.ranges.range_m[..., :2], self.ranges.sigma_m[:, :2], self.ranges.kinds)
        return unit_enu if np.linalg.matrix_rank(baseline_design(matrix, unit_enu)) == unit_enu.shape[1] else None

    @cached_property
    def near_place_m(self) -> Reals | None:
        """Return the mean ranges (K, R) less those expected at the first set's position; None without all orbits."""
        if self.navigation is None or self.unit_enu is None:
            return None
        first, place_m = self.ranges.signals, self.sets[0].position_ecef_m
        mean, measured, usable = measure_window(
            self.observed, self.navigation, multipath_sigma_m=self.noise.multipath_sigma_m, ionosphere_share=0.0
        )
        rows = np.array([mean.signals.index(signal) for signal in first if signal in mean.signals], np.intp)
        if rows.size < len(first) or not usable[rows].all():
            return None
        state_m = np.append(place_m, SPEED_OF_LIGHT_M_S * self.sets[0].clock_of_s(first[0].kind))
        misfit_m, _, _ = compute_misfits(measured, rows, state_m)
        return misfit_m[:, None] + self.ranges.mean_m - self.ranges.mean_m[:, :1]

    @cached_property
    def distances_m(self) -> tuple[float, ...] | None:
        """Return the horizontal distance of each receiver from the first by these signals; None without orbits."""
        if self.unit_enu is None:
            return None
        found = []
        for other in range(1, len(self.sets)):
            levels, matrix = self._levels_of([0, other])
            baseline = estimate_baselines(levels, baseline_design(matrix, self.unit_enu))
            found.append(float(np.hypot(*baseline.enu_m[0, :2])))
        return tuple(found)

    def at_least_p_value(self, distance_m: float) -> float:
        """Test "the sky, with all antennas at least so far from the first one"; 1 without orbits."""
        return self._distance_p_value(distance_m, at_least=True)

    def at_most_p_value(self, distance_m: float) -> float:
        """Test "the sky, with all antennas at most so far from the first one"; 1 without orbits."""
        return self._distance_p_value(distance_m, at_least=False)

    def _distance_p_value(self, distance_m: float, *, at_least: bool) -> float:
        if self.unit_enu is None:
            return 1.0
        p_values = []
        for other in range(1, len(self.sets)):
            levels, matrix = self._levels_of([0, other])
            baseline = estimate_baselines(levels, baseline_design(matrix, self.unit_enu))
            p_values.append(
                float(distance_p_value(levels, baseline, distance_m, "at least" if at_least else "at most"))
            )
        return min(1.0, len(p_values) * min(p_values))

    def survival(self, geometry: Fit) -> float:
        """Return the p-value of "the sky over antennas that stand so", never too small; 1 without orbits."""
        if self.unit_enu is None:
            return 1.0
        levels, matrix = self._levels
        estimate = estimate_baselines(levels, baseline_design(matrix, self.unit_enu))
        return float(levels.worst(geometry_survival(geometry, self.receivers, estimate, levels.dof))[0])

    @property
    def widest_baseline(self) -> Baseline | None:
        """Return the baseline over the window under the largest noise that is considered; None without orbits."""
        if self.unit_enu is None:
            return None
        levels, matrix = self._levels
        estimate = estimate_baselines(levels, baseline_design(matrix, self.unit_enu))
        spread_m2 = np.trace(estimate.covariance_m2, axis1=-2, axis2=-1)
        widest = int(np.argmax(np.where(levels.plausible, spread_m2, 0.0)))
        return Baseline(
            receivers=self.receivers,
            start_gpst=self.start_gpst,
            end_gpst=self.end_gpst,
            enu_m=estimate.enu_m[widest].reshape(-1, 3),
            covariance_m2=estimate.covariance_m2[widest],
        )

    @cached_property
    def fractions(self) -> tuple[Fractions, ...]:
        """Return the fractions of carriers of each receiver against the first one.

        Empty if some cannot be compared, or with several kinds of signals.
        """
        phases = self.ranges.phases
        if phases is None or self.unit_enu is None or self.ranges.kinds.max(initial=0) > 0:
            return ()
        found = [estimate_fractions(phases, k, self.noise.carrier_multipath_sigma_m) for k in range(1, len(self.sets))]
        known = tuple(receiver_fractions for receiver_fractions in found if receiver_fractions is not None)
        return known if len(known) == len(found) else ()

    @cached_property
    def one_antenna_carriers(self) -> CarrierTest | None:
        """Test of "all from one antenna" by carriers, of the receiver that fits it best."""
        return max(map(evaluate_one_antenna_carriers, self.fractions), key=lambda test: test.p_value, default=None)

    @cached_property
    def baselines(self) -> tuple[Baseline, ...]:
        """Return the antennas' baselines by these signals, over the window and over parts; empty without orbits."""
        if self.unit_enu is None:
            return ()
        values, gain, matrix = self.contrasts
        length_s = float(seconds_between(self.end_gpst, self.start_gpst))
        parts = max(1, min(len(values) // POLICY.part_epochs, round(length_s / POLICY.part_s)))
        edges = np.linspace(0, len(values), parts + 1).astype(int)
        stretches = [(0, len(values)), *pairwise(edges)][: None if parts > 1 else 1]
        design = baseline_design(matrix, self.unit_enu)
        found = []
        for (first, end), mean in zip(
            stretches, average_stretches(values, gain, self.noise.multipath_sigma_m, stretches), strict=True
        ):
            estimate = estimate_baselines(mean, design)
            found.append(
                Baseline(
                    receivers=self.receivers,
                    start_gpst=self._instant(first / len(values)),
                    end_gpst=self._instant(end / len(values)),
                    enu_m=estimate.enu_m.reshape(-1, 3),
                    covariance_m2=estimate.covariance_m2,
                )
            )
        return tuple(found)

    def _instant(self, share: float) -> np.datetime64:
        length_ns = int((self.end_gpst - self.start_gpst) / np.timedelta64(1, "ns"))
        instant: np.datetime64 = self.start_gpst + np.timedelta64(round(share * length_ns), "ns")
        return instant

    @cached_property
    def contrasts(self) -> TableContrasts:
        """Return the contrasts of all receivers, over the window."""
        return compute_contrasts(self.ranges.range_m, self.ranges.sigma_m, self.ranges.kinds)

    @property
    def plausible(self) -> Booleans:
        """Select the coefficients of `statistics.autoregression.correlation_grid` that the noise may have."""
        levels, _ = self._levels
        return levels.plausible[:-1] if levels.bounded else levels.plausible

    @cached_property
    def _levels(self) -> tuple[ContrastLevels, Reals]:
        """Return the levels of all receivers; those of two of them are `_levels_of`."""
        values, gain, matrix = self.contrasts
        return average_contrasts(values, gain, self.noise, self.ranges.gaps), matrix

    def _levels_of(self, receivers: list[int]) -> tuple[ContrastLevels, Reals]:
        if len(receivers) == len(self.sets):
            return self._levels
        ranges = self.ranges
        values, gain, matrix = compute_contrasts(
            ranges.range_m[..., receivers], ranges.sigma_m[:, receivers], ranges.kinds
        )
        return average_contrasts(values, gain, self.noise, self.ranges.gaps), matrix


def list_groups(sets: tuple[ConsistentSet, ...], min_satellites: int) -> list[Kind | None]:
    """List the kinds that all sets have from enough satellites; [None], all kinds as one, if there are none.

    All kinds as one need as many transmissions beyond one per kind as a single kind does. Empty if they have fewer.
    """
    shared = count_common_kinds(sets)
    enough: list[Kind | None] = [kind for kind, count in shared.items() if count >= min_satellites]
    if not enough and sum(shared.values()) - len(shared) >= min_satellites - 1:
        return [None]
    return enough


def pair_up(
    records: Records,
    sets: tuple[ConsistentSet, ...],
    noise: TrackNoise,
    *,
    min_satellites: int,
    kind: Kind | None = None,
) -> Pairing:
    """Build the pairing of the common transmissions of `sets` at common instants, of one kind or of all."""
    ranges = align_ranges(records, sets, kind=kind, min_satellites=min_satellites)
    by_frequency = any(scale == "R" and band in ("G1", "G2") for scale, band, _ in {s.kind for s in ranges.signals})
    if by_frequency:
        noise = replace(
            noise, multipath_sigma_m=float(np.hypot(noise.multipath_sigma_m, POLICY.glonass_channel_sigma_m))
        )
    # Interference raises thermal noise beyond any bound of slow errors; the receivers state it by their C/N0.
    thermal_m = float(np.sqrt(np.mean(ranges.sigma_m**2))) if ranges.sigma_m.size else 0.0
    return Pairing(
        sets=sets,
        observed=next(o for o in records.observations if o.receiver == sets[0].receiver),
        ranges=ranges,
        noise=replace(noise, bound_m=float(np.hypot(noise.bound_m, thermal_m))),
        navigation=records.navigation,
        start_gpst=records.start_gpst,
        end_gpst=records.end_gpst,
    )


def evaluate_sky_by_carriers(pairings: Sequence[Pairing], geometry: Fit) -> CarrierTest | None:
    """Test "the sky over antennas that stand so" by carriers, of pairings of the same sets, a kind each.

    The receiver that fits worst counts. None if carriers cannot tell.
    """
    worst = None
    receivers = pairings[0].receivers if pairings else ()
    for other in range(1, len(receivers)):
        usable = [(p.fractions[other - 1], p.unit_enu) for p in pairings if p.fractions and p.unit_enu is not None]
        two = (receivers[0], receivers[other])
        units = [unit[fractions_of_kind.rows] for fractions_of_kind, unit in usable]
        test = (
            sky_carriers([fractions_of_kind for fractions_of_kind, _ in usable], units, geometry, two)
            if usable
            else None
        )
        if test is None:
            return None
        worst = test if worst is None or test.p_value < worst.p_value else worst
    return worst


class Comparison(NamedTuple):
    """Of two pairings. p_value : of "it is the larger one, not the smaller, that comes from one antenna".
    log_likelihood_ratio : of the smaller over the larger."""

    p_value: float
    log_likelihood_ratio: float


def compare_pairings(larger: Pairing, smaller: Pairing, stated_enu_m: Reals | None = None) -> Comparison:
    """Test "it is `larger`, not `smaller`, that comes from one antenna", whatever the noise over time.

    Along baselines, where the orbits are known and the two share no signals, else by all contrasts. These decide as
    well where the larger one is not the larger: then it is not rejected by either.

    stated_enu_m : (R-1, 3) of each receiver's antenna from the first one's, where that is stated.
    """
    ranges, others = larger.ranges, smaller.ranges
    sigma_m, other_sigma_m = ranges.mean_sigma_m, others.mean_sigma_m
    test = ratio_test(
        ranges.mean_m, sigma_m, others.mean_m, other_sigma_m, larger_kinds=ranges.kinds, smaller_kinds=others.kinds
    )
    p_value = float(test.p_value)
    if test.statistic > 1.0 and not larger.takes & smaller.takes:
        p_span = _test_span(larger, smaller, stated_enu_m)
        p_value = p_value if p_span is None else p_span
    return Comparison(p_value, float(test.log_likelihood_ratio))


def _test_span(one: Pairing, other: Pairing, stated_enu_m: Reals | None) -> float | None:
    """Test along baselines that the one comes from one antenna; None if that takes more satellites or orbits."""
    tables = [(p.near_place_m, p.unit_enu) for p in (one, other) if p.ranges.kinds.max(initial=0) == 0]
    known = [(table_m, unit_enu) for table_m, unit_enu in tables if table_m is not None and unit_enu is not None]
    if len(known) < 2 or min(len(table_m) for table_m, _ in known) <= POLICY.fix_satellites:
        return None
    (one_m, unit_enu), (other_m, other_unit_enu) = known
    mixed = zip(*mix_sigmas(one.ranges.mean_sigma_m, other.ranges.mean_sigma_m), strict=True)
    return max(
        float(
            span_test(
                one_m,
                other_m,
                unit_enu,
                sigma_m,
                other_unit_enu=other_unit_enu,
                other_sigma_m=other_sigma_m,
                stated_enu_m=stated_enu_m,
            ).p_value
        )
        for sigma_m, other_sigma_m in mixed
    )
