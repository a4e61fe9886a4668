"""What antennas receive, as records: signals, reflections, noise and messages, as functions of time.

A delay is the time of reception minus the time that the satellite's clock showed at transmission, as the code (or the
carrier) has it: travel time, satellite clock, group delay, ionosphere (code late, carrier early), troposphere, and,
for a false signal, the way through the attacker. Times `true_s` are GPS time since the scenario's start.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyproof.arrays import Integers, Reals
from skyproof.gnss.ephemeris import BroadcastEphemeris, Ephemeris, NavigationData
from skyproof.gnss.lnav import SUBFRAME_S, encode_subframes
from skyproof.gnss.signals import GPS_L1_CA, SignalPlan, prn_of
from skyproof.gnss.time import week_and_tow
from skyproof.records import SignalId, SignalRef
from skyproof.simulator.attacks import Interference
from skyproof.simulator.clocks import Clock
from skyproof.simulator.motion import Trajectory
from skyproof.simulator.platforms import Point
from skyproof.simulator.scenario import Antenna, Scenario, SceneReceiver

__all__ = [
    "AddedNoise",
    "Delay",
    "Jammer",
    "Messages",
    "Ray",
    "ReceivedSignal",
    "ReceiverSky",
    "Scene",
    "collect_windows",
    "find_rows",
    "select_ephemeris",
    "stack_codes",
]

Delay = Callable[[Reals], tuple[Reals, Reals]]
"""Times of reception (n,) to delays of code and carrier in seconds, (n, n_signals) each."""

_SHORT_S = 0.01  # 0.1 mm/s at 2 g; the delays' own digits leave 1 um/s
_SPARE_S = 2  # of message before the first sample and after the last
_MESSAGE_STREAM = 1 << 21  # sets random bits apart from other random numbers of one seed
_GUESS_STREAM = 1 << 24  # and those that are guessed


@dataclass(frozen=True)
class ReceivedSignal:
    """Which signal this is, and the truth about it. `source` is "sky" or the attack's name.

    windows_s : true times of arrival of its first and last wave, infinite beyond the scene; several if it pauses.
    message : which message it carries: "" is the satellite's own.
    """

    id: SignalId
    source: str
    label: str  # "authentic" or "spoofed"
    windows_s: tuple[tuple[float, float], ...]
    message: str = ""

    @property
    def from_s(self) -> float:
        return self.windows_s[0][0]

    @property
    def until_s(self) -> float:
        return self.windows_s[-1][1]


@dataclass(frozen=True, eq=False, kw_only=True)
class Ray:
    """A reflection of the signal in column `of`: further delay (n,) s over true time, amplitude, phase and Doppler."""

    of: int
    further_s: Callable[[Reals], Reals]
    amplitude: float
    phase_cyc: float
    rate_hz: float


@dataclass(frozen=True, eq=False, kw_only=True)
class AddedNoise:
    """A transmitter's own white noise at an antenna: its power over the receiver's, when it is there (true time)."""

    power: Callable[[Reals], Reals]
    from_s: float
    until_s: float

    def power_at(self, true_s: Reals) -> Reals:
        """Compute the power at times (n,), zero while it is not there."""
        return np.where((self.from_s <= true_s) & (true_s <= self.until_s), self.power(true_s), 0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Jammer(AddedNoise):
    """A line or a chirp at an antenna: its power over the receiver's noise in the band, its delay, when it is there."""

    source: Interference
    delay_s: Callable[[Reals], Reals]

    def share_through(self, chip_rate_hz: float) -> float:
        """Compute the share of the power that chips' spectrum passes, 1 in its middle; the mean over a chirp."""
        sweep_hz = self.source.sweep_hz if self.source.kind == "chirp" else 0.0
        offsets_hz = self.source.offset_hz + sweep_hz * (np.arange(200) / 199.0 - 0.5)
        return float(np.mean(np.sinc(offsets_hz / chip_rate_hz) ** 2))


@dataclass(frozen=True, eq=False, kw_only=True)
class Messages:
    """The symbols (+1 for bit 0) of each message, one row each: (satellite, variant), variant "" its own.

    symbols : (n_messages, n_symbols) int8; the first begins `lead_s` before the scenario's start. guesses : of the same
    shape, what is sent instead for the first `guess_s`, (n_messages,), of each symbol.
    """

    names: tuple[tuple[str, str], ...]
    symbols: NDArray[np.int8]
    lead_s: float
    guesses: NDArray[np.int8]
    guess_s: Reals


@dataclass(frozen=True, eq=False, kw_only=True)
class ReceiverSky:
    """All signals at one antenna of a receiver.

    number : of the antenna, counted over all receivers. name : the receiver's, and the antenna's where it has several.
    delays_s : of all signals. cn0_dbhz : true times (n,) to (n, n_signals).
    point : the antenna's motion.
    knots_s, az_rad, el_rad : (n_knots,), (n_knots, n_signals), of the satellites as seen from the antenna that receives
        them; a meaconer's or a false place's for false signals.
    """

    receiver: SceneReceiver
    antenna: Antenna
    name: str
    number: int
    signals: tuple[ReceivedSignal, ...]
    delays_s: Delay
    cn0_dbhz: Callable[[ArrayLike], Reals]
    point: Point
    knots_s: Reals
    az_rad: Reals
    el_rad: Reals
    clock: Clock | None = None
    rays: tuple[Ray, ...] = ()
    noises: tuple[AddedNoise, ...] = ()
    jammers: tuple[Jammer, ...] = ()
    signal: SignalPlan = GPS_L1_CA

    def code_delay_s(self, true_s: ArrayLike) -> Reals:
        """Compute the code delays of all signals: times of any shape (...) to (..., n_signals)."""
        return self._at(true_s, 0)

    def carrier_delay_s(self, true_s: ArrayLike) -> Reals:
        """Compute the carrier delays of all signals: times of any shape (...) to (..., n_signals)."""
        return self._at(true_s, 1)

    def carrier_delay_rate(self, true_s: ArrayLike) -> Reals:
        """Compute the growth of the carriers' delays, s/s, by differences: (...) to (..., n_signals)."""
        at_s = np.asarray(true_s, np.float64)
        return np.asarray((self._at(at_s + _SHORT_S, 1) - self._at(at_s - _SHORT_S, 1)) / (2.0 * _SHORT_S))

    def noise_power(self, true_s: Reals) -> Reals:
        """Compute the power of all white noise at times (n,), over the receiver's own."""
        return np.ones(true_s.shape) + sum(noise.power_at(true_s) for noise in self.noises)

    def line_power(self, true_s: Reals, band_hz: float) -> Reals:
        """Compute the noise that lines and chirps are to a correlator at times (n,), over the receiver's own.

        band_hz : in which their power is over the receiver's noise.
        """
        chips_hz = self.signal.chip_rate_hz
        passed = sum(jammer.share_through(chips_hz) * jammer.power_at(true_s) for jammer in self.jammers)
        return np.zeros(true_s.shape) + passed * band_hz / chips_hz

    def _at(self, true_s: ArrayLike, which: int) -> Reals:
        at_s = np.asarray(true_s, np.float64)
        return self.delays_s(at_s.ravel())[which].reshape(*at_s.shape, len(self.signals))

    def true_minus_elapsed_s(self, elapsed_s: ArrayLike) -> Reals:
        """Compute true time minus the sampling clock's count, any shape.

        It is small, so that it keeps its digits.
        """
        elapsed_s = np.asarray(elapsed_s, np.float64)
        if self.clock is not None:
            return self.receiver.start_offset_s + self.clock.true_minus_shown_s(elapsed_s)
        fast = self.receiver.lo_ppm * 1e-6
        return np.asarray(self.receiver.start_offset_s - elapsed_s * (fast / (1.0 + fast)))

    def elapsed_at(self, true_s: ArrayLike) -> Reals:
        """Compute the sampling clock's count at a true time, any shape; beyond the recording roughly."""
        after_s = np.asarray(true_s, np.float64) - self.receiver.start_offset_s
        if self.clock is None:
            return np.asarray(after_s * (1.0 + self.receiver.lo_ppm * 1e-6))
        within_s = np.clip(after_s, -1.0, self.clock.duration_s)
        return np.asarray(after_s + self.clock.offset_s(within_s))


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """A scenario worked out: the sky of every antenna, and the messages.

    trajectories : of the receivers, by name. shown : where each attack puts whoever believes it.
    path_m : (n_attacks, n_antennas), main transmit antenna to antenna, at the onset.
    """

    scenario: Scenario
    navigation: NavigationData
    skies: tuple[ReceiverSky, ...]
    trajectories: dict[str, Trajectory]
    shown: tuple[Point, ...]
    path_m: Reals

    @property
    def labels(self) -> dict[SignalRef, str]:
        """Return the truth: "authentic" or "spoofed" for every signal at every antenna."""
        return {SignalRef(s.name, received.id): received.label for s in self.skies for received in s.signals}

    @cached_property
    def messages(self) -> Messages:
        """Encode every message that is received, over the whole scene."""
        scenario, nav = self.scenario, self.navigation
        names = tuple(sorted({(received.id.sat, received.message) for sky in self.skies for received in sky.signals}))
        attacks = dict(zip(scenario.attack_names, scenario.attacks, strict=True))
        week, tow_s = week_and_tow(scenario.start_gpst)
        first_s = min(sky.receiver.start_offset_s for sky in self.skies) - _SPARE_S
        last_s = max(float(sky.knots_s[-1]) for sky in self.skies) + _SPARE_S
        start = int((tow_s + first_s) // SUBFRAME_S) * SUBFRAME_S  # may lie before or after this week
        count = int((tow_s + last_s - start) // SUBFRAME_S) + 1
        symbols = []
        for number, (sat, variant) in enumerate(names):
            ephemeris = select_ephemeris(nav, sat, scenario)
            assert isinstance(ephemeris, Ephemeris)
            attack = attacks.get(variant)
            stated_s = start + (attack.message_later_s if attack is not None else 0)
            week_stated, tow_stated = divmod(week * 604_800 + stated_s, 604_800)
            bits = encode_subframes(ephemeris, nav.ionosphere, nav.utc, tow_stated, week_stated, count)
            if attack is not None and attack.message == "inverted":
                bits = 1 - bits
            elif attack is not None and attack.message == "random":
                rng = np.random.default_rng(np.random.SeedSequence(scenario.seed, spawn_key=(_MESSAGE_STREAM, number)))
                bits = rng.integers(0, 2, bits.size, dtype=bits.dtype)
            symbols.append((1 - 2 * bits).astype(np.int8))
        guess_s = [attacks[variant].guess_s if variant else 0.0 for _, variant in names]
        return Messages(
            names=names,
            symbols=np.stack(symbols),
            lead_s=tow_s - start,
            guesses=np.stack([self._draw_guesses(number, symbols[0].size) for number in range(len(names))]),
            guess_s=np.array(guess_s),
        )

    def _draw_guesses(self, number: int, count: int) -> NDArray[np.int8]:
        """Toss a coin: +1 and -1, for the message of that number."""
        rng = np.random.default_rng(np.random.SeedSequence(self.scenario.seed, spawn_key=(_GUESS_STREAM, number)))
        return (1 - 2 * rng.integers(0, 2, count)).astype(np.int8)


def select_ephemeris(navigation: NavigationData, sat: str, scenario: Scenario) -> BroadcastEphemeris | None:
    """Select one ephemeris for the whole scene; None if the satellite is unhealthy."""
    return navigation.best(sat, scenario.start_gpst)


def find_rows(messages: Messages, signals: Sequence[ReceivedSignal]) -> Integers:
    """Find the row of `messages.symbols` that each signal carries."""
    return np.array([messages.names.index((received.id.sat, received.message)) for received in signals], dtype=np.int64)


def stack_codes(signals: Sequence[ReceivedSignal], signal: SignalPlan) -> NDArray[np.int8]:
    """Stack the spreading codes, shape (n_signals, code_length)."""
    return np.stack([signal.code(prn_of(received.id.sat)) for received in signals])


def collect_windows(received: Sequence[ReceivedSignal]) -> Reals:
    """Collect when each signal is received, true times (n, n_windows, 2), filled up with infinity."""
    most = max(len(each.windows_s) for each in received)
    windows_s = np.full((len(received), most, 2), np.inf)
    for row, each in enumerate(received):
        windows_s[row, : len(each.windows_s)] = each.windows_s
    return windows_s
