"""Messages that a log lacks and that would help, with what turns them on; keys as pyubx2 and pysbf2 know them."""

import re

import pytest
from pysbf2.sbftypes_core import SBF_MSGIDS
from pyubx2.ubxtypes_configdb import UBX_CONFIG_DATABASE
from pyubx2.ubxtypes_core import UBX_MSGIDS

from skyproof.logs.wanted import configure, missing_messages, protocol_of

BARE = {"NAV-SAT": 3, "NMEA GGA": 3}


def test_what_stands_under_another_name_is_not_missing() -> None:
    assert [m.name for m in missing_messages({"RXM-RAW": 1, "RXM-SFRB": 1, "MON-HW": 1})] == ["SEC-SIG", "NAV-PVT"]
    assert missing_messages({"NMEA GGA": 4, "RTCM 1077": 2}) == ()


def test_every_name_is_one_of_its_protocol() -> None:
    ubx, sbf = set(UBX_MSGIDS.values()), {name for name, *_ in SBF_MSGIDS.values()}
    for wanted in (*missing_messages({"0x0A31": 1}), *missing_messages({"SBF 4000": 1})):
        names = {wanted.name, *wanted.also}
        assert names <= (ubx if wanted.protocol == "UBX" else sbf)


@pytest.mark.parametrize(("interval_s", "rate"), [(1.0, True), (None, True), (0.25, True), (0.2, False), (0.05, False)])
def test_the_keys_are_those_of_the_receiver(interval_s, rate) -> None:
    (line,) = configure(missing_messages(BARE), interval_s)
    keys = re.findall(r"(CFG-[A-Z_-]+) =", line)
    assert all(key.replace("-", "_") in UBX_CONFIG_DATABASE for key in keys)
    assert len(keys) == 5 + rate
    assert ("CFG-RATE-MEAS = 200" in line) == rate


def test_blocks_of_septentrio_are_one_command() -> None:
    (line,) = configure(missing_messages({"MeasEpoch": 9, "GPSRawCA": 1}), 1.0)
    assert line.startswith("setSBFOutput, ")
    assert "GALRawINAV+ReceiverStatus+RFStatus+PVTGeodetic" in line


def test_a_name_tells_its_protocol() -> None:
    names = ("RXM-RAWX", "0x0A31", "MeasEpoch", "SBF 4000", "RTCM 1077", "NMEA GGA", "GnssLogger Raw")
    assert [protocol_of(name) for name in names] == ["UBX", "UBX", "SBF", "SBF", "RTCM", "NMEA", "GnssLogger"]
