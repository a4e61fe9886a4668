"""What the receiver's ranges are worth: the noise beside its stated sigma, its colour, and what a replica's shift does.

Beside each figure stands what the same data give without the measure that was taken.
"""

from collections.abc import Iterator
from unittest import mock

import numpy as np
from numpy.typing import NDArray
from timing import Spread, line

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.nominal import nominal_constellation
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import kernels as k
from skyproof.receiver import tracking
from skyproof.receiver.measurement import Measurement, measure
from skyproof.receiver.tracking import Epoch, Receiver, ReceiverState
from skyproof.simulate import Place, samples_of, scenes

Reals = NDArray[np.float64]

DURATION_S = 30.0
CHIP_M = SPEED_OF_LIGHT_M_S / GPS_L1_CA.chip_rate_hz


def report() -> Iterator[str]:
    """Rows of the table."""
    yield from _colour()
    yield from _shift()


def _colour() -> Iterator[str]:
    """Code minus carrier of every channel, less a line: noise of the code alone."""
    measured, loops, stated_m = _code_minus_carrier()
    channels = f"code minus carrier of {len(measured)} channels over {DURATION_S:g} s, an epoch every 0.2 s"
    yield f"pseudoranges, {channels}"
    ratio = [float(np.std(m, ddof=2)) / s for m, s in zip(measured, stated_m, strict=True)]
    yield line("noise over its stated sigma", Spread.of(ratio), "")
    yield line(
        "correlation with the epoch before", Spread.of([_lag_one(m) for m in measured]), "",
        f"of the loop alone, without its discriminator: {np.median([_lag_one(m) for m in loops]):.2f}",
    )  # fmt: skip


def _lag_one(noise_m: Reals) -> float:
    return float(noise_m[1:] @ noise_m[:-1] / (noise_m @ noise_m))


def _code_minus_carrier() -> tuple[list[Reals], list[Reals], list[float]]:
    """For each channel tracked to the end: as measured, by the loop alone, and the mean sigma stated; metres."""
    start = np.datetime64("2024-05-14T09:59:58", "ns")
    scenario = scenes.clean(Place(lat_deg=57.7, lon_deg=11.9, height_m=50.0), start, receivers=1, duration_s=DURATION_S)
    recording = samples_of(scenario, nominal_constellation(start))[0]
    by_loop_s: dict[Measurement, float] = {}

    def both(rows: Reals, *settings: object) -> Measurement:
        """The measurement, after noting what the loop's own code phase would have given."""
        measured = measure(rows, *settings)  # type: ignore[arg-type]
        undiscriminated = rows.copy()
        undiscriminated[:, k.OUT_CODE_ERROR] = 0.0
        by_loop_s[measured] = measure(undiscriminated, *settings).fraction_s  # type: ignore[arg-type]
        return measured

    receiver, state, epochs = Receiver(recording.rate_hz), ReceiverState(), list[Epoch]()
    block = int(recording.rate_hz)
    with mock.patch.object(tracking, "measure", both):
        for first in range(0, recording.n_samples, block):
            output, state = receiver.step(state, recording.read(first, block))
            epochs += output.epochs
    settled = [epoch for epoch in epochs if epoch.elapsed_s > 2.0]
    measured, loops, stated_m = [], [], []
    for arc in settled[-1].measurements:
        rows = [(e.elapsed_s, e.measurements[arc]) for e in settled if arc in e.measurements]
        if len(rows) > 100:
            measured.append(_straightened([_minus_carrier_m(t, m, m.fraction_s) for t, m in rows]))
            loops.append(_straightened([_minus_carrier_m(t, m, by_loop_s[m]) for t, m in rows]))
            stated_m.append(SPEED_OF_LIGHT_M_S * float(np.sqrt(np.mean([m.code_sigma_s**2 for _, m in rows]))))
    return measured, loops, stated_m


def _minus_carrier_m(elapsed_s: float, m: Measurement, fraction_s: float) -> float:
    code_s = (round(elapsed_s * 1e3) - m.periods) * GPS_L1_CA.period_s - fraction_s
    return SPEED_OF_LIGHT_M_S * (code_s - m.carrier_cyc / GPS_L1_CA.carrier_hz)


def _straightened(values: list[float]) -> Reals:
    """Less a straight line."""
    n = np.arange(len(values))
    centred = np.array(values) - values[0]
    return np.asarray(centred - np.polyval(np.polyfit(n, centred, 1), n))


def _shift() -> Iterator[str]:
    """Noise-free signals at 200 code phases: the error of the discriminator on the right code phase."""
    yield "error of one period's discriminator without noise, rms of 200 code phases and worst"
    for rate_hz in (2.6e6, 25e6):
        for n_phases in (32, 4):
            with_m, without_m = np.array([_discriminator_m(rate_hz, n_phases, chip) for chip in _chips(200)]).T
            left_in = f"with the replica's shift left in {_rms(without_m):.2g} m, worst {np.abs(without_m).max():.2g} m"
            yield (
                f"  {rate_hz / 1e6:g} Msps, replicas every 1/{n_phases} sample: {_rms(with_m):.2g} m, worst "
                f"{np.abs(with_m).max():.2g} m; {left_in}"
            )


def _chips(count: int) -> Reals:
    return np.random.default_rng(1).uniform(0.0, 0.04, count)


def _rms(values: Reals) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _discriminator_m(rate_hz: float, n_phases: int, chip: float) -> tuple[float, float]:
    """Error in metres, with the replica's known shift taken off and without."""
    code = GPS_L1_CA.code(7)
    nominal = GPS_L1_CA.chip_rate_hz / rate_hz
    chips_a_sample = nominal * (1.0 + 1e-6)
    n = int((code.size - chip) / chips_a_sample)
    samples = code[np.floor(chip + np.arange(n) * chips_a_sample).astype(np.int64) % code.size].astype(np.float32)
    table = k.code_table(code, nominal, n_phases, n + 1)
    sums, shifts = np.empty(6), np.empty(3)
    k._correlate_period(
        samples, np.zeros_like(samples), chip, chips_a_sample, 0.0, 0.0, table, nominal,
        np.array([0.125, 0.0, -0.125]), np.empty((4, k.CHUNK), np.float32), sums, shifts,
    )  # fmt: skip
    error = k._early_minus_late(sums, sums[2] ** 2 + sums[3] ** 2)
    return CHIP_M * (error - 0.5 * (shifts[0] + shifts[2])), CHIP_M * error
