"""What is no satellite's signal, in the samples: lines, chirps, noise, gain, reflections, pauses."""

from typing import Any

import numpy as np
import pytest

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import NavigationData
from skyproof.gnss.signals import GPS_L1_CA, prn_of
from skyproof.simulator.sample_kernels import CHUNK
from skyproof.simulator.samples import BLOCK, prepare_rendering, render, render_samples
from skyproof.simulator.scenario import parse_scenario
from skyproof.simulator.sky import make_scene

RATE_HZ = 2e6
PLACE = {"lat_deg": 40.0, "lon_deg": -3.0, "height_m": 650.0}
TRANSMIT = {"lat_deg": 40.001, "lon_deg": -3.0, "height_m": 655.0}
TABLE: dict[str, Any] = {
    "seed": 3,
    "start_gpst": "2023-03-04T05:06:07.25",
    "duration_s": 2.0,
    "receivers": [{"name": "one", **PLACE, "lo_ppm": 0.5}],
    "front_end": {"rate_hz": RATE_HZ, "encoding": "float", "bits": 32},
    "sky": {"zenith_cn0_dbhz": 0.0, "horizon_cn0_dbhz": 0.0},
}


def make_recording(navigation: NavigationData, **changes: Any) -> Any:
    return render_samples(parse_scenario(TABLE | changes), navigation)[0]


def jam(navigation: NavigationData, **source: Any) -> np.ndarray:
    read = make_recording(navigation, interference=[{"transmit": TRANSMIT, **source}]).read
    planes = read(0, int(2 * RATE_HZ)).astype(np.float64)
    return planes[0] + 1j * planes[1]


def test_a_line_has_the_power_and_the_frequency_asked_for(navigation: NavigationData) -> None:
    samples = jam(navigation, kind="cw", power_db=6.0, offset_hz=123_456.0, onset_s=0.5)
    quiet, loud = samples[: int(0.49 * RATE_HZ)], samples[int(0.51 * RATE_HZ) : int(1.51 * RATE_HZ)]
    assert np.mean(np.abs(quiet) ** 2) == pytest.approx(2.0, rel=0.01)
    assert np.mean(np.abs(loud) ** 2) == pytest.approx(2.0 * (1.0 + 10.0**0.6), rel=0.01)
    spectrum = np.abs(np.fft.fft(loud)) ** 2
    at_hz = np.fft.fftfreq(loud.size, 1.0 / RATE_HZ)[np.argmax(spectrum)]
    # the receiver's oscillator is 0.5 ppm fast, so all that it hears is that much lower
    assert at_hz == pytest.approx(123_456.0 - 0.5e-6 * GPS_L1_CA.carrier_hz, abs=1.5)
    assert spectrum.max() / spectrum.sum() > 0.5


def test_a_line_does_not_step_from_chunk_to_chunk(navigation: NavigationData) -> None:
    samples = jam(navigation, kind="cw", power_db=60.0, offset_hz=100_000.0)
    turned = np.unwrap(np.angle(samples)) / (2.0 * np.pi)
    line = np.polynomial.Polynomial.fit(np.arange(turned.size), turned, 2)(np.arange(turned.size))
    assert np.std(turned - line) == pytest.approx(1.0 / np.sqrt(2e6) / (2.0 * np.pi), rel=0.1)
    edges = np.arange(CHUNK, turned.size, CHUNK)
    steps = np.diff(turned - line)
    assert np.std(steps[edges - 1]) == pytest.approx(np.std(steps), rel=0.25)


def test_a_chirp_sweeps_its_band(navigation: NavigationData) -> None:
    samples = jam(navigation, kind="chirp", power_db=40.0, offset_hz=50_000.0, sweep_hz=400_000.0, period_s=1e-3)
    rate_hz = np.diff(np.unwrap(np.angle(samples))) / (2.0 * np.pi) * RATE_HZ
    low_hz, high_hz = np.quantile(rate_hz, [0.002, 0.998])
    assert low_hz == pytest.approx(-150_000.0, abs=6000.0)
    assert high_hz == pytest.approx(250_000.0, abs=6000.0)
    assert np.mean(rate_hz) == pytest.approx(50_000.0 - 788.0, abs=500.0)
    folded = rate_hz[: int(RATE_HZ)].reshape(-1, int(RATE_HZ * 1e-3)).mean(axis=0)  # the period's rise
    rises = np.diff(folded)
    assert np.median(rises) * RATE_HZ == pytest.approx(400_000.0 / 1e-3, rel=0.02)


def test_noise_rises_by_what_is_asked_and_falls_with_distance(navigation: NavigationData) -> None:
    far = {"name": "two", **PLACE, "lat_deg": 39.999}
    scene = make_scene(
        parse_scenario(
            TABLE
            | {
                "receivers": [TABLE["receivers"][0], far],
                "interference": [{"kind": "noise", "transmit": TRANSMIT, "power_db": 10.0}],
            }
        ),
        navigation,
    )
    near, far_power = (np.mean(render(prepare_rendering(scene, index), 3).astype(np.float64) ** 2) for index in (0, 1))
    assert near == pytest.approx(11.0, rel=0.01)
    ratio = [sky.noises[0].power(np.array([1.0]))[0] for sky in scene.skies]
    assert far_power == pytest.approx(1.0 + ratio[1], rel=0.01)
    assert ratio[0] / ratio[1] == pytest.approx(4.0, rel=0.02)  # twice as far


@pytest.mark.parametrize("agc", [False, True])
def test_the_gain_follows_the_power_only_where_it_is_asked_to(navigation: NavigationData, agc: bool) -> None:
    front_end = {"rate_hz": RATE_HZ, "encoding": "int", "bits": 16, "agc": agc}
    source = {"kind": "noise", "transmit": TRANSMIT, "power_db": 6.0, "onset_s": 1.0}
    planes = make_recording(navigation, front_end=front_end, interference=[source]).read(0, int(2 * RATE_HZ))
    before, after = (np.std(planes[:, int(a * RATE_HZ) : int(b * RATE_HZ)]) for a, b in ((0.1, 0.9), (1.1, 1.9)))
    assert before == pytest.approx(4096.0, rel=0.01)
    assert after == pytest.approx(4096.0 if agc else 4096.0 * np.sqrt(1.0 + 10.0**0.6), rel=0.02)


def test_reflections_are_later_weaker_copies(navigation: NavigationData) -> None:
    reflection = {"delay_m": 60.0, "power_db": -3.0, "phase_deg": 90.0}
    sat = make_scene(parse_scenario(TABLE), navigation).skies[0].signals[0].id.sat  # alone: no cross-correlation
    alone, mirrored = (
        make_scene(
            parse_scenario(
                TABLE
                | {
                    "receivers": [TABLE["receivers"][0] | {"multipath": rays}],
                    "sky": {"zenith_cn0_dbhz": 60.0, "horizon_cn0_dbhz": 60.0, "sats": [sat]},
                }
            ),
            navigation,
        )
        for rays in ([], [reflection])
    )
    sky = alone.skies[0]
    planes = [render(prepare_rendering(scene, 0), 0, noise=False).astype(np.float64) for scene in (alone, mirrored)]
    ray = (planes[1] - planes[0])[0] + 1j * (planes[1] - planes[0])[1]
    direct = planes[0][0] + 1j * planes[0][1]
    code = GPS_L1_CA.code(prn_of(sat)).astype(float)
    elapsed_s = np.arange(8000) / RATE_HZ
    true_s = elapsed_s + sky.true_minus_elapsed_s(elapsed_s)
    code_s, carrier_s = (delay[:, 0] for delay in sky.delays_s(true_s))

    def correlation(samples: np.ndarray, later_m: float) -> complex:
        chips = (true_s - code_s - later_m / SPEED_OF_LIGHT_M_S) * GPS_L1_CA.chip_rate_hz
        phase_cyc = GPS_L1_CA.carrier_hz * (true_s - elapsed_s - carrier_s - later_m / SPEED_OF_LIGHT_M_S)
        replica = code[np.floor(chips).astype(int) % 1023] * np.exp(-2j * np.pi * phase_cyc)
        first = int(np.ceil((1.0 - (chips[0] % 1023) / 1023) * 1e-3 * RATE_HZ))  # within one period, so within a bit
        return complex(np.mean((samples[:8000] * replica)[first : first + int(0.9e-3 * RATE_HZ)]))

    ratio = correlation(ray, 60.0) / correlation(direct, 0.0)
    assert abs(ratio) == pytest.approx(10.0 ** (-3.0 / 20.0), rel=0.05)
    assert np.angle(ratio) == pytest.approx(np.pi / 2.0, abs=0.1)


def test_a_pause_of_an_attack_is_silent_to_the_sample(navigation: NavigationData) -> None:
    attack = {
        "kind": "spoofer",
        "transmit": TRANSMIT,
        "shows": PLACE,
        "power_db": 30.0,
        "off_s": [[0.7, 0.9]],
        "onset_s": 0.3,
        "until_s": 1.5,
    }
    scene = make_scene(
        parse_scenario(TABLE | {"attacks": [attack], "sky": {"zenith_cn0_dbhz": 30.0, "horizon_cn0_dbhz": 30.0}}),
        navigation,
    )
    rendering, sky = prepare_rendering(scene, 0), scene.skies[0]
    n_blocks = -(-rendering.n_samples // BLOCK)
    power = np.concatenate([(render(rendering, b, noise=False) ** 2).sum(axis=0) for b in range(n_blocks)])
    windows_s = next(heard.windows_s for heard in sky.signals if heard.label == "spoofed")
    loud = power > 30.0 * np.median(power[: int(0.2 * RATE_HZ)])
    smooth = np.convolve(loud, np.ones(400) / 400, mode="same") > 0.3
    edges = np.flatnonzero(np.diff(smooth.astype(int)))
    expected = sky.elapsed_at(np.array(windows_s).ravel()) * RATE_HZ
    assert edges.size == 4
    assert np.abs(edges - expected).max() < 300


def test_blocks_of_any_size_give_the_same_samples(navigation: NavigationData) -> None:
    recorded = make_recording(
        navigation,
        front_end={"rate_hz": RATE_HZ, "encoding": "int", "bits": 8, "agc": True, "bandwidth_hz": 1.6e6},
        receivers=[
            TABLE["receivers"][0]
            | {
                "oscillator": "tcxo",
                "multipath": [{"height_m": 2.0, "power_db": -6.0}],
                "path": {"kind": "circle", "radius_m": 30.0, "speed_m_s": 5.0},
            }
        ],
        interference=[{"kind": "chirp", "transmit": TRANSMIT, "power_db": 3.0}],
    )
    whole = recorded.read(0, 900_000)
    for start, count in ((0, 1), (131_071, 2), (4096, 300_000), (777_777, 100_000)):
        assert np.array_equal(recorded.read(start, count), whole[:, start : start + count])
