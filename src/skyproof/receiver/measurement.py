"""Code periods of one channel to one measurement at a common receiver time.

The loops' own states are correlated in time. What is measured here is not them but the mean over the interval of the
code phase used plus the discriminator: white from epoch to epoch, whatever the loop bandwidth.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skyproof.gnss.signals import SignalDescription
from skyproof.receiver import kernels as k


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """One channel at one receiver time.

    periods, fraction_s : time that the received code shows, since the start of the channel's code period 0: whole code
        periods, and the rest in seconds.
    carrier_cyc : grows with the range; arbitrary start.
    """

    periods: int
    fraction_s: float
    carrier_cyc: float
    doppler_hz: float
    cn0_dbhz: float
    code_sigma_s: float
    carrier_sigma_cyc: float
    doppler_sigma_hz: float


def measure(
    rows: NDArray[np.float64], elapsed_s: float, rate_hz: float, if_hz: float, signal: SignalDescription,
    early_late_chips: float, pll_bandwidth_hz: float,
) -> Measurement:  # fmt: skip
    """Measurement at receiver time `elapsed_s` from the periods (n, columns of the kernel's output) around it.

    Every period's code phase is carried to the epoch by the carrier, which makes the mean right under any motion that
    the phase loop follows.
    """
    starts = rows[:, k.OUT_START]
    epoch = elapsed_s * rate_hz
    here = max(int(np.searchsorted(starts, epoch, side="right")) - 1, 0)
    phase = rows[here, k.OUT_PHASE] + rows[here, k.OUT_FREQUENCY] * (epoch - starts[here]) / rate_hz
    ahead_s = (epoch - starts) / rate_hz
    carrier_ahead_s = (phase - rows[:, k.OUT_PHASE] - if_hz * ahead_s) / signal.carrier_hz
    period = rows[here, k.OUT_PERIOD]
    code_s = (rows[:, k.OUT_PERIOD] - period) * signal.period_s + (
        rows[:, k.OUT_CHIP] + rows[:, k.OUT_CODE_ERROR]
    ) / signal.chip_rate_hz
    first, last = rows[0], rows[-1]
    span_s = (last[k.OUT_START] - first[k.OUT_START]) / rate_hz
    doppler_hz = (last[k.OUT_PHASE] - first[k.OUT_PHASE]) / span_s - if_hz
    duration_s = rows.shape[0] * signal.period_s
    cn0_hz = carrier_to_noise_hz(rows[:, k.OUT_TAPS + 2], rows[:, k.OUT_TAPS + 3], signal.period_s)
    code_sigma_s = code_sigma_chips(cn0_hz, early_late_chips, duration_s, signal.period_s) / signal.chip_rate_hz
    carrier_sigma_cyc = phase_sigma_cyc(cn0_hz, pll_bandwidth_hz, signal.period_s)
    return Measurement(
        periods=int(period),
        fraction_s=float(np.mean(code_s + ahead_s + carrier_ahead_s)),
        carrier_cyc=float(if_hz * elapsed_s - phase),
        doppler_hz=float(doppler_hz),
        cn0_dbhz=float(10.0 * np.log10(cn0_hz)),
        code_sigma_s=code_sigma_s,
        carrier_sigma_cyc=carrier_sigma_cyc,
        doppler_sigma_hz=np.sqrt(2.0) * carrier_sigma_cyc / duration_s,
    )


def carrier_to_noise_hz(i_prompt: NDArray[np.float64], q_prompt: NDArray[np.float64], period_s: float) -> float:
    """C/N0 as a ratio in hertz of a phase-locked signal: I carries signal and noise, Q noise alone.

    The difference of the mean squares is free of noise bias at any C/N0. At least 10 dB-Hz is returned.
    """
    noise = float(np.mean(q_prompt**2))
    signal = float(np.mean(i_prompt**2)) - noise
    return max(signal / (2.0 * noise * period_s), 10.0) if noise > 0.0 else 10.0


def code_sigma_chips(cn0_hz: float, early_late_chips: float, duration_s: float, period_s: float) -> float:
    """Thermal noise of a dot-product discriminator averaged over `duration_s`, chips.

    Kaplan & Hegarty, eq. 8.81 with the loop's noise bandwidth replaced by that of the average, 1/(2 duration).
    """
    squaring = 1.0 + 1.0 / (cn0_hz * period_s)
    return float(np.sqrt(early_late_chips / (4.0 * duration_s * cn0_hz) * squaring))


def phase_sigma_cyc(cn0_hz: float, bandwidth_hz: float, period_s: float) -> float:
    """Thermal noise of a Costas loop, cycles (Kaplan & Hegarty, eq. 8.74)."""
    return float(np.sqrt(bandwidth_hz / cn0_hz * (1.0 + 0.5 / (cn0_hz * period_s))) / (2.0 * np.pi))
