"""One candidate group: a consistent set from each receiver, and the p-values of what it could be."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from skyproof.detectors.common_epochs import CommonRanges, common_ranges
from skyproof.detectors.one_antenna import (
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
    table_contrasts,
)
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.orbits import satellite_state
from skyproof.gnss.sky import rotate_to_reception, unit_vectors
from skyproof.records import ConsistentSet, NavigationData, Reals, Records, SignalRef

__all__ = ["Pairing", "pair_up", "versus"]

_TRAVEL_S = 0.075  # to 10 ms: 40 m along the orbit, 2 microradians


@dataclass(frozen=True, eq=False)
class Pairing:
    """Sets, one a receiver, whose common satellites are looked at together."""

    sets: tuple[ConsistentSet, ...]
    ranges: CommonRanges
    noise: NoiseModel
    navigation: NavigationData | None

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
        return one_antenna_test(self._levels_of(range(len(self.sets)))[0])

    def threshold(self, false_alarm_probability: float) -> float:
        """What `one_antenna.statistic` has to exceed."""
        levels, _ = self._levels_of(range(len(self.sets)))
        return float(levels.threshold(false_alarm_probability, levels.level.shape[-1], self.one_antenna.decides))

    @cached_property
    def scatter_m(self) -> float:
        """How much the range differences between receivers differ from satellite to satellite, rms."""
        difference_m = self.ranges.mean_m[:, 1:] - self.ranges.mean_m[:, :1]
        return float(np.sqrt(np.mean((difference_m - difference_m.mean(axis=0)) ** 2)))

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

    def known_baseline_p_value(self, antennas_enu_m: Mapping[str, tuple[float, float, float]] | None) -> float | None:
        """Test of "the sky, with the antennas where they are known to be"; None if that, or an orbit, is not known."""
        if antennas_enu_m is None or self.unit_enu is None or any(s.receiver not in antennas_enu_m for s in self.sets):
            return None
        place_m = np.array([antennas_enu_m[chosen.receiver] for chosen in self.sets], float)
        levels, matrix = self._levels_of(range(len(self.sets)))
        expected = baseline_design(matrix, self.unit_enu) @ (place_m[1:] - place_m[0]).ravel()
        return float(one_antenna_test(levels, expected).p_value)

    def _levels_of(self, receivers: list[int] | range) -> tuple[Levels, Reals]:
        columns = list(receivers)
        values, gain, matrix = table_contrasts(self.ranges.range_m[..., columns], self.ranges.sigma_m[:, columns])
        return contrast_levels(values, gain, self.noise, self.ranges.gaps), matrix


def pair_up(records: Records, sets: tuple[ConsistentSet, ...], noise: NoiseModel, *, min_satellites: int) -> Pairing:
    """The common satellites of `sets` at common instants."""
    ranges = common_ranges(records, sets, min_satellites=min_satellites)
    return Pairing(sets=sets, ranges=ranges, noise=noise, navigation=records.navigation)


def versus(larger: Pairing, smaller: Pairing) -> RatioTest:
    """Test of "it is `larger`, not `smaller`, that comes from one antenna"."""
    return ratio_test(
        larger.ranges.mean_m, larger.ranges.mean_sigma_m, smaller.ranges.mean_m, smaller.ranges.mean_sigma_m
    )
