"""Make samples of signals whose motion is known in closed form, to measure a receiver with.

Scenes (`scenario`, `sky`) have the geometry of a sky. Here delay, Doppler, acceleration and jumps of the carrier are
given directly, and the truth is a polynomial.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import GPS_L1_CA, SignalPlan
from skyproof.records import SignalId
from skyproof.simulator.platforms import make_trajectory
from skyproof.simulator.received import Messages, ReceivedSignal, ReceiverSky, stack_codes
from skyproof.simulator.samples import Rendering, filter_codes
from skyproof.simulator.scenario import FrontEnd, SceneReceiver

__all__ = ["SignalDelays", "make_ideal_signals"]

_SPARE_S = 2.0  # of message before the first sample and after the last


@dataclass(frozen=True, eq=False, kw_only=True)
class SignalDelays:
    """Delays of n signals over receiver time, which here is true time.

    delay_s, doppler_hz : (n,) at time 0.
    accelerations : (from when, m/s^2) in order; each holds until the next, positive away from the receiver.
    jumps : (when, cycles): the received carrier's phase grows by so much at once, all signals' alike. The rendering
        takes one chunk of samples for it.
    """

    delay_s: Reals
    doppler_hz: Reals
    accelerations: tuple[tuple[float, float], ...] = ()
    jumps: tuple[tuple[float, float], ...] = ()
    signal: SignalPlan = GPS_L1_CA

    def code_delay_s(self, elapsed_s: ArrayLike) -> Reals:
        """Compute the delay of the code, (n_times, n)."""
        t = np.asarray(elapsed_s, np.float64)
        bent_s = np.zeros(t.shape)
        before = 0.0
        for start_s, acceleration in self.accelerations:
            bent_s += 0.5 * (acceleration - before) / SPEED_OF_LIGHT_M_S * np.maximum(t - start_s, 0.0) ** 2
            before = acceleration
        run_s = np.multiply.outer(t, self.doppler_hz / self.signal.carrier_hz)
        return np.asarray(self.delay_s - run_s + bent_s[:, None])

    def carrier_delay_s(self, elapsed_s: ArrayLike) -> Reals:
        """Compute the delay of the carrier, (n_times, n)."""
        t = np.asarray(elapsed_s, np.float64)
        jumped_cyc = sum((cycles * (t >= at_s) for at_s, cycles in self.jumps), np.zeros(t.shape))
        return np.asarray(self.code_delay_s(t) - jumped_cyc[:, None] / self.signal.carrier_hz)

    def doppler_at_hz(self, elapsed_s: ArrayLike) -> Reals:
        """Compute the Doppler of the carrier, (n_times, n)."""
        t = np.asarray(elapsed_s, np.float64)
        moved_hz = np.zeros(t.shape)
        before = 0.0
        for start_s, acceleration in self.accelerations:
            rate_hz_s = (acceleration - before) / SPEED_OF_LIGHT_M_S * self.signal.carrier_hz
            moved_hz -= rate_hz_s * np.maximum(t - start_s, 0.0)
            before = acceleration
        return np.asarray(self.doppler_hz + moved_hz[:, None])


def make_ideal_signals(
    sats: Sequence[str],
    motion: SignalDelays,
    cn0_dbhz: ArrayLike,
    front_end: FrontEnd,
    *,
    duration_s: float,
    seed: int = 0,
) -> Rendering:
    """Make signals (n,) of satellites in receiver noise, with random data bits, for `render`.

    cn0_dbhz : (n,) or one for all; constant.
    """
    signal, n = motion.signal, len(sats)
    cn0 = np.broadcast_to(np.asarray(cn0_dbhz, np.float64), (n,))
    received = tuple(ReceivedSignal(SignalId(sat), "sky", "authentic", ((-np.inf, np.inf),)) for sat in sats)

    def strength(elapsed_s: ArrayLike) -> Reals:
        return np.broadcast_to(cn0, (*np.shape(elapsed_s), n))

    receiver = SceneReceiver(name="ideal", lat_deg=0.0, lon_deg=0.0, height_m=0.0)
    standing = make_trajectory(receiver, "ideal")
    sky = ReceiverSky(
        receiver=receiver,
        antenna=receiver.antennas[0],
        name=receiver.name,
        number=0,
        signals=received,
        delays_s=lambda elapsed_s: (motion.code_delay_s(elapsed_s), motion.carrier_delay_s(elapsed_s)),
        cn0_dbhz=strength,
        point=standing.at,
        knots_s=np.array([0.0, duration_s]),
        az_rad=np.zeros((2, n)),
        el_rad=np.zeros((2, n)),
        signal=signal,
    )
    symbol_s = signal.period_s * signal.periods_per_symbol
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1 << 20,)))
    symbols = 1 - 2 * rng.integers(0, 2, (n, int((duration_s + 2.0 * _SPARE_S) / symbol_s)), dtype=np.int8)
    codes = stack_codes(received, signal)
    return Rendering(
        sky=sky,
        front_end=front_end,
        seed=seed,
        n_samples=int(duration_s * front_end.rate_hz) // 8 * 8,
        codes=codes,
        waves=filter_codes(codes, signal.chip_rate_hz, front_end),
        messages=Messages(
            names=tuple((sat, "") for sat in sats),
            symbols=symbols,
            lead_s=_SPARE_S,
            guesses=symbols,
            guess_s=np.zeros(n),
        ),
        carried=np.arange(n),
    )
