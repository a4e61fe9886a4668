"""Errors of the field have the size, the memory and the company that is said of them. Counted, two-sided."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import NavigationData
from skyproof.simulator.measurement_errors import (
    Exposure,
    FieldErrors,
    SignalPath,
    compute_ionosphere_obliquity,
    compute_troposphere_obliquity,
    draw_field_errors,
)
from skyproof.simulator.measurements import NoiseModel, draw, draw_noise, make_ideal_measurements
from skyproof.simulator.received import Scene
from skyproof.simulator.scenario import Scenario
from skyproof.simulator.sky import make_scene

HERE = np.array([6.378e6, 0.0, 0.0])
NO_AIR = FieldErrors(seed=1, ionosphere_m=0.0, troposphere_m=0.0)
NO_REFLECTIONS = FieldErrors(seed=1, multipath_floor_m=0.0, multipath_low_m=0.0)
WAVELENGTH_M = SPEED_OF_LIGHT_M_S / L1_HZ
DRAWS = 20_000


def make_exposure(
    *paths: SignalPath, name: str = "one", el_deg: float = 90.0, epochs: int = 6, first: int = 0
) -> Exposure:
    el_rad = np.full((epochs, len(paths)), np.radians(el_deg))
    return Exposure(receiver=name, paths=paths, first=first, el_rad=el_rad)


def draw_from_sky(sat: str = "G05", east_km: float = 0.0) -> SignalPath:
    return SignalPath(sat=sat, air_ecef_m=HERE + np.array([0.0, 1e3 * east_km, 0.0]))


def correlate(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.mean(one * other) / np.sqrt(np.mean(one**2) * np.mean(other**2)))


def is_correlated(one: np.ndarray, other: np.ndarray, expected: float) -> bool:
    """Test whether a correlation is within 4 sigma of that of as many independent pairs as there are draws."""
    spread = max((1.0 - expected**2) / np.sqrt(one.shape[0]), 1e-12)
    return abs(correlate(one, other) - expected) < 4.0 * spread + 1e-9


@pytest.mark.parametrize(("el_deg", "sigma_m"), [(90.0, 0.13007), (30.0, 0.15639), (10.0, 0.32498), (0.0, 0.66)])
def test_reflections_grow_towards_the_horizon(el_deg: float, sigma_m: float) -> None:
    (error,) = draw_field_errors(NO_AIR, [make_exposure(draw_from_sky(), el_deg=el_deg)], 1.0, draws=(DRAWS,))
    spread = 4.0 * np.sqrt(2.0 / DRAWS)
    np.testing.assert_allclose(error.code_m.var(axis=0) / sigma_m**2, 1.0, atol=spread)
    np.testing.assert_allclose(error.carrier_cyc.var(axis=0) / (0.05 * sigma_m) ** 2, 1.0, atol=spread + 0.05)
    assert np.abs(error.code_m.mean(axis=0) / sigma_m).max() < 4.0 / np.sqrt(DRAWS)
    assert is_correlated(error.code_m[:, 0, 0], error.carrier_cyc[:, 0, 0], 0.0)


@pytest.mark.parametrize("interval_s", [0.2, 1.0, 30.0])
def test_reflections_are_remembered_by_time_and_not_by_epochs(interval_s: float) -> None:
    (error,) = draw_field_errors(NO_AIR, [make_exposure(draw_from_sky())], interval_s, draws=(DRAWS,))
    for values in (error.code_m[..., 0], error.carrier_cyc[..., 0]):
        for lag in (1, 4):
            assert is_correlated(values[:, 1], values[:, 1 + lag], np.exp(-lag * interval_s / 60.0))


@pytest.mark.parametrize("interval_s", [0.2, 60.0, 1800.0])
def test_air_is_smooth_and_slow(interval_s: float) -> None:
    model = replace(NO_REFLECTIONS, troposphere_m=0.0)
    (error,) = draw_field_errors(model, [make_exposure(draw_from_sky(), el_deg=20.0)], interval_s, draws=(DRAWS,))
    values, turns = error.code_m[..., 0], interval_s / 1800.0
    slant_m = 1.5 * compute_ionosphere_obliquity(np.radians(20.0))
    np.testing.assert_allclose(values.var(axis=0) / slant_m**2, 1.0, atol=4.0 * np.sqrt(2.0 / DRAWS))
    np.testing.assert_allclose(error.carrier_cyc[..., 0] * WAVELENGTH_M, -values, atol=1e-12)
    for lag in (1, 5):
        assert is_correlated(values[:, 0], values[:, lag], (1.0 + lag * turns) * np.exp(-lag * turns))
    moved_m = np.diff(values[:, :2], axis=1).std() / slant_m
    expected = np.sqrt(2.0 - 2.0 * (1.0 + turns) * np.exp(-turns)) if turns > 1e-2 else turns
    assert moved_m == pytest.approx(expected, rel=4.0 / np.sqrt(2.0 * DRAWS) + 2e-3)


def test_neighbours_share_air_but_no_reflections() -> None:
    near, far = (
        make_exposure(draw_from_sky(east_km=0.06), name="two"),
        make_exposure(draw_from_sky(east_km=375.0), name="three"),
    )
    first, second, third = draw_field_errors(
        replace(NO_REFLECTIONS, troposphere_m=0.0), [make_exposure(draw_from_sky()), near, far], 1.0, draws=(DRAWS,)
    )
    assert (second.code_m - first.code_m).std() == pytest.approx(1.5 * 0.06 / 375.0, rel=0.03)  # 4 mm/km
    assert is_correlated(first.code_m[:, 0, 0], third.code_m[:, 0, 0], np.exp(-0.5))
    first, second = draw_field_errors(
        NO_AIR, [make_exposure(draw_from_sky(), draw_from_sky("G06")), near], 1.0, draws=(DRAWS,)
    )
    assert is_correlated(first.code_m[:, 0, 0], second.code_m[:, 0, 0], 0.0)
    assert is_correlated(first.code_m[:, 0, 0], first.code_m[:, 0, 1], 0.0)


def test_false_signals_share_the_way_from_their_transmitter() -> None:
    def relay(sat: str, antenna: str = "meaconer/0") -> SignalPath:
        return SignalPath(sat=sat, air_ecef_m=HERE, relay="meaconer", transmitter=antenna)

    def make(sat: str) -> SignalPath:
        return SignalPath(sat=sat, air_ecef_m=None, transmitter="spoofer/0")

    whole = FieldErrors(seed=3)
    near, far = draw_field_errors(
        whole, [make_exposure(make("G05"), make("G06")), make_exposure(make("G05"), name="two")], 1.0, draws=(DRAWS,)
    )
    np.testing.assert_array_equal(near.code_m[..., 0], near.code_m[..., 1])  # one direction, and no air
    np.testing.assert_array_equal(near.carrier_cyc[..., 0], near.carrier_cyc[..., 1])
    assert near.code_m.std() == pytest.approx(0.66, rel=0.03)
    assert is_correlated(near.code_m[:, 0, 0], far.code_m[:, 0, 0], 0.0)

    paths = relay("G05"), relay("G06"), relay("G07", "meaconer/1")
    near, far = draw_field_errors(
        whole, [make_exposure(*paths), make_exposure(*paths, name="two")], 1.0, draws=(DRAWS,)
    )
    # between satellites at one receiver the way from the antenna falls out; between receivers the ears' errors do
    near_m, far_m = (error.code_m[:, 0, 0] - error.code_m[:, 0, 1] for error in (near, far))
    np.testing.assert_allclose(near_m, far_m, atol=1e-9)
    expected_m = np.sqrt(2.0 * (0.13007**2 + 1.5**2 + 0.12**2))
    assert near_m.std() == pytest.approx(expected_m, rel=4.0 / np.sqrt(2.0 * DRAWS))
    across = (near.code_m - far.code_m)[:, 0]
    np.testing.assert_allclose(across[:, 0], across[:, 1], atol=1e-9)
    assert is_correlated(across[:, 0], across[:, 2], 0.0)  # another antenna, another way


def test_the_carrier_moves_by_a_quarter_of_a_cycle_at_most() -> None:
    (error,) = draw_field_errors(
        replace(NO_AIR, carrier_cyc_a_m=5.0), [make_exposure(draw_from_sky(), el_deg=5.0)], 1.0, draws=(999,)
    )
    assert 0.24 < np.abs(error.carrier_cyc).max() <= 0.25


def test_one_seed_is_one_world_whatever_is_asked_for() -> None:
    model = FieldErrors(seed=9)
    whole = draw_field_errors(
        model,
        [
            make_exposure(draw_from_sky(), draw_from_sky("G06"), epochs=50),
            make_exposure(draw_from_sky(east_km=1.0), epochs=50, name="two"),
        ],
        1.0,
        draws=(3,),
    )
    (window,) = draw_field_errors(model, [make_exposure(draw_from_sky("G06"), first=20, epochs=10)], 1.0, draws=(3,))
    np.testing.assert_allclose(window.code_m[..., 0], whole[0].code_m[:, 20:30, 1], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(window.carrier_cyc[..., 0], whole[0].carrier_cyc[:, 20:30, 1], rtol=0.0, atol=1e-12)
    (other,) = draw_field_errors(
        replace(model, seed=10), [make_exposure(draw_from_sky("G06"), first=20, epochs=10)], 1.0, draws=(3,)
    )
    assert np.abs(other.code_m - window.code_m).min() > 0.0
    with pytest.raises(ValueError, match="seed"):
        draw_field_errors(FieldErrors(), [make_exposure(draw_from_sky())], 1.0)


def test_obliquities_are_those_of_the_standard() -> None:
    # values of the formulas at the zenith and at 5 degrees, worked out by hand from DO-229D's constants
    np.testing.assert_allclose(compute_ionosphere_obliquity(np.radians([90.0, 5.0])), [1.0, 3.0406], rtol=1e-4)
    np.testing.assert_allclose(compute_troposphere_obliquity(np.radians([90.0, 5.0])), [1.0, 10.2171], rtol=1e-4)


@pytest.fixture(scope="module")
def scene(scenario: Scenario, navigation: NavigationData) -> Scene:
    return make_scene(scenario.model_copy(update={"duration_s": 40.0}), navigation)


def test_observations_have_them_if_asked(scene: Scene) -> None:
    geometries = make_ideal_measurements(scene)
    silent = NoiseModel(sigma_m=0.0, carrier_sigma_cyc=0.0, doppler_sigma_hz=0.0)
    field = NoiseModel(sigma_m=0.0, carrier_sigma_cyc=0.0, doppler_sigma_hz=0.0, field=FieldErrors(seed=4))
    plain, _ = draw(geometries, rng=np.random.default_rng(1), noise=silent)
    moved, labels = draw(geometries, rng=np.random.default_rng(2), noise=field)
    again, _ = draw(geometries, rng=np.random.default_rng(3), noise=field)
    np.testing.assert_array_equal(moved[0].pseudorange_m, again[0].pseudorange_m)
    error_m = [with_errors.pseudorange_m - other.pseudorange_m for with_errors, other in zip(moved, plain, strict=True)]
    assert np.nanstd(error_m[0][-1]) > 0.5
    # a meaconer's errors differ between receivers by one number, the true ones by one per satellite
    _, at_one, at_two = np.intersect1d(plain[0].gpst, plain[1].gpst, return_indices=True)
    across_m = error_m[0][at_one[-1]] - error_m[1][at_two[-1]]
    false = np.array([labels[ref] == "spoofed" for ref in labels if ref.receiver == "one"])
    assert np.ptp(across_m[false]) < 1e-6
    assert np.ptp(across_m[~false]) > 0.1


def test_white_noise_is_as_it_was_without_them(scene: Scene) -> None:
    geometry = make_ideal_measurements(scene)[0]
    white = draw_noise(geometry, NoiseModel(), rng=np.random.default_rng(2))
    noise = draw_noise(geometry, NoiseModel(field=FieldErrors()), rng=np.random.default_rng(2))
    extra = noise - white
    present = geometry.present.all(axis=0)
    assert correlate(extra[1:, present], extra[:-1, present]) > 0.9
    assert abs(correlate(white[1:, present], white[:-1, present])) < 0.2
