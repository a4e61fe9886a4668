"""What each receiver of a scene hears: every signal's delays as smooth functions of time, and the bits that it carries.

A delay is the time of reception minus the time that the satellite's clock showed at transmission, as the code (or the
carrier) tells it: travel time, satellite clock, group delay, ionosphere (code late, carrier early), troposphere, and,
for a false signal, the way through the attacker. Times `true_s` are GPS time since the scenario's start.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from skyproof.errors import ScenarioError
from skyproof.gnss.atmosphere import klobuchar_delay_s, troposphere_delay_m
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import Ephemeris, NavigationData
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.lnav import encode_subframes
from skyproof.gnss.orbits import satellite_state_s
from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS, SignalDescription, prn_of
from skyproof.gnss.sky import azimuth_elevation, rotate_to_reception
from skyproof.gnss.time import iso, week_and_tow
from skyproof.records import SignalId, SignalRef
from skyproof.simulate.scenario import Attack, Place, Receiver, Scenario, Sky

__all__ = ["AddedNoise", "Delays", "HeardSignal", "Messages", "ReceiverSky", "Scene", "delays_at", "scene_of"]

Reals = NDArray[np.float64]

KNOT_S = 1.0
"""Distance of the knots. A GPS range from a place on Earth has a fourth derivative of about 1e-8 m/s^4, so a cubic
spline errs by less than a nanometre. The only corner is the rim of the ionosphere model's day, smoothed over 1 s."""
_MARGIN_S = 4.0
_MIN_PATH_M = 1.0
_SUBFRAME_S = 6
_SPARE_S = 2  # of message before the first sample and after the last


@dataclass(frozen=True, eq=False, kw_only=True)
class Delays:
    """One satellite at one place: arrays of one shape (...), over time."""

    code_s: Reals
    carrier_s: Reals
    range_m: Reals
    az_rad: Reals
    el_rad: Reals


@dataclass(frozen=True)
class HeardSignal:
    """Which signal this is, and the truth about it. `source` is "sky" or the attack's name."""

    id: SignalId
    source: str
    label: str  # "authentic" or "spoofed"
    from_s: float  # true time of arrival of its first wave; -inf if before the scene
    until_s: float


@dataclass(frozen=True)
class AddedNoise:
    """A transmitter's own noise at a receiver: its power over the receiver's, and when it is there (true time)."""

    power: float
    from_s: float
    until_s: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Messages:
    """The symbols (+1 for bit 0) that satellites send, one row each in the order of `sats`.

    symbols : (n_sats, n_symbols) int8, the first of which begins `lead_s` before the scenario's start.
    """

    sats: tuple[str, ...]
    symbols: NDArray[np.int8]
    lead_s: float


@dataclass(frozen=True, eq=False, kw_only=True)
class ReceiverSky:
    """All signals at one receiver. Splines map true time (n,) to (n, n_signals)."""

    receiver: Receiver
    signals: tuple[HeardSignal, ...]
    knots_s: Reals
    delays: tuple[Delays, ...]  # at the knots, as seen from the antenna that hears the satellite; without the detour
    code_delay_s: CubicSpline
    carrier_delay_s: CubicSpline
    cn0_dbhz: CubicSpline
    noises: tuple[AddedNoise, ...]
    signal: SignalDescription = GPS_L1_CA

    def true_minus_elapsed_s(self, elapsed_s: ArrayLike) -> Reals:
        """True time minus what the sampling clock has counted, any shape: small, so that it keeps its digits."""
        return self.receiver.start_offset_s - np.asarray(elapsed_s, np.float64) * self.clock_drift

    def elapsed_at(self, true_s: ArrayLike) -> Reals:
        """What the sampling clock has counted at a true time, any shape."""
        return np.asarray((np.asarray(true_s, np.float64) - self.receiver.start_offset_s) / (1.0 - self.clock_drift))

    @property
    def clock_drift(self) -> float:
        """Seconds by which the sampling clock gets ahead of true time in one second of its own."""
        fast = self.receiver.lo_ppm * 1e-6
        return fast / (1.0 + fast)


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """A scenario worked out: the sky of every receiver, and the messages."""

    scenario: Scenario
    navigation: NavigationData
    skies: tuple[ReceiverSky, ...]
    path_m: Reals  # (n_attacks, n_receivers), transmit antenna to receiver

    @property
    def labels(self) -> dict[SignalRef, str]:
        """The truth: "authentic" or "spoofed" for every signal in every receiver."""
        return {SignalRef(s.receiver.name, heard.id): heard.label for s in self.skies for heard in s.signals}

    @cached_property
    def messages(self) -> Messages:
        """The message of every satellite heard, over the whole scene."""
        scenario = self.scenario
        sats = tuple(sorted({heard.id.sat for sky in self.skies for heard in sky.signals}))
        week, tow_s = week_and_tow(scenario.start_gpst)
        first_s = min(sky.receiver.start_offset_s for sky in self.skies) - _SPARE_S
        last_s = max(float(sky.knots_s[-1]) for sky in self.skies) + _SPARE_S
        start = int((tow_s + first_s) // _SUBFRAME_S) * _SUBFRAME_S  # may lie before or after this week
        count = int((tow_s + last_s - start) // _SUBFRAME_S) + 1
        week_of_start, start_in_week = divmod(week * 604_800 + start, 604_800)
        nav = self.navigation
        bits = [
            encode_subframes(eph, nav.ionosphere, nav.utc, start_in_week, week_of_start, count)
            for eph in (_ephemeris(nav, sat, scenario) for sat in sats)
            if eph is not None
        ]
        return Messages(sats=sats, symbols=(1 - 2 * np.stack(bits)).astype(np.int8), lead_s=tow_s - start)


def scene_of(scenario: Scenario, navigation: NavigationData) -> Scene:
    """Work out who hears what.

    Raises
    ------
    ScenarioError : no satellite is in view, the navigation data are of another time, an attack imitates a satellite
        that cannot be seen from the place it shows, or a receiver stands on a transmit antenna.
    """
    if all(_ephemeris(navigation, sat, scenario) is None for sat in GPS_SATS):
        raise ScenarioError(
            f"start_gpst: {navigation.source or 'the navigation data'} has no healthy satellite for "
            f"{iso(scenario.start_gpst, 0)}; give the navigation file of that day"
        )
    receiver_ecef_m = np.stack([_ecef(receiver) for receiver in scenario.receivers])
    transmit_ecef_m = np.array([_ecef(attack.transmit) for attack in scenario.attacks]).reshape(-1, 1, 3)
    path_m = np.linalg.norm(transmit_ecef_m - receiver_ecef_m, axis=-1)
    for attack, receiver in np.argwhere(path_m < _MIN_PATH_M):
        raise ScenarioError(
            f"attacks[{attack}].transmit: {path_m[attack, receiver]:.2f} m from receiver "
            f"{scenario.receivers[receiver].name}, expected at least {_MIN_PATH_M:g} m; move one of them"
        )
    skies = tuple(_receiver_sky(scenario, navigation, index, path_m) for index in range(len(scenario.receivers)))
    return Scene(scenario=scenario, navigation=navigation, skies=skies, path_m=path_m)


def delays_at(place: Place, ephemeris: Ephemeris, navigation: NavigationData, start_gpst: np.datetime64,
              true_s: ArrayLike) -> Delays:  # fmt: skip
    """Delays of one satellite's signal at a place that stands still, at true times (...) of reception.

    The satellite clock of an L1 C/A user is the message's minus the group delay (IS-GPS-200N, 20.3.3.3.3.2); the
    carrier is coherent with the code at the satellite, so the ionosphere alone parts them.
    """
    week, tow_s = week_and_tow(start_gpst)
    lat_rad, lon_rad, height_m = place.geodetic_rad
    rx_ecef_m = _ecef(place)
    received_s = tow_s + np.asarray(true_s, np.float64)
    travel_s = np.full(received_s.shape, 0.075)
    for _ in range(4):  # each round shrinks the error by the satellite's speed over that of light, 1e-5
        state = satellite_state_s(ephemeris, week, received_s - travel_s)
        sat_ecef_m = rotate_to_reception(state.position_ecef_m, travel_s)
        range_m = np.linalg.norm(sat_ecef_m - rx_ecef_m, axis=-1)
        travel_s = range_m / SPEED_OF_LIGHT_M_S
    az_rad, el_rad = azimuth_elevation(rx_ecef_m, sat_ecef_m)
    up_rad = np.maximum(el_rad, 0.0)  # the models end at the horizon
    troposphere_s = troposphere_delay_m(lat_rad, height_m, up_rad) / SPEED_OF_LIGHT_M_S
    klobuchar = navigation.ionosphere
    ionosphere_s = (
        klobuchar_delay_s(klobuchar, lat_rad, lon_rad, az_rad, up_rad, received_s)
        if klobuchar is not None else np.zeros_like(travel_s)
    )  # fmt: skip
    common_s = travel_s + troposphere_s - (state.clock_s - ephemeris.tgd)
    return Delays(code_s=common_s + ionosphere_s, carrier_s=common_s - ionosphere_s, range_m=np.asarray(range_m),
                  az_rad=az_rad, el_rad=el_rad)  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Arrival:
    """One signal at one receiver, before the splines."""

    heard: HeardSignal
    delays: Delays
    added_s: float
    cn0_dbhz: Reals


def _receiver_sky(scenario: Scenario, navigation: NavigationData, index: int, path_m: Reals) -> ReceiverSky:
    receiver = scenario.receivers[index]
    first_s = receiver.start_offset_s - _MARGIN_S
    n_knots = int(np.ceil((scenario.duration_s + 2 * _MARGIN_S) / KNOT_S)) + 1
    knots_s: Reals = first_s + KNOT_S * np.arange(n_knots, dtype=np.float64)
    arrivals = _from_the_sky(scenario, navigation, receiver, knots_s)
    noises = []
    for number, attack in enumerate(scenario.attacks):
        path_s = float(path_m[number, index]) / SPEED_OF_LIGHT_M_S
        spread_db = -20.0 * float(np.log10(path_m[number, index] / path_m[number, 0]))  # free space
        arrivals += _from_an_attack(scenario, navigation, number, knots_s, path_s, spread_db)
        if attack.noise_db is not None:
            power = 10.0 ** ((attack.noise_db + spread_db) / 10.0)
            noises.append(AddedNoise(power, attack.onset_s + path_s, _end_s(attack) + path_s))
    if not arrivals:
        raise ScenarioError(
            f"mask_deg: nothing stands above {scenario.mask_deg:g} degrees at receiver {receiver.name}; lower the mask"
        )
    arrivals.sort(key=lambda arrival: arrival.heard.id)
    return ReceiverSky(
        receiver=receiver,
        signals=tuple(arrival.heard for arrival in arrivals),
        knots_s=knots_s,
        delays=tuple(arrival.delays for arrival in arrivals),
        code_delay_s=CubicSpline(knots_s, np.stack([a.delays.code_s + a.added_s for a in arrivals], axis=1)),
        carrier_delay_s=CubicSpline(knots_s, np.stack([a.delays.carrier_s + a.added_s for a in arrivals], axis=1)),
        cn0_dbhz=CubicSpline(knots_s, np.stack([a.cn0_dbhz for a in arrivals], axis=1)),
        noises=tuple(noises),
    )


def _from_the_sky(scenario: Scenario, navigation: NavigationData, receiver: Receiver, knots_s: Reals) -> list[_Arrival]:
    arrivals = []
    for sat in GPS_SATS:
        ephemeris = _ephemeris(navigation, sat, scenario)
        if ephemeris is None:
            continue
        delays = delays_at(receiver, ephemeris, navigation, scenario.start_gpst, knots_s)
        seen = _when_above(delays.el_rad, knots_s, scenario.mask_deg)
        if seen is not None:
            heard = HeardSignal(SignalId(sat), "sky", "authentic", *seen)
            arrivals.append(_Arrival(heard, delays, 0.0, _cn0_dbhz(scenario.sky, delays.el_rad)))
    return arrivals


def _from_an_attack(scenario: Scenario, navigation: NavigationData, number: int, knots_s: Reals, path_s: float,
                    spread_db: float) -> list[_Arrival]:  # fmt: skip
    """What reaches the receiver left the antenna `path_s` earlier, and was true at the place shown earlier still.

    A false clock ahead of true time means that the attacker knows the future; orbits and messages are no secret.
    """
    attack = scenario.attacks[number]
    added_s = path_s + attack.added_delay_s
    reference = scenario.receivers[0]
    arrivals, unseen = [], []
    for sat in attack.sats if attack.sats is not None else GPS_SATS:
        ephemeris = _ephemeris(navigation, sat, scenario)
        if ephemeris is None:
            unseen.append(sat)
            continue
        delays = delays_at(attack.shows, ephemeris, navigation, scenario.start_gpst, knots_s - added_s)
        seen = _when_above(delays.el_rad, knots_s, scenario.mask_deg)
        if seen is None:
            unseen.append(sat)
            continue
        true_el_rad = delays_at(reference, ephemeris, navigation, scenario.start_gpst, knots_s).el_rad
        cn0_dbhz = _cn0_dbhz(scenario.sky, true_el_rad) + attack.power_db + attack.sat_db.get(sat, 0.0) + spread_db
        heard = HeardSignal(
            SignalId(sat, copy=chr(ord("b") + number)), scenario.attack_names[number], "spoofed",
            max(seen[0], attack.onset_s + path_s), min(seen[1], _end_s(attack) + path_s),
        )  # fmt: skip
        arrivals.append(_Arrival(heard, delays, added_s, cn0_dbhz))
    if attack.sats is not None and unseen:
        raise ScenarioError(
            f"attacks[{number}].sats: {', '.join(unseen)} cannot be seen above {scenario.mask_deg:g} degrees from the "
            "place shown; leave them out, or leave out sats to imitate all that can"
        )
    return arrivals


def _when_above(el_rad: Reals, knots_s: Reals, mask_deg: float) -> tuple[float, float] | None:
    """First and last moment above the mask, infinite where that is an end of the scene; None if never."""
    above = np.flatnonzero(el_rad >= np.radians(mask_deg))
    if above.size == 0:
        return None
    return (-np.inf if above[0] == 0 else float(knots_s[above[0]]),
            np.inf if above[-1] == knots_s.size - 1 else float(knots_s[above[-1]]))  # fmt: skip


def _cn0_dbhz(sky: Sky, el_rad: Reals) -> Reals:
    return sky.horizon_cn0_dbhz + (sky.zenith_cn0_dbhz - sky.horizon_cn0_dbhz) * np.maximum(np.sin(el_rad), 0.0)


def _end_s(attack: Attack) -> float:
    return np.inf if attack.until_s is None else attack.until_s


def _ephemeris(navigation: NavigationData, sat: str, scenario: Scenario) -> Ephemeris | None:
    """One for the whole scene; none if the satellite is unhealthy."""
    ephemeris = navigation.best(sat, scenario.start_gpst)
    return ephemeris if isinstance(ephemeris, Ephemeris) else None


def _ecef(place: Place) -> Reals:
    return ecef_from_geodetic(*place.geodetic_rad)


def row_of(messages: Messages, signals: Sequence[HeardSignal]) -> NDArray[np.int64]:
    """The row of `messages.symbols` that each signal carries."""
    return np.array([messages.sats.index(heard.id.sat) for heard in signals], dtype=np.int64)


def codes_of(signals: Sequence[HeardSignal], signal: SignalDescription) -> NDArray[np.int8]:
    """The spreading codes, shape (n_signals, code_length)."""
    return np.stack([signal.code(prn_of(heard.id.sat)) for heard in signals])
