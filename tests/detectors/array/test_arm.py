"""A turning antenna against the orbits: false signals are named with their direction, true ones stay authentic."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from skyproof.detectors.array.spin import Spin, SpinSettings
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.orbits import compute_satellite_state_s
from skyproof.gnss.sky import compute_azimuth_elevation
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.predictor import Standing, place_surveyed
from skyproof.records import Cause, SpinArm
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

RADIUS_M, RATE_HZ = 0.0951, 0.25
SCENE = MeasuredScene(
    antennas_enu_m={"rx1": (0.0, 0.0, 0.0)},
    false=(FalseSky(shows_enu_m=(300.0, 200.0, 0.0), delay_m=50.0),),
    epochs=50,
    step_s=0.2,
    errors=TrackErrors(1.0, 0.9),
    max_satellites=9,
)
FROM = np.radians(160.0), np.radians(25.0)


def make_turning(
    rng,
    false=3,
    *,
    beside=(),
    between=False,
    rate_hz=RATE_HZ,
    tilt_rad=0.0,
    slips=(),
    start_rad=None,
    moved_rad=None,
    lasting_cyc=0.0,
    radius_m=RADIUS_M,
):
    """Make a window of an arm that turns clockwise, with `false` satellites imitated from one direction.

    beside : columns of true signals that each have a false one of half their amplitude dragged off within a chip.
    between : within a chip of every true signal is a false one that is as strong and stays: the sum of their waves
        is one from halfway between.
    moved_rad : the first signal is false, and comes from so far beside its satellite.
    lasting_cyc : of what reflections write into each phase in step with the arm.
    """
    records = SCENE.records(rng)
    (o,) = records.observations
    n = len(o.signals) // 2
    kept = np.r_[np.arange(n), n + np.arange(false)]
    start_rad = rng.uniform(0.0, 2.0 * np.pi) if start_rad is None else start_rad
    arm = start_rad + 2.0 * np.pi * rate_hz * o.elapsed_s
    axis = rng.uniform(0.0, 2.0 * np.pi)
    place = np.column_stack([np.cos(arm), np.sin(arm), tilt_rad * np.cos(arm - axis)]) * radius_m  # north, east, up
    week, tow_s = week_and_tow(SCENE.start_gpst)
    carrier = o.carrier_cyc.copy()
    for k in kept:
        az, el = FROM
        if k < n:
            orbit = records.navigation.best(o.signals[k].sat, SCENE.start_gpst)
            where = compute_satellite_state_s(orbit, week, tow_s).position_ecef_m
            az, el = compute_azimuth_elevation(records.sets[0].position_ecef_m, where)
        towards = make_direction((az, el))
        if moved_rad is not None and k == 0:
            across = np.cross(towards, rng.normal(size=3))
            towards = np.cos(moved_rad) * towards + np.sin(moved_rad) * across / np.linalg.norm(across)
        carrier[:, k] -= place @ towards * L1_HZ / SPEED_OF_LIGHT_M_S
        carrier[:, k] += lasting_cyc * np.column_stack([np.cos(arm), np.sin(arm)]) @ rng.normal(size=2)
        apart = place @ (towards - make_direction(FROM)) * L1_HZ / SPEED_OF_LIGHT_M_S
        if between:
            carrier[:, k] += 0.5 * apart
        if k in beside:
            apart = apart + 0.4 * o.elapsed_s + rng.uniform()
            carrier[:, k] += np.angle(1.0 + 0.5 * np.exp(2j * np.pi * apart)) / (2.0 * np.pi)
    for signal, epoch, size in slips:
        carrier[epoch:, signal] += size
    fields = ("pseudorange_m", "doppler_hz", "cn0_dbhz", "pseudorange_sigma_m", "carrier_sigma_cyc", "doppler_sigma_hz")
    cells = {name: getattr(o, name)[:, kept] for name in (*fields, "status", "half_cycle_open", "quadrature_m")}
    single = {name: getattr(o, name)[kept] for name in ("found_elapsed_s", "missed_elapsed_s", "carrier_hz")}
    # Stronger than the sum of a direct signal and its reflection, which may be 6 dB over the strongest of the others.
    cells["cn0_dbhz"] = cells["cn0_dbhz"] + np.where((kept >= n) | (moved_rad is not None) & (kept == 0), 7.0, 0.0)
    part = replace(o, signals=tuple(o.signals[k] for k in kept), carrier_cyc=carrier[:, kept], **cells, **single)
    return replace(records, observations=(part,), sets=records.sets[:1])


def make_direction(azimuth_elevation_rad):
    """Return the unit vector north, east and up."""
    az, el = azimuth_elevation_rad
    return np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])


def examine_records(records, *, rate_sigma_hz=0.0, alpha=1e-4, pattern_sigma_m=None):
    arm = SpinArm(
        receiver="rx1",
        radius_m=RADIUS_M,
        rate_rad_s=2.0 * np.pi * RATE_HZ,
        rate_sigma_rad_s=2.0 * np.pi * rate_sigma_hz,
        pattern_sigma_m=pattern_sigma_m,
    )
    evidence, _ = Spin(SpinSettings(false_alarm_probability=alpha)).examine(replace(records, spin_arms=(arm,)))
    words = {e.says: {ref.signal for ref in e.signals} for e in evidence}
    return words, evidence


CASES = {
    "as stated": ({}, {}),
    "rate wrong by 1 %": ({"rate_hz": 1.01 * RATE_HZ}, {"rate_sigma_hz": 0.0025}),
    "wobble of 2 degrees": ({"tilt_rad": np.radians(2.0)}, {}),
    "slips": ({"slips": ((1, 20, 0.5), (4, 33, -1.0))}, {}),
}


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("made", "stated"), CASES.values(), ids=CASES.keys())
def test_false_signals_are_named_and_true_ones_stay_authentic(made, stated, seed):
    records = make_turning(np.random.default_rng(seed), **made)
    words, evidence = examine_records(records, **stated)
    signals = records.observations[0].signals
    assert words == {
        "authentic": {s for s in signals if s.copy == "a"},
        "spoofed": {s for s in signals if s.copy == "b"},
    }
    (spoofed,) = [e for e in evidence if e.says == "spoofed"]
    (direction,) = spoofed.directions
    assert direction.frame == "enu"
    off = (direction.azimuth_rad - FROM[0]) * np.cos(FROM[1]), direction.elevation_rad - FROM[1]
    assert np.sqrt(off @ np.linalg.solve(direction.covariance_rad2, off)) < 3.7  # 1 in 1000


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("made", "stated"), CASES.values(), ids=CASES.keys())
def test_a_true_sky_is_authentic(made, stated, seed):
    records = make_turning(np.random.default_rng(seed), false=0, **made)
    words, _ = examine_records(records, **stated)
    assert words == {"authentic": set(records.observations[0].signals)}


def test_a_stated_pattern_of_the_antenna_raises_no_alarm():
    # 0.03 cycles in step with the arm, 5.7 mm: if nothing is stated, most such skies are suspect.
    named = 0
    for seed in range(8):
        for moved_rad in (None, np.radians(40.0)):
            rng = np.random.default_rng([seed, 3])
            records = make_turning(rng, false=0, lasting_cyc=0.03, moved_rad=moved_rad)
            words, _ = examine_records(records, alpha=1e-6, pattern_sigma_m=0.0057)
            signals, spoofed = records.observations[0].signals, words.get("spoofed", set())
            if moved_rad is None:
                assert words == {"authentic": set(signals)}
            else:
                assert spoofed <= {signals[0]}
                named += bool(spoofed)
    assert named >= 4


def test_a_surveyed_place_needs_no_set_of_signals_that_fit():
    standing = Standing(stands=True, oscillator=None, by=())
    for moved_rad in (None, np.radians(30.0)):
        records = make_turning(np.random.default_rng(7), false=0, moved_rad=moved_rad)
        surveyed = place_surveyed(standing, records.sets[0].position_ecef_m, 25.0 * np.eye(3))
        words, _ = examine_records(replace(records, sets=(), standing={"rx1": surveyed}))
        signals = records.observations[0].signals
        named = set() if moved_rad is None else {signals[0]}
        assert words.get("spoofed", set()) == named
        assert words["authentic"] == set(signals) - named


def test_most_false_signals_ten_degrees_off_are_named():
    # One in six was, as errors were counted twice; theory with all others known exactly says nine in ten.
    named = []
    for seed in range(12):
        records = make_turning(np.random.default_rng([10, seed]), false=0, moved_rad=np.radians(10.0))
        words, _ = examine_records(records, alpha=1e-5)
        named.append(words.get("spoofed", set()) == {records.observations[0].signals[0]})
    assert sum(named) >= 9


@pytest.mark.parametrize("lasting_cyc", [0.0, 0.01])
def test_errors_of_arm_and_phases_as_stated_raise_no_alarm(lasting_cyc):
    # Each of fifty windows may alarm once in twenty.
    alarms = 0
    for seed in range(50):
        rng = np.random.default_rng([20, seed])
        wrong = {"radius_m": RADIUS_M + rng.normal(0.0, 0.002), "tilt_rad": abs(rng.normal(0.0, np.radians(2.0)))}
        words, _ = examine_records(make_turning(rng, false=0, **wrong, lasting_cyc=lasting_cyc), alpha=0.05)
        alarms += "spoofed" in words
    assert binom.sf(alarms - 1, 50, 0.05) > 1e-3


@pytest.mark.parametrize("orbits", [True, False])
def test_a_signal_of_no_single_direction_is_not_authentic(orbits):
    # A takeover within a chip: every phase is of two directions, and shows a third one.
    for beside in ((2,), (1, 4), tuple(range(9))):
        records = make_turning(np.random.default_rng(4), false=0, beside=beside)
        words, _ = examine_records(records if orbits else replace(records, navigation=None), alpha=1e-4)
        signals = records.observations[0].signals
        bent = {signals[k] for k in beside}
        if len(beside) == 1:
            assert words == {"authentic": set(signals) - bent}
        else:
            assert set(words) == {"undecided"}


def test_after_several_mixed_signals_none_is_authentic_a_minute():
    # What averages out in a window by its speed is still there.
    rng = np.random.default_rng(4)
    arm = SpinArm(receiver="rx1", radius_m=RADIUS_M, rate_rad_s=2.0 * np.pi * RATE_HZ)
    clear, bent = (replace(make_turning(rng, false=0, beside=beside), spin_arms=(arm,)) for beside in ((), (1, 4)))
    detector, state, words = Spin(SpinSettings(false_alarm_probability=1e-4)), None, {}
    for after_s, window in ((-20, clear), (0, bent), (15, clear), (65, clear), (75, clear)):
        at = clear.start_gpst + np.timedelta64(after_s, "s")
        (finding,), state = detector.examine(
            replace(window, start_gpst=at, end_gpst=at + np.timedelta64(10, "s")), state
        )
        words[after_s] = finding.says
        if after_s == 65:
            assert (finding.code, finding.data) == ("phases_bent", {"ago_s": 55.0})
    assert words == {-20: "authentic", 0: "undecided", 15: "undecided", 65: "undecided", 75: "authentic"}


@pytest.mark.parametrize("seed", range(3))
def test_directions_other_than_the_satellites_are_not_authentic(seed):
    records = make_turning(np.random.default_rng(seed), false=0, between=True)
    words, (finding,) = examine_records(records)
    assert set(words) == {"undecided"}
    assert (finding.code, finding.may_also_be) == ("not_from_satellites", (Cause.REFLECTIONS, Cause.STATEMENT))
    assert finding.failed


def test_without_orbits_signals_are_compared_with_each_other():
    records = make_turning(np.random.default_rng(1), false=7)
    words, evidence = examine_records(replace(records, navigation=None), alpha=1e-3)
    assert words == {"spoofed": {s for s in records.observations[0].signals if s.copy == "b"}}
    assert not evidence[0].directions
