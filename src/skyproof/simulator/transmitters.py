"""Compute what transmitters on the ground add at an antenna: false signals, noise, lines.

What reaches the antenna left the transmitter some time before, and was true at the place shown earlier still. A false
clock ahead of true time means that the attacker knows the future; orbits and messages are no secret.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from skyproof.arrays import Integers, Reals
from skyproof.errors import ScenarioError
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import GPS_L1_CA, prn_of
from skyproof.records import SignalId
from skyproof.simulator.attacks import Attack, Interference, Takeover
from skyproof.simulator.motion import Motion, Trajectory
from skyproof.simulator.platforms import Point, compute_motion
from skyproof.simulator.received import AddedNoise, Jammer, ReceivedSignal
from skyproof.simulator.scenario import Antenna
from skyproof.simulator.sites import interpolate_points
from skyproof.simulator.trajectories import ecef_from_enu
from skyproof.simulator.view import View, compute_patch_db, find_when_above

__all__ = [
    "Attacker",
    "Group",
    "Radio",
    "compute_added_noise",
    "compute_interference",
    "lead_away",
    "make_false_signals",
]

NEAREST_M = 1.0
_PHASE_STREAM = 1 << 22  # sets random phases apart from other random numbers of one seed
_CLOSE_S = 1e-9  # from one round of a light-time equation to the next; what moves on the ground shrinks it 10^6 times


@dataclass(frozen=True, eq=False, kw_only=True)
class Group:
    """Signals of one origin at one antenna.

    delays_s, cn0_dbhz : true times (n,) and the antenna's motion then to (n, n_signals).
    """

    received: tuple[ReceivedSignal, ...]
    delays_s: Callable[[Reals, Motion], tuple[Reals, Reals]]
    cn0_dbhz: Callable[[Reals, Motion], Reals]
    az_rad: Reals
    el_rad: Reals


@dataclass(frozen=True, eq=False)
class Radio:
    """One transmit antenna. reference : the antenna that powers refer to, at `onset_s`."""

    trajectory: Trajectory
    reference: Point
    onset_s: float

    def flight_s(self, received_s: Reals, here: Motion) -> Reals:
        """Compute the time of flight to an antenna, of what is received at times (n,)."""
        flight_s, change_s = np.zeros(received_s.shape), np.ones(1)
        while np.abs(change_s).max(initial=0.0) > _CLOSE_S:
            sender = compute_motion(self.trajectory, received_s - flight_s)
            away_m = here.position_ecef_m - sender.position_ecef_m
            change_s = np.sqrt(np.einsum("ni,ni->n", away_m, away_m)) / SPEED_OF_LIGHT_M_S - flight_s
            flight_s = flight_s + change_s
        return flight_s

    def arrival_s(self, point: Point, left_s: Reals) -> Reals:
        """Compute the time of arrival at an antenna, of what leaves at times (n,)."""
        arrived_s, change_s = left_s, np.ones(1)
        while np.abs(change_s).max(initial=0.0) > _CLOSE_S:
            change_s = left_s + self.flight_s(arrived_s, point(arrived_s)) - arrived_s
            arrived_s = arrived_s + change_s
        return arrived_s

    @cached_property
    def reference_s(self) -> float:
        """Time of flight to the reference."""
        onset_s = np.array([self.onset_s])
        return max(float(self.flight_s(onset_s, self.reference(onset_s))[0]), 1e-12)

    def spread_db(self, flight_s: Reals) -> Reals:
        """Compute what distance changes against the reference, in free space."""
        return np.asarray(-20.0 * np.log10(flight_s / self.reference_s))

    def power(self, power_at_db: Callable[[Reals], Reals], point: Point) -> Callable[[Reals], Reals]:
        """Make the function of power at an antenna over time of reception, from the reference's `power_at_db`."""

        def power(true_s: Reals) -> Reals:
            flight_s = self.flight_s(true_s, point(true_s))
            return np.asarray(10.0 ** ((power_at_db(true_s - flight_s) + self.spread_db(flight_s)) / 10.0))

        return power


@dataclass(frozen=True, eq=False, kw_only=True)
class Attacker:
    """An attack of the scenario, worked out.

    radios : its transmit antennas. view : the sky at the place that it shows.
    target, true : of a takeover, the antenna that is taken over, and the sky there.
    """

    number: int
    name: str
    seed: int
    attack: Attack
    radios: tuple[Radio, ...]
    view: View
    target: Point | None = None
    true: View | None = None

    def delays_s(self, left_s: Reals, radio: Radio, columns: Integers) -> tuple[Reals, Reals]:
        """Compute delays of code and carrier of satellites as they leave, (n, n_columns).

        A delay is time there minus the time that they show.
        """
        attack = self.attack
        shown_s = left_s - attack.added_delay_s - attack.clock_s(left_s)
        ahead_s = np.zeros(left_s.shape)
        if self.target is not None:  # what leaves now is to be true when it arrives there
            ahead_s = radio.arrival_s(self.target, left_s) - left_s
        late_s = (left_s - shown_s - ahead_s)[:, np.newaxis]
        code_s, carrier_s = self.view.delays_s(shown_s + ahead_s, columns)
        if isinstance(attack, Takeover) and attack.carrier == "locked":
            assert self.true is not None
            _, true_s = self.true.delays_s(left_s + ahead_s, columns)
            return code_s + late_s, true_s - ahead_s[:, np.newaxis]
        return code_s + late_s, carrier_s + late_s

    def single_s(self, sats: Sequence[str], left_s: Reals) -> tuple[Reals, Reals]:
        """Compute additional delays of the code and the carrier of single satellites, (n, len(sats))."""
        attack, carrier_hz = self.attack, GPS_L1_CA.carrier_hz

        def of(values: Mapping[str, float]) -> Reals:
            return np.array([values.get(sat, 0.0) for sat in sats])

        since_s = np.maximum(left_s - attack.onset_s, 0.0)[:, np.newaxis]
        code_m = of(attack.sat_code_m) + of(attack.sat_code_m_s) * since_s
        carrier_s = -of(attack.sat_doppler_hz) / carrier_hz * since_s
        if isinstance(attack, Takeover):
            code_m = code_m + attack.code_offset_m
            carrier_s = carrier_s + attack.phase_cyc(left_s)[:, np.newaxis] / carrier_hz
            if attack.phase == "random":
                seeds = [
                    np.random.SeedSequence(self.seed, spawn_key=(_PHASE_STREAM, self.number, prn_of(sat)))
                    for sat in sats
                ]
                carrier_s = carrier_s + np.array([np.random.default_rng(s).uniform() for s in seeds]) / carrier_hz
        return code_m / SPEED_OF_LIGHT_M_S, carrier_s


def lead_away(target: Point, attack: Takeover) -> Point:
    """Make a point that leaves the target by the attack, in east, north, up of the target's place at the onset."""
    if not attack.away_points_enu_m:
        return target
    origin = target(np.array([attack.onset_s])).position_ecef_m[0]

    def point(at_s: Reals) -> Motion:
        motion = target(at_s)
        away_m = ecef_from_enu(interpolate_points(attack.away_points_enu_m, at_s, 3), origin) - origin
        return replace(motion, position_ecef_m=motion.position_ecef_m + away_m)

    return point


def make_false_signals(
    attacker: Attacker,
    point: Point,
    antenna: Antenna,
    reference_cn0_dbhz: Callable[[Reals], Reals],
    *,
    knots_s: Reals,
    mask_deg: float,
) -> Group:
    """Compute an attack's signals at an antenna.

    reference_cn0_dbhz : of the true signals of all satellites at the first receiver, (n, n_sats).

    Raises ScenarioError if a satellite that is asked for cannot be seen from the place shown.
    """
    attack, view, radios = attacker.attack, attacker.view, attacker.radios
    columns, received = _list_imitated(attacker, point, knots_s, mask_deg)
    sats = [view.orbits.sats[column] for column in columns]
    offset_db = np.array([attack.sat_db.get(sat, 0.0) for sat in sats])
    senders = np.array([attack.find_antenna(sat) for sat in sats], np.int64)
    shares = [(radio, np.flatnonzero(senders == number)) for number, radio in enumerate(radios)]
    shares = [(radio, mine) for radio, mine in shares if mine.size]
    all_columns = np.array(columns, np.int64)

    def delays_s(true_s: Reals, here: Motion) -> tuple[Reals, Reals]:
        delays = np.empty((2, true_s.size, len(sats)))
        for radio, mine in shares:
            left_s = true_s - radio.flight_s(true_s, here)
            leaving = attacker.delays_s(left_s, radio, all_columns[mine])
            single = attacker.single_s([sats[place] for place in mine], left_s)
            for which in (0, 1):
                delays[which][:, mine] = leaving[which] + single[which]
            delays[:, :, mine] += (true_s - left_s)[:, np.newaxis]
        return delays[0], delays[1]

    def cn0_dbhz(true_s: Reals, here: Motion) -> Reals:
        level: Reals = reference_cn0_dbhz(true_s)[:, all_columns] + offset_db
        for radio, mine in shares:
            flight_s = radio.flight_s(true_s, here)
            power_db = attack.power_at_db(true_s - flight_s) + radio.spread_db(flight_s)
            if antenna.gain == "patch":
                away_m = compute_motion(radio.trajectory, true_s).position_ecef_m - here.position_ecef_m
                toward = away_m / np.linalg.norm(away_m, axis=-1, keepdims=True)
                tilt_db = compute_patch_db(toward[:, np.newaxis], here.position_ecef_m, here.attitude)
                power_db = power_db + tilt_db[:, 0]
            level[:, mine] += power_db[:, np.newaxis]
        return level

    return Group(
        received=tuple(received),
        delays_s=delays_s,
        cn0_dbhz=cn0_dbhz,
        az_rad=view.az_rad[:, all_columns],
        el_rad=view.el_rad[:, all_columns],
    )


def _list_imitated(
    attacker: Attacker, point: Point, knots_s: Reals, mask_deg: float
) -> tuple[list[int], list[ReceivedSignal]]:
    """List the columns of the satellites that an attack imitates, and when each is received."""
    attack, view = attacker.attack, attacker.view
    own_message = attack.message != "true" or attack.message_later_s or attack.guess_s
    message = attacker.name if own_message else ""
    known = {sat: column for column, sat in enumerate(view.orbits.sats)}
    columns, received, unseen = [], [], []
    for sat in attack.sats if attack.sats is not None else view.orbits.sats:
        column = known.get(sat)
        above = None if column is None else find_when_above(view.el_rad[:, column], knots_s, mask_deg)
        if column is None or above is None:
            unseen.append(sat)
            continue
        edges_s = np.array(attack.windows_s)
        finite = np.isfinite(edges_s)
        edges_s[finite] = attacker.radios[attack.find_antenna(sat)].arrival_s(point, edges_s[finite])
        windows = tuple(
            (max(begin, above[0]), min(end, above[1]))
            for begin, end in edges_s.tolist()
            if max(begin, above[0]) < min(end, above[1])
        )
        if windows:
            columns.append(column)
            copy = SignalId(sat, copy=chr(ord("b") + attacker.number))
            received.append(ReceivedSignal(copy, attacker.name, "spoofed", windows, message))
    if attack.sats is not None and unseen:
        raise ScenarioError(
            f"attacks[{attacker.number}].sats: {', '.join(unseen)} cannot be seen above {mask_deg:g} degrees from the "
            "place shown; leave them out, or leave out sats to imitate all that can"
        )
    return columns, received


def compute_added_noise(attacker: Attacker, point: Point) -> AddedNoise | None:
    """Compute the attacker's own noise at an antenna: what it amplifies grows and falls with its power."""
    attack, radio = attacker.attack, attacker.radios[0]
    if attack.noise_db is None:
        return None
    noise_db = attack.noise_db - attack.power_db
    begin_s, end_s = radio.arrival_s(point, np.array([attack.onset_s]))[0], np.inf
    if attack.until_s is not None:
        end_s = radio.arrival_s(point, np.array([attack.until_s]))[0]
    power = radio.power(lambda left_s: attack.power_at_db(left_s) + noise_db, point)
    return AddedNoise(power=power, from_s=float(begin_s), until_s=float(end_s))


def compute_interference(source: Interference, radio: Radio, point: Point) -> AddedNoise:
    """Compute an interference's noise or line at an antenna."""
    power = radio.power(source.power_at_db, point)
    from_s = float(radio.arrival_s(point, np.array([source.onset_s]))[0])
    until_s = np.inf
    if source.until_s is not None:
        until_s = float(radio.arrival_s(point, np.array([source.until_s]))[0])
    if source.kind == "noise":
        return AddedNoise(power=power, from_s=from_s, until_s=until_s)
    return Jammer(
        source=source,
        power=power,
        delay_s=lambda true_s: radio.flight_s(true_s, point(true_s)),
        from_s=from_s,
        until_s=until_s,
    )
