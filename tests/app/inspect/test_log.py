"""`inspect`, `init` and `fleet` of receivers' logs and observation files."""

import json
from pathlib import Path

import numpy as np
import pytest
from tests.logs.frames import make_ubx_frame
from tests.logs.test_nmea import make_gga
from tests.logs.test_ubx import make_rawx

from skyproof.app.init.run import init
from skyproof.app.inspect.inspection import write_document_json
from skyproof.app.inspect.log import LogInspection, inspect_log
from skyproof.app.inspect.run import inspect
from skyproof.errors import InputError

WEEK = 2300


def make_cell(sv: int) -> tuple:
    """Return a cell of RXM-RAWX of a GPS satellite on L1."""
    return (0, sv, 0, 0, 2.2e7, 1.1e8, 500.0, 64_000, 42, 7)


def make_log(*further: bytes, epochs: int = 90, step_s: float = 1.0) -> bytes:
    epoch = [make_rawx(100.0 + step_s * k, WEEK, [make_cell(sv) for sv in range(1, 7 - k % 2)]) for k in range(epochs)]
    return b"".join([*epoch, *further])


def write_content(tmp_path: Path, content: bytes, name: str = "rover.ubx") -> Path:
    path = tmp_path / name
    path.write_bytes(content)
    return path


def look(path: Path) -> LogInspection:
    (found,) = inspect(path)
    assert isinstance(found, LogInspection)
    return found


def test_a_log_is_counted(tmp_path) -> None:
    log = look(write_content(tmp_path, make_log()))
    assert (log.epochs, log.interval_s, log.gaps, log.duration_s) == (90, 1.0, 0, 89.0)
    assert [(s.system, s.band, s.satellites, s.most_at_once, s.cn0_dbhz) for s in log.signals] == [
        ("G", "L1", 6, 6, 42.0)
    ]
    assert log.messages == {"RXM-RAWX": 90}
    assert [wanted.name for wanted in log.missing] == ["RXM-SFRBX", "MON-RF", "SEC-SIG", "NAV-PVT"]
    assert "CFG-RATE-MEAS = 200" in log.configuration[0]
    assert "--nav" in log.advice


def test_damage_is_counted(tmp_path) -> None:
    content = bytearray(make_log())
    content[30] ^= 0x40
    log = look(write_content(tmp_path, bytes(content[:-3])))
    assert log.damaged_frames == 1
    assert log.cut
    assert log.epochs == 88


def test_gaps_are_intervals_longer_than_two(tmp_path) -> None:
    late = b"".join(make_rawx(300.0 + k, WEEK, [make_cell(5)]) for k in range(5))
    assert look(write_content(tmp_path, make_log(late))).gaps == 1


def test_a_log_without_measurements_says_how_to_get_them(tmp_path) -> None:
    path = write_content(tmp_path, make_ubx_frame(0x27, 0x09, bytes([2, 0b0011_1011, 0, 0])) * 4)
    log = look(path)
    assert log.epochs == 0
    assert "CFG-MSGOUT-UBX_RXM_RAWX_USB = 1" in log.configuration[0]
    with pytest.raises(InputError, match="RXM_RAWX"):
        init([path], out=tmp_path / "platform.toml")


def test_sentences_alone_are_taken_for_their_fixes(tmp_path) -> None:
    found = look(write_content(tmp_path, b"".join(make_gga(f"1200{k:02d}.00") for k in range(30)), "a.nmea"))
    assert (found.epochs, found.fixes, found.ranged) == (30, 30, False)
    assert "ranges" in found.advice
    assert "--nav" not in found.advice


def test_the_document_is_json_of_numbers_that_are_there(tmp_path) -> None:
    document = json.loads(write_document_json(inspect(write_content(tmp_path, make_log()))))
    assert document["format"] == "skyproof-inspect-log/1"
    assert document["receiver"] == {"fixes": 0, "levels": 0, "states": 0, "alarms": 0}
    assert document["missing"][0]["name"] == "RXM-SFRBX"


def test_init_takes_a_log(tmp_path) -> None:
    result = init([write_content(tmp_path, make_log())], out=tmp_path / "platform.toml")
    text = result.path.read_text(encoding="utf-8")
    assert 'inputs = ["rover.ubx"]' in text
    assert "90 epochs" in text
    assert "MON-RF" in text
    assert [receiver.name for receiver in result.platform.receivers] == ["rover"]


@pytest.mark.shared_data
@pytest.mark.parametrize(
    ("file", "epochs", "kinds", "orbits"),
    [
        ("imu-gnss-walk/gnss_1730.ubx", 536, 10, True),
        ("rinex-mosaic-1m/base.obs", 301, 15, False),
        ("osnma-sbf/change_wt5.sbf", 0, 0, True),
    ],
)
def test_real_files_are_what_their_readme_says(shared_data, file, epochs, kinds, orbits) -> None:
    log = inspect_log(shared_data / "real" / file)
    assert (log.epochs, len(log.signals), log.orbits > 0) == (epochs, kinds, orbits)
    assert np.isfinite([s.cn0_dbhz for s in log.signals]).all()
