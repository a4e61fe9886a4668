"""Rendered samples against a slow twin that knows neither chunks nor splines, and against themselves."""

import os

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from tests.simulator.exact import compute_delays

from skyproof.gnss.constants import CA_CHIP_RATE_HZ, L1_HZ
from skyproof.gnss.ephemeris import NavigationData
from skyproof.gnss.lnav import encode_subframes
from skyproof.gnss.signals import GPS_L1_CA, prn_of
from skyproof.gnss.time import week_and_tow
from skyproof.simulator import samples as samples_module
from skyproof.simulator.received import Scene
from skyproof.simulator.sample_kernels import CHUNK
from skyproof.simulator.samples import BLOCK, Rendering, prepare_rendering, render, render_samples
from skyproof.simulator.scenario import FrontEnd, Scenario
from skyproof.simulator.sky import make_scene


def compute_twin(
    scene: Scene, receiver: int, start: int, count: int, *, only: int | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Compute complex samples without noise, and where no chip edge is so near that rounding may decide.

    only : the one signal wanted; all of them if None.
    """
    scenario, sky = scene.scenario, scene.skies[receiver]
    rate_hz, place = scenario.front_end.rate_hz, scenario.receivers[receiver]
    elapsed_s = np.arange(start, start + count) / rate_hz
    fast = place.lo_ppm * 1e-6
    true_s = place.start_offset_s + elapsed_s / (1.0 + fast)
    week, tow_s = week_and_tow(scenario.start_gpst)
    first_tow = int((tow_s - 10.0) // 6) * 6
    total, clear = np.zeros(count, complex), np.ones(count, bool)
    for column, heard in enumerate(sky.signals):
        if only not in (None, column):
            continue
        ephemeris = scene.navigation.best(heard.id.sat, scenario.start_gpst)
        assert ephemeris is not None
        added_s, seen_at = 0.0, place
        if heard.label == "spoofed":
            number = scenario.attack_names.index(heard.source)
            seen_at = scenario.attacks[number].shows
            added_s = scenario.attacks[number].added_delay_s + scene.path_m[number, receiver] / 299_792_458.0
        at_s = true_s if count < 10_000 else true_s[:: count // 20]  # orbits bend little
        delays = compute_delays(seen_at, ephemeris, scene.navigation, scenario.start_gpst, at_s - added_s)
        code_s, carrier_s = delays.code_s, delays.carrier_s
        if at_s.size < count:
            code_s, carrier_s = (Polynomial.fit(at_s, delay_s, 4)(true_s) for delay_s in (code_s, carrier_s))
        chip = CA_CHIP_RATE_HZ * (tow_s - first_tow + true_s - (code_s + added_s))
        bits = encode_subframes(
            ephemeris,
            scene.navigation.ionosphere,
            scene.navigation.utc,
            first_tow,
            week,
            5 + int(scenario.duration_s / 6),
        )
        index = np.floor(chip).astype(int)
        value = GPS_L1_CA.code(prn_of(heard.id.sat))[index % 1023] * (1 - 2 * bits[index // (1023 * 20)])
        phase_cyc = L1_HZ * (true_s - elapsed_s - (carrier_s + added_s)) + scenario.front_end.if_hz * elapsed_s
        present = (true_s >= heard.from_s) & (true_s < heard.until_s)
        per_hertz = 4.0 if scenario.front_end.kind == "real" else 2.0
        amplitude = np.sqrt(per_hertz / rate_hz * 10.0 ** (float(sky.cn0_dbhz(true_s[0])[column]) / 10.0))
        total += present * amplitude * value * np.exp(2j * np.pi * phase_cyc)
        clear &= np.abs(chip - np.rint(chip)) > 2e-5
    return total, clear


def drop_noise(rendering: Rendering, start: int, count: int) -> np.ndarray:
    block = start // BLOCK
    planes = np.concatenate([render(rendering, b, noise=False) for b in (block, block + 1)], axis=1).astype(float)
    begin = start - block * BLOCK
    return planes[0, begin : begin + count] + 1j * planes[1, begin : begin + count]


@pytest.fixture(scope="module")
def scene(scenario: Scenario, navigation: NavigationData) -> Scene:
    return make_scene(scenario, navigation)


# the copies arrive at sample 3899972 of the first receiver and 3901063 of the second, within a step of the carrier
@pytest.mark.parametrize("start", [0, CHUNK - 50, BLOCK - 700, 2_600_000 - 800, 3_899_000, 3_900_500, 5_200_000])
@pytest.mark.parametrize("receiver", [0, 1])
def test_the_samples_are_those_of_the_slow_twin(scene: Scene, receiver: int, start: int) -> None:
    expected, clear = compute_twin(scene, receiver, start, 1500)
    got = drop_noise(prepare_rendering(scene, receiver), start, 1500)
    assert np.abs(expected).max() > 0.1
    assert clear.mean() > 0.99
    assert np.abs(got - expected)[clear].max() < 2e-4 * np.abs(expected).max()


@pytest.mark.parametrize(
    "front_end",
    [FrontEnd(rate_hz=8e6, kind="real", if_hz=2.1e6), FrontEnd(rate_hz=1.3e6), FrontEnd(rate_hz=25e6, if_hz=-3e6)],
    ids=["real", "slow", "fast"],
)
def test_other_rates_and_frequencies_agree_with_the_twin(
    scenario: Scenario, navigation: NavigationData, front_end: FrontEnd
) -> None:
    scene = make_scene(scenario.model_copy(update={"front_end": front_end}), navigation)
    expected, clear = compute_twin(scene, 0, 40_000, 3000)
    got = drop_noise(prepare_rendering(scene, 0), 40_000, 3000)
    assert np.abs(got - expected)[clear].max() < 2e-4 * np.abs(expected).max()


def test_the_copies_begin_when_their_first_wave_arrives(scene: Scene) -> None:
    rendering, sky = prepare_rendering(scene, 0), scene.skies[0]
    from_s = next(heard.from_s for heard in sky.signals if heard.label == "spoofed")
    first = int(np.ceil((from_s - sky.receiver.start_offset_s) * (1.0 + 0.7e-6) * 2.6e6))
    clean = make_scene(scene.scenario.model_copy(update={"attacks": ()}), scene.navigation)
    start = first - 1000
    difference = drop_noise(rendering, start, 2000) - drop_noise(prepare_rendering(clean, 0), start, 2000)
    assert not difference[:1000].any()
    assert (difference[1000:] != 0).mean() > 0.99
    assert difference[1000] != 0


def test_any_stretches_give_the_same_samples(scenario: Scenario, navigation: NavigationData) -> None:
    samples = render_samples(scenario, navigation)[1]
    start, end = BLOCK - 20_000, 3 * BLOCK + 100
    whole = samples.read(start, end - start)
    again = render_samples(scenario, navigation)[1]
    rng, position, pieces = np.random.default_rng(3), start, []
    while position < end:
        count = min(int(rng.integers(1, 70_000)), end - position)
        pieces.append(again.read(position, count))
        position += count
    np.testing.assert_array_equal(np.concatenate(pieces, axis=1), whole)


def test_the_number_of_threads_changes_nothing(
    scenario: Scenario, navigation: NavigationData, monkeypatch: pytest.MonkeyPatch
) -> None:
    def with_cores(cores: int) -> np.ndarray:
        monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(cores)), raising=False)
        return render_samples(scenario, navigation)[0].read(0, 5 * BLOCK)

    np.testing.assert_array_equal(with_cores(1), with_cores(4))


def test_the_seed_and_the_receiver_decide_the_noise(scene: Scene) -> None:
    rendering = prepare_rendering(scene, 0)
    noise = [samples_module._draw_noise(rendering, 2), samples_module._draw_noise(prepare_rendering(scene, 0), 2)]
    np.testing.assert_array_equal(noise[0], noise[1])
    other_seed = make_scene(scene.scenario.model_copy(update={"seed": 8}), scene.navigation)
    for other in (
        samples_module._draw_noise(prepare_rendering(other_seed, 0), 2),
        samples_module._draw_noise(prepare_rendering(scene, 1), 2),
        samples_module._draw_noise(rendering, 3),
    ):
        assert abs(np.corrcoef(noise[0].ravel(), other.ravel())[0, 1]) < 5.0 / np.sqrt(2 * BLOCK)
    assert noise[0].var() == pytest.approx(1.0, abs=5.0 * np.sqrt(1.0 / BLOCK))


def test_a_transmitter_adds_its_noise_from_its_onset_on(scenario: Scenario, navigation: NavigationData) -> None:
    attack = scenario.attacks[0].model_copy(update={"noise_db": 3.0, "onset_s": 0.1, "until_s": 0.2})
    scene = make_scene(scenario.model_copy(update={"attacks": (attack,)}), navigation)
    rendering = prepare_rendering(scene, 0)
    noise = np.concatenate([samples_module._draw_noise(rendering, block) for block in range(6)], axis=1)
    n = 2_600
    power = [noise[:, int(at_s * 2.6e6) :][:, : 60 * n].var() for at_s in (0.02, 0.12, 0.22)]
    assert np.allclose(power, [1.0, 1.0 + 10.0**0.3, 1.0], rtol=0.02)


def make_few_satellites(scenario: Scenario, navigation: NavigationData, front_end: FrontEnd) -> Scene:
    """Make a scene in which the other signals are too few to count as noise."""
    update = {"attacks": (), "mask_deg": 55.0, "front_end": front_end}
    return make_scene(scenario.model_copy(update=update), navigation)


@pytest.mark.parametrize(
    ("front_end", "loss_db"),
    [
        (FrontEnd(rate_hz=4e6, encoding="float", bits=32), 0.0),
        (FrontEnd(rate_hz=4e6, encoding="int", bits=8), 0.0),
        (FrontEnd(rate_hz=4e6, encoding="sign-magnitude", bits=2), 0.55),
        (FrontEnd(rate_hz=4e6, encoding="sign", bits=1), 1.96),
        (FrontEnd(rate_hz=8e6, kind="real", if_hz=2e6, encoding="float", bits=32), 0.0),
    ],
    ids=lambda value: f"{value.encoding}-{value.kind}" if isinstance(value, FrontEnd) else "",
)
def test_the_carrier_to_noise_density_is_as_asked(
    scenario: Scenario, navigation: NavigationData, front_end: FrontEnd, loss_db: float
) -> None:
    # Losses of quantisation: 2 / pi for one bit, 0.55 dB for two (Max, 1960).
    scene = make_few_satellites(scenario, navigation, front_end)
    assert 1 <= len(scene.skies[0].signals) <= 3
    rate_hz, count = front_end.rate_hz, int(0.2 * front_end.rate_hz)
    planes = render_samples(scene.scenario, navigation)[0].read(0, count).astype(float)
    received = planes[0] + 1j * planes[1]
    for column, heard in enumerate(scene.skies[0].signals):
        replica, _ = compute_twin(scene, 0, 0, count, only=column)
        gain = np.vdot(replica, received) / np.vdot(replica, replica)
        power = np.abs(gain) ** 2 * np.mean(np.abs(replica) ** 2)
        band_hz = rate_hz
        if front_end.kind == "real":  # half of a real carrier's power lies at the positive frequency
            power, band_hz = 2.0 * power, rate_hz / 2.0
        noise_density = (np.mean(np.abs(received) ** 2) - power) / band_hz
        cn0_dbhz = 10.0 * np.log10(power / noise_density)
        assert cn0_dbhz == pytest.approx(float(scene.skies[0].cn0_dbhz(0.1)[column]) - loss_db, abs=0.2), heard.id
