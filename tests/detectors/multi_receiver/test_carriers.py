"""Carriers between receivers: rates under both hypotheses, and what they decide where code cannot."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.multi_receiver.carriers import (
    Fractions,
    estimate_fractions,
    evaluate_one_antenna_carriers,
    sky_carriers,
)
from skyproof.detectors.multi_receiver.common_epochs import CommonPhases, align_ranges
from skyproof.detectors.multi_receiver.detector import MultiReceiver
from skyproof.detectors.multi_receiver.known_geometry import AntennaDistance, AntennaPlaces
from skyproof.detectors.multi_receiver.one_antenna import TrackNoise
from skyproof.detectors.multi_receiver.pairing import evaluate_sky_by_carriers, pair_up
from skyproof.detectors.multi_receiver.settings import MultiReceiverSettings
from skyproof.records import OBSERVABLES, Cause, CellStatus
from skyproof.statistics.distributions import binomial_survival
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

TRUE_M = np.array([0.6, -0.75, 0.25])
PLACES = {"rx1": (0.0, 0.0, 0.0), "rx2": tuple(TRUE_M)}
GIVEN = {
    "places": {"antennas_enu_m": PLACES, "antennas_sigma_m": 0.01},
    "distance": {"antenna_distance_m": 1.0, "antenna_distance_sigma_m": 0.02},
}
WAVE_M = 0.19029
ERRORS = TrackErrors(sigma_m=1.0, correlation=0.5, constant_m=1.0)
RATE = 1e-6


def draw_directions(rng, count):
    """Draw directions of satellites above 10 degrees."""
    up = np.sin(rng.uniform(np.radians(10.0), 0.5 * np.pi, count))
    azimuth, level = rng.uniform(0.0, 2.0 * np.pi, count), np.sqrt(1.0 - up**2)
    return np.column_stack([level * np.sin(azimuth), level * np.cos(azimuth), up])


def draw_fractions(rng, way_cyc, sigma_cyc):
    """Draw fractions of differences of this way, with whole cycles and noise of their own."""
    cycles = way_cyc + rng.integers(-50, 50, way_cyc.size) + sigma_cyc * rng.standard_normal(way_cyc.size)
    cycles -= cycles[0]
    return Fractions(rows=np.arange(cycles.size), cycles=cycles - np.rint(cycles), sigma_cyc=sigma_cyc, wave_m=WAVE_M)


def draw_sigmas(rng, count):
    return rng.uniform(0.02, 0.06, count)


@pytest.mark.parametrize("count", [5, 8, 14])
def test_of_one_antenna_small_p_values_are_as_rare_as_they_say(count):
    rng, draws = np.random.default_rng(count), 3000
    p_values = np.array(
        [
            evaluate_one_antenna_carriers(draw_fractions(rng, np.zeros(count), draw_sigmas(rng, count))).p_value
            for _ in range(draws)
        ]
    )
    for rate in (0.1, 0.01):
        assert binomial_survival(np.sum(p_values < rate), draws, rate) > 1e-3
    assert np.mean(p_values < 0.1) > 0.05  # and not much rarer


@pytest.mark.parametrize(("near_m", "count"), [(1.0, 5), (5.0, 8), (50.0, 6)])
def test_skies_put_antennas_into_one_place_as_rarely_as_stated(near_m, count):
    rng, draws, p_values = np.random.default_rng(count), 4000, []
    for _ in range(draws):
        way_cyc = draw_directions(rng, count) @ draw_directions(rng, 1)[0] * near_m * rng.uniform(1.0, 2.0) / WAVE_M
        p_values.append(
            evaluate_one_antenna_carriers(draw_fractions(rng, way_cyc, draw_sigmas(rng, count))).p_unrelated
        )
    for rate in (0.1, 0.01):
        assert binomial_survival(np.sum(np.array(p_values) < rate), draws, rate) > 1e-3
    assert np.mean(np.array(p_values) < 0.1) > 0.05


@pytest.mark.parametrize("known", ["places", "distance"])
@pytest.mark.parametrize("count", [6, 10])
def test_small_p_values_of_the_sky_keep_their_frequency(known, count):
    rng, draws = np.random.default_rng(count), 150
    p_values = np.empty(draws)
    for k in range(draws):
        off_m = 0.01 * rng.standard_normal((2, 3))
        if known == "places":
            geometry, true_m = AntennaPlaces(PLACES, 0.01), TRUE_M + off_m[1] - off_m[0]
        else:
            length_m = 1.0 + 0.02 * rng.standard_normal()
            geometry, true_m = AntennaDistance(1.0, 0.02), draw_directions(rng, 1)[0] * length_m
        unit, sigma = draw_directions(rng, count), draw_sigmas(rng, count)
        test = sky_carriers([draw_fractions(rng, -unit @ true_m / WAVE_M, sigma)], [unit], geometry, ("rx1", "rx2"))
        p_values[k] = 1.0 if test is None else test.p_value
    for rate in (0.1, 0.01):
        assert binomial_survival(np.sum(p_values < rate), draws, rate) > 1e-3


def test_the_best_cycles_and_baseline_of_all_are_found():
    # Where some fit, against every way to choose the whole cycles of all satellites near the place that is known.
    rng = np.random.default_rng(4)
    geometry = AntennaPlaces(PLACES, 0.02)
    for _ in range(5):
        unit, sigma = draw_directions(rng, 5), np.full(5, 0.03)
        kind_fractions = draw_fractions(rng, -unit @ TRUE_M / WAVE_M, sigma)
        columns = np.column_stack([-unit / WAVE_M, np.ones(5)]) / sigma[:, None]
        expected_m = np.append(np.asarray(TRUE_M), 0.0)
        prior = np.diag([1.0 / (np.sqrt(2.0) * 0.02)] * 3 + [0.0])
        stacked, least = np.vstack([columns, prior]), np.inf
        middle = np.rint(kind_fractions.cycles - (-unit @ TRUE_M / WAVE_M))
        for whole in np.stack(np.meshgrid(*[np.arange(-3, 4)] * 4, indexing="ij"), -1).reshape(-1, 4):
            y = np.append((kind_fractions.cycles - middle - np.append(0.0, whole)) / sigma, prior @ expected_m)
            residual = y - stacked @ np.linalg.lstsq(stacked, y, rcond=None)[0]
            least = min(least, float(residual @ residual))
        assert sky_carriers([kind_fractions], [unit], geometry, ("rx1", "rx2")).statistic == pytest.approx(
            least, rel=1e-4
        )


def make_scene(**changes):
    options = {"antennas_enu_m": PLACES, "epochs": 10, "errors": ERRORS, "max_satellites": 10}
    return MeasuredScene(**(options | changes))


def examine(records, **settings):
    return MultiReceiver(MultiReceiverSettings(false_alarm_probability=RATE, **settings)).examine(records)[0]


def list_named(evidence, says):
    return {(ref.receiver, ref.signal.copy) for e in evidence if e.says == says for ref in e.signals}


def test_error_free_carriers_fit_the_sky_in_any_geometry():
    # Half a step between the receivers' epochs, 100 m of distance and 10 m of height: millimetres each.
    places = {"rx1": (0.0, 0.0, 0.0), "rx2": (60.0, 80.0, 10.0)}
    exact = make_scene(antennas_enu_m=places, first_epoch_s=(0.0, 0.45))
    records = replace(exact.records(np.random.default_rng(0)), observations=tuple(exact._exact))
    pairing = pair_up(records, records.sets, TrackNoise(), min_satellites=5)
    assert evaluate_sky_by_carriers([pairing], AntennaPlaces(places, 0.01)).statistic < 0.1


def test_a_metre_apart_ten_seconds_tell_the_sky_from_one_antenna():
    for seed in range(3):
        rng = np.random.default_rng(seed)
        (sky,) = examine(make_scene().records(rng), **GIVEN["places"])
        assert sky.says == "authentic"
        assert sky.data["by"] == "carriers"
        assert sky.statistic > sky.threshold
        assert sky.p_value < RATE
        (false,) = examine(make_scene(sky=(), false=(FalseSky(),)).records(rng), **GIVEN["places"])
        assert false.says == "spoofed"


def test_fractions_that_fit_by_chance_are_no_evidence():
    # Ten signals of one kind fit somewhere on a shell of 2 cm with any fractions; carriers of more kinds do not.
    (sky,) = examine(make_scene().records(np.random.default_rng(0)), **GIVEN["distance"])
    assert (sky.says, sky.data["carriers"]) == ("undecided", "coarse")


def test_a_metre_apart_the_false_sky_beside_the_true_is_named():
    evidence = examine(make_scene(false=(FalseSky(),)).records(np.random.default_rng(0)), **GIVEN["places"])
    assert list_named(evidence, "spoofed") == {("rx1", "b"), ("rx2", "b")}
    assert list_named(evidence, "authentic") == {("rx1", "a"), ("rx2", "a")}


@pytest.mark.parametrize("kinds", [1, 3])
def test_how_often_any_fractions_fit_is_no_more_than_expected(kinds):
    rng, draws, fit, expected = np.random.default_rng(kinds), 60, 0, 0.0
    for _ in range(draws):
        units = [draw_directions(rng, 7) for _ in range(kinds)]
        ones = [draw_fractions(rng, rng.uniform(0.0, 1.0, 7), np.full(7, 0.04)) for _ in range(kinds)]
        test = sky_carriers(ones, units, AntennaDistance(1.0, 0.02), ("rx1", "rx2"))
        fit += test.p_value >= 1e-3
        expected += min(test.by_chance, 1.0)
    assert fit <= expected + 4.0 * np.sqrt(expected) + 1.0
    assert (kinds == 1) == (fit > 0.1 * draws)


def test_of_three_receivers_all_have_to_fit():
    places = PLACES | {"rx3": (-0.8, 0.4, 0.1)}
    clean = make_scene(antennas_enu_m=places).records(np.random.default_rng(0))
    assert [e.says for e in examine(clean, antennas_enu_m=places, antennas_sigma_m=0.01)] == ["authentic"]
    moved = places | {"rx3": (-0.8, 0.7, 0.1)}
    findings = examine(clean, antennas_enu_m=moved, antennas_sigma_m=0.01)
    assert {e.says for e in findings} == {"undecided"}
    assert findings[0].data["carriers"] == "misfit"


@pytest.mark.parametrize("given", GIVEN)
def test_a_receiver_that_is_captured_alone_is_not_authentic(given):
    for seed in range(3):
        made = make_scene(sky=("rx1",), false=(FalseSky(receivers=("rx2",), shows_enu_m=(0.5, 0.0, 0.0), delay_m=0.0),))
        evidence = examine(made.records(np.random.default_rng(seed)), **GIVEN[given])
        assert list_named(evidence, "authentic") == set()


def change_cells(records, **cells):
    """Change these cells of the second receiver by functions of its observations."""
    first, second = records.observations
    return replace(records, observations=(first, replace(second, **{n: f(second) for n, f in cells.items()})))


def test_carriers_of_no_whole_cycles_are_no_evidence():
    records = make_scene(sky=(), false=(FalseSky(),)).records(np.random.default_rng(0))
    odd = np.random.default_rng(1).uniform(0.0, 1.0, 10)
    findings = examine(change_cells(records, carrier_cyc=lambda o: o.carrier_cyc + odd), **GIVEN["places"])
    assert [e.says for e in findings] == ["undecided"]


def test_slips_and_half_cycles_change_nothing():
    rng = np.random.default_rng(0)
    for made, word in ((make_scene(), "authentic"), (make_scene(sky=(), false=(FalseSky(),)), "spoofed")):
        records = made.records(rng)
        slipped = change_cells(records, carrier_cyc=lambda o: o.carrier_cyc + rng.integers(-9, 9, o.carrier_cyc.shape))
        assert [e.says for e in examine(slipped, **GIVEN["places"])] == [word]
        halves = 0.5 * rng.integers(0, 2, 10)
        half_open = change_cells(
            records,
            carrier_cyc=lambda o, halves=halves: o.carrier_cyc + halves,
            half_cycle_open=lambda o: np.full(o.status.shape, True),
        )
        assert [e.says for e in examine(half_open, carrier_multipath_sigma_m=0.002, **GIVEN["places"])] == [word]


def drop_epochs(observations, dropped):
    kept = np.setdiff1d(np.arange(observations.gpst.size), dropped)
    cells = [*OBSERVABLES, "status", "half_cycle_open", "quadrature_m", "gpst", "elapsed_s"]
    return replace(observations, **{name: getattr(observations, name)[kept] for name in cells})


@pytest.mark.parametrize("number", [0, 1])
def test_epochs_that_one_receiver_lacks_cost_only_themselves(number):
    # The noise of Dopplers over the whole step to an epoch that is not used does not count.
    made = make_scene(epochs=20, first_epoch_s=(0.0, 0.0))
    records = made.records(np.random.default_rng(0))
    dropped = np.arange(2, 20, 5)
    rough = [replace(o, doppler_sigma_hz=np.full(o.status.shape, 1.0)) for o in records.observations]
    both_short = replace(records, observations=tuple(drop_epochs(o, dropped) for o in rough))
    first_short = replace(
        records, observations=tuple(drop_epochs(o, dropped) if k == number else o for k, o in enumerate(rough))
    )
    expected, found = (estimate_fractions(align_ranges(r, r.sets).phases, 1, 0.005) for r in (both_short, first_short))
    np.testing.assert_allclose(found.sigma_cyc, expected.sigma_cyc)
    np.testing.assert_allclose(found.cycles, expected.cycles, atol=1e-3)
    assert [e.says for e in examine(first_short, **GIVEN["places"])] == ["authentic"]


def test_the_noise_of_a_stretch_is_that_of_its_instants():
    records = make_scene(epochs=20).records(np.random.default_rng(0))
    first, second = records.observations
    grown = np.where(np.arange(20)[:, None] < 10, 1.0, 3.0) * np.ones(second.status.shape)
    ranges = align_ranges(
        replace(records, observations=(first, replace(second, pseudorange_sigma_m=grown))), records.sets
    )
    np.testing.assert_allclose(ranges.at(ranges.time_s < 9.0).sigma_m[:, 1], 1.0)
    np.testing.assert_allclose(ranges.at(ranges.time_s > 11.0).sigma_m[:, 1], 3.0)


@pytest.mark.parametrize("missing", ["carrier_cyc", "doppler_hz"])
def test_what_carriers_lack_is_said(missing):
    # Epochs of the two lie some tenths of a second apart: without Dopplers they cannot be brought together.
    records = make_scene().records(np.random.default_rng(0))
    records = change_cells(records, **{missing: lambda o: np.full(o.status.shape, np.nan)})
    if missing == "doppler_hz":
        pytest.skip("ranges need Dopplers as well") if not examine(records, **GIVEN["places"]) else None
    assert all(e.says == "undecided" for e in examine(records, **GIVEN["places"]))


def test_a_place_known_too_roughly_decides_nothing_by_carriers():
    (finding,) = examine(make_scene().records(np.random.default_rng(0)), antennas_enu_m=PLACES, antennas_sigma_m=1.0)
    assert (finding.says, finding.data["carriers"]) == ("undecided", "coarse")


def test_frequencies_of_their_own_have_no_fractions():
    n = 6
    phases = CommonPhases(
        cyc=np.zeros((5, n, 2)),
        sigma_cyc=np.full((5, n, 2), 0.01),
        wave_m=np.full(n, WAVE_M),
        half_open=np.zeros((5, n, 2), bool),
        whole_cycles=np.ones(n, bool),
    )
    assert estimate_fractions(phases, 1, 0.005) is not None
    assert estimate_fractions(replace(phases, whole_cycles=np.zeros(n, bool)), 1, 0.005) is None
    assert estimate_fractions(phases.take(np.arange(4)), 1, 0.005) is None


def test_status_of_cells_is_of_no_concern():
    records = make_scene().records(np.random.default_rng(0))
    slips = change_cells(records, status=lambda o: np.full(o.status.shape, CellStatus.SLIP, np.uint8))
    assert [e.says for e in examine(slips, **GIVEN["places"])] == ["authentic"]


THREE = PLACES | {"rx3": (-0.8, 0.4, 0.1)}


def state_noise(records):
    """State that the noise of each receiver is of another antenna than that of any other."""
    names = {o.receiver for o in records.observations}
    return replace(records, apart_from={name: frozenset(names - {name}) for name in names})


@pytest.mark.parametrize("places", [PLACES, THREE], ids=["two", "three"])
def test_antennas_that_differ_in_noise_are_never_in_one_place(places):
    # Nothing is stated: code alone may come from antennas a metre apart.
    rng = np.random.default_rng(0)
    false = make_scene(antennas_enu_m=places, sky=(), false=(FalseSky(),)).records(rng)
    (finding,) = examine(state_noise(false))
    assert (finding.code, finding.failed, finding.says) == ("one_place", True, "undecided")
    assert finding.may_also_be == (Cause.STATEMENT,)
    assert [e.failed for e in examine(false)] == [False]
    (true,) = examine(state_noise(make_scene(antennas_enu_m=places).records(rng)))
    assert not true.failed


def test_antennas_half_a_wavelength_apart_are_not_in_one_place():
    for seed in range(10):
        rng = np.random.default_rng(seed)
        near = {"rx1": (0.0, 0.0, 0.0), "rx2": tuple(0.095 * draw_directions(rng, 1)[0])}
        assert not any(e.failed for e in examine(state_noise(make_scene(antennas_enu_m=near).records(rng))))


def test_one_receiver_of_three_without_noise_of_its_own_decides_nothing():
    records = state_noise(
        make_scene(antennas_enu_m=THREE, sky=(), false=(FalseSky(),)).records(np.random.default_rng(0))
    )
    apart_from = {"rx1": frozenset({"rx2"}), "rx2": frozenset({"rx1"})}
    assert not any(e.failed for e in examine(replace(records, apart_from=apart_from)))
