"""Measure code phase and Doppler of a signal in a recording too short to track: tens of milliseconds at once.

The signal is wiped off with what the search found, period by period; the edge of its bits, the bits and the Doppler are
those with which the whole recording sums up best; and the delay is moved until early and late replicas agree. Coherent
over everything, this is maximum likelihood, so that both come as exact as the noise lets them.
"""

from dataclasses import dataclass
from math import gcd
from typing import Final

import numpy as np

from skyproof.arrays import Complexes, Floats, Integers, Reals
from skyproof.gnss.signals import GPS_L1_CA, SignalPlan, prn_of

__all__ = ["CodePhase", "estimate_symbols", "grid_sigma_chips", "measure_code_phase", "sample_code", "spacing_chips"]

_MAX_SYMBOLS: Final = 9  # 0.16 s: all their signs are tried
_NARROWEST_CHIPS: Final = 0.1
_ROUNDS: Final = 4  # from 0.5 chips off, each leaves a few hundredths of what the one before did
_OFFSETS: Final = np.array([-0.3, -0.15, 0.0, 0.15, 0.3])


@dataclass(frozen=True, kw_only=True)
class CodePhase:
    """One signal at one instant, the middle of the samples.

    elapsed_s : that instant, from the first sample on.
    code_s, code_sigma_s : time that the received code shows, modulo its period.
    doppler_hz, doppler_sigma_hz : apparent minus nominal carrier.
    found : False where early and late never agreed, so that the numbers are without meaning.
    """

    sat: str
    elapsed_s: float
    code_s: float
    code_sigma_s: float
    doppler_hz: float
    doppler_sigma_hz: float
    cn0_dbhz: float
    found: bool


def measure_code_phase(
    samples: Floats,
    rate_hz: float,
    if_hz: float,
    sat: str,
    delay_s: float,
    doppler_hz: float,
    *,
    doppler_reach_hz: float = 40.0,
    signal: SignalPlan = GPS_L1_CA,
) -> CodePhase:
    """Measure the fine delay and Doppler of a signal that a search found.

    Parameters
    ----------
    samples : (2, n) I and Q (Q zero for real samples), at most 0.16 s.
    if_hz : where the nominal carrier lies in them.
    delay_s, doppler_hz : where a code period begins, from the first sample on (at Doppler's pace), and the apparent
        minus nominal carrier: right to half a chip and `doppler_reach_hz`.

    The replicas stand one sample apart, at least a tenth of a chip. In white noise over the band of the samples the
    variance is then (chips between them) / (4 T C/N0). For chips with steep edges this is the Cramer-Rao bound of that
    band (Betz and Kolodziejski, "Generalized theory of code tracking", part I, IEEE Trans. AES 45(4), 2009). That of
    the Doppler is 6 / (4 pi^2 T^3 C/N0) (Rife and Boorstyn, "Single-tone parameter estimation from discrete-time
    observations", IEEE Trans. IT 20(5), 1974). The error of the grid of samples is added to the former. Samples that no
    filter limits to their band, as simulated ones, hold more information: their sigma is too large.

    Raises
    ------
    ValueError : the samples are shorter than two code periods or longer than can be summed up.
    """
    n = samples.shape[1]
    duration_s = n / rate_hz
    longest_s = (_MAX_SYMBOLS - 1) * signal.symbol_s
    if not 2.0 * signal.period_s <= duration_s <= longest_s:
        raise ValueError(f"{duration_s:g} s of samples; expected {2.0 * signal.period_s:g} to {longest_s:g} s")
    middle_s = 0.5 * (n - 1) / rate_hz
    k = np.arange(n)
    turn = np.exp(-2j * np.pi * np.mod((if_hz + doppler_hz) / rate_hz * k, 1.0))
    base = (samples[0] + 1j * samples[1]) * turn
    grid = grid_sigma_chips(rate_hz, signal)
    spacing = spacing_chips(rate_hz, signal)
    code = signal.code(prn_of(sat)).astype(np.float64)
    chip_rate_hz = signal.chip_rate_hz * (1.0 + doppler_hz / signal.carrier_hz)
    chip = (middle_s - delay_s) * chip_rate_hz  # at the middle
    searched_chip, off_hz, sign, error, sigma = chip, 0.0, np.ones(0), np.inf, 0.0
    for number in range(_ROUNDS):
        chips = chip + (k / rate_hz - middle_s) * chip_rate_hz
        period = np.floor(chips / code.size).astype(np.int64)
        first = np.flatnonzero(np.diff(period, prepend=period[0] - 1))
        centre_s = (first + np.append(first[1:], n) - 1) / 2.0 / rate_hz - middle_s
        prompt = np.add.reduceat(base * sample_code(code, chips, 0.0), first)
        if number < 2 or sign.size != prompt.size:  # the delay found in the first round makes the second's bits surer
            off_hz, sign = estimate_symbols(prompt, centre_s, period[first], doppler_reach_hz, duration_s, signal)
        wiped = sign * np.exp(-2j * np.pi * off_hz * centre_s)
        total = complex(prompt @ wiped)
        cn0_hz = _carrier_to_noise_hz(base, total, rate_hz)
        sigma = float(np.sqrt(spacing / (4.0 * duration_s * cn0_hz) + grid**2))
        # The samples' grid makes early minus late a staircase: the mean over some delays climbs it evenly.
        errors = []
        for offset in spacing * (_OFFSETS if number == _ROUNDS - 1 else _OFFSETS[2:3]):
            apart = sample_code(code, chips, offset + spacing / 2) - sample_code(code, chips, offset - spacing / 2)
            difference = np.add.reduceat(base * apart, first) @ wiped
            errors.append(offset + float((difference * np.conj(total)).real / abs(total) ** 2) / 2.0)
        error = float(np.mean(errors))
        error /= 1.0 + abs(error)  # the prompt of a replica that is off is that much smaller
        chip += error
    return CodePhase(
        sat=sat,
        elapsed_s=middle_s,
        code_s=float(np.mod(chip, code.size) / signal.chip_rate_hz),
        code_sigma_s=sigma / signal.chip_rate_hz,
        doppler_hz=doppler_hz + off_hz,
        doppler_sigma_hz=float(np.sqrt(6.0 / (4.0 * np.pi**2 * duration_s**3 * cn0_hz))),
        cn0_dbhz=float(10.0 * np.log10(cn0_hz)),
        found=abs(error) < 3.0 * sigma and abs(chip - searched_chip) < 1.0,
    )


def spacing_chips(rate_hz: float, signal: SignalPlan) -> float:
    """Return the spacing of the early and the late replica: one sample, at least a tenth of a chip."""
    return max(signal.chip_rate_hz / rate_hz, _NARROWEST_CHIPS)


def grid_sigma_chips(rate_hz: float, signal: SignalPlan) -> float:
    """Return the error that samples of steep edges leave without any noise, one sigma, chips.

    An edge lies anywhere between two samples: 1/sqrt(12) of their distance. The edges of a period, half as many as
    chips, share the error of one only as far as they fall between the samples differently: where the samples of a
    period and its chips have a common divisor, few places are left, and at 16/3 samples a chip three.
    """
    per_period = rate_hz * signal.period_s
    whole = round(per_period)
    places = signal.code_length / (gcd(whole, signal.code_length) if abs(per_period - whole) < 1e-6 else 1)
    return float(signal.chip_rate_hz / rate_hz / np.sqrt(12.0) / min(places, np.sqrt(signal.code_length / 2.0)))


def sample_code(code: Reals, chips: Reals, ahead_chips: float) -> Reals:
    """Return the code (n_chips,) where it stands at `chips` and so much ahead."""
    return code[np.floor(chips + ahead_chips).astype(np.int64) % code.size]


def estimate_symbols(
    prompt: Complexes,
    centre_s: Reals,
    period: Integers,
    reach_hz: float,
    duration_s: float,
    signal: SignalPlan,
) -> tuple[float, Reals]:
    """Estimate the residual frequency of the prompts (n,), and the signs (n,) of their symbols with the best sum."""
    step_hz = 0.25 / duration_s
    grid_hz = np.arange(-np.ceil(reach_hz / step_hz), np.ceil(reach_hz / step_hz) + 1.0) * step_hz
    turned = prompt * np.exp(-2j * np.pi * grid_hz[:, None] * centre_s)  # (n_frequencies, n)
    best, peak_hz, sign = -1.0, 0.0, np.ones(prompt.size)
    for edge in range(signal.periods_per_symbol):
        symbol = (period - edge) // signal.periods_per_symbol
        symbol = symbol - symbol[0]
        signs = 1.0 - 2.0 * ((np.arange(2 ** symbol[-1])[:, None] << 1 >> np.arange(symbol[-1] + 1)) & 1)
        sums = np.add.reduceat(turned, np.flatnonzero(np.diff(symbol, prepend=-1)), axis=1)
        power = np.abs(sums @ signs.T)
        row, column = np.unravel_index(int(np.argmax(power)), power.shape)
        if power[row, column] > best:
            best, peak_hz, sign = float(power[row, column]), float(grid_hz[row]), signs[column][symbol]
    for width_hz in (step_hz, step_hz / 8.0):  # the peak of a parabola through three, twice
        near_hz = peak_hz + width_hz * np.arange(-1, 2)
        three = np.abs((prompt * sign) @ np.exp(-2j * np.pi * near_hz * centre_s[:, None])) ** 2
        bend = three[0] - 2.0 * three[1] + three[2]
        if bend < 0.0:
            peak_hz += float(np.clip(0.5 * (three[0] - three[2]) / bend, -1.0, 1.0)) * width_hz
    return peak_hz, sign


def _carrier_to_noise_hz(base: Complexes, total: complex, rate_hz: float) -> float:
    """Estimate C/N0 from the power of the sum and that of the samples; >= 10 Hz.

    The signal's share in the samples' power is negligible.
    """
    noise = float(np.mean(base.real**2 + base.imag**2))
    return max((abs(total) ** 2 / base.size - noise) / (noise * base.size) * rate_hz, 10.0)
