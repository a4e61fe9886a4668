"""Receivers' logs as inputs: measurements, orbits and the receiver's own words out of one file."""

import numpy as np
import pytest
from tests.logs.frames import make_nmea_sentence
from tests.logs.phone import HEADER, Measured, make_raw_line
from tests.logs.test_nmea import make_gga, make_rmc
from tests.logs.test_rtcm3 import make_simple
from tests.logs.test_ubx import make_gps, make_hardware, make_pvt, make_rawx

from skyproof.app.common.settings import Settings
from skyproof.app.protect import protect
from skyproof.app.receive.inputs import adopt_antenna_multipath, open_inputs
from skyproof.errors import InputError
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.remarks import Remark, RemarkKind

WALK = "real/imu-gnss-walk/gnss_1730.ubx"


def make_epochs(count: int) -> bytes:
    return b"".join(
        make_rawx(100.0 + k, 2300, [make_gps(2000 + 1000 * k)]) + make_hardware(90, 4000, 0, 1) for k in range(count)
    )


def open_log(path, navigation=None):
    (source,) = open_inputs([path], Settings(), navigation)
    return source


@pytest.mark.shared_data
def test_a_real_log_gives_measurements_orbits_and_fixes(shared_data) -> None:
    source = open_log(shared_data / WALK)
    assert source.observations.gpst.size == 536
    assert {e.sat[0] for e in source.decoded.ephemerides} == set("GEC")
    assert source.own.fixes.gpst.size == 536
    assert not any(Remark.kind_of(remark) is RemarkKind.CUT for remark in source.remarks)


def test_a_log_is_known_by_its_content(tmp_path) -> None:
    path = tmp_path / "noted.bin"
    path.write_bytes(b"started\r\n" + make_epochs(5) + make_pvt(104_000, (2024, 2, 4)))
    source = open_log(path)
    assert source.observations.gpst.size == 5
    assert source.own.levels.gpst.size == 5
    assert source.own.fixes.gpst.size == 1


def test_a_cut_log_says_so_and_damage_is_counted(tmp_path) -> None:
    path = tmp_path / "a.ubx"
    octets = bytearray(make_epochs(6))
    octets[40] ^= 0xFF
    path.write_bytes(octets[:-7])
    kinds = [Remark.kind_of(remark) for remark in open_log(path).remarks]
    assert RemarkKind.CUT in kinds
    assert RemarkKind.BEARS in kinds


def test_impossible_cells_of_a_log_are_left_out(tmp_path) -> None:
    path = tmp_path / "a.ubx"
    cycles = (0, 6, 0, 0, 1.1e8, 1.1e8, -500.0, 9000, 44, 7)
    path.write_bytes(b"".join(make_rawx(100.0 + k, 2300, [make_gps(9000), cycles]) for k in range(4)))
    o = open_log(path).observations.read(0, 4)
    column = [signal.sat for signal in o.signals].index("G06")
    assert np.isnan(o.pseudorange_m[:, column]).all()
    assert np.isfinite(o.pseudorange_m[:, 1 - column]).all()


def test_a_log_without_measurements_says_what_to_log(tmp_path) -> None:
    path = tmp_path / "a.ubx"
    path.write_bytes(make_pvt(104_000, (2024, 2, 4)) * 9)
    with pytest.raises(InputError, match="UBX-RXM-RAWX"):
        open_log(path)


def test_a_phones_text_is_a_log_with_the_multipath_of_phones(tmp_path) -> None:
    path = tmp_path / "a.txt"
    path.write_text(HEADER + "".join(make_raw_line(Measured().at(k)) for k in range(4)))
    source = open_log(path)
    assert source.observations.gpst.size == 4
    assert adopt_antenna_multipath(Settings(), [source]).multipath_sigma_m == 15.0
    assert adopt_antenna_multipath(Settings(multipath_sigma_m=2.0), [source]).multipath_sigma_m == 2.0
    walk = tmp_path / "a.ubx"
    walk.write_bytes(make_epochs(5))
    assert adopt_antenna_multipath(Settings(), [open_log(walk)]).multipath_sigma_m == 1.0


def test_a_phones_text_without_measurements_says_so(tmp_path) -> None:
    path = tmp_path / "a.txt"
    path.write_text(HEADER)
    with pytest.raises(InputError, match="Raw"):
        open_inputs([path], Settings())


PHONES = "real/phone-orientation"


@pytest.mark.shared_data
@pytest.mark.parametrize("name", ["gnss_log_2019_12_12_11_07_38.txt", "gnss_log_2019_12_12_11_25_30.txt"])
def test_real_phones_under_the_sky_are_no_attack(shared_data, name) -> None:
    folder = shared_data / PHONES
    verdict = protect([folder / name], nav=folder / "hour3460.19n").verdict
    assert verdict.verdict == "no_attack_seen"


@pytest.mark.shared_data
def test_a_phone_without_orbits_asks_for_a_navigation_file(shared_data) -> None:
    with pytest.raises(InputError, match="--nav"):
        protect([shared_data / PHONES / "gnss_log_2019_12_12_11_07_38.txt"])


def test_a_log_without_a_week_asks_for_orbits(tmp_path) -> None:
    path = tmp_path / "a.rtcm3"
    path.write_bytes(b"".join(make_simple(1000 * k) for k in range(5)))
    with pytest.raises(InputError, match=r"\bweek.*--nav"):
        open_log(path)


def test_orbits_beside_a_log_say_its_week(tmp_path) -> None:
    path = tmp_path / "a.rtcm3"
    path.write_bytes(b"".join(make_simple(602_000_000 + 1000 * k) for k in range(5)))
    navigation = make_nominal_constellation(np.datetime64("2022-01-01T22:00:00", "ns"))
    assert open_log(path, navigation).start_gpst == np.datetime64("2022-01-01T23:13:20", "ns")


def test_another_protocol_in_the_log_says_its_week(tmp_path) -> None:
    path = tmp_path / "a.log"
    path.write_bytes(b"".join(make_simple(100_000 + 1000 * k) for k in range(5)) + make_pvt(104_000, (2024, 2, 4)))
    assert open_log(path).start_gpst == np.datetime64("2024-02-04T00:01:40", "ns")


def write_sentences(count: int, *, jump_from: int = 10**6) -> bytes:
    """Write sentences of a receiver that stands, or whose place jumps by 5 minutes of arc to the north."""
    return b"".join(
        make_rmc(f"1200{k:02d}.00", "050224")
        + make_gga(f"1200{k:02d}.00", lat="4735.0000000" if k >= jump_from else "4730.0000000")
        + make_nmea_sentence("GPGSV,1,1,02,05,40,083,46,09,10,100,33")
        for k in range(count)
    )


def test_sentences_alone_are_no_attack_seen_and_name_the_lack(tmp_path) -> None:
    path = tmp_path / "a.nmea"
    path.write_bytes(write_sentences(40))
    verdict = protect([path], out=tmp_path / "out").verdict
    assert verdict.verdict == "no_attack_seen"
    assert any("no ranges" in words for words in verdict.not_excluded)
    assert verdict.remedy is not None
    assert "ranges" in verdict.remedy


def test_sentences_that_jump_by_kilometres_are_suspect(tmp_path) -> None:
    path = tmp_path / "a.nmea"
    path.write_bytes(write_sentences(40, jump_from=25))
    verdict = protect([path]).verdict
    assert verdict.verdict == "suspect"
    assert verdict.since_gpst.startswith("2024-02-05T12:00:43")  # UTC and 18 s
    assert verdict.may_also_be == ("fault",)


def test_sentences_without_a_date_or_signals_run_as_well(tmp_path) -> None:
    path = tmp_path / "a.nmea"
    path.write_bytes(b"".join(make_gga(f"1200{k:02d}.00") for k in range(20)))
    result = protect([path])
    assert result.verdict.verdict == "no_attack_seen"
    assert any("date" in remark for remark in result.verdict.inputs[0].remarks)


@pytest.mark.shared_data
@pytest.mark.parametrize("name", ["spoof_init_-0.5chips.DAT", "spoof_init_-4.0chips_0.5v_prn8.DAT"])
def test_a_real_log_of_sentences_is_no_attack_seen(shared_data, name) -> None:
    assert protect([shared_data / "real/nmea-pulled" / name]).verdict.verdict == "no_attack_seen"


@pytest.mark.shared_data
def test_a_real_stream_of_rtcm_is_no_attack_seen(shared_data) -> None:
    assert protect([shared_data / "real/streams/testglo.rtcm3"]).verdict.verdict == "no_attack_seen"
