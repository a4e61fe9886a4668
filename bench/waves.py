"""Samples of two signals of one satellite, chip by chip: as sharp as they are sent, in white noise."""

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Floats, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import GPS_L1_CA, prn_of

RATE_HZ = 2.6037e6
"""No whole number of samples a code period: with one, a signal of little Doppler is read at the same places of its
chips for seconds, and sharp chips alias into a metre of code."""
SAT = "G07"
CHIP_S = 1.0 / GPS_L1_CA.chip_rate_hz
CHIP_M = SPEED_OF_LIGHT_M_S * CHIP_S


@dataclass(frozen=True, kw_only=True)
class Wave:
    """One signal: a data bit begins at `delay_s` (less than 20 ms); there from `begin_s` on."""

    sat: str
    cn0_dbhz: float
    delay_s: float
    doppler_hz: float
    phase_cyc: float
    bits: Floats
    begin_s: float = 0.0

    def sent_s(self, t_s: Reals | float) -> Reals:
        """Time shown by the code, s."""
        return np.asarray(t_s * (1.0 + self.doppler_hz / GPS_L1_CA.carrier_hz) - self.delay_s)


def add(wave: Wave, first: int, planes: Floats, rate_hz: float = RATE_HZ) -> None:
    """Add a signal to samples, (2, n), of which the first has this number. Noise has variance 1 in I and in Q."""
    amplitude = math.sqrt(2.0 * 10.0 ** (0.1 * wave.cn0_dbhz) / rate_hz)
    skip = min(max(math.ceil(wave.begin_s * rate_hz) - first, 0), planes.shape[1])
    t_s = (first + skip) / rate_hz
    _add(
        GPS_L1_CA.code(prn_of(wave.sat)),
        wave.bits,
        float(wave.sent_s(t_s)) / CHIP_S,
        (1.0 + wave.doppler_hz / GPS_L1_CA.carrier_hz) / CHIP_S / rate_hz,
        (wave.phase_cyc + wave.doppler_hz * t_s) % 1.0,
        wave.doppler_hz / rate_hz,
        amplitude,
        planes[:, skip:],
    )


@numba.njit(cache=True, nogil=True)
def _add(
    code: NDArray[np.int8],
    bits: Floats,
    chip: float,
    chip_step: float,
    cycle: float,
    cycle_step: float,
    amplitude: float,
    planes: Floats,
) -> None:
    step = complex(math.cos(2.0 * math.pi * cycle_step), math.sin(2.0 * math.pi * cycle_step))
    turn = amplitude * complex(math.cos(2.0 * math.pi * cycle), math.sin(2.0 * math.pi * cycle))
    per_bit = 20 * code.shape[0]
    for i in range(planes.shape[1]):
        now = math.floor(chip + i * chip_step) + per_bit  # a bit before the first, for delays
        value = bits[now // per_bit] * code[now % code.shape[0]]
        planes[0, i] += value * turn.real
        planes[1, i] += value * turn.imag
        turn *= step


def noise(rng: np.random.Generator, n: int) -> Floats:
    """Samples of receiver noise, (2, n)."""
    return rng.standard_normal((2, n), dtype=np.float32)


def bits(rng: np.random.Generator, duration_s: float) -> Floats:
    """Data bits for so long and a delay."""
    return rng.choice(np.array([-1.0, 1.0], np.float32), math.ceil(50.0 * duration_s) + 3)


@dataclass(frozen=True, kw_only=True)
class Cell:
    """Second signal beside the first: separation (that in the middle of where errors are taken), power, Doppler."""

    apart_chips: float
    relative_db: float
    apart_hz: float
    cn0_dbhz: float = 45.0  # of the first
    rate_hz: float = RATE_HZ


def pair_of(
    rng: np.random.Generator, cell: Cell, onset_s: float, middle_s: float, duration_s: float
) -> tuple[Wave, Wave]:
    """A pair with the same data, the second from `onset_s` on; as far apart as the cell says at `middle_s`."""
    sign = rng.choice([-1.0, 1.0])
    apart_hz = cell.apart_hz * rng.choice([-1.0, 1.0])
    doppler_hz, delay_s = rng.uniform(-4000.0, 4000.0), rng.uniform(2e-5, 0.0198)
    data = bits(rng, duration_s)
    later_s = sign * cell.apart_chips * CHIP_S + apart_hz / GPS_L1_CA.carrier_hz * middle_s
    first = Wave(
        sat=SAT, cn0_dbhz=cell.cn0_dbhz, delay_s=delay_s, doppler_hz=doppler_hz, phase_cyc=rng.random(), bits=data
    )
    second = Wave(
        sat=SAT,
        cn0_dbhz=cell.cn0_dbhz + cell.relative_db,
        delay_s=delay_s + later_s,
        doppler_hz=doppler_hz + apart_hz,
        phase_cyc=rng.random(),
        bits=data,
        begin_s=onset_s,
    )
    return first, second
