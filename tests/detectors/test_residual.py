from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats

from skyproof.detectors.residual import Residual, ResidualSettings, fit_layers
from skyproof.detectors.residual_causes import find_reflected
from skyproof.detectors.second_signals.detector import elevation_rad
from skyproof.detectors.second_signals.second_sky import echoes_p_value, second_sky_p_value
from skyproof.errors import SettingsError
from skyproof.navigation.chance import bound_chance_p_value
from skyproof.navigation.fix import fix_and_geometry
from skyproof.navigation.sets import find_consistent_sets
from skyproof.navigation.window import average_window
from skyproof.records import OBSERVABLES, Cause
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

ERRORS = TrackErrors(sigma_m=1.0, constant_m=1.0)
ONE = {"rx1": (0.0, 0.0, 0.0)}


def draw_scene(**changes):
    return MeasuredScene(**({"antennas_enu_m": ONE, "errors": ERRORS, "epochs": 10} | changes))


def shift_ranges(records, column, metres):
    """Move one channel's pseudoranges."""
    first = records.observations[0]
    pseudorange_m = first.pseudorange_m.copy()
    pseudorange_m[:, column] += metres
    return replace(records, observations=(replace(first, pseudorange_m=pseudorange_m), *records.observations[1:]))


def test_a_clean_sky_fits_one_position():
    (evidence,) = Residual().examine(draw_scene().records(np.random.default_rng(0)))[0]
    assert (evidence.says, evidence.code) == ("clean", "fits")


@pytest.mark.parametrize("metres", [-60.0, 900.0, -1.7e6])
def test_a_single_fault_is_named_and_nothing_else(metres):
    # What comes early, or later than any street makes it, is no reflection.
    records = draw_scene().records(np.random.default_rng(0))
    (finding,) = Residual().examine(shift_ranges(records, 4, metres))[0]
    assert (finding.says, finding.code) == ("undecided", "single_misfit")
    assert finding.data["excluded"] == str(records.observations[0].signals[4])
    assert {"fault", "orbits"} <= set(finding.may_also_be)
    assert "reflections" not in finding.may_also_be or metres == -60.0


@pytest.mark.parametrize("late_m", [(60.0,), (60.0, 140.0)])
def test_satellites_that_come_late_are_reflected(late_m):
    records = draw_scene().records(np.random.default_rng(0))
    for column, metres in enumerate(late_m, 3):
        records = shift_ranges(records, column, metres)
    (reflected,) = Residual().examine(records)[0]
    (o,) = records.observations
    assert {ref.signal for ref in reflected.signals} == set(o.signals[3 : 3 + len(late_m)])
    assert (reflected.says, reflected.code) == ("multipath", "reflected")
    assert reflected.p[Cause.REFLECTIONS] > 1e-3 > reflected.p[Cause.CLEAN]


def test_misfits_of_seven_satellites_are_reflections_of_one():
    records = draw_scene(max_satellites=7).records(np.random.default_rng(0))
    both_shifted = shift_ranges(shift_ranges(records, 3, 60.0), 4, 140.0)
    (finding,) = Residual().examine(both_shifted)[0]
    assert finding.code == "misfit"


def find_lowest(records):
    """Return the column of the lowest satellite, and all elevations, degrees."""
    (o,), (chosen,) = records.observations, records.sets
    sats = [elevation_rad(records.navigation, (chosen,), signal.sat) for signal in o.signals]
    return int(np.argmin(sats)), np.degrees(sats)


@pytest.mark.parametrize("mask_deg", [35.0, 10.0])
def test_no_satellite_below_the_mask_makes_the_word(mask_deg):
    records = draw_scene(mask_deg=3.0).records(np.random.default_rng(0))
    column, elevation_deg = find_lowest(records)
    assert elevation_deg.min() < 10.0
    moved = shift_ranges(records, column, 60.0)
    (low,) = Residual(ResidualSettings(elevation_mask_deg=0.0)).examine(moved)[0]
    (high,) = Residual(ResidualSettings(elevation_mask_deg=mask_deg)).examine(moved)[0]
    assert (low.says, high.says) == ("multipath", "clean")
    assert {ref.signal for ref in high.signals} == {
        signal
        for signal, at_deg in zip(records.observations[0].signals, elevation_deg, strict=True)
        if at_deg >= mask_deg
    }


def test_too_few_satellites_above_the_mask_are_the_reason():
    records = draw_scene().records(np.random.default_rng(0))
    (evidence,) = Residual(ResidualSettings(elevation_mask_deg=75.0)).examine(records)[0]
    assert (evidence.says, evidence.code) == ("undecided", "few_above_mask")


def test_no_satellite_above_the_mask_means_no_test():
    # Such a window ended the run.
    records = draw_scene().records(np.random.default_rng(1))
    (finding,), _ = Residual(ResidualSettings(elevation_mask_deg=89.9)).examine(records)
    assert finding.says == "undecided"


@pytest.mark.parametrize("columns", [(4,), (4, 7), (1, 4, 7)])
def test_satellites_farther_off_than_any_echo_have_wrong_orbits(columns):
    records = draw_scene().records(np.random.default_rng(0))
    (sky,) = records.sets
    wrong = [records.observations[0].signals[column] for column in columns]
    right_signals = tuple(signal for signal in sky.signals if signal not in wrong)
    for k, column in enumerate(columns):
        records = shift_ranges(records, column, (-1.0) ** k * 3e5)
    (evidence,) = Residual().examine(replace(records, sets=(replace(sky, signals=right_signals),)))[0]
    assert (evidence.says, evidence.code) == ("undecided", "orbits_off")
    assert evidence.may_also_be == ("orbits", "fault")
    assert evidence.data["far"] == tuple(sorted(signal.sat for signal in wrong))
    assert evidence.data["least_m"] == pytest.approx(3e5, rel=1e-3)


def test_no_single_signal_is_blamed_beside_second_ones():
    # A channel that has been led away beside a second sky is no fault of its satellite.
    records = draw_scene(false=(FalseSky(),)).records(np.random.default_rng(0))
    (evidence,) = Residual().examine(replace(shift_ranges(records, 4, 60.0), sets=records.sets[:1]))[0]
    assert (evidence.says, evidence.code) == ("undecided", "misfit_with_second_signals")
    assert evidence.data["doubled"] == len(records.sets[1].signals)


def test_a_mixture_is_no_single_fault():
    records = draw_scene().records(np.random.default_rng(0))
    for column, metres in ((1, 200.0), (4, 330.0), (7, -150.0), (9, 500.0)):
        records = shift_ranges(records, column, metres)
    (evidence,) = Residual().examine(records)[0]
    assert (evidence.says, evidence.code) == ("undecided", "misfit")


def test_two_skies_are_an_attack():
    records = draw_scene(false=(FalseSky(),)).records(np.random.default_rng(0))
    found = find_consistent_sets(records.observations[0], records.navigation)
    (evidence,) = Residual().examine(replace(records, sets=found))[0]
    assert evidence.says == "attack"
    assert evidence.p_value < 1e-9
    assert {ref.signal.copy for ref in evidence.signals} == {"a", "b"}


def test_a_false_sky_at_the_true_place_shows_by_its_time():
    late = FalseSky(shows_enu_m=(0.0, 0.0, 0.0))
    (evidence,) = Residual().examine(draw_scene(false=(late,)).records(np.random.default_rng(0)))[0]
    assert (evidence.says, evidence.code) == ("attack", "several_skies")
    assert evidence.data["times_apart_s"] > 1e-7


def test_a_small_second_set_proves_nothing():
    records = draw_scene(false=(FalseSky(),)).records(np.random.default_rng(0))
    sky, false = records.sets
    few = replace(false, signals=false.signals[:5], statistic=1.0, dof=1)
    (evidence,) = Residual().examine(replace(records, sets=(sky, few)))[0]
    assert (evidence.says, evidence.code, evidence.p) == ("undecided", "sets_by_chance", {})


def test_sets_that_may_be_chance_do_not_hide_a_misfit():
    # Half of the satellites show another place, one signal each: too few for a second sky.
    records = draw_scene().records(np.random.default_rng(0))
    (o,), (sky,) = records.observations, records.sets
    _, geometry = fix_and_geometry(o, records.navigation)
    codes_m = o.pseudorange_m.copy()
    codes_m[:, :5] += geometry.design[:, :5, :3] @ np.array([400.0, 300.0, 0.0])
    halves = tuple(
        replace(sky, signals=o.signals[rows], statistic=1.0, dof=1) for rows in (slice(5, None), slice(0, 5))
    )
    torn = replace(records, observations=(replace(o, pseudorange_m=codes_m),), sets=halves)
    (evidence,) = Residual().examine(torn)[0]
    assert evidence.failed
    assert evidence.p_value < 1e-9


def test_four_signals_are_no_second_sky():
    records = draw_scene(false=(FalseSky(),)).records(np.random.default_rng(0))
    sky, false = records.sets
    four = replace(false, signals=false.signals[:4], statistic=0.0, dof=0)
    (evidence,) = Residual().examine(replace(records, sets=(sky, four)))[0]
    assert evidence.says == "clean"


def test_the_chance_counts_sets_of_second_signals_only():
    records = draw_scene(false=(FalseSky(),)).records(np.random.default_rng(0))
    sky, false = records.sets
    mean = average_window(records.observations[0])
    sigma_m = [np.hypot(mean.sigma_m[mean.signals.index(s)], 1.0) for s in false.signals]
    alone = bound_chance_p_value(sigma_m, window_m=300.0, largest_statistic=false.statistic)  # one set of all of them
    assert second_sky_p_value(records.observations[0], (sky, false), unrelated_spread_m=300.0) == pytest.approx(alone)


@pytest.mark.parametrize(("of", "least", "most"), [(5, 1e-2, 1.0), (10, 0.0, 1e-7)])
def test_few_satellites_of_another_kind_fit_elsewhere_by_chance(of, least, most):
    # As where their orbits or clocks are wrong by some hundred metres, each by its own: no second sky.
    o, sky, galileo = draw_with_galileo("E1")
    other = show_elsewhere(sky, galileo["E1"][:of], 400.0)
    assert least <= second_sky_p_value(o, (sky, other), unrelated_spread_m=300.0) <= most


def draw_with_galileo(*bands):
    """Return a sky's observations with as many satellites of Galileo in each band, its set, and signals by band."""
    records = draw_scene().records(np.random.default_rng(0))
    (sky,), (o,) = records.sets, records.observations
    galileo = {
        band: tuple(replace(s, sat=f"E{number:02d}", band=band, code="C") for number, s in enumerate(o.signals, 1))
        for band in bands
    }
    times = 1 + len(bands)
    every = replace(
        o,
        signals=sum(galileo.values(), o.signals),
        **{
            name: np.tile(getattr(o, name), (1, times))
            for name in (*OBSERVABLES, "status", "half_cycle_open", "quadrature_m")
        },
        **{name: np.tile(getattr(o, name), times) for name in ("found_elapsed_s", "missed_elapsed_s", "carrier_hz")},
    )
    return every, sky, galileo


def show_elsewhere(sky, signals, off_m):
    dof = len(signals) - 4
    return replace(sky, signals=signals, position_ecef_m=sky.position_ecef_m + off_m, statistic=1.0, dof=dof)


def test_bands_of_the_same_satellites_form_no_more_sets():
    # Signals of a satellite take one way: three bands of eight satellites are eight paths and no 6561 sets.
    bands = ("E1", "E5a", "E5b")
    o, sky, galileo = draw_with_galileo(*bands)
    alone, every = (
        echoes_p_value(
            o, show_elsewhere(sky, sum((galileo[band][:8] for band in some_bands), ()), 400.0), unrelated_spread_m=300.0
        )
        for some_bands in (bands[:1], bands)
    )
    # Of several kinds the statistic of each is not known, and that which fits once in 10^4 stands for it.
    assert alone < every < 1e3 * alone


def test_what_is_kilometres_off_had_kilometres_to_be_in():
    o, sky, galileo = draw_with_galileo("E1")
    near, far = (
        second_sky_p_value(o, (sky, show_elsewhere(sky, galileo["E1"][:8], off_m)), unrelated_spread_m=300.0)
        for off_m in (100.0, 8000.0)
    )
    assert 0.0 < far < 1e-4 * near


def test_a_signal_of_the_other_skys_kind_hides_no_sky():
    # A false band beside which one signal of the true band fits by chance.
    o, sky, galileo = draw_with_galileo("E1")
    pure = show_elsewhere(sky, galileo["E1"][:9], 400.0)
    mixed = replace(pure, signals=(*pure.signals, sky.signals[-1]))
    true = replace(sky, signals=sky.signals[:-1])
    assert second_sky_p_value(o, (true, mixed), unrelated_spread_m=300.0) < 1e-6


def test_the_chance_of_a_second_set_falls_with_its_size():
    records = draw_scene(false=(FalseSky(),)).records(np.random.default_rng(0))
    sky, false = records.sets
    observations = records.observations[0]
    by_size = [
        second_sky_p_value(
            observations,
            (sky, replace(false, signals=false.signals[:k], statistic=k - 4.0, dof=k - 4)),
            unrelated_spread_m=300.0,
        )
        for k in (6, 8, 10, 12)
    ]
    assert np.all(np.diff(by_size) < 0)
    assert second_sky_p_value(observations, (sky,), unrelated_spread_m=300.0) == 1.0


def test_four_satellites_are_too_few_to_be_clean():
    (evidence,) = Residual().examine(draw_scene(max_satellites=4).records(np.random.default_rng(0)))[0]
    assert (evidence.says, evidence.code) == ("undecided", "few_ranges")
    assert evidence.data["ranged"] == 4


@pytest.mark.parametrize("wrong", [{"false_alarm_probability": 1.0}, {"min_satellites": 4}])
def test_settings_that_make_no_sense_are_refused(wrong):
    with pytest.raises(SettingsError, match=next(iter(wrong))):
        ResidualSettings(**wrong)


# p-values by cause ----------------------------------------------------------------------------------------------------


@cache
def clean_skies(draws=100):
    rng = np.random.default_rng(5)
    return [draw_scene(epochs=4).records(rng) for _ in range(draws)]


def draw_fits(errors, seed=6):
    """Fit each of several clean skies with errors (n,) of ranges beside noise."""
    rng, settings, found = np.random.default_rng(seed), ResidualSettings(false_alarm_probability=0.5), []
    for records in clean_skies():
        (o,) = records.observations
        moved = replace(o, pseudorange_m=o.pseudorange_m + errors(rng, len(o.signals)))
        found.append(max(fit_layers(moved, records.navigation, settings), key=lambda fix: len(fix.signals)).fit)
    return found


def draw_two_faults(rng, n):
    errors_m = np.zeros(n)
    errors_m[rng.choice(n, 2, replace=False)] = rng.normal(0.0, 500.0, 2)
    return errors_m


CAUSES = {
    "two faults": (draw_two_faults, lambda fit, rate: fit.p_value_without_two(rate)),
    "all late": (lambda rng, n: rng.uniform(0.0, 300.0, n), lambda fit, rate: fit.p_value_with_errors(0.0, 300.0)),
    "all drawn off": (
        lambda rng, n: rng.uniform(-300.0, 300.0, n),
        lambda fit, rate: fit.p_value_with_errors(-300.0, 300.0),
    ),
    "two late": (
        lambda rng, n: np.where(np.arange(n) < 2, rng.uniform(0.0, 300.0, n), 0.0),
        lambda fit, rate: find_reflected(fit, spread_m=300.0, alpha=rate).p_value,
    ),
}


@pytest.mark.parametrize("cause", CAUSES)
def test_no_cause_is_rejected_more_often_than_stated(cause):
    errors, p_value = CAUSES[cause]
    drawn = draw_fits(errors)
    for rate in (0.1, 0.02):
        rejected = sum(p_value(fit, rate) < rate for fit in drawn)
        assert stats.binomtest(rejected, len(drawn), rate, alternative="greater").pvalue > 1e-3


def test_a_mixture_of_skies_far_apart_is_none_of_the_causes():
    # Five of ten satellites show a place 4 km away: the orbits alone remain.
    records = draw_scene().records(np.random.default_rng(0))
    (o,) = records.observations
    _, geometry = fix_and_geometry(o, records.navigation)
    codes_m = o.pseudorange_m.copy()
    codes_m[:, :5] += geometry.design[:, :5, :3] @ np.array([3000.0, 2600.0, 0.0])
    (finding,) = Residual().examine(replace(records, observations=(replace(o, pseudorange_m=codes_m),)))[0]
    assert finding.may_also_be == ("orbits",)


@pytest.mark.parametrize(("seen", "misfits"), [(False, 20), (True, 0)])
def test_reflections_that_discriminators_show_are_no_misfit(seen, misfits):
    codes = []
    for draw in range(20):
        rng = np.random.default_rng(draw)
        records = draw_scene().records(rng)
        (o,) = records.observations
        late_m, off_m = 12.0 * rng.standard_normal((2, len(o.signals)))
        shown_m = np.broadcast_to(off_m, o.pseudorange_m.shape) if seen else np.array(np.nan)
        reflected = replace(o, pseudorange_m=o.pseudorange_m + late_m, quadrature_m=shown_m)
        codes.append(Residual().examine(replace(records, observations=(reflected,), sets=()))[0][0].code)
    assert sum("misfit" in code for code in codes) == misfits
