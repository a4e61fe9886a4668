"""Levels of one receiver: noise is interference, what false signals do fails, what the sky does is neither."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from skyproof.detectors.levels.detector import SignalLevels, SignalLevelsSettings
from skyproof.detectors.levels.front_end import carrier_name, chain_covers
from skyproof.detectors.levels.policy import POLICY
from skyproof.errors import SettingsError
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.records import Cause, CellStatus, FrontEndLevels, Records, SignalId
from skyproof.testing import MeasuredScene

RATE = 1e-6
WINDOW = 10
WINDOWS = 14
ONSET = 83  # inside the ninth window
SCENE = MeasuredScene(antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=WINDOW * WINDOWS)
(EXACT,) = SCENE.records(np.random.default_rng(0)).observations
N = len(EXACT.signals)
L5_HZ = 1176.45e6


def draw_levels(seed: int = 0, *, common_db: float = 0.3, fading_db: float = 1.0) -> np.ndarray:
    """Return levels (n_epochs, n) of a clean sky: own levels by elevation, fading and a common wander by window."""
    rng = np.random.default_rng(seed)
    own_db = 36.0 + 14.0 * rng.random(N)
    windows = common_db * rng.standard_normal((WINDOWS, 1)) + fading_db * rng.standard_normal((WINDOWS, N))
    return own_db + np.repeat(windows, WINDOW, axis=0) + 0.3 * rng.standard_normal((WINDOW * WINDOWS, N))


def drop_levels(
    levels_db: np.ndarray, fall_db: float, *, epochs=slice(ONSET, None), floor_db: float = 24.0
) -> np.ndarray:
    """Return levels that fall together at some epochs; what falls below the floor is lost."""
    changed_db = levels_db.copy()
    changed_db[epochs] -= fall_db
    return np.where(changed_db < floor_db, np.nan, changed_db)


def examine(levels_db, *, chains: FrontEndLevels | None = None, second_db=None, signals=None, **settings) -> list:
    """Return the findings of each window. second_db : of the same satellites on L5, after those on L1."""
    detector = SignalLevels(SignalLevelsSettings(**{"false_alarm_probability": RATE, **settings}))
    o = replace(
        EXACT,
        cn0_dbhz=levels_db,
        status=np.where(np.isnan(levels_db), CellStatus.NOT_TRACKED, 0).astype(np.uint8),
        signals=signals or EXACT.signals,
    )
    if second_db is not None:
        cells = {name: np.hstack([getattr(o, name)] * 2) for name in CELLS}
        signals = (*o.signals, *(SignalId(s.sat, "L5", "Q") for s in o.signals))
        o = replace(o, **cells | {"cn0_dbhz": np.hstack([levels_db, second_db]), "signals": signals})
    found, state = [], None
    for first in range(0, o.gpst.size, WINDOW):
        part = o.read(first, first + WINDOW)
        start, end = part.gpst[0], part.gpst[-1] + np.timedelta64(1, "s")
        levels = {} if chains is None else {"rx1": chains.select_between(start, end)}
        records = Records(start_gpst=start, end_gpst=end, observations=(part,), levels=levels)
        evidence, state = detector.examine(records, state)
        found += evidence
    return found


CELLS = (
    *("pseudorange_m", "carrier_cyc", "doppler_hz", "pseudorange_sigma_m", "carrier_sigma_cyc", "doppler_sigma_hz"),
    *("status", "half_cycle_open", "quadrature_m", "found_elapsed_s", "missed_elapsed_s", "carrier_hz"),
)


def make_front_end(rise_db: float, *, share: bool = False, band: str = "L1") -> FrontEndLevels:
    """Return a gain that gives way at the onset, once a second."""
    rng = np.random.default_rng(3)
    n = EXACT.gpst.size
    gain_db = 35.0 + 0.2 * rng.standard_normal(n) - np.where(np.arange(n) >= ONSET, rise_db, 0.0)
    none = np.full(n, np.nan)
    return FrontEndLevels(
        gpst=EXACT.gpst,
        band=np.full(n, band),
        agc_db=none if share else gain_db,
        agc_share=gain_db / 60.0 if share else none,
        noise_db=none,
        jamming_share=none,
    )


def select_falls(found: list) -> list:
    return [rise for e in found for rise in e.interference or ()]


def select_failed(found: list) -> list:
    return [e for e in found if e.failed]


@pytest.mark.parametrize("seed", range(6))
def test_a_clean_sky_neither_fails_nor_is_interfered(seed) -> None:
    found = examine(draw_levels(seed))
    assert [e.code for e in found] == ["nothing_before"] + ["steady"] * (WINDOWS - 1)
    assert not select_falls(found)
    assert [e.p_value is None for e in found] == [True] + [False] * (WINDOWS - 1)


def test_the_first_window_says_that_nothing_came_before() -> None:
    assert examine(draw_levels())[0].code == "nothing_before"
    assert examine(np.full((WINDOW * WINDOWS, N), np.nan))[-1].code == "no_levels"


def test_three_satellites_of_a_kind_are_too_few() -> None:
    levels_db = draw_levels()
    levels_db[:, 3:] = np.nan
    assert {e.code for e in examine(levels_db)[1:]} == {"few_satellites"}


@pytest.mark.parametrize("fall_db", [5.0, 12.0, 20.0])
def test_noise_is_interference_since_its_first_epoch(fall_db) -> None:
    found = examine(drop_levels(draw_levels(), fall_db))
    assert not select_failed(found)
    rises = select_falls(found)
    assert {e.code for e in found if e.interference} == {"interfered"}
    assert len(rises) == WINDOWS - 8
    assert rises[0].from_gpst == EXACT.gpst[ONSET]
    assert rises[-1].to_gpst == EXACT.gpst[-1]
    assert rises[-1].fall_db == pytest.approx(fall_db, abs=1.5)
    assert {rise.carrier for rise in rises} == {"L1"}


def test_interference_that_ends_is_no_rise_of_false_signals() -> None:
    found = examine(drop_levels(draw_levels(), 12.0, epochs=slice(ONSET, 112)))
    assert not select_failed(found)
    assert select_falls(found)[-1].to_gpst == EXACT.gpst[111]


def test_lost_signals_fell_at_least_to_the_floor() -> None:
    levels_db = draw_levels()
    found = examine(drop_levels(levels_db, 30.0))
    (first, *_) = select_falls(found)
    assert first.signs == ("cn0", "lost")
    assert first.from_gpst == EXACT.gpst[ONSET]
    assert 2 * first.lost > N
    assert 5.0 < first.fall_db <= 30.0
    assert not select_failed(found)


@pytest.mark.parametrize("fall_db", [12.0, 30.0])
@pytest.mark.parametrize("first", [ONSET, 97], ids=["within a window", "over two"])
def test_interference_of_four_seconds_is_reported(first, fall_db) -> None:
    found = examine(drop_levels(draw_levels(), fall_db, epochs=slice(first, first + 4)))
    assert not select_failed(found)
    rises = select_falls(found)
    assert rises
    assert (rises[0].from_gpst, rises[-1].to_gpst) == (EXACT.gpst[first], EXACT.gpst[first + 3])
    assert 6.0 < max(rise.fall_db for rise in rises) <= fall_db + 2.0


def test_parts_of_windows_fall_at_the_rate_that_is_asked() -> None:
    # Draw fading that goes on from part to part by half, beside that of windows.
    asked, n_windows, reported = 0.1, 0, 0
    rng = np.random.default_rng(8)
    for seed in range(40):
        parts_db = rng.standard_normal((WINDOWS * 5, N))
        for k in range(1, len(parts_db)):
            parts_db[k] = 0.5 * parts_db[k - 1] + np.sqrt(0.75) * parts_db[k]
        found = examine(
            draw_levels(seed, fading_db=1.5) + np.repeat(1.3 * parts_db, 2, axis=0), interference_probability=asked
        )
        n_windows += WINDOWS
        reported += len(select_falls(found))
    assert stats.binomtest(reported, n_windows, asked, alternative="greater").pvalue > 1e-4


def test_one_satellite_in_shade_is_neither() -> None:
    levels_db = draw_levels()
    levels_db[ONSET:, 1] -= 18.0
    found = examine(levels_db)
    assert not select_failed(found)
    assert not select_falls(found)


@pytest.mark.parametrize("share", [False, True])
def test_interference_from_the_start_shows_when_it_ends(share) -> None:
    # Noise that is there from the first epoch on, and leaves: C/N0 rises and less power comes in.
    jammed_db = drop_levels(draw_levels(), 10.0, epochs=slice(0, ONSET))
    found = examine(jammed_db, chains=make_front_end(-11.0, share=share))
    assert not select_failed(found)
    (rise,) = select_falls(found)
    assert (rise.from_gpst, rise.to_gpst) == (EXACT.gpst[0], EXACT.gpst[ONSET - 1])
    assert rise.fall_db == pytest.approx(10.0, abs=1.5)
    assert (rise.signs, rise.may_be_shade) == (("cn0", "level"), False)
    assert rise.level_db is None if share else rise.level_db == pytest.approx(11.0, abs=1.0)


def test_signals_that_rise_at_the_level_of_before_still_fail() -> None:
    jammed_db = drop_levels(draw_levels(), 10.0, epochs=slice(0, ONSET))
    assert select_failed(examine(jammed_db))
    assert select_failed(examine(jammed_db, chains=make_front_end(0.0)))
    assert not select_falls(examine(jammed_db, chains=make_front_end(0.0)))


@pytest.mark.parametrize("shared_db", [-14.0, 0.0])
def test_weak_signals_from_the_start_are_told_and_not_accused(shared_db) -> None:
    # A jammer, a roof and a poor antenna scale C/N0 of all alike: it is said that it is open which.
    found = examine(draw_levels() + shared_db)
    assert not select_failed(found)
    assert not select_falls(found)
    weak = [start for e in found for start in e.weak_start]
    assert len(weak) == (shared_db < 0.0)
    if weak:
        assert (weak[0].carrier, weak[0].from_gpst) == ("L1", EXACT.gpst[0])
        assert weak[0].cn0_dbhz < weak[0].least_dbhz == pytest.approx(36.0)
        assert weak[0].cn0_dbhz == pytest.approx(43.0 + shared_db, abs=4.0)


def test_shade_is_named_unless_something_excludes_it() -> None:
    dark = drop_levels(draw_levels(), 10.0)
    assert select_falls(examine(dark))[0].may_be_shade
    assert not select_falls(examine(dark, speed_max_m_s=0.0))[0].may_be_shade
    assert not select_falls(examine(dark, chains=make_front_end(10.0)))[0].may_be_shade
    assert not select_falls(examine(dark, second_db=draw_levels(1)))[0].may_be_shade
    assert select_falls(examine(dark, second_db=drop_levels(draw_levels(1), 10.0)))[0].may_be_shade


def test_the_level_of_the_front_end_says_how_much_came_in() -> None:
    rises = select_falls(examine(drop_levels(draw_levels(), 10.0), chains=make_front_end(11.0)))
    assert rises[-1].signs == ("cn0", "level")
    assert rises[-1].level_db == pytest.approx(11.0, abs=0.5)
    unknown = select_falls(examine(drop_levels(draw_levels(), 10.0), chains=make_front_end(11.0, share=True)))
    assert unknown[-1].signs == ("cn0", "level")
    assert unknown[-1].level_db is None


def test_power_that_weakens_no_signal_is_suspect() -> None:
    first, *_ = select_failed(examine(draw_levels(), chains=make_front_end(12.0)))
    assert (first.code, first.says, first.overrules) == ("odd", "undecided", False)
    assert (first.data["test"], first.data["chain"]) == ("level", "L1")
    assert first.data["rise_db"] == pytest.approx(12.0, abs=6.0)
    assert first.may_also_be == (Cause.GAIN, Cause.INTERFERENCE)
    assert not select_failed(
        examine(draw_levels(), chains=make_front_end(12.0, band="L5"))
    )  # no signal is received there


def draw_false_signals(levels_db: np.ndarray, over_db: float, *, phases: int = 0) -> np.ndarray:
    """Return levels of true signals and false ones on top of them, stronger by so much, from the onset on."""
    turned = np.exp(2j * np.pi * np.random.default_rng(phases).random(N))
    both_db = levels_db + 20.0 * np.log10(np.abs(1.0 + 10.0 ** (over_db / 20.0) * turned))
    return np.where(np.arange(len(levels_db))[:, None] >= ONSET, both_db, levels_db)


@pytest.mark.parametrize("phases", range(3))
def test_power_that_enters_with_the_signals_is_dated(phases: int) -> None:
    # A takeover 10 dB over the true signals, whose own noise adds 4 dB to the receiver's.
    found = select_failed(examine(draw_false_signals(draw_levels(), 6.0, phases=phases), chains=make_front_end(4.0)))
    first = found[0]
    assert first.data["test"] == "entered"
    assert abs((first.dated_gpst - EXACT.gpst[ONSET]) / np.timedelta64(1, "s")) < 3.0
    assert first.end_gpst - EXACT.gpst[ONSET] <= np.timedelta64(WINDOW, "s")
    assert Cause.INTERFERENCE in first.may_also_be
    assert first.says == "undecided"


@pytest.mark.parametrize("input_db", [4.0, 0.0, -4.0])
def test_only_a_standing_receiver_needs_no_more_power(input_db: float) -> None:
    # Shade that ends strengthens signals as well, and noise that ends brings less power.
    strong_db = draw_false_signals(draw_levels(), 4.0)
    found = [
        [
            e
            for e in select_failed(examine(strong_db, chains=make_front_end(input_db), speed_max_m_s=speed))
            if e.code == "odd"
        ]
        for speed in (0.0, None)
    ]
    entered = [any(e.data["test"] == "entered" for e in each) for each in found]
    assert entered == {4.0: [True, True], 0.0: [True, False], -4.0: [False, False]}[input_db]


def test_noise_and_single_reflections_do_not_enter() -> None:
    # Noise weakens signals, and what one reflector strengthens are few.
    few_db = draw_levels()
    few_db[ONSET:, :3] += 6.0
    for levels_db in (
        few_db,
        drop_levels(draw_levels(), 10.0),
        drop_levels(draw_levels(), 4.0, epochs=slice(ONSET, ONSET + 8)),
    ):
        for speed in (0.0, None):
            found = examine(levels_db, chains=make_front_end(10.0), speed_max_m_s=speed)
            assert not [e for e in select_failed(found) if e.data["test"] == "entered"]


def test_signals_that_get_stronger_together_are_suspect() -> None:
    first, *_ = select_failed(examine(drop_levels(draw_levels(), -8.0)))
    assert first.dated_gpst == EXACT.gpst[ONSET]
    assert first.statistic == pytest.approx(8.0, abs=1.5)
    assert (first.data["test"], first.data["unit"]) == ("rise", ("G", "L1", "CA"))
    assert first.may_also_be == (Cause.SHADE, Cause.INTERFERENCE, Cause.GAIN)


def test_satellites_of_equal_power_are_suspect() -> None:
    levels_db = draw_levels(2)
    noise_db = 0.3 * np.random.default_rng(5).standard_normal(levels_db[ONSET:].shape)
    levels_db[ONSET:] = levels_db[:ONSET].mean() + noise_db
    first, *_ = select_failed(examine(levels_db, false_alarm_probability=1e-4))
    assert first.statistic == pytest.approx(-1.0, abs=0.3)
    assert (first.data["test"], first.data["slope"]) == ("pattern", first.statistic)
    assert first.may_also_be == (Cause.REFLECTIONS, Cause.MOTION)


def test_signals_stronger_than_any_from_space_are_suspect() -> None:
    loud = draw_levels()
    loud[:, 3] = GPS_L1_CA.strongest_dbw + POLICY.most_cn0_over_power_db + 4.0
    first, *_ = select_failed(examine(loud))
    assert [ref.signal for ref in first.signals] == [EXACT.signals[3]]
    assert (first.data["test"], first.data["strong"]) == ("strong", 1)
    assert first.may_also_be == (Cause.GAIN,)


@pytest.mark.parametrize(("code", "over_db", "says"), [("CA", 4.0, 1), ("Q", 4.0, 0), ("Q", 9.0, 1)])
def test_what_is_too_strong_is_asked_of_the_signals_plan(code: str, over_db: float, says: int) -> None:
    # L5 may arrive 5 dB stronger than C/A (IS-GPS-705J, IS-GPS-200N, 6.3.1).
    loud_db = np.full_like(draw_levels(), GPS_L1_CA.strongest_dbw + POLICY.most_cn0_over_power_db + over_db)
    found = examine(loud_db) if code == "CA" else examine(draw_levels(), second_db=loud_db)
    assert any(f.data.get("test") == "strong" for f in select_failed(found)) == bool(says)


@pytest.mark.parametrize(("over_db", "fails"), [(1.0, False), (4.0, True)])
def test_a_reading_over_the_bound_has_its_chance(over_db: float, fails: bool) -> None:
    loud = draw_levels()
    loud[:, 3] = GPS_L1_CA.strongest_dbw + POLICY.most_cn0_over_power_db + over_db
    found = examine(loud)[1:]
    assert bool(select_failed(found)) == fails
    assert min(e.p_value for e in found) > 0.0


def test_interference_is_told_where_no_kind_has_enough_signals() -> None:
    # Three satellites of each system share a carrier that all of them fall on.
    kinds = (("G", "L1", "CA"), ("E", "E1", "C"), ("C", "B1C", "1P"), ("J", "L1", "CA"), ("I", "L1", "D"))
    few = tuple(SignalId(f"{kinds[k // 3][0]}{k + 1:02d}", *kinds[k // 3][1:]) for k in range(N))
    found = examine(drop_levels(draw_levels(), 12.0), signals=few)
    assert select_falls(found)[0].carrier == "L1"
    assert [e.p_value for e in found] == [None] * WINDOWS
    assert {e.code for e in found} == {"nothing_before", "few_satellites", "interfered"}


def test_falls_are_reported_at_the_rate_that_is_asked() -> None:
    # Draw clean skies of the stated law: a union bound of two tests keeps the rate, and half of it is left.
    asked, n_windows, reported = 0.1, 0, 0
    for seed in range(60):
        found = examine(draw_levels(seed, common_db=0.5, fading_db=2.0), interference_probability=asked)
        n_windows += WINDOWS - 1
        reported += len(select_falls(found))
    assert stats.binomtest(reported, n_windows, asked, alternative="greater").pvalue > 1e-4
    assert reported > 0.2 * asked * n_windows


def test_pieces_give_what_the_whole_gives() -> None:
    levels_db = drop_levels(draw_levels(), 9.0)
    assert [e.p_value for e in examine(levels_db)] == [e.p_value for e in examine(levels_db.copy())]


def test_own_levels_follow_elevation_and_no_noise() -> None:
    drift_db = 3.0 * np.arange(WINDOW * WINDOWS)[:, None] / (WINDOW * WINDOWS) * np.linspace(-1.0, 1.0, N)
    found = examine(drop_levels(draw_levels() + drift_db, 12.0, epochs=slice(ONSET, 121)))
    assert not select_failed(found)
    assert [bool(e.interference) for e in found] == [False] * 8 + [True] * 5 + [False]


def test_carriers_share_a_name_and_chains_cover_them() -> None:
    assert {carrier_name(SignalId("E01", "E1", "C")), carrier_name(SignalId("C20", "B1C", "1P"))} == {"L1"}
    assert carrier_name(SignalId("R01", "G1", "CA")) == "G1"
    assert [chain_covers(chain, "L1") for chain in ("L1", "L2L5", "7", "B1C")] == [True, False, True, True]
    assert [chain_covers(chain, "L5") for chain in ("L1", "L2L5", "E6")] == [False, True, True]


@pytest.mark.parametrize("name", ["fading_db", "common_db", "gain_db", "gain_share"])
def test_settings_that_make_no_sense_are_refused(name) -> None:
    with pytest.raises(SettingsError, match=name):
        SignalLevelsSettings(**{name: 0.0})
