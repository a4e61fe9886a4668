"""Files of real receivers through `protect`: nothing false is said of a clean sky, and a capture is found."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from tests.app.protect.captured import capture_receiver

from skyproof.app.protect import ProtectResult, protect
from skyproof.formats.rinex_nav import get_glonass_channels, read_nav
from skyproof.formats.rinex_obs import write_obs
from skyproof.formats.rinex_obs_read import read_obs
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.time import format_iso

pytestmark = [pytest.mark.shared_data, pytest.mark.long]


@dataclass(frozen=True)
class Pair:
    """Two files of a folder, their orbits, what the equipment page asks to give, and what is said of the clean sky.

    truth : of the first antenna, ECEF, where it is surveyed; within_m : of a trusted position, horizontally.
    """

    folder: str
    files: tuple[str, str]
    nav: str
    given: dict[str, object]
    says: str
    truth: tuple[float, float, float] | None = None
    within_m: float = np.inf
    more: dict[str, object] = field(default_factory=dict)


PAIRS = {
    "1 m": Pair("rinex-mosaic-1m", ("base.obs", "rover.obs"), "base.nav", {"antenna_distance_m": 0.99}, "authentic"),
    "1 m, places": Pair(
        "rinex-mosaic-1m",
        ("base.obs", "rover.obs"),
        "base.nav",
        {"antennas_enu_m": {"base": (0.0, 0.0, 0.0), "rover": (-0.223, -0.965, 0.010)}, "antennas_sigma_m": 0.01},
        "authentic",
    ),
    "5 km, rover at rest": Pair(
        "rinex-mosaic-5km",
        ("3034265G.21O", "SEPT265G.21O"),
        "SEPT2650.21P",
        {"antenna_distance_m": 5324.0},
        "authentic",
        truth=(-3959400.631, 3385704.533, 3667523.111),
        within_m=5.0,
        more={"duration_s": 38.0},
    ),
    "5 km, rover moves": Pair(
        "rinex-mosaic-5km",
        ("3034265G.21O", "SEPT265G.21O"),
        "SEPT2650.21P",
        {"antenna_distance_m": 5324.0},
        "suspect",
        truth=(-3959400.631, 3385704.533, 3667523.111),
        within_m=5.0,
    ),
    "3 km": Pair(
        "rinex-gsi-3km",
        ("07590920.05o", "30400920.05o"),
        "07590920.05n",
        {"antenna_distance_m": 3335.4},
        "authentic",
        truth=(-3976219.508, 3382372.567, 3652512.985),
        within_m=5.0,
    ),
}


def list_paths(pair: Pair, shared_data: Path) -> tuple[list[Path], Path]:
    folder = shared_data / "real" / pair.folder
    return [folder / name for name in pair.files], folder / pair.nav


def measure_horizontal_error_m(result: ProtectResult, receiver: int, truth: tuple[float, float, float]) -> float:
    fix = result.outcome.receivers[receiver].trusted
    assert fix is not None
    lat, lon, _ = geodetic_from_ecef(np.array(truth))
    enu = (fix.position_ecef_m[fix.status == 0] - np.array(truth)) @ rot_enu_ecef(lat, lon).T
    return float(np.hypot(enu[:, 0], enu[:, 1]).max())


@pytest.mark.parametrize("name", PAIRS)
def test_nothing_false_is_said_of_a_real_clean_sky(shared_data, name):
    pair = PAIRS[name]
    paths, nav = list_paths(pair, shared_data)
    result = protect(paths, nav=nav, **pair.given, **pair.more)
    false = [e for e in result.outcome.evidence if e.says in ("spoofed", "attack", "multipath")]
    assert not false, [(str(e.start_gpst), e.detector, e.code) for e in false]
    assert not {s.label for s in result.verdict.signals} & {"spoofed", "multipath"}
    assert result.verdict.verdict == pair.says, result.verdict.summary
    assert [m.ran for m in result.verdict.methods if m.detector == "multi_receiver"] == [True]
    if pair.truth is not None:
        assert measure_horizontal_error_m(result, 0, pair.truth) < pair.within_m


@pytest.mark.parametrize("name", PAIRS)
def test_nothing_false_is_said_where_nothing_is_given(shared_data, name):
    pair = PAIRS[name]
    paths, nav = list_paths(pair, shared_data)
    result = protect(paths, nav=nav, **pair.more)
    assert not [e.code for e in result.outcome.evidence if e.says in ("spoofed", "attack", "multipath")]
    far = "km" in name  # than antennas may be that nothing is said of
    assert result.verdict.verdict == ("suspect" if far else "no_attack_seen")
    assert (result.verdict.may_also_be[:1] == ("statement",)) == far


def protect_captured(pair, shared_data, folder):
    """Run the command on a pair whose second receiver reports the first's measurements from its middle on. Return what
    is written of the second, and the first's.
    """
    paths, nav = list_paths(pair, shared_data)
    navigation = read_nav(nav)
    base, rover = (read_obs(path, glonass_channels=get_glonass_channels(navigation)).observations for path in paths)
    middle = rover.gpst.size // 2 if not pair.more else 20
    rover = capture_receiver(rover, base, middle, rng=np.random.default_rng(1))
    signals = tuple(s for s in rover.signals if s.sat[0] in "GECRJ")
    path = folder / f"{paths[1].stem}.obs"
    write_obs(path, rover, signals=signals, holds="captured", marker="rover", version="test")
    return protect([paths[0], path], nav=nav, **pair.given, **pair.more), base, rover, signals, middle


def test_a_captured_receiver_of_few_satellites_is_open_since(shared_data, tmp_path):
    # Seven to nine satellites whose ranges are as of one antenna: echoes in place of blocked signals may be so.
    result, _, rover, _, middle = protect_captured(PAIRS["3 km"], shared_data, tmp_path)
    assert result.verdict.verdict == "suspect"
    since = format_iso(rover.gpst[middle], 6)
    assert not [s for s in result.verdict.signals if s.label == "authentic" and s.to_gpst > since]
    assert [e for e in result.outcome.evidence if e.code in ("one_antenna_or_few_echoes", "elsewhere_by_few")]


@pytest.mark.parametrize("name", ["1 m, places", "5 km, rover at rest", "5 km, rover moves"])
def test_a_captured_receiver_is_spoofed_since_with_its_signals(shared_data, tmp_path, name):
    result, base, rover, signals, middle = protect_captured(PAIRS[name], shared_data, tmp_path)
    verdict = result.verdict
    since = rover.gpst[middle]
    assert verdict.verdict == "spoofed", verdict.summary
    window = np.timedelta64(round(2e9 * float(verdict.settings["window_s"])), "ns")
    assert verdict.since_latest_gpst is not None
    assert abs(np.datetime64(verdict.since_latest_gpst, "ns") - since) <= window
    compared = {s for s in signals if s in base.signals}
    for s in verdict.signals:
        if s.label == "authentic":
            assert s.to_gpst <= format_iso(since + window // 2, 6), (s.receiver, s.sat, s.to_gpst)
        if s.label == "spoofed":
            assert (s.sat, s.band, s.code) in {c.transmission for c in compared}
            assert s.from_gpst >= format_iso(since - window // 2, 6), (s.receiver, s.sat, s.from_gpst)
    present = np.isfinite(rover.pseudorange_m[middle:]).mean(axis=0) > 0.9
    compared = {s for s, whole in zip(rover.signals, present, strict=True) if whole and s in compared}
    named = {(s.receiver, s.sat, s.band, s.code) for s in verdict.signals if s.label == "spoofed"}
    assert {sat for _, sat, band, _ in named if band == "L1"} >= {
        s.sat for s in compared if s.kind == ("G", "L1", "CA")
    }
