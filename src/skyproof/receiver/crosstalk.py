"""What another signal of the same satellite does to a measured code.

Away from its peak a code's autocorrelation is not zero: that of C/A has steps of 0.06 between neighbouring chips. So a
second signal of the satellite adds a slope under the peak of the first, whose sign turns with the carrier's phase
between the two, and the code that is measured swings with it: multipath (Kaplan & Hegarty, 9.5) whose delay and
amplitude are known. With two signals of equal strength it is 1 to 5 m, with one 20 dB weaker ten times that.
"""

from functools import cache

import numpy as np
from scipy import fft

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import SignalDescription
from skyproof.receiver.replica import passed
from skyproof.records import Observations, Reals

__all__ = ["crosstalk_sigma_m"]

_STEPS = 16
"""Points a chip at which correlations are tabled."""


def crosstalk_sigma_m(
    observations: Observations, signal: SignalDescription, *, rate_hz: float, early_late_chips: float
) -> Reals:
    """One sigma of the swing of each pseudorange, (n_epochs, n_signals), metres; zero where a satellite has one signal.

    Over all phases between the carriers, as long as they turn little in an epoch; less by so much as they turn more.

    Parameters
    ----------
    rate_hz : of the samples. early_late_chips : between the early and the late replica, as they were.
    """
    chip_m = SPEED_OF_LIGHT_M_S / signal.chip_rate_hz
    variance_m2 = np.zeros(observations.pseudorange_m.shape)
    columns: dict[str, list[int]] = {}
    for column, one in enumerate(observations.signals):
        columns.setdefault(one.sat, []).append(column)
    for sat, own in columns.items():
        slope = _slope(signal, sat, signal.chip_rate_hz / rate_hz, early_late_chips) if len(own) > 1 else None
        for victim in own:
            for other in own:
                if slope is None or other == victim:
                    continue
                apart = (observations.pseudorange_m[:, other] - observations.pseudorange_m[:, victim]) / chip_m
                stronger_db = observations.cn0_dbhz[:, other] - observations.cn0_dbhz[:, victim]
                turns = np.abs(observations.doppler_hz[:, other] - observations.doppler_hz[:, victim])
                turns *= np.pi * observations.averaged_s
                there = np.isfinite(apart) & np.isfinite(stronger_db) & np.isfinite(turns)
                places = np.arange(slope.size + 1) / _STEPS
                at = np.interp(np.where(there, apart, 0.0) % (slope.size / _STEPS), places, np.append(slope, slope[0]))
                swing_m = chip_m * np.abs(at) * 10.0 ** (stronger_db / 20.0) / np.maximum(turns, 1.0)
                variance_m2[:, victim] += np.where(there, 0.5 * swing_m**2, 0.0)
    return np.sqrt(variance_m2)


@cache
def _slope(signal: SignalDescription, sat: str, chips_per_sample: float, early_late_chips: float) -> Reals:
    """Error of the code (chips) by a signal of equal strength, in phase, so many 1/16 chips later."""
    code = signal.code(int(sat[1:])).astype(np.float64)
    lines = np.zeros(code.size * _STEPS)
    lines[::_STEPS] = fft.irfft(np.abs(fft.rfft(code)) ** 2, code.size)
    cycles = fft.fftfreq(lines.size, 1.0 / _STEPS)  # a chip
    passing = np.where(np.abs(cycles) * chips_per_sample < 0.5, passed(cycles * chips_per_sample), 0.0)
    early_minus_late = fft.fft(lines) * np.sinc(cycles) ** 2 * passing * 2j * np.sin(np.pi * cycles * early_late_chips)
    steepness = fft.ifft(early_minus_late * 2j * np.pi * cycles).real[0]  # under the signal's own peak
    return np.asarray(fft.ifft(early_minus_late).real / steepness)
