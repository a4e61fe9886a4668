"""The detector of two skies in overlapping signals: an attack that it names, and what it does without grids."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, chi2
from tests.detectors.nulls import (
    CCAF_SCENE,
    CHIP_M,
    CLEAN_CCAF,
    OVERLAPPED_CCAF,
    UNRELATED,
    draw_ccaf,
    draw_near_reflections,
    draw_second_signals,
)

from skyproof.app.common.body import Carried, body_of, body_states, open_body
from skyproof.app.common.platform import Platform
from skyproof.app.common.platform_use import match_tables
from skyproof.detectors.dccaf.delays import (
    DccafSettings,
    estimate_delays,
    last_burst,
    select_second_signals,
    split_bursts,
)
from skyproof.detectors.dccaf.detector import Dccaf
from skyproof.errors import SettingsError
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.testing import FalseSky, MeasuredScene

OF_A_RUN = 1e-3 * 10.0 / 3600.0 / 7.0
"""What `protect` allows a window of one receiver, by default."""


def test_an_overlapping_sky_two_hundred_metres_off_is_an_attack():
    rng = np.random.default_rng(2)
    detector = Dccaf(DccafSettings(false_alarm_probability=1e-6))
    reported = [detector.examine(draw_ccaf(OVERLAPPED_CCAF.records(rng), rng))[0][0] for _ in range(5)]
    assert all((finding.says, finding.code) == ("attack", "unlike_reflections") for finding in reported)
    assert any("sky_satellites" in finding.data for finding in reported)


def test_grids_of_a_signal_whose_code_is_not_known_say_nothing():
    # They were held against the C/A code of the satellite's number, which is another shape.
    rng = np.random.default_rng(2)
    records = draw_ccaf(OVERLAPPED_CCAF.records(rng), rng)
    (grid,) = records.ccaf
    (o,) = records.observations
    records = replace(
        records,
        observations=(replace(o, signals=tuple(replace(s, band="L5", code="Q") for s in o.signals)),),
        ccaf=(replace(grid, signals=tuple(replace(s, band="L5", code="Q") for s in grid.signals)),),
    )
    found, _ = Dccaf(DccafSettings(false_alarm_probability=1e-6)).examine(records)
    assert {finding.says for finding in found} == {"undecided"}
    assert not np.isfinite(estimate_delays(*_take_last(records), DccafSettings()).p_value).any()


def _take_last(records):
    (grid,) = records.ccaf
    return grid, last_burst(grid)


@pytest.mark.parametrize("pushed_m", [100.0, -100.0])
def test_a_push_of_the_clock_alone_is_an_attack_whichever_way(pushed_m):
    # The false signals are 1 dB stronger, all later by one delay or all earlier.
    rng = np.random.default_rng(3)
    sats = 8
    records = draw_ccaf(draw_second_signals(rng, np.ones(sats, bool), pushed_m, scene=UNRELATED), rng, 1.0)
    (reported, *_), _ = Dccaf(DccafSettings(false_alarm_probability=1e-6)).examine(records)
    assert reported.says == "attack"
    assert abs(reported.data["time_apart_m"]) == pytest.approx(100.0, abs=10.0)


def test_a_mirror_all_around_is_no_attack():
    # Every satellite's signal comes once more by a mirror 40 m below, 4 dB weaker: that fits a position, too.
    rng = np.random.default_rng(4)
    for _ in range(5):
        elevated = rng.uniform(0.2, 1.0, 8)
        records = draw_ccaf(draw_second_signals(rng, np.ones(8, bool), 80.0 * elevated, scene=UNRELATED), rng, -4.0)
        (reported,), _ = Dccaf(DccafSettings(false_alarm_probability=1e-3)).examine(records)
        assert (reported.says, reported.code) == ("clean", "as_reflections")
        assert reported.p_value > 1e-3


def test_a_mirror_and_two_odd_satellites_are_no_attack():
    # That the ranges of a mirror's image agree is no evidence that the two are an attacker's.
    rng = np.random.default_rng(14)
    for _ in range(3):
        delay_m = 80.0 * rng.uniform(0.2, 1.0, 8)
        delay_m[:2] *= -1.0
        records = draw_ccaf(draw_second_signals(rng, np.ones(8, bool), delay_m, scene=UNRELATED), rng, -4.0)
        (reported,), _ = Dccaf(DccafSettings(false_alarm_probability=1e-3)).examine(records)
        assert (reported.says, reported.code) == ("clean", "as_reflections")
        assert reported.p_value > 0.1


@pytest.mark.parametrize("rays", [0, 1])
@pytest.mark.long
def test_five_clean_hours_raise_no_alarm_at_a_runs_rate(rays):
    # 1800 windows of ten seconds each, without and with a reflection on every satellite, one in seven of them such that
    # no reflection explains it.
    rng, p_values = np.random.default_rng(15 + rays), []
    detector = Dccaf(DccafSettings(multipath_sigma_m=2.0))
    settings = detector.settings
    for _ in range(1800):
        if rays:
            records = draw_near_reflections(rng, settings.no_reflection_probability)
        else:
            records = draw_ccaf(CLEAN_CCAF.records(rng), rng)
        (reported, *_), _ = detector.examine(records)
        p_values.append(reported.p_value)
    assert min(p_values) > OF_A_RUN
    for level in (0.1, 0.01):
        assert np.sum(np.array(p_values) <= level) <= binom.ppf(0.999, len(p_values), level)


def test_two_delays_come_where_two_are_counted_else_one():
    rng = np.random.default_rng(3)
    settings = DccafSettings()
    single, double = (draw_ccaf(scene.records(rng), rng).ccaf[0] for scene in (CLEAN_CCAF, OVERLAPPED_CCAF))
    assert np.isnan(estimate_delays(single, last_burst(single), settings).delay_chips[:, 1]).all()
    found = estimate_delays(double, last_burst(double), settings)
    assert np.isfinite(found.delay_chips[:, 1]).sum() >= 5


def test_delays_count_from_the_last_interval_as_the_loop_moves():
    rng = np.random.default_rng(5)
    (grid,) = draw_ccaf(CLEAN_CCAF.records(rng), rng).ccaf
    reference_m = np.array(grid.reference_m)
    reference_m[:-1] += 2.0
    hertz = np.full_like(grid.reference_hz, 100.0)
    reference_m -= hertz * 0.19029 * (grid.elapsed_s - grid.elapsed_s[-1])[:, None]
    settings, epochs = DccafSettings(), last_burst(grid)
    still = estimate_delays(grid, epochs, settings).delay_chips[:, 0]
    moved = estimate_delays(replace(grid, reference_m=reference_m, reference_hz=hertz), epochs, settings).delay_chips[
        :, 0
    ]
    np.testing.assert_allclose((moved - still) * CHIP_M, 1.5, atol=0.01)


def test_the_last_burst_of_most_channels_is_looked_at():
    rng = np.random.default_rng(6)
    (grid,) = draw_ccaf(CLEAN_CCAF.records(rng), rng).ccaf
    n = len(grid.elapsed_s)
    earlier = {name: np.concatenate([getattr(grid, name)] * 3) for name in ("reference_m", "reference_hz")}
    value, variance = np.concatenate([grid.value] * 3), np.concatenate([grid.noise_variance] * 3)
    value[-1, 0] = np.nan  # a channel of the last burst is not whole
    elapsed_s = np.concatenate([grid.elapsed_s + 1.0 * k for k in range(3)])
    gpst = np.concatenate([grid.gpst + np.timedelta64(k, "s") for k in range(3)])
    longer = replace(grid, value=value, noise_variance=variance, elapsed_s=elapsed_s, gpst=gpst, **earlier)
    assert last_burst(longer).tolist() == list(range(n, 2 * n))
    assert last_burst(replace(grid, value=np.full_like(grid.value, np.nan))).size == 0


def draw_grids(scene, rng, second_db, n):
    """Draw the grids of one moment `n` times with new phases and noise, two seconds apart."""
    ccaf = [draw_ccaf(scene, rng, second_db).ccaf[0] for _ in range(n)]
    many = {name: np.concatenate([getattr(grid, name) for grid in ccaf]) for name in ("value", "noise_variance")}
    many |= {name: np.concatenate([getattr(ccaf[0], name)] * n) for name in ("reference_m", "reference_hz")}
    elapsed_s = np.concatenate([ccaf[0].elapsed_s + 2.0 * k for k in range(n)])
    gpst = np.concatenate([ccaf[0].gpst + np.timedelta64(2 * k, "s") for k in range(n)])
    return replace(ccaf[0], elapsed_s=elapsed_s, gpst=gpst, **many)


def find_second_signals(ccaf, settings):
    """Find the channels that have a second signal in all bursts."""
    *earlier, last = (estimate_delays(ccaf, epochs, settings) for epochs in split_bursts(ccaf))
    return select_second_signals(last, earlier, settings)


def test_signals_too_near_for_a_burst_are_seen_in_a_window():
    # Two skies 6 m apart, equally strong: how many of eight satellites one burst shows, and how many five do.
    rng, single, five, clean = np.random.default_rng(8), [], [], []
    for _ in range(3):
        near, alone = (
            draw_second_signals(rng, np.full(8, second_there), 6.0, scene=UNRELATED) for second_there in (True, False)
        )
        for counts, ccaf in (
            (single, draw_grids(near, rng, 0.0, 1)),
            (five, draw_grids(near, rng, 0.0, 5)),
            (clean, draw_grids(alone, rng, 0.0, 5)),
        ):
            counts.append(find_second_signals(ccaf, DccafSettings()).sum())
    assert sum(clean) <= 1
    assert min(five) >= 5
    assert np.mean(single) < np.mean(five) - 2.0


@pytest.mark.long
@pytest.mark.parametrize("n", [1, 5])
def test_a_single_signal_has_a_second_one_no_oftener_than_stated(n):
    # In a window of one burst, and of several: 200 windows of eight satellites.
    rng, settings, seen = np.random.default_rng(9), DccafSettings(second_signal_probability=0.2), 0
    for _ in range(200):
        ccaf = draw_grids(draw_second_signals(rng, np.zeros(8, bool), scene=UNRELATED), rng, 0.0, n)
        seen += find_second_signals(ccaf, settings).sum()
    assert seen <= binom.ppf(0.999, 200 * 8, 0.2 / 8)
    print(seen, "of", 200 * 8 * 0.2 / 8)


def test_missing_grids_cost_their_channel_only():
    rng = np.random.default_rng(4)
    records = draw_ccaf(OVERLAPPED_CCAF.records(rng), rng)
    grid = records.ccaf[0]
    value = np.array(grid.value)
    value[:, 0] = np.nan
    less = replace(records, ccaf=(replace(grid, value=value),))
    assert Dccaf().examine(less)[0][0].says == "attack"
    value[:, :-4] = np.nan
    none = replace(records, ccaf=(replace(grid, value=value),))
    assert Dccaf().examine(none)[0][0].says == "undecided"


@pytest.mark.long
def test_several_bins_find_what_the_right_bin_finds():
    rng = np.random.default_rng(9)
    records = draw_ccaf(OVERLAPPED_CCAF.records(rng), rng)
    (single,) = records.ccaf
    bins_hz, epochs = 25.0 * np.arange(-2.0, 3.0), last_burst(single)
    scale = np.sinc((8.0 - bins_hz) * 0.02)[:, None]  # noise of the bins alike: the worst case of a reference
    several = replace(single, dopplers_hz=bins_hz, value=single.value * scale)
    found, other = (estimate_delays(each, epochs, DccafSettings()) for each in (single, several))
    np.testing.assert_allclose(other.delay_chips, found.delay_chips, atol=0.02)


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(SettingsError, match="second_signal_probability"):
        DccafSettings(second_signal_probability=0.0)


# Which sky is true


RX2_ENU_M = -120.0, 40.0, 0.0
RX1_PLACE = OVERLAPPED_CCAF.place_deg
"""Of the other receiver, and what the false sky in rx2 shows."""
LED_TO_RX1 = MeasuredScene(
    **CCAF_SCENE | {"antennas_enu_m": {"rx2": RX2_ENU_M}},
    false=(FalseSky(antenna_enu_m=RX2_ENU_M, shows_enu_m=(0.0, 0.0, 0.0), delay_m=20.0),),
)


def state_platform(records):
    """Return states of a platform with a surveyed rx1 and a stated attitude, as `protect` gives them."""
    surveyed = dict(zip(("lat_deg", "lon_deg", "height_m"), RX1_PLACE, strict=True)) | {"sigma_m": 0.05}
    tables = {
        "attitude": {"heading_deg": 30.0, "pitch_deg": 0.0, "roll_deg": 0.0, "sigma_deg": 1.0},
        "receivers": [{"name": "rx1", "position": surveyed}, {"name": "rx2"}],
    }
    carrier, names = Platform.model_validate(tables), ("rx1", "rx2")
    body = body_of(carrier, open_body(carrier), names, match_tables(carrier, names), records.start_gpst, 300.0)
    return body_states(body, records, Carried())[0]


def test_another_receivers_place_makes_no_true_signal_false():
    # The false sky in rx2 shows the place of rx1, which is surveyed: that says nothing of what rx2 receives.
    rng, detector, attacks = np.random.default_rng(10), Dccaf(), 0
    for _ in range(24):
        records = draw_ccaf(LED_TO_RX1.records(rng), rng)
        reported, _ = detector.examine(replace(records, nav_state=state_platform(records)))
        assert {finding.code for finding in reported} <= {"unlike_reflections", "as_reflections"}
        attacks += reported[0].says == "attack"
    assert attacks >= 20


def test_both_skies_become_fixes_and_one_is_the_true_one():
    rng, detector, squares = np.random.default_rng(12), Dccaf(), []
    lat_deg, lon_deg, height_m = OVERLAPPED_CCAF.place_deg
    place_m = ecef_from_geodetic(np.radians(lat_deg), np.radians(lon_deg), height_m)
    for _ in range(12):
        (reported, *_), _ = detector.examine(draw_ccaf(OVERLAPPED_CCAF.records(rng), rng))
        for skies in reported.overlapping:
            assert len(skies.sets) == 2
            assert skies.doubt <= detector.settings.wrong_choice_probability
            assert max(skies.reflected) < 1e-3  # all are as strong
            off_m = [place_m - sky.position_ecef_m for sky in skies.sets]
            square = [d @ np.linalg.solve(s.covariance_m2[:3, :3], d) for d, s in zip(off_m, skies.sets, strict=True)]
            squares.append(min(square))
            assert max(square) > 100.0
    assert len(squares) >= 6
    assert sum(squares) < chi2.ppf(0.999, 3 * len(squares))


def test_only_the_stronger_sky_may_have_made_the_other():
    rng, detector, seen = np.random.default_rng(14), Dccaf(), 0
    lat_deg, lon_deg, height_m = OVERLAPPED_CCAF.place_deg
    place_m = ecef_from_geodetic(np.radians(lat_deg), np.radians(lon_deg), height_m)
    for _ in range(12):
        (reported, *_), _ = detector.examine(draw_ccaf(OVERLAPPED_CCAF.records(rng), rng, -6.0))
        for skies in reported.overlapping:
            true = int(np.argmin([np.linalg.norm(s.position_ecef_m - place_m) for s in skies.sets]))
            assert skies.reflected[true] > skies.reflected[1 - true]
            seen += 1
    assert seen >= 3


def test_single_signals_and_a_reflection_make_no_two_skies():
    rng, detector = np.random.default_rng(13), Dccaf()
    for records in (draw_ccaf(CLEAN_CCAF.records(rng), rng), draw_near_reflections(rng, 0.15)):
        (reported, *_), _ = detector.examine(records)
        assert reported.overlapping == ()
