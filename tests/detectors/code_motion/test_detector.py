"""Positions by codes alone: jumps are an attack, what one or two satellites or a clock do is not."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.code_motion.detector import CodeMotion, CodeMotionSettings, select_primary_signals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.navigation.fix import fix_and_geometry
from skyproof.records import OBSERVABLES, Cause, Observations, Records
from skyproof.testing import MeasuredScene, TrackErrors

RATE = 1e-6
SCENE = MeasuredScene(
    antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=20, errors=TrackErrors(sigma_m=1.0, constant_m=1.0)
)


def draw_records(seed: int = 0, scene: MeasuredScene = SCENE) -> Records:
    """Return a clean window of codes alone."""
    drawn = scene.records(np.random.default_rng(seed))
    (o,) = drawn.observations
    missing = np.full(o.pseudorange_m.shape, np.nan)
    codes = replace(o, carrier_cyc=missing, doppler_hz=missing, carrier_sigma_cyc=missing, doppler_sigma_hz=missing)
    return replace(drawn, observations=(codes,))


def pull_codes(drawn: Records, epoch: int, shift_m: tuple[float, float, float], clock_m: float = 0.0) -> Records:
    """Return the records with all codes showing another place and clock from an epoch on."""
    (o,) = drawn.observations
    _, geometry = fix_and_geometry(o, drawn.navigation)
    change_m = geometry.design[epoch:, :, :3] @ np.array(shift_m) + clock_m
    codes_m = o.pseudorange_m.copy()
    codes_m[epoch:] += change_m
    return replace(drawn, observations=(replace(o, pseudorange_m=codes_m),))


def move_codes(drawn: Records, epochs: slice, columns: list[int], metres: float) -> Records:
    (o,) = drawn.observations
    codes_m = o.pseudorange_m.copy()
    codes_m[epochs, columns] += metres
    return replace(drawn, observations=(replace(o, pseudorange_m=codes_m),))


def examine(*windows: Records, **settings) -> list:
    """Return findings of position and clock in the last window."""
    detector, state = CodeMotion(CodeMotionSettings(false_alarm_probability=RATE, **settings)), None
    for window in windows:
        found, state = detector.examine(window, state)
    return found


def list_words(*windows: Records, **settings) -> list[str]:
    return [e.says for e in examine(*windows, **settings)]


def test_a_clean_sky_goes_on() -> None:
    assert [list_words(draw_records(seed)) for seed in range(5)] == [["clean", "clean"]] * 5


@pytest.mark.parametrize("seed", range(3))
def test_a_jump_of_all_codes_is_an_attack(seed) -> None:
    position, clock = examine(pull_codes(draw_records(seed), 8, (600.0, -500.0, 300.0)))
    assert (position.code, position.says, position.overrules) == ("jumps_by_all", "attack", False)
    assert position.p_value == max(position.p[Cause.CLEAN], position.p[Cause.FAULT]) < RATE
    assert position.data["moved_m"] == pytest.approx(np.linalg.norm((600.0, -500.0, 300.0)), rel=0.1)
    assert abs(position.dated_gpst - draw_records(seed).observations[0].gpst[8]) < np.timedelta64(10, "ms")
    assert clock.says == "clean"


def test_a_jump_at_the_edge_of_a_window_is_seen_in_the_next() -> None:
    whole = pull_codes(draw_records(), 10, (1000.0, 0.0, 0.0))
    (o,) = whole.observations
    first, second = (replace(whole, observations=(o.read(*rows),)) for rows in ((0, 10), (10, 20)))
    assert list_words(first) == ["clean", "clean"]
    assert list_words(first, second) == ["attack", "clean"]


def test_a_clock_that_jumps_alone_has_failed_and_no_more() -> None:
    position, clock = examine(pull_codes(draw_records(), 8, (0.0, 0.0, 0.0), 3000.0))
    assert (position.code, position.says) == ("goes_on", "clean")
    assert (clock.code, clock.says, clock.overrules) == ("jumps", "undecided", True)
    assert clock.may_also_be == (Cause.OSCILLATOR,)
    assert clock.data["clock_s"] == pytest.approx(1e-5, rel=0.1)
    ms_m = 1e-3 * SPEED_OF_LIGHT_M_S
    assert list_words(pull_codes(draw_records(), 8, (0.0, 0.0, 0.0), ms_m)) == ["clean", "clean"]


@pytest.mark.parametrize("columns", [[3], [3, 6]])
@pytest.mark.parametrize("metres", [200.0, 5e3, 3e5])
def test_faults_of_two_satellites_are_no_attack(columns, metres) -> None:
    for seed in range(3):
        assert "attack" not in list_words(move_codes(draw_records(seed), slice(8, None), columns, metres))


def test_few_satellites_leave_a_jump_open() -> None:
    few = replace(SCENE, max_satellites=6)
    (position, _) = examine(pull_codes(draw_records(1, few), 8, (2000.0, 0.0, 0.0)))
    assert (position.code, position.says, position.overrules) == ("jumps_by_two", "undecided", True)
    assert position.may_also_be == (Cause.FAULT,)
    assert position.p[Cause.FAULT] == 1.0


def test_a_jump_after_a_gap_needs_a_known_speed() -> None:
    longer = replace(SCENE, epochs=30)
    whole = pull_codes(draw_records(0, longer), 18, (1000.0, 0.0, 0.0))
    (o,) = whole.observations
    windows = [replace(whole, observations=(o.read(*rows),)) for rows in ((0, 10), (18, 28))]
    assert list_words(*windows) == ["clean", "clean"]
    assert list_words(*windows, speed_max_m_s=40.0) == ["attack", "clean"]


def test_pieces_give_what_the_whole_gives() -> None:
    whole = pull_codes(draw_records(2), 13, (300.0, 0.0, 0.0))
    (o,) = whole.observations
    joined = min(e.p_value for e in examine(whole))
    detector, state, least = CodeMotion(CodeMotionSettings(false_alarm_probability=RATE)), None, 1.0
    for first in range(0, 20, 4):
        found, state = detector.examine(replace(whole, observations=(o.read(first, first + 4),)), state)
        least = min([least, *(e.p_value for e in found if e.p_value is not None)])
    assert least < RATE
    assert joined < RATE


def test_a_satellite_received_twice_leaves_it_open() -> None:
    (o,) = draw_records().observations
    twice = Observations.join([o])
    assert select_primary_signals(twice) is not None
    signals = (replace(o.signals[1], copy="b"), *o.signals[1:])
    assert select_primary_signals(replace(o, signals=signals)) is None


def test_the_mask_holds() -> None:
    (position, _) = examine(draw_records(), elevation_mask_deg=20.0)
    assert position.says == "clean"
    assert [e.says for e in examine(draw_records(), elevation_mask_deg=60.0)] == ["undecided"]


def test_a_jump_after_a_time_of_few_satellites_is_seen() -> None:
    whole = pull_codes(draw_records(0, replace(SCENE, epochs=40)), 30, (9e4, 0.0, 0.0))
    (o,) = whole.observations
    codes_m = o.pseudorange_m.copy()
    codes_m[10:30, 3:] = np.nan
    few = replace(whole, observations=(replace(o, pseudorange_m=codes_m),))
    windows = [replace(few, observations=(few.observations[0].read(k, k + 10),)) for k in (0, 10, 20, 30)]
    assert list_words(*windows) == ["attack", "clean"]


def add_second_band(drawn: Records) -> Records:
    """Return the records with all codes on a second band as well."""
    (o,) = drawn.observations
    second = replace(
        o, signals=tuple(replace(signal, band="L2", code="W") for signal in o.signals), carrier_hz=np.array(1227.6e6)
    )
    cells = {
        name: np.hstack([getattr(o, name), getattr(second, name)])
        for name in (*OBSERVABLES, "status", "half_cycle_open", "quadrature_m")
    }
    channels = {
        name: np.concatenate([getattr(o, name), getattr(second, name)])
        for name in ("found_elapsed_s", "missed_elapsed_s", "carrier_hz")
    }
    return replace(drawn, observations=(replace(o, signals=o.signals + second.signals, **cells, **channels),))


def move_band(drawn: Records, band: str, epochs: slice, metres: np.ndarray) -> Records:
    (o,) = drawn.observations
    columns = [k for k, signal in enumerate(o.signals) if signal.band == band]
    codes_m = o.pseudorange_m.copy()
    codes_m[epochs, columns] += metres
    return replace(drawn, observations=(replace(o, pseudorange_m=codes_m),))


def test_a_jump_between_bands_is_seen() -> None:
    # The first band is lost for a window, and jumped when it comes back.
    both_bands = add_second_band(pull_codes(draw_records(0, replace(SCENE, epochs=30)), 20, (9e4, 0.0, 0.0)))
    lost = move_band(both_bands, "L1", slice(10, 20), np.nan)
    windows = [replace(lost, observations=(lost.observations[0].read(k, k + 10),)) for k in (0, 10, 20)]
    found = [e for e in examine(*windows) if len({ref.signal.band for ref in e.signals}) == 1]
    assert "attack" in [e.says for e in found]


def test_a_second_band_that_jumps_alone_leaves_the_cause_open() -> None:
    clean = draw_records()
    jump_m = (
        pull_codes(clean, 8, (900.0, 400.0, 0.0)).observations[0].pseudorange_m - clean.observations[0].pseudorange_m
    )
    found = examine(move_band(add_second_band(clean), "L2", slice(8, None), jump_m[8:]))
    assert [e.says for e in found] == ["clean", "clean", "undecided", "clean"]
    assert {ref.signal.band for ref in found[2].signals} == {"L2"}
    assert found[2].may_also_be == (Cause.ORBITS, Cause.FAULT)
    assert (found[2].code, found[2].data["alone"]) == ("jumps", ("G L2",))
    assert found[2].overrules
