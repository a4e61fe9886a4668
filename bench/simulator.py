"""The simulator: how much faster than real time, beside a plain NumPy rendering of the same scene."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from timing import line, take_turns

from skyproof.gnss.nominal import nominal_constellation
from skyproof.simulate import scene_of, scenes
from skyproof.simulate.samples import Rendering, ahead_of, quantised, rendering_of

DURATION_S = 2.0
PLAIN_S = 0.02


def report() -> Iterator[str]:
    """Rows of the table."""
    scenario = scenes.demo(duration_s=DURATION_S, onset_s=0.0)
    rendering = rendering_of(scene_of(scenario, nominal_constellation(scenario.start_gpst)), 0)
    signals = len(rendering.sky.signals)
    blocks = range(-(-rendering.n_samples // 131_072))

    def ours() -> None:
        for _ in ahead_of(lambda block: quantised(rendering, block), blocks):
            pass

    ours_s, plain_s = take_turns(ours, lambda: _plain(rendering), runs=5)
    factor, plain_factor = DURATION_S / ours_s.median, PLAIN_S / plain_s.median
    yield f"simulator, {signals} signals at {rendering.front_end.rate_hz / 1e6:g} Msps, all cores"
    yield line(
        "a second of one receiver's samples", ours_s * (1.0 / DURATION_S), "s",
        f"{factor:.1f} times real time; plain NumPy {plain_factor:.2g} ({factor / plain_factor:.0f} times slower)",
    )  # fmt: skip


def _plain(rendering: Rendering) -> NDArray[np.complex128]:
    """The same sum of signals and noise, one array operation after the other; the bits are left out."""
    sky, rate_hz = rendering.sky, rendering.front_end.rate_hz
    elapsed_s = np.arange(int(PLAIN_S * rate_hz)) / rate_hz
    true_s = elapsed_s + sky.true_minus_elapsed_s(elapsed_s)
    rng = np.random.default_rng(1)
    samples = rng.standard_normal(elapsed_s.size) + 1j * rng.standard_normal(elapsed_s.size)
    delay_s, carrier_delay_s, cn0_dbhz = sky.code_delay_s(true_s), sky.carrier_delay_s(true_s), sky.cn0_dbhz(true_s)
    for column, code in enumerate(rendering.codes):
        chip = np.floor((true_s - delay_s[:, column]) * sky.signal.chip_rate_hz).astype(np.int64) % code.size
        phase_cyc = sky.signal.carrier_hz * (true_s - elapsed_s - carrier_delay_s[:, column])
        amplitude = np.sqrt(2.0 / rate_hz) * 10.0 ** (cn0_dbhz[:, column] / 20.0)
        samples += amplitude * code[chip] * np.exp(2j * np.pi * phase_cyc)
    return np.sign(samples.real) + 1j * np.sign(samples.imag)
