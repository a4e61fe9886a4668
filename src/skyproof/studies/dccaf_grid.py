"""Studies of the grid itself, from samples: what the correlation over delay and Doppler looks like with one signal and
with two, and its noise (Ahmed, Khanafseh, Pervan: figures 2 and 3, known by their captions only).

Signals are made from the codes of real satellites in the band of an ideal front end: a code's spectrum has a line each
kilohertz, so delays and the band are exact. None of the correlation functions of
`decomposition` are used.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import find_peaks

from skyproof.arrays import Complexes, Reals
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.report.chart import Axes
from skyproof.studies.base import Claim, Row, Study, StudySettings, value_of
from skyproof.studies.decomposition_laws import noise_variance

__all__ = ["STUDIES_OF_THE_GRID"]

PAPER: Final = "Ahmed, Khanafseh, Pervan, decomposition of the cross-ambiguity function with inverse RAIM and inertia"
_CHIPS = 1023
_CODE_S: Final = 1e-3
_BIT_S: Final = 0.02
_CN0_DBHZ: Final = 45.0
_SATELLITES: Final = 12
_PART_S: Final = 1e-5  # sums over this before Dopplers are taken out: 4 kHz lose 0.3 % of amplitude
_PROMINENT: Final = 0.12  # three times the noise


# Samples --------------------------------------------------------------------------------------------------------------


def _period(prn: int, rate_hz: float, delay_chips: ArrayLike) -> Reals:
    """Return one period (..., samples) of a code of unit power before the band limit, delayed (...)."""
    samples = round(rate_hz * _CODE_S)
    half = (samples - 1) // 2
    line = np.arange(-half, half + 1)
    chips = np.fft.fft(GPS_L1_CA.code(prn).astype(np.float64)) / _CHIPS
    spectrum = chips[line % _CHIPS] * np.sinc(line / _CHIPS)
    later = np.exp(-2j * np.pi * line * np.asarray(delay_chips, np.float64)[..., None] / _CHIPS)
    whole = np.zeros((*later.shape[:-1], samples), np.complex128)
    whole[..., line] = spectrum * later
    return np.asarray(np.fft.ifft(whole, axis=-1).real * samples)


def _signal(prn: int, rate_hz: float, coherent_s: float, delay_chips: float, doppler_hz: float) -> Complexes:
    """Samples (n,) of a signal whose phase is zero at mid-interval."""
    periods = round(coherent_s / _CODE_S)
    code = np.tile(_period(prn, rate_hz, delay_chips), periods)
    return np.asarray(code * np.exp(2j * np.pi * doppler_hz * (_times(code.size, rate_hz) - 0.5 * coherent_s)))


def _times(n: int, rate_hz: float) -> Reals:
    return np.asarray((np.arange(n) + 0.5) / rate_hz)


def _noise(n: int, rate_hz: float, rng: np.random.Generator) -> Complexes:
    sigma = np.sqrt(0.5 * rate_hz / 10.0 ** (0.1 * _CN0_DBHZ))
    return np.asarray(sigma * (rng.standard_normal(n) + 1j * rng.standard_normal(n)))


def _correlate(samples: Complexes, prn: int, rate_hz: float, delays_chips: Reals, dopplers_hz: Reals) -> Complexes:
    """Correlate a grid (dopplers, delays), one where a signal of amplitude one is met."""
    replicas = _period(prn, rate_hz, delays_chips)
    power = np.mean(replicas[0] ** 2)
    part = round(_PART_S * rate_hz)
    periods = samples.size // replicas.shape[1]
    sums = (samples.reshape(periods, 1, -1) * replicas).reshape(periods, len(replicas), -1, part).mean(axis=-1)
    sums = np.moveaxis(sums, 1, 0).reshape(len(replicas), -1) / power
    times = _times(sums.shape[1], 1.0 / _PART_S) - 0.5 * samples.size / rate_hz
    return np.asarray(np.exp(-2j * np.pi * dopplers_hz[:, None] * times) @ sums.T / sums.shape[1])


# The studies ----------------------------------------------------------------------------------------------------------


_CASES: Final = {
    "one signal": ((1.0, 0.0, 0.0),),
    "two, 1.5 chip and 300 Hz apart": ((1.0, 0.0, 0.0), (0.87j, 1.5, 300.0)),
    "two, 0.25 chip apart": ((1.0, 0.0, 0.0), (0.87j, 0.25, 0.0)),
}
"""Amplitude, delay (chips) and Doppler (Hz) of each signal. Phases are ours, a quarter of a cycle apart."""


def grid(settings: StudySettings) -> Iterator[Row]:
    """Compute the grid of 20 ms at 25 Msps and 45 dB-Hz along delay and along Doppler.

    peaks : over delay, that stand out by 0.12, three times the noise. phase_cyc : from that of the highest cell, where
    the magnitude is above half of it. Eleven others are in the sky.
    """
    rng = settings.rng()
    rate_hz, coherent_s = 25e6, 0.02
    delays = np.asarray(np.arange(-25, 66) * (GPS_L1_CA.chip_rate_hz / rate_hz), np.float64)
    dopplers = np.arange(-400.0, 701.0, 10.0)
    other_sats = _others(rate_hz, coherent_s, rng)
    for case, signals in _CASES.items():
        samples = other_sats + _noise(other_sats.size, rate_hz, rng)
        for amplitude, delay, doppler in signals:
            samples = samples + amplitude * _signal(1, rate_hz, coherent_s, delay, doppler)
        cells = _correlate(samples, 1, rate_hz, delays, dopplers)
        peaks, highest = _peaks(np.abs(cells)), cells.ravel()[np.argmax(np.abs(cells))]
        for along, x, lines in (("delay", delays, cells.T), ("Doppler", dopplers, cells)):
            best = np.take_along_axis(lines, np.argmax(np.abs(lines), axis=1)[:, None], axis=1)[:, 0]
            phase = np.angle(best / highest) / (2.0 * np.pi)
            for k, at in enumerate(x.tolist()):
                yield {
                    "case": case,
                    "along": along,
                    "delay_chip": at if along == "delay" else None,
                    "doppler_hz": at if along == "Doppler" else None,
                    "magnitude": float(abs(best[k])),
                    "phase_cyc": float(phase[k]) if abs(best[k]) > 0.5 * abs(highest) else math.nan,
                    "peaks": peaks,
                }


def _peaks(size: Reals) -> int:
    over_delay = np.pad(size.max(axis=0), 1)  # one at the edge stands out over what is outside
    return int(find_peaks(over_delay, prominence=_PROMINENT)[0].size)


def noise(settings: StudySettings) -> Iterator[Row]:
    """Measure the noise of one value of the grid: thermal, and what eleven other satellites add.

    They are as strong, with Dopplers within 4 kHz, random delays and a data bit's edge somewhere. added_predicted: the
    mean over delays and Dopplers, for each satellite the integral of the code's spectrum squared, 2/3 of a chip
    without a band limit, over the interval.
    """
    rng = settings.rng()
    rate_hz = 5e6
    delays = np.asarray(np.arange(-4, 5) * (GPS_L1_CA.chip_rate_hz / rate_hz), np.float64)
    f = (np.arange(20_000) + 0.5) / 20_000 * 0.5 * rate_hz / GPS_L1_CA.chip_rate_hz
    overlap = np.mean(np.sinc(f) ** 4) / np.mean(np.sinc(f) ** 2) ** 2 / (2.0 * f[-1])
    for coherent_ms in (1, 4, 20):
        coherent_s = 1e-3 * coherent_ms
        dopplers = np.arange(-4000.0, 4001.0, 1.0 / coherent_s)
        skies = settings.count(400, 40)
        thermal: list[float] = []
        added: list[float] = []
        for _ in range(skies):
            other_sats = _others(rate_hz, coherent_s, rng)
            for powers, samples in ((thermal, _noise(other_sats.size, rate_hz, rng)), (added, other_sats)):
                powers.append(float(np.mean(np.abs(_correlate(samples, 1, rate_hz, delays, dopplers)) ** 2)))
        predicted = float(noise_variance(_CN0_DBHZ, coherent_s, rate_hz))
        yield {
            "coherent_ms": coherent_ms,
            "rate_hz": rate_hz,
            "noise_rms": float(np.sqrt(np.mean(thermal))),
            "noise_predicted": float(np.sqrt(predicted)),
            "added_power": float(np.mean(added)),
            "added_predicted": float((_SATELLITES - 1) * overlap / (_CHIPS * coherent_ms)),
            "rise_db": float(10.0 * np.log10(1.0 + np.mean(added) / np.mean(thermal))),
            "trials": skies,
        }


def _others(rate_hz: float, coherent_s: float, rng: np.random.Generator) -> Complexes:
    """Samples of eleven satellites; where the interval is as long as a bit, each bit ends somewhere in it."""
    n = round(rate_hz * coherent_s)
    total = np.zeros(n, np.complex128)
    for prn in range(2, _SATELLITES + 1):
        edge, turned = rng.uniform(0.0, _BIT_S), rng.choice([-1.0, 1.0])
        bits = np.where(_times(n, rate_hz) < edge, 1.0, turned)
        phase = np.exp(2j * np.pi * rng.random())
        total += phase * bits * _signal(prn, rate_hz, coherent_s, rng.uniform(0.0, _CHIPS), rng.uniform(-4e3, 4e3))
    return total


# What is claimed ------------------------------------------------------------------------------------------------------


def _span(values: Sequence[float]) -> float:
    return float(np.nanmax(values) - np.nanmin(values))


_PICTURE: Final = "a picture"
STUDIES_OF_THE_GRID: Final[tuple[Study, ...]] = (
    Study(
        name="dccaf.grid",
        title="One signal and two on the grid of delay and Doppler",
        paper=PAPER,
        figure="Figures 2 and 3",
        run=grid,
        charts=(
            Axes(
                title="Along delay: the largest of all Dopplers",
                x="delay_chip",
                y="magnitude",
                x_label="delay, chip",
                y_label="magnitude",
                by=("case",),
            ),
            Axes(
                title="Along Doppler: the largest of all delays",
                x="doppler_hz",
                y="magnitude",
                x_label="Doppler, Hz",
                y_label="magnitude",
                by=("case",),
            ),
            Axes(
                title="Phase along delay, above half of the height",
                x="delay_chip",
                y="phase_cyc",
                x_label="delay, chip",
                y_label="phase, cycles",
                by=("case",),
            ),
        ),
        claims=(
            *(
                Claim(
                    what=f"{case}: number of peaks",
                    paper=stated,
                    reference=float(peaks),
                    same=value_of("peaks", case=case),
                    tolerance=0.0,
                )
                for case, peaks, stated in zip(_CASES, (1, 2, 1), ("one", "two", "one, the phase differs"), strict=True)
            ),
            *(
                Claim(
                    what=f"{case}: change of phase along delay, cycles",
                    paper=stated,
                    same=value_of("phase_cyc", _span, case=case, along="delay"),
                    reference=reference,
                    tolerance=tolerance,
                )
                for case, stated, reference, tolerance in (
                    ("one signal", "none", 0.0, 0.03),
                    ("two, 0.25 chip apart", "differs", 0.08, 0.03),
                )
            ),
            Claim(
                what="amplitudes, phases and C/N0 of the figure",
                paper="not given",
                reference="ours: 1 and 0.87, a quarter of a cycle, 45 dB-Hz; no value of it can be compared",
            ),
        ),
    ),
    Study(
        name="dccaf.noise",
        title="The noise of the grid, and what other satellites add",
        paper=PAPER,
        figure="Figure 2, twelve satellites",
        run=noise,
        charts=(
            Axes(
                title="Thermal noise of a value of the grid, 45 dB-Hz",
                x="coherent_ms",
                y="noise_rms",
                x_label="coherent time, ms",
                y_label="rms",
                x_log=True,
                y_log=True,
            ),
        ),
        claims=(
            Claim(
                what="noise level at 20 ms",
                paper="a picture",
                reference=0.040,
                same=value_of("noise_rms", coherent_ms=20),
                tolerance=0.001,
            ),
            Claim(
                what="power that eleven others add at 20 ms",
                paper="not stated",
                reference="3.2e-4 to 3.9e-4",
                same=value_of("added_power", coherent_ms=20),
            ),
            Claim(
                what="the same over the integral of the spectrum squared",
                paper="none",
                reference=1.0,
                same=lambda rows: (
                    value_of("added_power", coherent_ms=20)(rows) / value_of("added_predicted", coherent_ms=20)(rows)
                ),
                tolerance=0.1,
            ),
            Claim(
                what="rise of the noise at 20 ms, dB",
                paper="not stated",
                reference=0.9,
                same=value_of("rise_db", coherent_ms=20),
                tolerance=0.15,
                digits=2,
            ),
            Claim(
                what="power that they add at 1 ms, times that at 20 ms",
                paper="not stated",
                reference=20.0,
                same=lambda rows: (
                    value_of("added_power", coherent_ms=1)(rows) / value_of("added_power", coherent_ms=20)(rows)
                ),
                tolerance=3.0,
            ),
        ),
    ),
)
