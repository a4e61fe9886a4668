"""A receiver that is stated to stand and moves by all its carriers: the word, what explains it, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.detectors.continuity.test_detector import (
    FIELD,
    NAVIGATION,
    PLACE_ECEF_M,
    WHITE,
    change_cells,
    examine_all,
    observe_scene,
)

from skyproof.detectors.continuity.series import Limits, build_series
from skyproof.detectors.continuity.standing import find_carrier_motion

WAVE_M = 299_792_458.0 / 1575.42e6
ERROR_M = 0.04
STANDING = ("stands", "moves", "moves_by_some")
ONSET_S = 25.0


def select_attacks(found):
    return [[e for e in evidence if e.says == "attack"] for evidence in found]


def move_receiver(o, moved_m):
    """Move all that a receiver measures by ranges (n, m)."""
    rate_m_s = np.gradient(moved_m, o.elapsed_s, axis=0)
    return change_cells(
        o,
        pseudorange_m=o.pseudorange_m + moved_m,
        carrier_cyc=o.carrier_cyc + moved_m / WAVE_M,
        doppler_hz=o.doppler_hz - rate_m_s / WAVE_M,
    )


def drag_codes(o, speed_m_s):
    """Drag codes to the north and up from the onset on."""
    series = build_series(o, NAVIGATION, PLACE_ECEF_M, Limits())
    way_m = speed_m_s * np.maximum(o.elapsed_s - ONSET_S, 0.0)
    return move_receiver(o, -(series.unit @ np.array([0.0, 0.6, 0.8])) * way_m[:, None])


def test_a_dragged_position_is_an_attack_in_its_first_window():
    found = examine_all(drag_codes(observe_scene(), 0.3), speed_max_m_s=0.0)
    assert [len(attack) for attack in select_attacks(found)] == [0, 0, 1, 1]
    first, second = select_attacks(found)[2][0], select_attacks(found)[3][0]
    assert (first.code, first.data["assumes"]) == ("moves", ("receiver_stands",))
    assert second.data["moved_m"] == pytest.approx(3.0, abs=0.2)


@pytest.mark.parametrize("satellites", [1, 2])
def test_reflections_that_move_a_few_carriers_are_no_attack(satellites):
    # Walls that move past: their carriers go off together, by 3 m/s.
    o = observe_scene()
    way_m = np.zeros(o.pseudorange_m.shape)
    way_m[:, :satellites] = 3.0 * np.maximum(o.elapsed_s - ONSET_S, 0.0)[:, None]
    assert not any(select_attacks(examine_all(move_receiver(o, way_m), speed_max_m_s=0.0)))


def test_two_satellites_that_could_explain_it_leave_it_open():
    # Of six satellites no four are left to show anything by themselves.
    o = drag_codes(observe_scene(), 3.0)
    six = replace(
        o, pseudorange_m=np.where(np.arange(o.pseudorange_m.shape[1]) < 6, o.pseudorange_m, np.nan)
    )  # the others are not received
    found = examine_all(six, speed_max_m_s=0.0)
    assert not any(select_attacks(found))
    assert any(e.failed and e.overrules and e.code == "moves_by_some" for e in found[-1])


def test_the_strongest_reflections_at_once_are_no_motion():
    # Each carrier is turned by a quarter of a wavelength either way, anew after a second.
    o, rng = observe_scene(), np.random.default_rng(3)
    turned = rng.choice([-0.25, 0.25], o.carrier_cyc.shape)[np.floor(o.elapsed_s).astype(int)]
    found = examine_all(change_cells(o, carrier_cyc=o.carrier_cyc + turned), speed_max_m_s=0.0)
    assert not any(select_attacks(found))
    assert not any(e.code.startswith("moves") for evidence in found for e in evidence)


@pytest.mark.parametrize("oscillator", ["tcxo", "ocxo"])
def test_a_clock_that_runs_off_is_no_motion(oscillator):
    o = observe_scene(oscillator=oscillator)
    way_m = np.broadcast_to(10.0 * np.maximum(o.elapsed_s - ONSET_S, 0.0)[:, None], o.carrier_cyc.shape)
    assert not any(select_attacks(examine_all(move_receiver(o, way_m), speed_max_m_s=0.0)))


def test_only_a_stated_stand_is_contradicted_by_motion():
    ship = observe_scene(motion="ship")
    assert [len(attacks_found) for attacks_found in select_attacks(examine_all(ship, speed_max_m_s=0.0))] == [
        1,
        1,
        1,
        1,
    ]
    assert not any(select_attacks(examine_all(ship)))
    assert not any(e.code in STANDING for evidence in examine_all(ship) for e in evidence)


def draw_p_values(draws, error_m, *, span_s=2.5):
    """Draw p-values of a standing receiver whose carriers err by `error_m` at each end, independently."""
    o = observe_scene(noise=WHITE)
    o = o.select(o.elapsed_s <= o.elapsed_s[0] + span_s + 0.01)
    series, rng, found = build_series(o, NAVIGATION, PLACE_ECEF_M, Limits()), np.random.default_rng(5), []
    still = replace(series, move_m=np.zeros_like(series.move_m), bridge_m2=np.zeros_like(series.bridge_m2))
    for _ in range(draws):
        moved_series = replace(still, move_m=rng.normal(0.0, error_m, series.move_m.shape))
        moved = find_carrier_motion(o, moved_series, NAVIGATION, PLACE_ECEF_M, carrier_error_m=ERROR_M, alpha=0.0)
        assert moved is not None
        found.append(moved.p_value)
    return np.array(found)


def test_the_p_value_is_uniform_where_carriers_err_as_stated():
    chances = draw_p_values(400, ERROR_M)
    assert stats.kstest(chances, "uniform").pvalue > 1e-3
    for level in (0.1, 0.02):
        assert stats.binomtest(int((chances < level).sum()), chances.size, level).pvalue > 1e-3


@pytest.mark.long
@pytest.mark.parametrize("noise", [FIELD, WHITE], ids=["field", "white"])
def test_hours_of_standing_raise_no_alarm(noise):
    # Ten hours under the errors of the model, noise of its loops included.
    alarms, windows, least = 0, 0, 1.0
    for seed in range(6):
        for draw in range(20):
            for evidence in examine_all(
                observe_scene(draw, noise=noise, seed=seed, duration_s=302.0), speed_max_m_s=0.0
            ):
                of_standing = [e for e in evidence if e.code in STANDING]
                windows += 1
                alarms += any(e.says != "clean" for e in of_standing)
                least = min([least, *(e.p_value for e in of_standing)])
    print(f"{windows} windows of 10 s, {alarms} alarms at 1e-6, least p {least:.2g}")
    assert windows >= 3600
    assert alarms == 0
