"""A receiver's log under a jammer, whole: interference since its epoch, the receiver's own words beside, no attack."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest

from skyproof.app.protect.run import protect
from skyproof.cli.summary import print_result
from skyproof.logs.ubx_write import ubx_frame, ubx_log
from skyproof.records import ReceiverFixes
from skyproof.testing import MeasuredScene, TrackErrors

ONSET, EPOCHS = 93, 140
SCENE = MeasuredScene(
    antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=EPOCHS, errors=TrackErrors(sigma_m=0.5), cn0_sigma_db=0.5
)


def make_radio(agc: int, noise: int, state: int) -> bytes:
    """Return MON-RF of one front end."""
    block = struct.pack("<BBBBI4xHHBbBbB3x", 0, state, 2, 1, 0, noise, agc, 40, 0, 100, 0, 100)
    return ubx_frame(0x0A, 0x38, struct.pack("<BB2x", 0, 1) + block)


def make_security(jamming: int) -> bytes:
    """Return SEC-SIG, version 2, with this state of jamming and no spoofing."""
    return ubx_frame(0x27, 0x09, bytes([2, 1 | jamming << 1 | 1 << 4, 0, 0]))


def write_jammed_log(fall_db: float) -> bytes:
    (o,) = SCENE.records(np.random.default_rng(3)).observations
    late = np.arange(EPOCHS) >= ONSET
    weaker_db = np.where(late, fall_db, 0.0)[:, None] + np.linspace(0.0, 8.0, len(o.signals))
    o = replace(o, cn0_dbhz=o.cn0_dbhz + 4.0 - weaker_db)
    fixes = ReceiverFixes.from_geodetic(
        o.gpst, np.full(EPOCHS, np.radians(59.0)), np.full(EPOCHS, np.radians(17.0)), np.full(EPOCHS, 100.0)
    )
    frames = []
    for k, epoch in enumerate(ubx_log(o, SCENE.navigation, fixes)):
        frames += [epoch, make_radio(5000 - (1800 if late[k] else k % 7), 90, 3 if late[k] else 1)]
        frames.append(make_security(2 if late[k] else 1))
    return b"".join(frames)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("jammed")
    (folder / "rover.ubx").write_bytes(write_jammed_log(10.0))
    return protect([folder / "rover.ubx"], out=folder / "out")


def test_a_jammer_is_interference_and_no_attack(result) -> None:
    (spell,) = result.verdict.interference.spells
    (start,) = (r.start_gpst for r in result.verdict.receivers)
    since_s = (np.datetime64(spell.since_gpst) - np.datetime64(start)) / np.timedelta64(1, "s")
    assert result.verdict.verdict == "no_attack_seen"
    assert since_s == pytest.approx(ONSET, abs=1e-3)
    assert spell.until_gpst is None
    assert spell.carriers == ("L1",)
    assert spell.fall_db == pytest.approx(10.0, abs=1.0)
    assert spell.jammer_to_noise_low_db < 10.0 * np.log10(9.0) < spell.jammer_to_noise_high_db
    assert "J/N" in result.verdict.interference.words
    assert spell.signs == ("cn0", "level")
    assert spell.may_also_be == ()


def test_the_receivers_own_words_stand_beside(result) -> None:
    (receiver,) = result.verdict.receivers
    alarms = [(s.subject, s.state) for s in receiver.own_states if s.alarm]
    assert alarms == [("jamming", "critical")]
    assert receiver.own_fix.lat_deg == pytest.approx(59.0, abs=1e-6)
    assert any("jamming critical" in words for _, words in result.verdict.explained)


def test_files_and_terminal_show_both(result, capsys) -> None:
    document = json.loads((result.folder / "verdict.json").read_text(encoding="utf-8"))
    assert document["interference"]["state"] == "present"
    page = (result.folder / "report.html").read_text(encoding="utf-8")
    assert "jamming" in page
    assert "rover receiver" in (result.folder / "tracks.kml").read_text(encoding="utf-8")
    assert "receiver" in {line.split(",")[2] for line in (result.folder / "fixes.csv").read_text().splitlines()}
    print_result(result, as_json=False)
    screen = " ".join(capsys.readouterr().out.split())
    assert "Interference: since" in screen
    assert "jamming critical" in screen
