"""What the report draws of a run: peaks where signals are, one antenna's in one line, truth where it is known."""

import json

import numpy as np
import pytest
from tests.app import kit

from skyproof.app.protect import pictures
from skyproof.app.protect.pictures import build_pictures
from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.report.page import write_report_html
from skyproof.simulator.scenario import Meaconer

PLACE = {"lat_deg": 57.7, "lon_deg": 11.9, "height_m": 50.0}


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """Run the command on two receivers under a meaconer that is switched on after 12 s."""
    attack = Meaconer(receive=kit.ELSEWHERE, transmit=kit.TRANSMIT, delay_s=4e-6, onset_s=12.0, noise_db=-13.0)
    scenario = kit.make_scenario(attacks=(attack,), duration_s=26.0)
    return kit.protect_scenario(scenario, tmp_path_factory.mktemp("pictures")).result


@pytest.mark.long
def test_every_signal_stands_at_a_peak_of_its_correlation(result):
    drawn = build_pictures(result.outcome).profiles
    assert len(drawn) == pictures.PROFILES
    for profile in drawn:
        assert [tag.label for tag in profile.tags] == ["authentic", "spoofed"]
        for tag in profile.tags:
            near = np.abs(profile.delays_chips - tag.delay_chips) < 0.7
            top = profile.delays_chips[near][np.argmax(profile.power[near])]
            assert top == pytest.approx(tag.delay_chips, abs=0.25)
            assert profile.power[near].max() > 4.0


@pytest.mark.long
def test_false_signals_share_their_range_difference(result):
    drawn = build_pictures(result.outcome).differences
    metres = {label: [d.metres for d in drawn if d.label == label] for label in ("authentic", "spoofed")}
    assert min(map(len, metres.values())) >= 8
    assert np.ptp(metres["spoofed"]) < 5.0
    assert np.ptp(metres["authentic"]) > 30.0  # the antennas stand 60 m apart


@pytest.mark.long
def test_the_simulated_truth_lies_where_the_receiver_stood(result):
    drawn = build_pictures(result.outcome)
    assert {place.receiver for place in drawn.truth} == {"bow", "stern"}
    for place in drawn.truth:
        trusted = next(t for t in drawn.tracks if (t.receiver, t.kind) == (place.receiver, "trusted"))
        assert np.hypot(*(trusted.points()[-1] - (place.east_m, place.north_m))) < 5.0


@pytest.mark.long
def test_the_same_run_gives_the_same_page(result):
    pages = {write_report_html(result.verdict, build_pictures(result.outcome)) for _ in range(2)}
    assert len(pages) == 1


@pytest.mark.long
def test_each_detector_that_ran_says_what_it_found(result):
    ran = {m.detector for m in result.verdict.methods if m.ran}
    assert {finding.detector for finding in build_pictures(result.outcome).findings} == ran


def test_a_place_is_read_in_either_spelling(tmp_path):
    path = tmp_path / "truth.json"
    path.write_text(
        json.dumps(
            {
                "receivers": [
                    {"name": "rx1", "position": PLACE},
                    {"name": "rx2", "position": {"lat_deg": 1, "lon_deg": 2, "h_m": 3}},
                ]
            }
        )
    )
    first, second = (pictures._read_place(path, name) for name in ("rx1", "rx2"))
    np.testing.assert_allclose(np.degrees(geodetic_from_ecef(first)[:2]), (57.7, 11.9))
    np.testing.assert_allclose(geodetic_from_ecef(second)[2], 3.0, atol=1e-6)


@pytest.mark.parametrize(
    "reported",
    [
        "",
        "[]",
        "3",
        "{}",
        '{"receivers": 3}',
        '{"receivers": [3]}',
        '{"receivers": [{"name": "rx1"}]}',
        '{"receivers": [{"name": "rx1", "position": {"lat_deg": "x"}}]}',
        '{"receivers": [{"name": "rx1", "position": {"lat_deg": NaN, "lon_deg": 1, "h_m": 2}}]}',
        '{"receivers": [{"name": "other", "position": {"lat_deg": 1, "lon_deg": 1, "h_m": 2}}]}',
    ],
)
def test_a_truth_file_that_is_not_understood_is_ignored(tmp_path, reported):
    path = tmp_path / "truth.json"
    path.write_text(reported)
    assert pictures._read_place(path, "rx1") is None
    assert pictures._read_place(tmp_path / "none.json", "rx1") is None


def test_a_receiver_that_moved_has_no_one_true_place(tmp_path):
    path = tmp_path / "truth.json"
    moved = {"name": "rx1", "position": PLACE, "position_at_end": PLACE | {"lat_deg": 57.71}}
    path.write_text(json.dumps({"receivers": [moved]}))
    assert pictures._read_place(path, "rx1") is None


def test_where_a_moving_receiver_was_is_read_from_its_table(tmp_path):
    path = tmp_path / "rx1-truth.csv"
    path.write_text("gpst,true_s,x_m,y_m,z_m\n2024-05-14T10:00:00.0,0,1,2,3\n2024-05-14T10:00:00.1,0.1,2,4,6\n")
    at = np.datetime64("2024-05-14T10:00:00.05", "ns")
    np.testing.assert_allclose(pictures._interpolate_place(path, at), (1.5, 3.0, 4.5))
    assert pictures._interpolate_place(path, at + np.timedelta64(1, "s")) is None
    for reported in (
        "",
        "a,b\n1,2\n",
        "gpst,x_m,y_m,z_m\nnever,1,2,3\n",
        "gpst,x_m,y_m,z_m\n2024-05-14T10:00:00,1,2\n",
    ):
        path.write_text(reported)
        assert pictures._interpolate_place(path, at) is None
