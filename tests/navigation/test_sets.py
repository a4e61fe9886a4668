from dataclasses import replace
from itertools import combinations, product

import numpy as np
import pytest
from scipy import stats
from tests.navigation import sky

from skyproof.formats.rinex_nav import read_nav
from skyproof.navigation import search
from skyproof.navigation import sets as sets_module
from skyproof.navigation.fit_kernels import solve_bancroft
from skyproof.navigation.sets import find_consistent_sets
from skyproof.records import NavigationData

WHITE = {"multipath_sigma_m": 0.01, "ionosphere_share": 0.0}  # the noise of these tests: thermal only


@pytest.fixture(scope="module")
def nav():
    return sky.make_navigation()


@pytest.fixture(scope="module")
def here():
    return sky.place(0.0, 150.0, 50.0)


@pytest.fixture(scope="module")
def twelve(nav, here):
    return sky.list_visible(nav, here, 5.0)[:12]


def make_measurements(seen, nav):
    return sets_module.measure_window(seen, nav, multipath_sigma_m=0.01, ionosphere_share=0.0)[1]


def list_copies(seen, sats):
    return [np.flatnonzero([s.sat == sat for s in seen.signals]) for sat in sats]


def draw_far_place(rng, position, distance_m):
    """Draw a place `distance_m` away along the great circle, up to 300 m higher or lower."""
    up = position / np.linalg.norm(position)
    along = np.cross(up, rng.standard_normal(3))
    angle = distance_m / np.linalg.norm(position)
    direction = np.cos(angle) * up + np.sin(angle) * along / np.linalg.norm(along)
    lat, lon, _ = sky.geodetic_from_ecef(direction * np.linalg.norm(position))
    return sky.ecef_from_geodetic(lat, lon, rng.uniform(0.0, 300.0))


def list_strangers(scene, consistent, nav, skies):
    """List members of a set from another sky than most, and by how many metres their own copies differ."""
    owners = scene.list_owners(consistent.signals)
    own = int(np.bincount(owners).argmax())
    middle = scene.observations.gpst[scene.observations.gpst.size // 2 :][:1]
    found = []
    for signal, owner in zip(consistent.signals, owners, strict=True):
        if owner != own:
            of, own_one = (
                sky.measure(nav, signal.sat, middle, skies[k][1], skies[k][2]).pseudorange_m[0] for k in (owner, own)
            )
            found.append(abs(of - own_one))
    return found


def draw_trial(nav, rng, n_skies):
    """Draw places, offsets from 100 m to 3000 km, clocks, missing satellites and noise from 1 to 5 m."""
    sats: list[str] = []
    while len(sats) < 8:
        first = sky.place(np.degrees(np.arcsin(rng.uniform(-0.95, 0.95))), rng.uniform(-180.0, 180.0), 100.0)
        sats = sky.list_visible(nav, first, 5.0)
    places = [first] + [draw_far_place(rng, first, 10 ** rng.uniform(2.0, 6.48)) for _ in range(n_skies - 1)]
    clock = rng.uniform(-1e-3, 1e-3)
    clocks = [clock] + [clock + rng.choice([0.0, 1e-6, 1e-3, 0.3]) * rng.uniform(-1, 1) for _ in range(n_skies - 1)]
    skies = [([s for s in sats if rng.random() > 0.1], p, b) for p, b in zip(places, clocks, strict=True)]
    noise_m = rng.uniform(1.0, 5.0)
    return sky.make_scene(nav, skies, n=6, noise_m=noise_m * np.sqrt(6), rng=rng, shuffle=True), skies, noise_m


def count_mistakes(nav, rng, trials, n_skies):
    wrong_sizes = mixed = 0
    for _ in range(trials):
        scene, skies, noise_m = draw_trial(nav, rng, n_skies)
        sets = find_consistent_sets(scene.observations, nav, **WHITE)
        expected = sorted((len(sats) for sats, _, _ in skies if len(sats) >= 5), reverse=True)
        wrong_sizes += [len(s.signals) for s in sets] != expected
        for found in sets:
            # Within six sigma of each other copies cannot be told apart, nor does it matter.
            mixed += sum(difference > 6.0 * noise_m for difference in list_strangers(scene, found, nav, skies))
    return wrong_sizes, mixed


@pytest.mark.parametrize(("n_skies", "trials"), [(2, 12), (3, 6)])
def test_skies_are_not_mixed(nav, n_skies, trials):
    wrong_sizes, mixed = count_mistakes(nav, np.random.default_rng(n_skies), trials, n_skies)
    assert mixed == 0
    assert wrong_sizes <= 0.03 * trials  # a missing satellite's place can be taken by chance


@pytest.mark.long
@pytest.mark.parametrize(("n_skies", "trials"), [(2, 1000), (3, 500)])
def test_skies_are_not_mixed_in_many_trials(nav, n_skies, trials):
    wrong_sizes, mixed = count_mistakes(nav, np.random.default_rng(100 + n_skies), trials, n_skies)
    print(f"{n_skies} skies: {wrong_sizes} of {trials} with another size, {mixed} strangers beyond six sigma")
    assert mixed <= 0.003 * trials
    assert wrong_sizes <= 0.02 * trials


def test_each_sky_has_its_place_clock_and_covariance(nav, here, twelve):
    rng = np.random.default_rng(5)
    elsewhere = sky.move_place(here, 900.0, -250.0, 15.0)
    squares = {0: 0.0, 1: 0.0}
    statistics = []
    for _ in range(30):
        scene = sky.make_scene(
            nav, [(twelve, here, 2e-4), (twelve, elsewhere, 2.05e-4)], noise_m=3.0, rng=rng, n=9, shuffle=True
        )
        sets = find_consistent_sets(scene.observations, nav, **WHITE)
        assert len(sets) == 2
        for found in sets:
            (owner,) = set(scene.list_owners(found.signals))
            error = np.append(found.position_ecef_m - (here, elsewhere)[owner], 0.0)
            error[3] = (found.clock_bias_s - (2e-4, 2.05e-4)[owner]) * sky.C
            squares[owner] += error @ np.linalg.solve(found.covariance_m2, error)
            statistics.append(found.statistic)
            assert found.gpst == scene.observations.gpst[4]
            assert found.dof == 8
            np.testing.assert_allclose(found.p_value, stats.chi2(8).sf(found.statistic))
    for total in squares.values():
        assert 1e-3 < stats.chi2(4 * 30).cdf(total) < 1 - 1e-3
    assert stats.kstest(statistics, stats.chi2(8).cdf).pvalue > 1e-3


def test_a_clean_sky_loses_a_signal_at_the_stated_rate(nav, here, twelve):
    rng = np.random.default_rng(6)
    clean = sky.make_scene(nav, [(twelve[:8], here, 0.0)], n=1).observations
    trials, short = 150, 0
    for _ in range(trials):
        noisy = clean.pseudorange_m + 3.0 * rng.standard_normal(clean.pseudorange_m.shape)
        seen = replace(clean, pseudorange_m=noisy, pseudorange_sigma_m=np.full(noisy.shape, 3.0))
        sets = find_consistent_sets(seen, nav, false_alarm_probability=0.05, **WHITE)
        short += not sets or len(sets[0].signals) < 8
    assert stats.binomtest(short, trials, 0.05).pvalue > 1e-3


def test_a_clean_sky_with_one_fault_is_one_set_without_it(nav, here, twelve):
    seen = sky.make_scene(nav, [(twelve, here, 0.0)], noise_m=2.0).observations
    pseudorange = seen.pseudorange_m.copy()
    pseudorange[:, 4] += 150.0
    (found,) = find_consistent_sets(replace(seen, pseudorange_m=pseudorange), nav)
    assert set(seen.signals) - set(found.signals) == {seen.signals[4]}


def test_four_satellites_make_no_set_and_five_do(nav, here, twelve):
    for count, sets in ((4, 0), (5, 1)):
        seen = sky.make_scene(nav, [(twelve[:count], here, 0.0)], noise_m=1.0).observations
        assert len(find_consistent_sets(seen, nav)) == sets
    with pytest.raises(ValueError, match="always fit"):
        find_consistent_sets(seen, nav, min_satellites=4)


def test_without_ephemerides_there_is_no_set(nav, here, twelve):
    seen = sky.make_scene(nav, [(twelve, here, 0.0)]).observations
    assert find_consistent_sets(seen, NavigationData(ephemerides=())) == ()


def test_a_spoofer_of_few_satellites_shows_beside_the_full_sky(nav, here, twelve):
    rng = np.random.default_rng(8)
    elsewhere = sky.move_place(here, -2000.0, 4000.0, 100.0)
    scene = sky.make_scene(
        nav, [(twelve, here, 0.0), (twelve[3:9], elsewhere, 3e-6)], noise_m=2.0, rng=rng, shuffle=True
    )
    sets = find_consistent_sets(scene.observations, nav)
    assert [len(s.signals) for s in sets] == [12, 6]
    assert [set(scene.list_owners(s.signals)) for s in sets] == [{0}, {1}]


def test_a_timing_attack_shows_as_two_clocks_at_one_place(nav, here, twelve):
    scene = sky.make_scene(nav, [(twelve, here, 0.0), (twelve, here, 1e-6)], noise_m=2.0, shuffle=True)
    first, second = find_consistent_sets(scene.observations, nav)
    assert np.linalg.norm(first.position_ecef_m - second.position_ecef_m) < 15.0
    np.testing.assert_allclose(abs(first.clock_bias_s - second.clock_bias_s), 1e-6, atol=3e-8)


def test_one_sky_tracked_thrice_is_one_set(nav, here, twelve):
    scene = sky.make_scene(nav, [(twelve, here, 0.0)] * 3, noise_m=2.0, rng=np.random.default_rng(9))
    (found,) = find_consistent_sets(scene.observations, nav)
    assert len(found.signals) == 12


def test_underground_there_is_no_set_and_in_low_orbit_there_is(nav, twelve):
    for height_m, sets in ((-15e3, 1), (900e3, 1), (-30e3, 0)):
        position = sky.place(0.0, 150.0, height_m)
        seen = sky.make_scene(nav, [(twelve, position, 0.0)], noise_m=1.0).observations
        assert len(find_consistent_sets(seen, nav)) == sets, height_m


def test_a_chance_member_goes_to_its_likelier_set(nav, here, twelve):
    rng = np.random.default_rng(12)
    elsewhere = sky.move_place(here, 1500.0, 900.0, 0.0)
    apart = [
        abs(
            np.subtract(
                *(sky.measure(nav, sat, np.array([sky.START]), p, 0.0).pseudorange_m[0] for p in (here, elsewhere))
            )
        )
        for sat in twelve
    ]
    lent = twelve[int(np.argmin(apart))]  # the true sky lacks it; its false copy lies nearly as well in the true one
    sigma = min(apart) / 4.5
    scene = sky.make_scene(nav, [([s for s in twelve if s != lent], here, 0.0), (twelve, elsewhere, 0.0)], n=1)
    seen = scene.observations
    (column,) = (k for k, s in enumerate(seen.signals) if s.sat == lent)
    false = scene.owners == 1
    amount = np.where(false & (np.arange(false.size) != column), 1.5, 0.1)  # a noisy false sky beside a quiet true one
    noise = sigma * amount * rng.standard_normal(seen.pseudorange_m.shape)
    sigmas = np.full(noise.shape, sigma)
    seen = replace(seen, pseudorange_m=seen.pseudorange_m + noise, pseudorange_sigma_m=sigmas)
    whole = search.SetSearch(make_measurements(seen, nav), list_copies(seen, twelve))
    robber = whole.find_of_size(12, ~false | (np.arange(false.size) == column), false_alarm_probability=1e-4)
    robbed = whole.find_of_size(12, false, false_alarm_probability=1e-4)
    assert robber.statistic[0] < robbed.statistic[0]  # so the true sky comes first, and takes the lent signal
    sets = find_consistent_sets(seen, nav, **WHITE)
    assert [set(scene.list_owners(s.signals)) for s in sets] == [{1}, {0}]
    assert [len(s.signals) for s in sets] == [12, 11]


def test_a_signals_cost_in_a_set_is_its_likelihood_there(nav, here, twelve):
    seen = sky.make_scene(nav, [(twelve[:7], here, 0.0)], n=1, noise_m=2.0).observations
    measurements, sats = make_measurements(seen, nav), np.array([s.sat for s in seen.signals])
    start = np.append(here, 0.0)[None]
    whole = search.solve(measurements, np.arange(7)[None], start)
    cost = sets_module._compute_costs(measurements, sats, [whole])[:, 0]
    for k in range(7):
        rest = search.solve(measurements, np.delete(np.arange(7), k)[None], start)
        misfit, variance = search.compute_innovation(measurements, np.array([k]), rest.state_m, rest.covariance_m2)
        logarithm = stats.norm.logpdf(misfit[0], scale=np.sqrt(variance[0]))
        np.testing.assert_allclose(cost[k], -2.0 * logarithm - np.log(2.0 * np.pi), atol=1e-2)


def test_a_sky_through_a_narrow_gap_is_found(nav, here):
    position = np.concatenate((here, [0.0]))
    sats = sky.list_visible(nav, here, 5.0)
    seen = sky.make_scene(nav, [(sats, here, 0.0)], n=1).observations
    measurements = make_measurements(seen, nav)
    dilution = {
        six: np.trace(search.solve(measurements, np.array([six]), position[None]).covariance_m2[0])
        for six in combinations(range(len(sats)), 6)
    }
    narrow = [seen.signals[k].sat for k in max(dilution, key=dilution.get)]
    for seed in range(8):
        window = sky.make_scene(
            nav, [(narrow, here, 1e-4)], n=4, noise_m=2.0, rng=np.random.default_rng(seed)
        ).observations
        (found,) = find_consistent_sets(window, nav, **WHITE)
        assert len(found.signals) == 6
        assert np.sqrt(np.trace(found.covariance_m2)) > 20.0  # narrow indeed


def test_the_search_finds_what_trying_all_combinations_finds(nav, here, twelve):
    rng = np.random.default_rng(13)
    elsewhere = sky.move_place(here, 120.0, 80.0, 10.0)
    for _ in range(5):
        scene = sky.make_scene(nav, [(twelve[:6], here, 0.0), (twelve[:6], elsewhere, 0.0)], noise_m=3.0, n=1, rng=rng)
        seen = scene.observations
        ranges, copies = make_measurements(seen, nav), list_copies(seen, twelve[:6])
        free = np.ones(12, bool)
        found = search.SetSearch(ranges, copies).find_of_size(6, free, false_alarm_probability=1e-2)
        everything = np.array(list(product(*copies)))
        start = np.tile(np.append(here, 0.0), (len(everything), 1))
        solved = search.solve(ranges, everything, start, rounds=3)
        passing = solved.statistic <= stats.chi2(2).isf(1e-2)
        assert {frozenset(row) for row in found.choice.tolist()} == {
            frozenset(row) for row in everything[passing].tolist()
        }
        assert (np.diff(found.statistic) >= 0).all()
        np.testing.assert_allclose(found.statistic, np.sort(solved.statistic[passing]), atol=1e-3)


def test_the_closed_form_has_the_place_and_no_negative_range(nav, here, twelve):
    for four in ([0, 1, 2, 3], [2, 5, 7, 9], [1, 4, 8, 11]):
        seen = sky.make_scene(nav, [([twelve[k] for k in four], here, 1e-3)], n=1, air=False).observations
        measurements = make_measurements(seen, nav)
        solutions = np.empty((2, 4))
        solve_bancroft(measurements.satellite_ecef_m, measurements.range_m, solutions)
        assert np.nanmin(np.linalg.norm(solutions[:, :3] - here, axis=1)) < 1e3  # the Earth's turn is rough there
        assert not np.any(measurements.range_m - solutions[:, 3:] < 0.0)
    solve_bancroft(np.repeat(measurements.satellite_ecef_m[:1], 4, axis=0), np.full(4, 2.2e7), solutions)
    assert np.isnan(solutions).all()


def test_each_four_is_solved_with_its_own_atmosphere(nav, here, twelve):
    seen = sky.make_scene(nav, [(twelve, here, 1e-3)], n=1).observations
    measurements = make_measurements(seen, nav)
    whole = search.SetSearch(measurements, list_copies(seen, twelve))
    for level in (3, 5, 8):
        fours = whole._find_fours_up_to(level)
        good = np.trace(fours.covariance_m2, axis1=1, axis2=2) < (20 * 0.01) ** 2
        distance = np.linalg.norm(fours.state_m[good, :3] - here, axis=1)
        assert good.any()
        assert (distance < 1.0).sum() == len({tuple(c) for c in fours.choice[good].tolist()})


@pytest.mark.shared_data
@pytest.mark.parametrize("receiver", ["rx1", "rx2"])
def test_the_meaconing_pair_shows_two_skies_after_onset(shared_data, receiver):
    rng = np.random.default_rng(14)
    nav = read_nav(shared_data / "rf" / "brdc0010.22n")
    seen, clock_s, truth = sky.read_meaconing_pair(shared_data, receiver)
    noisy = replace(seen, pseudorange_m=seen.pseudorange_m + 3.0 * rng.standard_normal(seen.pseudorange_m.shape))
    for first, labels in ((2, ["authentic"]), (30, ["authentic", "spoofed"]), (45, ["authentic", "spoofed"])):
        sets = find_consistent_sets(noisy.select(slice(first, first + 9)), nav)
        copies = sorted("".join({s.copy for s in found.signals}) for found in sets)
        assert copies == ["a", "b"][: len(labels)]
        for found in sets:
            assert len(found.signals) == 12
            label = "authentic" if found.signals[0].copy == "a" else "spoofed"
            place, extra_s = sky.find_shown(truth, receiver, label)
            assert np.linalg.norm(found.position_ecef_m - place) < 8.0
            assert abs(found.clock_bias_s - clock_s[first + 4] - extra_s) * sky.C < 8.0
