"""Interleaved channels are distinguished from one channel, whatever else is in the samples."""

import numpy as np
import pytest

from skyproof.gnss.signals import GPS_L1_CA, prn_of
from skyproof.recording.interleaving import InterleavedSignal, Turns, turns

RATE_HZ = 6.2e6
SATS = {"G03": (1234.0, 0.0), "G07": (-2750.0, 2.2e-4), "G19": (3900.0, 5.1e-4), "G30": (-180.0, 9.0e-4)}


def draw_channel(rate_hz: float, n: int, seed: int, *, if_hz: float = 0.0, real: bool = False, sats=tuple(SATS)):
    """Draw signals of 46 dB-Hz with phases of its own in noise of its own, (2, n)."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(n) / rate_hz
    wave = rng.normal(size=n) + 1j * rng.normal(size=n)
    for sat in sats:
        doppler_hz, delay_s = SATS[sat]
        chip = np.floor((time_s - delay_s) * GPS_L1_CA.chip_rate_hz).astype(int) % 1023
        turned = np.exp(2j * np.pi * ((if_hz + doppler_hz) * time_s + rng.random()))
        wave += np.sqrt(2.0 * 10**4.6 / rate_hz) * GPS_L1_CA.code(prn_of(sat))[chip] * turned
    return np.stack([wave.real, 0.0 * wave.real if real else wave.imag]).astype(np.float32)


def weave(channels: list[np.ndarray]) -> np.ndarray:
    return np.stack(channels, axis=2).reshape(2, -1)


def mix(carrier_hz: float = 0.0) -> list[InterleavedSignal]:
    return [
        InterleavedSignal(sat=sat, carrier_hz=carrier_hz + hz, delay_s=s, cn0_dbhz=46.0)
        for sat, (hz, s) in SATS.items()
    ]


@pytest.mark.parametrize("n", [1, 2, 3, 4, 6])
def test_as_many_complex_channels_as_there_are(n: int) -> None:
    planes = weave([draw_channel(RATE_HZ, 62_000, seed) for seed in range(n)])
    assert turns(planes, n * RATE_HZ, mix(), real=False) == Turns(samples=n)


@pytest.mark.parametrize("if_hz", [1.4e6, RATE_HZ / 4])
@pytest.mark.parametrize("n", [1, 2, 4])
def test_as_many_real_channels_as_there_are(n: int, if_hz: float) -> None:
    planes = weave([draw_channel(RATE_HZ, 62_000, seed, if_hz=if_hz, real=True) for seed in range(n)])
    assert turns(planes, n * RATE_HZ, mix(if_hz), real=True) == Turns(samples=n)


@pytest.mark.parametrize("if_hz", [1.4e6, RATE_HZ / 4])
@pytest.mark.parametrize("n", [2, 4])
def test_real_channels_read_as_i_and_q_show_mirror_images(n: int, if_hz: float) -> None:
    numbers = weave([draw_channel(RATE_HZ, 62_000, seed, if_hz=if_hz, real=True) for seed in range(n)])[0]
    reported = turns(numbers.reshape(-1, 2).T, n / 2 * RATE_HZ, mix(if_hz), real=False)
    assert reported == Turns(samples=n // 2, mirrored=True)


def test_a_real_signals_mirror_image_is_no_channel() -> None:
    planes = draw_channel(RATE_HZ, 62_000, 1, if_hz=RATE_HZ / 4, real=True, sats=("G30",))
    assert turns(planes, RATE_HZ, mix(RATE_HZ / 4)[-1:], real=True).one_channel


def test_a_channel_without_signals_takes_its_turn() -> None:
    planes = weave([draw_channel(RATE_HZ, 62_000, 1), draw_channel(RATE_HZ, 62_000, 2, sats=())])
    assert turns(planes, 2 * RATE_HZ, mix(), real=False) == Turns(samples=2)


@pytest.mark.parametrize("noise", [0.0, 0.5, 1.0])
def test_copies_of_one_channel_have_no_images_and_are_reported(noise: float) -> None:
    drawn = draw_channel(RATE_HZ, 62_000, 1)
    rng = np.random.default_rng(2)
    planes = weave([drawn + noise * rng.normal(size=drawn.shape).astype(np.float32) for _ in range(2)])
    assert turns(planes, 2 * RATE_HZ, mix(), real=False) == Turns(samples=2)


def test_a_line_and_imbalance_of_i_and_q_are_no_channels() -> None:
    planes = draw_channel(RATE_HZ, 62_000, 1, if_hz=1.1e6)
    time_s = np.arange(planes.shape[1]) / RATE_HZ
    for line_hz in (1.1e6 + RATE_HZ / 2, RATE_HZ / 4, 0.3e6):
        planes += np.stack([np.cos(2 * np.pi * line_hz * time_s), np.sin(2 * np.pi * line_hz * time_s)])
    planes[1] *= 1.2  # 1.6 dB
    assert turns(planes.astype(np.float32), RATE_HZ, mix(1.1e6), real=False).one_channel


@pytest.mark.parametrize("real", [False, True])
@pytest.mark.parametrize("parts", [4, 6, 8])
def test_lines_of_the_sampling_clock_are_no_channels(parts: int, real: bool) -> None:
    if_hz = 1.4e6 if real else 0.0
    planes = draw_channel(RATE_HZ, 62_000, 1, if_hz=if_hz, real=real)
    turned = 2.0 * np.exp(2j * np.pi * np.arange(62_000) / parts)
    planes += np.stack([turned.real, 0.0 * turned.real if real else turned.imag]).astype(np.float32)
    planes += np.float32(0.0 if real else 1.0) * (-1.0) ** np.arange(62_000, dtype=np.float32)
    assert turns(planes, RATE_HZ, mix(if_hz), real=real).one_channel


def test_of_many_single_channels_none_is_taken_for_several() -> None:
    taken = 0
    for seed in range(60):
        real = bool(seed % 2)
        planes = draw_channel(RATE_HZ, 31_000, 100 + seed, if_hz=1.4e6 if real else 0.0, real=real)
        taken += not turns(planes, RATE_HZ, mix(1.4e6 if real else 0.0), real=real).one_channel
    assert taken == 0


def test_without_signals_nothing_is_said() -> None:
    assert turns(draw_channel(RATE_HZ, 62_000, 1), RATE_HZ, [], real=False).one_channel
