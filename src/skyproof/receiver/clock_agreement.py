"""Test if codes and carriers run at rates that belong together, and correct how a recording is read.

A signal's code and carrier come from one clock. A recorder with one oscillator keeps them together, however far it is
off. If the stated sample rate is wrong by the share w, all codes seem to run faster than their carriers by w. Carriers
at zero intermediate frequency do not change. If the stated carrier frequency is wrong by some hertz, all carriers are
off, and the codes are right. The size shows which of the two is wrong. Right values put satellites about as far on one
side of zero as on the other, but for the oscillator's few parts in a million.

Loops that take the code's rate from the carrier's lose a code that parts from it by a chip a second.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.gnss.signals import GPS_L1_CA, SignalPlan
from skyproof.receiver import measurement as m
from skyproof.receiver.measurement import Measurements
from skyproof.recording.survey import Survey, estimate_oscillator_error
from skyproof.records import Samples

__all__ = ["Disagreement", "correct_samples", "estimate_from_survey", "estimate_from_tracks"]

LEAST_SATS: Final = 4
CERTAIN_SIGMAS: Final = 6.0
LEAST: Final = 1e-8
"""Less than that parts code and carrier by a tenth of a chip in ten seconds, which the loops' slow mean follows."""
_LEAST_SURVEYED: Final = 1e-7
_OSCILLATOR_HZ: Final = 3e3  # at L1, of 2 ppm
_LONG_S: Final = 1.0
_LEAST_ROWS: Final = 4


@dataclass(frozen=True, kw_only=True)
class Disagreement:
    """How much faster all codes run than their carriers say, as a share of the rate, with one sigma.

    oscillator_hz : the Doppler common to all carriers, with one sigma. certain : whether it is there and worth a
        correction. carrier_hz : nominal.
    """

    code_minus_carrier: float
    sigma: float
    oscillator_hz: float
    oscillator_sigma_hz: float
    certain: bool
    carrier_hz: float

    @property
    def of_carrier(self) -> bool:
        """Tell if the carriers are off: by more than oscillators are, and the codes clearly less."""
        codes_hz = self.oscillator_hz + self.code_minus_carrier * self.carrier_hz
        least_hz = max(abs(codes_hz), _OSCILLATOR_HZ) + 2.0 * self.oscillator_sigma_hz
        return least_hz < abs(self.oscillator_hz)


def estimate_from_survey(
    survey: Survey, dopplers_hz: Mapping[str, float], *, signal: SignalPlan = GPS_L1_CA
) -> Disagreement | None:
    """Estimate the disagreement from a survey of the first half second; None if it does not show it.

    `dopplers_hz` : one a satellite.
    """
    if len(dopplers_hz) < LEAST_SATS or not math.isfinite(survey.clock_minus_lo_ppm):
        return None
    share, sigma = -1e-6 * survey.clock_minus_lo_ppm, 1e-6 * survey.clock_minus_lo_sigma_ppm
    return _build_disagreement(share, sigma, list(dopplers_hz.values()), _LEAST_SURVEYED, signal)


def estimate_from_tracks(
    measured: Measurements, sat_of: Mapping[int, str], *, signal: SignalPlan = GPS_L1_CA
) -> Disagreement | None:
    """Estimate the disagreement from the drift of code against carrier of signals followed for a second or more.

    sat_of : the satellite of each arc. None if there are fewer than four such satellites.

    Of each satellite its longest arc counts. The median of the satellites is taken, so that one or two that an attacker
    or a reflection drags off do not move it. Its sigma is that of a median of as many normal values, by the greater of
    their own sigmas and their scatter.
    """
    code_s = (
        measured.column(m.PERIODS) * signal.period_s
        - measured.elapsed_s
        + measured.column(m.FRACTION_S)
        + measured.column(m.CARRIER_CYC) / signal.carrier_hz
    )
    longest: dict[str, tuple[float, float, float, float]] = {}
    for arc in np.unique(measured.arc):
        rows = np.flatnonzero((measured.arc == arc) & np.isfinite(code_s))
        if rows.size < _LEAST_ROWS or arc not in sat_of:
            continue
        length_s = float(np.ptp(measured.elapsed_s[rows]))
        if length_s >= max(_LONG_S, longest.get(sat_of[int(arc)], (0.0,))[0]):
            slope, sigma = _fit_slope(measured.elapsed_s[rows], code_s[rows], measured.column(m.CODE_SIGMA_S)[rows])
            doppler_hz = float(np.median(measured.column(m.DOPPLER_HZ)[rows]))
            longest[sat_of[int(arc)]] = length_s, slope, sigma, doppler_hz
    if len(longest) < LEAST_SATS:
        return None
    _, slopes, sigmas, dopplers_hz = np.array(list(longest.values())).T
    middle = float(np.median(slopes))
    scatter = 1.4826 * float(np.median(np.abs(slopes - middle)))
    sigma = math.sqrt(math.pi / 2.0 / slopes.size) * max(scatter, float(np.median(sigmas)))
    return _build_disagreement(middle, sigma, dopplers_hz, LEAST, signal)


def _build_disagreement(
    share: float, sigma: float, dopplers_hz: Sequence[float] | Reals, least: float, signal: SignalPlan
) -> Disagreement:
    oscillator = estimate_oscillator_error(dopplers_hz)
    return Disagreement(
        code_minus_carrier=share,
        sigma=sigma,
        oscillator_hz=oscillator.doppler_hz,
        oscillator_sigma_hz=oscillator.sigma_hz,
        certain=abs(share) > max(least, CERTAIN_SIGMAS * sigma),
        carrier_hz=signal.carrier_hz,
    )


def _fit_slope(time_s: Reals, values: Reals, sigmas: Reals) -> tuple[float, float]:
    """Fit the slope of a straight line, and its sigma by the stated ones."""
    centred = time_s - time_s.mean()
    power = float(centred @ centred)
    return float(centred @ values) / power, float(np.sqrt(np.mean(sigmas**2) / power))


def correct_samples(samples: Samples, found: Disagreement, *, signal: SignalPlan = GPS_L1_CA) -> Samples:
    """Correct the rate, or the intermediate frequency, of a recording so that codes and carriers agree.

    A rate that is too high by the share w lifts codes by w and carriers by w times their frequency in the samples.
    """
    if found.of_carrier:
        return replace(samples, if_hz=samples.if_hz - found.code_minus_carrier * signal.carrier_hz)
    carrier_hz = samples.if_hz + signal.carrier_hz - samples.centre_hz
    return replace(
        samples, rate_hz=samples.rate_hz / (1.0 + found.code_minus_carrier / (1.0 - carrier_hz / signal.carrier_hz))
    )
