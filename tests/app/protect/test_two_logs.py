"""Two receivers' UBX logs of a scene give what two observation files of the same measurements give."""

from dataclasses import replace

import numpy as np
import pytest
from tests.gnss.later import extrapolate_hours

from skyproof.app.common.rinex import write_channels
from skyproof.app.protect import protect
from skyproof.errors import InputError
from skyproof.formats.rinex_nav import write_nav
from skyproof.logs.ubx_write import ubx_log
from skyproof.records import NavigationData
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.measurements import draw, make_ideal_measurements
from skyproof.simulator.ordinary import follow_strongest
from skyproof.simulator.scenes import read_ready_made
from skyproof.simulator.sky import make_scene
from skyproof.simulator.standalone import override


@pytest.mark.parametrize(("name", "word"), [("clean", "authentic"), ("starts-spoofed", "spoofed")])
def test_two_logs_are_as_good_as_two_observation_files(tmp_path, name, word) -> None:
    made = override(read_ready_made(name), seed=None, duration_s=45.0)
    navigation = make_navigation(made)
    scene = make_scene(made, navigation)
    observations, _ = draw(make_ideal_measurements(scene), rng=np.random.default_rng(1))
    write_nav(tmp_path / "nav.rnx", navigation)
    logs, files, places = [], [], []
    for o, sky in zip(map(follow_strongest, observations), scene.skies, strict=True):
        logs.append(tmp_path / f"{o.receiver}.ubx")
        logs[-1].write_bytes(b"".join(ubx_log(o, navigation)))
        files.append(tmp_path / f"{o.receiver}.obs")
        write_channels(files[-1], o, "mixed", None, o.signals)
        places.append(sky.point(np.array([sky.receiver.start_offset_s])).position_ecef_m[0])
    apart_m = float(np.linalg.norm(places[0] - places[1]))
    of_files = protect(files, nav=tmp_path / "nav.rnx", antenna_distance_m=apart_m)
    of_logs = protect(logs, nav=tmp_path / "nav.rnx", antenna_distance_m=apart_m)
    alone = protect(logs, antenna_distance_m=apart_m)  # orbits from the messages in the logs
    assert [result.verdict.verdict for result in (of_files, of_logs, alone)] == [word] * 3
    labels = [{(s.receiver, s.sat): s.label for s in result.verdict.signals} for result in (of_files, of_logs)]
    assert labels[0] == labels[1]
    for a, b in zip(of_files.verdict.receivers, of_logs.verdict.receivers, strict=True):
        for kind in ("trusted_fix", "false_fix", "unprotected_fix"):
            ours, theirs = getattr(a, kind), getattr(b, kind)
            assert (ours is None) == (theirs is None)
            if ours is not None:
                assert ours.lat_deg == pytest.approx(theirs.lat_deg, abs=1e-6)
                assert ours.lon_deg == pytest.approx(theirs.lon_deg, abs=1e-6)
                assert ours.height_m == pytest.approx(
                    theirs.height_m, abs=0.2
                )  # levels and deviations are rounded in UBX


@pytest.fixture(scope="module")
def scene_log(tmp_path_factory):
    """Write one receiver's log with its messages, and return the orbits that these are made of."""
    made = override(read_ready_made("clean"), seed=None, duration_s=60.0)
    navigation = make_navigation(made)
    observations, _ = draw(make_ideal_measurements(make_scene(made, navigation)), rng=np.random.default_rng(1))
    path = tmp_path_factory.mktemp("log") / "rx.ubx"
    path.write_bytes(b"".join(ubx_log(follow_strongest(observations[0]), navigation)))
    return path, navigation


def protect_with_old_file(log_of_a_scene, folder, hours: float, late_s: float = 0.0):
    """Run the command with a navigation file of so many hours before, whose clocks are late by so much."""
    path, navigation = log_of_a_scene
    before = [extrapolate_hours(replace(e, af0=e.af0 + late_s), -hours) for e in navigation.ephemerides]
    write_nav(folder / "nav.rnx", NavigationData(ephemerides=tuple(before)))
    return protect([path], nav=folder / "nav.rnx")


@pytest.mark.parametrize(("late_s", "code"), [(0.0, "of_day_expected"), (2e-6, "of_day_odd")])
def test_a_log_goes_on_from_a_file_of_the_day_before(scene_log, tmp_path, late_s, code) -> None:
    result = protect_with_old_file(scene_log, tmp_path, 12.0, late_s)
    assert code in {e.code for e in result.outcome.evidence if e.detector == "messages"}
    assert result.verdict.verdict == ("suspect" if late_s else "no_attack_seen")


def test_a_file_of_another_week_is_refused(scene_log, tmp_path) -> None:
    with pytest.raises(InputError, match=r"nav\.rnx"):
        protect_with_old_file(scene_log, tmp_path, 7 * 24.0)
