"""What a run states of its receivers and asks of the detector."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.multi_receiver.known_geometry import AntennaDistance, AntennaPlaces, StatedGeometry
from skyproof.detectors.multi_receiver.one_antenna import TrackNoise
from skyproof.detectors.multi_receiver.policy import POLICY
from skyproof.errors import SettingsError, require_probability
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.records import NavState, Records

__all__ = ["MultiReceiverSettings"]


@dataclass(frozen=True)
class MultiReceiverSettings:
    """Settings of `MultiReceiver`.

    false_alarm_probability : of each window's decision: authenticating signals of one antenna, or naming those of the
        sky false.
    accept_probability : a pairing counts as "could be one antenna", and a baseline as the known one, from this p-value
        on.
    min_satellites : common satellites of a pairing, 4 at least.
    min_epochs : common epochs of a pairing, 4 at least.
    multipath_sigma_m : error of a track that stays constant over the window, one sigma.
    carrier_multipath_sigma_m : the same of a carrier. Between two receivers under open sky 1 to 6 mm were measured.
    correlation_max : largest AR(1) coefficient of the noise from epoch to epoch; 0 if it is known to be white.
    error_bound_m : no track's slow error has a larger sigma, beside thermal noise; infinite if that is not known.
    antenna_separation_m : the antennas stand at least this far from the first one, horizontally; 0 if they may share
        one, or if it is not known.
    max_separation_m : they stand at most this far from it. It catches pairings of one receiver's true with another's
        false signals, but for false positions nearer than this.
    antenna_distance_m : the antennas of two receivers stand so far apart; None if that is not known.
    antenna_distance_sigma_m : its standard deviation; None is half of 5 %, and at least 0.5 m.
    antennas_enu_m : where each receiver's antenna is, east, north, up of any common point; for the receivers that it
        names it replaces all of the above, and decides what they cannot.
    antennas_sigma_m : standard deviation of these places, on each axis.
    antennas_body_m : (3,) of each receiver's antenna on one body, which is turned as its attitude in the window says.
    antennas_body_sigma_m : of these places, on each axis.
    positions_ecef_m : (3,) of each receiver that was surveyed.
    unrelated_spread_m : delays of second signals that have nothing to do with each other spread over at least this.
    mistaken_probability : share of echoes among further signals that are called false one by one, under an attack.
    """

    false_alarm_probability: float = 1e-3
    accept_probability: float = 1e-3
    min_satellites: int = 5
    min_epochs: int = 4
    multipath_sigma_m: float = 1.0
    carrier_multipath_sigma_m: float = 0.005
    correlation_max: float = 0.98
    error_bound_m: float = 3.0
    antenna_separation_m: float = 0.0
    max_separation_m: float = 300.0
    antenna_distance_m: float | None = None
    antenna_distance_sigma_m: float | None = None
    antennas_enu_m: Mapping[str, tuple[float, float, float]] | None = None
    antennas_sigma_m: float = 0.1
    antennas_body_m: Mapping[str, Reals] | None = None
    antennas_body_sigma_m: float = 0.0
    positions_ecef_m: Mapping[str, Reals] | None = None
    unrelated_spread_m: float = 300.0
    mistaken_probability: float = 0.01

    def __post_init__(self) -> None:
        for name in ("false_alarm_probability", "accept_probability", "mistaken_probability"):
            require_probability("multi_receiver", name, getattr(self, name))
        for name in ("min_satellites", "min_epochs"):
            if getattr(self, name) < 4:
                raise SettingsError(f"multi_receiver: {name} is {getattr(self, name)}, expected 4 or more; give more")
        if not 0.0 <= self.correlation_max < 1.0:
            raise SettingsError(f"multi_receiver: correlation_max is {self.correlation_max}, expected 0 to below 1")

    def geometry(self, receivers: Sequence[str]) -> StatedGeometry | None:
        """Return what is known of where these receivers' antennas stand; None if nothing is."""
        if self.antennas_enu_m is not None and all(name in self.antennas_enu_m for name in receivers):
            return AntennaPlaces(self.antennas_enu_m, self.antennas_sigma_m, self.positions_ecef_m)
        if self.antenna_distance_m is not None and len(receivers) == 2:
            sigma_m = self.antenna_distance_sigma_m
            given_m = self.antenna_distance_m
            return AntennaDistance(
                given_m, max(0.5 * POLICY.distance_share * given_m, 0.5) if sigma_m is None else sigma_m
            )
        return None

    def place_antennas(self, records: Records) -> "MultiReceiverSettings":
        """Return the settings with the antennas placed by their body's attitude in a window.

        They are the same where places are given, the attitude is not known, or turns and its error leave the antennas
        less well placed than codes show: their distance says more then.
        """
        state = next(iter(records.nav_state.values()), None)
        if self.antennas_body_m is None or self.antennas_enu_m is not None or state is None or state.covariance is None:
            return self
        body_m = np.array(list(self.antennas_body_m.values()))
        body_m = body_m - body_m[0]
        middle = state.gpst.size // 2
        turns_rad = _measure_turns_rad(state)
        attitude_rad2 = float(np.linalg.eigvalsh(state.covariance[middle, 6:, 6:])[-1]) + float(np.mean(turns_rad**2))
        arm_m = float(np.linalg.norm(body_m, axis=1).max())
        sigma_m = float(np.hypot(self.antennas_body_sigma_m, arm_m * np.sqrt(attitude_rad2)))
        if not sigma_m <= self.multipath_sigma_m:
            return self
        lat_rad, lon_rad, _ = geodetic_from_ecef(state.position_ecef_m[middle])
        enu_m = body_m @ (rot_enu_ecef(lat_rad, lon_rad) @ state.attitude[middle]).T
        places = dict(zip(self.antennas_body_m, map(tuple, enu_m.tolist()), strict=True))
        return replace(self, antennas_enu_m=places, antennas_sigma_m=sigma_m)

    def noise(self, tests: int) -> TrackNoise:
        """Return the noise model for one of `tests` tests; a tenth of the rate goes to the unknown correlation."""
        white = self.correlation_max == 0.0
        return TrackNoise(
            multipath_sigma_m=self.multipath_sigma_m,
            correlation_max=self.correlation_max,
            miss_probability=0.0 if white else 0.1 * self.false_alarm_probability / tests,
            bound_m=self.error_bound_m,
            carrier_multipath_sigma_m=self.carrier_multipath_sigma_m,
        )


def _measure_turns_rad(state: NavState) -> Reals:
    """Measure by what angle (n,) the body is turned from where it is in the middle of a window."""
    between = np.einsum("ji,njk->nik", state.attitude[state.gpst.size // 2], state.attitude)
    return np.asarray(np.arccos(np.clip(0.5 * (np.trace(between, axis1=1, axis2=2) - 1.0), -1.0, 1.0)))
