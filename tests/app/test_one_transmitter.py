"""Whatever one transmitter does, through samples: no false position is trusted, and no attack is passed over."""

import numpy as np
import pytest
from tests.app import kit

from skyproof.simulator.attacks import TransmitAntenna
from skyproof.simulator.scenario import FrontEnd, Multipath, ScenePlace, Sky, Spoofer, Takeover
from skyproof.simulator.scenes import read_ready_made

pytestmark = pytest.mark.long

SHOWS = ScenePlace(lat_deg=57.6985, lon_deg=11.9275, height_m=60.0)  # 400 m off
BESIDE_STERN = ScenePlace(lat_deg=57.7009, lon_deg=11.932967, height_m=51.2)  # 1 m from it, 60 m from bow


def state_antennas(what):
    """Return what is stated of the antennas."""
    places = {name: kit.ENU_M[name] for name in ("bow", "stern")}
    distance = {"antenna_distance_m": kit.DISTANCE_M}
    return {"nothing": {}, "distance": distance, "places": {"antennas_enu_m": places}}[what]


def find_largest_ratio(judged):
    """Return the largest error of any trusted fix over its stated 95 % bound."""
    worst = 0.0
    for r in judged.result.outcome.receivers:
        if r.trusted is not None:
            good = r.trusted.status == 0
            error_m = judged.measure_trusted_error_m(r.reception.samples.name)[good]
            bound_m = 2.45 * np.sqrt(np.linalg.eigvalsh(r.trusted.covariance_m2[good, :3, :3]).max(axis=1))
            worst = max(worst, float(np.nanmax(error_m / bound_m, initial=0.0)))
    return worst


@pytest.mark.parametrize("known", ["nothing", "distance", "places"])
def test_one_captured_receiver_of_two_is_never_trusted(tmp_path, known):
    # A spoofer 1 m from stern, 20 dB above its true signals with noise that drowns them; bow hears the true sky.
    captured = Spoofer(
        shows=SHOWS, transmit=BESIDE_STERN, clock_offset_s=3e-6, onset_s=-10.0, power_db=-15.6, noise_db=-23.6
    )
    judged = kit.protect_scenario(kit.make_scenario(attacks=(captured,)), tmp_path, **state_antennas(known))
    assert judged.verdict.verdict != "authentic"
    assert "no sign" not in judged.verdict.summary
    assert find_largest_ratio(judged) < 1.0


@pytest.mark.parametrize("known", ["nothing", "distance", "places"])
def test_a_takeover_at_one_receiver_leaves_no_false_trusted_fix(tmp_path, known):
    # Aligned with bow's signals, misaligned at stern by what the antennas are apart; drawn off 1.2 km from 24 s on.
    takeover = Takeover(
        target="bow",
        transmit=ScenePlace(lat_deg=57.70183, lon_deg=11.9311, height_m=56.0),
        onset_s=12.0,
        power_db=4.0,
        power_points_db=((12.0, -20.0), (20.0, 0.0)),
        away_points_enu_m=((24.0, 0.0, 0.0, 0.0), (60.0, 1150.0, 350.0, 0.0)),
    )
    judged = kit.protect_scenario(
        kit.make_scenario(attacks=(takeover,), duration_s=60.0), tmp_path, **state_antennas(known)
    )
    assert judged.verdict.verdict == "spoofed"
    assert find_largest_ratio(judged) < 1.5
    onset = judged.scene.scenario.start_gpst + np.timedelta64(12, "s")
    assert np.datetime64(judged.verdict.since_latest_gpst) >= onset
    assert judged.verdict.since_earliest_gpst is None  # it may have lain hidden in the true signals for any time


def test_a_few_second_signals_from_two_antennas_are_counted(tmp_path):
    # Two of ten, up to 8 dB stronger, in both receivers.
    few = Spoofer(
        shows=SHOWS,
        transmit=ScenePlace(lat_deg=57.7012, lon_deg=11.9371, height_m=58.0),
        clock_offset_s=3e-6,
        power_db=8.0,
        onset_s=12.0,
        sats=("G07", "G17"),
        antennas=(TransmitAntenna(lat_deg=57.7035, lon_deg=11.9346, height_m=58.0, sats=("G17",)),),
    )
    judged = kit.protect_scenario(kit.make_scenario(attacks=(few,)), tmp_path, **state_antennas("distance"))
    assert judged.verdict.verdict != "authentic"
    assert [s.kind for s in judged.result.outcome.decision.unexplained] == ["rival"] * 4
    assert find_largest_ratio(judged) < 1.0


def test_four_of_ten_are_named_though_recordings_start_milliseconds_apart(tmp_path):
    # The ready-made scene at a lower rate: two from each of two antennas, ever stronger.
    made = read_ready_made("some-satellites")
    late = made.receivers[1].model_copy(update={"start_offset_s": 0.0123, "clock_offset_s": -0.005})
    front_end = FrontEnd(rate_hz=2.6e6, bandwidth_hz=2.08e6)
    changes = {"duration_s": 46.0, "front_end": front_end, "receivers": (made.receivers[0], late)}
    judged = kit.protect_scenario(made.model_copy(update=changes), tmp_path, antenna_distance_m=40.0)
    assert judged.verdict.verdict == "spoofed"
    assert judged.find_false_labels() == []
    for r in judged.result.outcome.receivers:
        assert judged.list_named("spoofed", r.reception.source.name) == {"G07", "G17", "G21", "G29"}
        assert np.mean(r.trusted.status == 0) > 0.95
    assert find_largest_ratio(judged) < 1.0


def test_a_late_repeated_sky_in_one_receiver_is_no_attack(tmp_path):
    scenario = kit.make_scenario()
    stern = scenario.receivers[1].model_copy(update={"multipath": (Multipath(delay_m=450.0, power_db=-6.0),)})
    scenario = scenario.model_copy(update={"receivers": (scenario.receivers[0], stern)})
    judged = kit.protect_scenario(scenario, tmp_path, **state_antennas("distance"))
    assert judged.verdict.verdict == "authentic"
    assert {s.label for s in judged.verdict.signals if s.receiver == "bow"} == {"authentic"}
    assert {s.label for s in judged.verdict.signals if s.receiver == "stern"} == {"authentic", "multipath"}
    assert find_largest_ratio(judged) < 1.5


@pytest.mark.parametrize("receivers", [2, 3])
def test_one_false_sky_alone_is_suspect_by_carriers_and_noise(tmp_path, receivers):
    # As under a roof: the true signals are 25 dB weaker than outside, and a transmitter repeats them from the start on.
    repeated = Spoofer(shows=SHOWS, transmit=kit.TRANSMIT, clock_offset_s=3e-6, onset_s=-10.0, power_db=26.0)
    scenario = kit.make_scenario(receivers=receivers, duration_s=14.0, attacks=(repeated,))
    inside = scenario.model_copy(update={"sky": Sky(zenith_cn0_dbhz=20.0, horizon_cn0_dbhz=14.0)})
    judged = kit.protect_scenario(inside, tmp_path)
    assert judged.verdict.verdict == "suspect"
    assert {e.code for e in judged.result.outcome.evidence if e.failed} == {"one_place"}
    assert {s.label for s in judged.verdict.signals} == {"unknown"}
    assert all(r.trusted_fix is None for r in judged.verdict.receivers)


def test_receivers_of_one_sky_at_unknown_distances_are_not_suspect(tmp_path):
    judged = kit.protect_scenario(kit.make_scenario(receivers=3, duration_s=14.0), tmp_path)
    assert judged.verdict.verdict == "no_attack_seen"
    assert all(len(r.reception.apart_from) == 2 for r in judged.result.outcome.receivers)
