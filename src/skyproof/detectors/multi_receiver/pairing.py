"""One candidate group: a consistent set from each receiver, and the p-values of what it could be."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.multi_receiver.common_epochs import CommonRanges, common_ranges
from skyproof.detectors.multi_receiver.known_geometry import Geometry, survival
from skyproof.detectors.multi_receiver.one_antenna import (
    Levels,
    MeanTest,
    NoiseModel,
    RatioTest,
    baseline_design,
    baseline_estimate,
    contrast_levels,
    distance_p_value,
    one_antenna_test,
    ratio_test,
    stretch_means,
    table_contrasts,
)
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.orbits import satellite_state
from skyproof.gnss.sky import rotate_to_reception, unit_vectors
from skyproof.gnss.time import seconds_between
from skyproof.records import Baseline, ConsistentSet, NavigationData, Records, SignalRef
from skyproof.statistics.lines import fit_line

__all__ = ["Pairing", "pair_up", "versus"]

_TRAVEL_S = 0.075  # to 10 ms: 40 m along the orbit, 2 microradians
_PART_S = 2.0
"""Parts of a window whose baselines are looked at one by one: a false sky that is drawn off at 10 m/s is then noticed
before it is 20 m away."""
_PART_EPOCHS = 4


@dataclass(frozen=True, eq=False)
class Pairing:
    """Sets, one a receiver, whose common satellites are looked at together."""

    sets: tuple[ConsistentSet, ...]
    ranges: CommonRanges
    noise: NoiseModel
    navigation: NavigationData | None
    start_gpst: np.datetime64
    end_gpst: np.datetime64

    @property
    def receivers(self) -> tuple[str, ...]:
        return tuple(chosen.receiver for chosen in self.sets)

    @cached_property
    def subject(self) -> tuple[SignalRef, ...]:
        """The signals of the satellites that all have, receiver by receiver."""
        return tuple(
            SignalRef(chosen.receiver, signal)
            for chosen in self.sets
            for signal in chosen.signals
            if signal.sat in self.ranges.sats
        )

    @cached_property
    def one_antenna(self) -> MeanTest:
        """Test of "all from one antenna"."""
        return one_antenna_test(self._levels[0])

    def threshold(self, false_alarm_probability: float) -> float:
        """What `one_antenna.statistic` has to exceed."""
        levels, _ = self._levels
        return float(levels.threshold(false_alarm_probability, levels.level.shape[-1], self.one_antenna.decides))

    @cached_property
    def scatter_m(self) -> float:
        """How much the range differences between receivers differ from satellite to satellite, rms."""
        difference_m = self.ranges.mean_m[:, 1:] - self.ranges.mean_m[:, :1]
        return float(np.sqrt(np.mean((difference_m - difference_m.mean(axis=0)) ** 2)))

    @cached_property
    def noise_m(self) -> float:
        """Of a track about a line over the window, rms, metres: what a signal that is drawn off shows as well."""
        rms_of_sigma = float(np.sqrt(np.mean(fit_line(self._contrasts[0]).residual ** 2)))
        return rms_of_sigma * float(np.sqrt(np.mean(self.ranges.sigma_m**2)))

    @cached_property
    def unit_enu(self) -> Reals | None:
        """(K, 3) directions at the first set's position in the window's middle; None without all orbits."""
        if self.navigation is None:
            return None
        place, when = self.sets[0].position_ecef_m, self.sets[0].gpst
        orbits = [self.navigation.best(sat, when) for sat in self.ranges.sats]
        sent = when - np.timedelta64(round(_TRAVEL_S * 1e9), "ns")
        sat_ecef_m = [satellite_state(orbit, sent).position_ecef_m for orbit in orbits if orbit is not None]
        if len(sat_ecef_m) < len(orbits):
            return None
        lat_rad, lon_rad, _ = geodetic_from_ecef(place)
        units = unit_vectors(place, rotate_to_reception(np.array(sat_ecef_m), _TRAVEL_S))
        return np.asarray(units @ rot_enu_ecef(lat_rad, lon_rad).T)

    @cached_property
    def distances_m(self) -> tuple[float, ...] | None:
        """Horizontal distance of each receiver from the first as these signals tell it; None without orbits."""
        if self.unit_enu is None:
            return None
        found = []
        for other in range(1, len(self.sets)):
            levels, matrix = self._levels_of([0, other])
            baseline = baseline_estimate(levels, baseline_design(matrix, self.unit_enu))
            found.append(float(np.hypot(*baseline.enu_m[0, :2])))
        return tuple(found)

    def at_least_p_value(self, distance_m: float) -> float:
        """Test of "the sky, with all antennas at least so far from the first one"; 1 without orbits."""
        return self._distance_p_value(distance_m, at_least=True)

    def at_most_p_value(self, distance_m: float) -> float:
        """Test of "the sky, with all antennas at most so far from the first one"; 1 without orbits."""
        return self._distance_p_value(distance_m, at_least=False)

    def _distance_p_value(self, distance_m: float, *, at_least: bool) -> float:
        if self.unit_enu is None:
            return 1.0
        p_values = []
        for other in range(1, len(self.sets)):
            levels, matrix = self._levels_of([0, other])
            baseline = baseline_estimate(levels, baseline_design(matrix, self.unit_enu))
            p_values.append(
                float(distance_p_value(levels, baseline, distance_m, "at least" if at_least else "at most"))
            )
        return min(1.0, len(p_values) * min(p_values))

    def survival(self, geometry: Geometry) -> float:
        """p-value of "the sky over antennas that stand so", never too small; 1 without orbits."""
        if self.unit_enu is None:
            return 1.0
        levels, matrix = self._levels
        estimate = baseline_estimate(levels, baseline_design(matrix, self.unit_enu))
        return float(levels.worst(survival(geometry, self.receivers, estimate, levels.dof))[0])

    @cached_property
    def baselines(self) -> tuple[Baseline, ...]:
        """Where the antennas stand by these signals, over the window and over parts of it; nothing without orbits."""
        if self.unit_enu is None:
            return ()
        values, gain, matrix = self._contrasts
        length_s = float(seconds_between(self.end_gpst, self.start_gpst))
        parts = max(1, min(len(values) // _PART_EPOCHS, round(length_s / _PART_S)))
        edges = np.linspace(0, len(values), parts + 1).astype(int)
        stretches = [(0, len(values)), *pairwise(edges)][: None if parts > 1 else 1]
        design = baseline_design(matrix, self.unit_enu)
        found = []
        for first, end in stretches:
            mean = stretch_means(values, gain, self.noise.multipath_sigma_m, first, end)
            estimate = baseline_estimate(mean, design)
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
    def _contrasts(self) -> tuple[Reals, Reals, Reals]:
        """Of all receivers, over the window: values, gain and matrix as of `table_contrasts`."""
        return table_contrasts(self.ranges.range_m, self.ranges.sigma_m)

    @cached_property
    def _levels(self) -> tuple[Levels, Reals]:
        """Of all receivers; the levels of two of them are `_levels_of`."""
        values, gain, matrix = self._contrasts
        return contrast_levels(values, gain, self.noise, self.ranges.gaps), matrix

    def _levels_of(self, receivers: list[int]) -> tuple[Levels, Reals]:
        if len(receivers) == len(self.sets):
            return self._levels
        values, gain, matrix = table_contrasts(self.ranges.range_m[..., receivers], self.ranges.sigma_m[:, receivers])
        return contrast_levels(values, gain, self.noise, self.ranges.gaps), matrix


def pair_up(records: Records, sets: tuple[ConsistentSet, ...], noise: NoiseModel, *, min_satellites: int) -> Pairing:
    """The common satellites of `sets` at common instants."""
    ranges = common_ranges(records, sets, min_satellites=min_satellites)
    return Pairing(
        sets=sets,
        ranges=ranges,
        noise=noise,
        navigation=records.navigation,
        start_gpst=records.start_gpst,
        end_gpst=records.end_gpst,
    )


def versus(larger: Pairing, smaller: Pairing) -> RatioTest:
    """Test of "it is `larger`, not `smaller`, that comes from one antenna"."""
    return ratio_test(
        larger.ranges.mean_m, larger.ranges.mean_sigma_m, smaller.ranges.mean_m, smaller.ranges.mean_sigma_m
    )
