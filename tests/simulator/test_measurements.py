"""Measurements of the scene without samples: they follow the sky, and their errors are those asked for."""

import time
from collections import Counter
from typing import Literal

import numpy as np
import pytest

from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import NavigationData
from skyproof.records import SignalRef
from skyproof.simulator.attacks import Interference
from skyproof.simulator.measurements import NoiseModel, draw, draw_noise, make_ideal_measurements, simulate_observations
from skyproof.simulator.received import Scene
from skyproof.simulator.scenario import Scenario
from skyproof.simulator.sky import make_scene

SILENT = NoiseModel(sigma_m=0.0, carrier_sigma_cyc=0.0, doppler_sigma_hz=0.0)


@pytest.fixture(scope="module")
def scene(scenario: Scenario, navigation: NavigationData) -> Scene:
    return make_scene(scenario.model_copy(update={"duration_s": 30.0}), navigation)


def test_pseudoranges_are_on_the_receivers_own_clock(scene: Scene) -> None:
    # What the clock shows minus what the code shows, worked out from an epoch's label and nothing else.
    (observed, _), _ = draw(make_ideal_measurements(scene), rng=np.random.default_rng(1), noise=SILENT)
    sky = scene.skies[0]
    epoch = 10
    shown_s = (observed.gpst[epoch] - scene.scenario.start_gpst) / np.timedelta64(1, "s")
    elapsed_s = shown_s - 1.23e-5 - 2.1e-4
    assert observed.elapsed_s[epoch] == pytest.approx(elapsed_s, abs=1e-14)
    true_s = 1.23e-5 + elapsed_s / (1.0 + 0.7e-6)
    # over one second the mean differs from the middle by a twenty-fourth of the acceleration
    before_s, now_s, after_s = sky.code_delay_s(true_s + np.array([-1.0, 0.0, 1.0]))
    bend_s = (before_s - 2.0 * now_s + after_s) / 24.0
    expected_m = SPEED_OF_LIGHT_M_S * (shown_s - true_s + sky.code_delay_s(true_s) + bend_s)
    columns = [observed.signals.index(heard.id) for heard in sky.signals]
    np.testing.assert_allclose(observed.pseudorange_m[epoch, columns], expected_m, rtol=0.0, atol=1e-5)


def test_carrier_and_doppler_are_one_and_follow_the_range(scene: Scene) -> None:
    (observed, _), _ = draw(make_ideal_measurements(scene, interval_s=0.5), rng=np.random.default_rng(1), noise=SILENT)
    present = np.isfinite(observed.carrier_cyc).all(axis=0)
    carrier_m = observed.carrier_cyc[:, present] * SPEED_OF_LIGHT_M_S / L1_HZ
    moved_m = np.diff(observed.pseudorange_m[:, present], axis=0) - np.diff(carrier_m, axis=0)
    assert np.abs(moved_m).max() < 2e-3  # the ionosphere, with opposite signs
    rate = np.diff(observed.carrier_cyc[:, present], axis=0) / 0.5
    mean_doppler = 0.5 * (observed.doppler_hz[1:, present] + observed.doppler_hz[:-1, present])
    np.testing.assert_allclose(mean_doppler, -rate, rtol=0.0, atol=1e-3)
    assert np.abs(observed.carrier_cyc[0, present]).max() < 1.0


def test_a_copy_exists_from_its_onset_and_states_when_found(scene: Scene) -> None:
    (observed, _), labels = draw(make_ideal_measurements(scene), rng=np.random.default_rng(1))
    for column, signal in enumerate(observed.signals):
        present = np.isfinite(observed.pseudorange_m[:, column])
        np.testing.assert_array_equal(observed.status[:, column], np.where(present, 0, 1))
        if labels[SignalRef("one", signal)] == "spoofed":
            found_s, missed_s = observed.found_elapsed_s[column], observed.missed_elapsed_s[column]
            assert missed_s < 1.5 < found_s < 3.0
            np.testing.assert_array_equal(present, observed.elapsed_s - 0.5 > 1.5)
        else:
            assert present.all()
            assert np.isnan(observed.missed_elapsed_s[column])


def test_receivers_share_epochs(scene: Scene) -> None:
    (first, second), _ = draw(make_ideal_measurements(scene), rng=np.random.default_rng(1))
    shared = np.intersect1d(first.gpst, second.gpst)
    assert shared.size >= 28
    assert np.all(np.diff(shared) == np.timedelta64(1, "s"))
    assert np.all(shared == shared.astype("datetime64[s]"))  # whole seconds, whenever the scene began


def test_double_differences_name_the_copies(scene: Scene) -> None:
    (first, second), labels = draw(make_ideal_measurements(scene), rng=np.random.default_rng(1), noise=SILENT)
    _, at_one, at_two = np.intersect1d(first.gpst, second.gpst, return_indices=True)
    assert first.signals == second.signals
    single_m = second.pseudorange_m[at_two[10]] - first.pseudorange_m[at_one[10]]
    # labels are equal, true times are not: each range moves on by its rate in the difference of the clocks
    apart_s = (2.1e-4 + 3.3e-4) + 11.0 * 1.8e-6
    single_m = single_m + apart_s * SPEED_OF_LIGHT_M_S / L1_HZ * first.doppler_hz[at_one[10]]
    false = np.array([labels[SignalRef("one", signal)] == "spoofed" for signal in first.signals])
    assert np.ptp(single_m[false]) < 0.02
    assert np.ptp(single_m[~false]) > 30.0


def test_noise_has_the_sigma_and_the_correlation_asked_for(scene: Scene) -> None:
    geometry = make_ideal_measurements(scene)[0]
    model = NoiseModel(sigma_m=0.8, ar1=0.9)
    error_m = draw_noise(geometry, model, rng=np.random.default_rng(2), draws=(4000,))
    assert error_m.shape == (4000, *geometry.pseudorange_m.shape)
    steady = error_m[..., geometry.present.all(axis=0)]
    unit = steady / (0.8 * model.growth(geometry.cn0_dbhz[:, geometry.present.all(axis=0)]))
    assert np.allclose(unit.var(axis=(0, 2)), 1.0, atol=0.04)  # from the first epoch on
    assert np.mean(unit[:, 1:] * unit[:, :-1]) == pytest.approx(0.9, abs=0.01)
    white = draw_noise(geometry, NoiseModel(), rng=np.random.default_rng(2), draws=(4000,))
    assert abs(np.nanmean(white[:, 1:] * white[:, :-1])) < 0.005


def test_a_constant_error_stays_for_the_window(scene: Scene) -> None:
    geometry = make_ideal_measurements(scene)[0]
    model = NoiseModel(sigma_m=0.0, constant_m=1.5)
    error_m = draw_noise(geometry, model, rng=np.random.default_rng(2), draws=(3000,))
    steady = error_m[..., geometry.present.all(axis=0)]
    assert np.ptp(steady, axis=1).max() == 0.0
    assert steady[:, 0].std() == pytest.approx(1.5, rel=0.03)


def test_stated_sigmas_follow_the_carrier_to_noise_density(scene: Scene) -> None:
    (observed, _), _ = draw(make_ideal_measurements(scene), rng=np.random.default_rng(1), noise=NoiseModel(sigma_m=0.4))
    measured = observed.status == 0
    expected_m = 0.4 * 10.0 ** ((45.0 - observed.cn0_dbhz[measured]) / 20.0)
    np.testing.assert_allclose(observed.pseudorange_sigma_m[measured], expected_m)


@pytest.mark.parametrize("kind", ["noise", "cw"])
def test_interference_is_noise_to_every_signal(
    kind: Literal["noise", "cw"], scenario: Scenario, navigation: NavigationData
) -> None:
    # A line in the middle of the band is spread over the width of the chips' spectrum.
    over = 10.0**1.3 * (1.0 if kind == "noise" else scenario.front_end.band_hz / 1.023e6)
    transmit = scenario.receivers[0].model_dump(include={"lat_deg", "lon_deg"}) | {"height_m": 500.0}
    jammer = Interference(kind=kind, transmit=transmit, power_db=13.0, onset_s=10.0, until_s=20.0)
    jammed = scenario.model_copy(update={"duration_s": 30.0, "interference": (jammer,)})
    with_it, without = (
        make_ideal_measurements(make_scene(s, navigation))[0]
        for s in (jammed, jammed.model_copy(update={"interference": ()}))
    )
    fell_db = without.cn0_dbhz - with_it.cn0_dbhz
    inside = (with_it.elapsed_s > 11.0) & (with_it.elapsed_s < 19.0)
    np.testing.assert_allclose(fell_db[inside][:, 0], 10.0 * np.log10(1.0 + over), atol=1e-6)
    assert not fell_db[(with_it.elapsed_s < 9.0) | (with_it.elapsed_s > 21.0)][:, 0].any()


def test_shuffled_letters_say_nothing(scene: Scene) -> None:
    geometries, rng = make_ideal_measurements(scene), np.random.default_rng(5)
    plain = draw(geometries, rng=rng, noise=SILENT)[0][0]
    authentic = {
        signal.sat: plain.pseudorange_m[-1, column] for column, signal in enumerate(plain.signals) if signal.copy == "a"
    }
    seen: Counter[tuple[str, str]] = Counter()
    for _ in range(200):
        observations, labels = draw(geometries, rng=rng, noise=SILENT, shuffle_copies=True)
        observed = observations[0]
        assert list(observed.signals) == sorted(observed.signals)
        for column, signal in enumerate(observed.signals):
            label = labels[SignalRef("one", signal)]
            assert (label == "authentic") == (observed.pseudorange_m[-1, column] == authentic[signal.sat])
            seen[label, signal.copy] += 1
    total = sum(seen.values())
    assert all(abs(seen[label, copy] / total - 0.25) < 0.03 for label in ("authentic", "spoofed") for copy in "ab")


def test_the_same_generator_gives_the_same_window(scenario: Scenario, navigation: NavigationData) -> None:
    (first, _), labels = simulate_observations(scenario, navigation, rng=np.random.default_rng(9), shuffle_copies=True)
    (second, _), again = simulate_observations(scenario, navigation, rng=np.random.default_rng(9), shuffle_copies=True)
    np.testing.assert_array_equal(first.pseudorange_m, second.pseudorange_m)
    assert labels == again


def test_a_window_costs_a_millisecond_or_so(scene: Scene) -> None:
    geometries, rng = make_ideal_measurements(scene), np.random.default_rng(5)
    started_s = time.thread_time()
    for _ in range(100):
        draw(geometries, rng=rng, noise=NoiseModel(ar1=0.9, constant_m=1.0))
    assert (time.thread_time() - started_s) / 100 < 5e-3  # 0.3 ms on the machine of record
