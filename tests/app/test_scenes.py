"""Scenes from samples to verdict: whatever the attack, no label is false, and the verdict is what can be known."""

import numpy as np
import pytest
from tests.app import kit

from skyproof.simulator.scenario import FrontEnd, Meaconer, ScenePlace, Sky, Spoofer

pytestmark = pytest.mark.long

NEARBY = ScenePlace(lat_deg=57.7013, lon_deg=11.934, height_m=52.0)  # 110 m from the first receiver


@pytest.fixture
def meaconer():
    """Return a meaconer with ears 0.9 km away, on from 12 s; its copies come two chips and more late."""

    def make(**changes):
        keys = {"receive": kit.ELSEWHERE, "transmit": kit.TRANSMIT, "delay_s": 4e-6, "onset_s": 12.0}
        return Meaconer(**keys | {"noise_db": -13.0} | changes)

    return make


@pytest.fixture
def spoofer():
    """Return a spoofer that shows a place 3 km away from 12 s on."""

    def make(**changes):
        shows = ScenePlace(lat_deg=57.72, lon_deg=11.90, height_m=30.0)
        return Spoofer(**{"shows": shows, "transmit": kit.TRANSMIT, "onset_s": 12.0} | changes)

    return make


def assert_trusted(judged, limit_m: float = 5.0) -> None:
    """Fixes within the limit in 95 % of epochs, in every receiver."""
    for receiver in judged.verdict.receivers:
        error_m = judged.measure_trusted_error_m(receiver.name)
        assert np.isfinite(error_m).sum() > 40
        assert np.nanpercentile(error_m, 95) < limit_m


def assert_spoofed(judged, *, authentic: int = 10, spoofed: int = 10, onset_s: float | None = 12.0) -> None:
    """Check spoofed since then (None: from the start), no false label, and so many named in each receiver."""
    assert judged.find_false_labels() == []
    assert judged.verdict.verdict == "spoofed"
    for receiver in judged.verdict.receivers:
        assert len(judged.list_named("authentic", receiver.name)) >= authentic
        assert len(judged.list_named("spoofed", receiver.name)) >= spoofed
    since = np.datetime64(judged.verdict.since_gpst, "ns")
    off_s = (since - judged.scene.scenario.start_gpst) / np.timedelta64(10**9, "ns") - (onset_s or 0.0)
    assert abs(off_s) < 3.0
    assert (judged.verdict.since_sigma_s is None) == (onset_s is None)
    assert_trusted(judged)


def assert_not_authentic(judged) -> None:
    """Check that nothing false is stated and that the answer is not authentic."""
    assert judged.find_false_labels() == []
    assert judged.verdict.verdict != "authentic"
    assert judged.verdict.reason


# --- a clean sky


@pytest.mark.parametrize(("receivers", "duration_s"), [(2, 34.0), (3, 16.0)])
def test_a_clean_sky_is_authentic(tmp_path, receivers, duration_s):
    arguments = {"antenna_distance_m": kit.DISTANCE_M} if receivers == 2 else {"antennas_enu_m": kit.ENU_M}
    judged = kit.protect_scenario(kit.make_scenario(receivers=receivers, duration_s=duration_s), tmp_path, **arguments)
    assert judged.verdict.verdict == "authentic"
    assert judged.find_false_labels() == []
    assert {s.label for s in judged.verdict.signals} == {"authentic"}
    assert judged.verdict.since_gpst is None
    assert_trusted(judged)


# --- meaconers


@pytest.mark.parametrize("nav", [True, False])
def test_a_meaconer_is_named(meaconer, tmp_path, nav):
    judged = kit.protect_scenario(kit.make_scenario(attacks=(meaconer(),)), tmp_path, with_nav=nav)
    assert_spoofed(judged)
    assert judged.verdict.until_gpst is None
    (source,) = judged.verdict.sources
    assert source.time_offset_s == pytest.approx(4.33e-6, abs=3e-8)


def test_three_receivers_under_a_meaconer(meaconer, tmp_path):
    assert_spoofed(kit.protect_scenario(kit.make_scenario(receivers=3, attacks=(meaconer(),)), tmp_path))


@pytest.mark.parametrize("power_db", [0.0, 10.0])
def test_an_attack_that_was_on_at_the_start(meaconer, tmp_path, power_db):
    # The strongest signal is found first, so here the false one has the first letter.
    scenario = kit.make_scenario(duration_s=24.0, attacks=(meaconer(onset_s=-10.0, power_db=power_db),))
    assert_spoofed(kit.protect_scenario(scenario, tmp_path), onset_s=None)


def test_a_stronger_meaconer(meaconer, tmp_path):
    assert_spoofed(kit.protect_scenario(kit.make_scenario(attacks=(meaconer(power_db=10.0),)), tmp_path))


def test_a_weaker_meaconer(meaconer, tmp_path):
    # Not all of its signals are found.
    assert_spoofed(kit.protect_scenario(kit.make_scenario(attacks=(meaconer(power_db=-6.0),)), tmp_path), spoofed=6)


def test_weak_signals(meaconer, tmp_path):
    # Between 35 and 42 dB-Hz not all of them are found, nor all messages read.
    sky = Sky(zenith_cn0_dbhz=42.0, horizon_cn0_dbhz=35.0)
    scenario = kit.make_scenario(attacks=(meaconer(),)).model_copy(update={"sky": sky})
    assert_spoofed(kit.protect_scenario(scenario, tmp_path), authentic=6, spoofed=6)


def test_true_signals_20_db_under_the_false_ones_are_told_apart(meaconer, tmp_path):
    # They are found and followed at 25 to 34 dB-Hz, and measured without the false ones' sidelobes, 30 m of range.
    assert_spoofed(kit.protect_scenario(kit.make_scenario(attacks=(meaconer(power_db=20.0),)), tmp_path))


def test_a_meaconer_that_drowns_the_true_signals(meaconer, tmp_path):
    # One sky is left, the false one: only who knows how far apart the antennas are can tell, and trust what was before.
    scenario = kit.make_scenario(attacks=(meaconer(power_db=35.0),))
    assert_not_authentic(kit.protect_scenario(scenario, tmp_path / "unknown"))
    judged = kit.protect_scenario(scenario, tmp_path / "known", antenna_distance_m=kit.DISTANCE_M)
    assert judged.find_false_labels() == []
    assert judged.verdict.verdict == "spoofed"
    assert_trusted(judged)


def test_an_attack_that_ends(meaconer, tmp_path):
    judged = kit.protect_scenario(kit.make_scenario(duration_s=40.0, attacks=(meaconer(until_s=28.0),)), tmp_path)
    assert_spoofed(judged)
    end = np.datetime64(judged.verdict.until_gpst, "ns")
    assert abs((end - judged.scene.scenario.start_gpst) / np.timedelta64(10**9, "ns") - 28.0) < 3.0


def test_an_attack_on_some_satellites(meaconer, tmp_path):
    sats = ("G02", "G05", "G06", "G07", "G10", "G17")
    judged = kit.protect_scenario(kit.make_scenario(attacks=(meaconer(sats=sats),)), tmp_path)
    assert_spoofed(judged, spoofed=6)
    assert {s.sat for s in judged.verdict.signals if s.label == "spoofed"} == set(sats)


@pytest.mark.parametrize(
    "front_end",
    [
        FrontEnd(rate_hz=4e6, if_hz=1e6, kind="real", encoding="int", bits=8),
        FrontEnd(encoding="sign-magnitude", bits=2),
    ],
    ids=["real-int8-with-an-if", "two-bits"],
)
def test_other_front_ends(meaconer, tmp_path, front_end):
    scenario = kit.make_scenario(duration_s=26.0, attacks=(meaconer(),), front_end=front_end)
    assert_spoofed(kit.protect_scenario(scenario, tmp_path))


@pytest.mark.parametrize("nav", [True, False])
def test_the_week_turns_over(meaconer, tmp_path, nav):
    # The message was read in the old week, of orbits that hold for the new one.
    start = np.datetime64("2024-05-18T23:59:28", "ns")
    scenario = kit.make_scenario(duration_s=38.0, start_gpst=start, attacks=(meaconer(),))
    assert_spoofed(kit.protect_scenario(scenario, tmp_path, with_nav=nav))


# --- spoofers


@pytest.mark.parametrize("clock_offset_s", [-8e-6, 0.0])
def test_a_self_consistent_spoofer_is_named(spoofer, tmp_path, clock_offset_s):
    scenario = kit.make_scenario(attacks=(spoofer(clock_offset_s=clock_offset_s),))
    assert_spoofed(kit.protect_scenario(scenario, tmp_path))


@pytest.mark.parametrize("clock_offset_s", [-0.3, 0.2])
def test_a_spoofer_far_off_in_time_is_named(spoofer, tmp_path, clock_offset_s):
    # Without a clock of GPS time: its message states another time of week than the sky's.
    judged = kit.protect_scenario(kit.make_scenario(attacks=(spoofer(clock_offset_s=clock_offset_s),)), tmp_path)
    assert_spoofed(judged)
    assert judged.verdict.sources[0].time_offset_s == pytest.approx(clock_offset_s, abs=1e-6)


def test_false_signals_on_top_of_some_true_ones(spoofer, tmp_path):
    # Three of ten copies come within a chip of the true signal: those satellites cannot be parted.
    judged = kit.protect_scenario(kit.make_scenario(attacks=(spoofer(clock_offset_s=8e-6),)), tmp_path)
    assert_spoofed(judged, authentic=7, spoofed=6)


@pytest.mark.parametrize("power_db", [0.0, 15.0], ids=["mixed", "captured"])
def test_signals_dragged_off_their_delays_are_not_authentic(spoofer, tmp_path, power_db):
    # All copies come within a chip of the true signals: no second signal shows, and no channel slips.
    scenario = kit.make_scenario(attacks=(spoofer(shows=NEARBY, power_db=power_db),))
    judged = kit.protect_scenario(scenario, tmp_path, antenna_distance_m=kit.DISTANCE_M)
    assert_not_authentic(judged)
    assert_trusted(judged)


def test_two_attackers(meaconer, spoofer, tmp_path):
    second = spoofer(
        shows=ScenePlace(lat_deg=57.73, lon_deg=11.95, height_m=30.0),
        clock_offset_s=2e-5,
        onset_s=20.0,
        transmit=ScenePlace(lat_deg=57.7000, lon_deg=11.931, height_m=60.0),
    )
    judged = kit.protect_scenario(kit.make_scenario(attacks=(meaconer(), second)), tmp_path)
    assert_spoofed(judged)
    assert len(judged.verdict.sources) == 2
