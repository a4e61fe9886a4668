"""The same samples through independent receivers, signal by signal: `make interop`, or `python interop/run.py FILE...`.

Two recordings: the rendered pair's rx1.bin if the folder of recordings ($SKYPROOF_DATA) is there, or those that are
named; and a clean sky that skyproof simulates, where the truth is known. Then two receivers at once, the rendered pair
and one that skyproof simulates: RTKLIB fixes the baseline between their RINEX files. What is not installed is reported
and skipped.
"""

import json
import os
import resource
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import compare
import gnss_sdr
import numpy as np
import readers
from tracks import Tracks, read_tracks

from skyproof.app.receive import receive
from skyproof.app.receive.time_tag import select_first_copies
from skyproof.formats.raw import open_raw
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.fix import fix
from skyproof.simulator import FrontEnd, Scenario, ScenePlace, make_clean, make_scene, write

PEERS = (gnss_sdr,)  # a peer is a module with NAME, CURE, find() and receive(samples, folder)

PLACE = ScenePlace(lat_deg=47.38, lon_deg=8.54, height_m=450.0)
# Two seconds before subframe 1 of the frame whose subframe 4 is page 18: gnss-sdr writes no RINEX before it has the
# ionosphere.
START_GPST = np.datetime64("2024-05-14T10:03:28", "ns")
DURATION_S = 60.0


@dataclass(frozen=True, eq=False)
class Case:
    """A recording, and what is known of it from elsewhere than a receiver."""

    title: str
    path: Path
    truth: Tracks | None
    place_ecef_m: np.ndarray | None


@dataclass(frozen=True, eq=False)
class Pair:
    """Recordings of a base and a rover, and where they stood, (2, 3)."""

    name: str
    title: str
    paths: tuple[Path, Path]
    places_ecef_m: np.ndarray


def main(named: list[str]) -> None:
    for peer in PEERS:
        if not peer.find():
            print(f"skipped: {peer.NAME} not found; {peer.CURE}")
    for found, name, cure in (
        (readers.rtklib_found(), "rnx2rtkp (RTKLIB)", "on Debian: apt-get install rtklib"),
        (readers.georinex_found(), "georinex", "pip install georinex"),
    ):
        if not found:
            print(f"skipped: {name} not found; {cure}")
    if not (any(peer.find() for peer in PEERS) or readers.rtklib_found() or readers.georinex_found()):
        return
    with tempfile.TemporaryDirectory(prefix="skyproof-interop-") as folder:
        cases = (*_recorded(named), _simulated(Path(folder) / "simulated"))
        for number, case in enumerate(cases):
            for line in _report(case, Path(folder) / f"received-{number}"):
                print(line, flush=True)
        for pair in (*_recorded_pair(named), _simulated_pair(Path(folder) / "pair")):
            for line in _baselines(pair, Path(folder) / f"received-{pair.name}"):
                print(line, flush=True)


def _rendered(name: str) -> Path:
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    return Path(os.environ.get("SKYPROOF_DATA", beside)) / "rf" / "meaconing-pair" / name


def _recorded(named: list[str]) -> Iterator[Case]:
    for path in [Path(name) for name in named] or [_rendered("rx1.bin")]:
        if path.is_file():
            yield Case(str(path.name), path, None, _stated_place(path))
        else:
            print(f"skipped: no recording at {path}; give one, or set SKYPROOF_DATA to the folder of recordings")


def _stated_place(path: Path) -> np.ndarray | None:
    """Where the receiver stood, if a truth.json beside the recording says so."""
    truth = path.with_name("truth.json")
    if not truth.is_file():
        return None
    for receiver in json.loads(truth.read_text(encoding="utf-8"))["receivers"]:
        if receiver["name"] == path.stem:
            place = receiver["position"]
            height_m = place.get("h_m", place.get("height_m"))
            return ecef_from_geodetic(np.radians(place["lat_deg"]), np.radians(place["lon_deg"]), height_m)
    return None


def _simulated(folder: Path) -> Case:
    front_end = FrontEnd(rate_hz=2.6e6, encoding="sign-magnitude", bits=2)
    scenario = make_clean(PLACE, START_GPST, receivers=1, duration_s=DURATION_S, front_end=front_end, seed=11)
    (path,) = write(scenario, make_nominal_constellation(START_GPST), folder)
    return Case("a clean sky that skyproof simulates", path, _truth(scenario), ecef_from_geodetic(*PLACE.geodetic_rad))


def _recorded_pair(named: list[str]) -> Iterator[Pair]:
    base, rover = _rendered("rx1.bin"), _rendered("rx2.bin")
    if not named and base.is_file() and rover.is_file():
        yield Pair(
            "rendered", "rx1.bin and rx2.bin", (base, rover), np.stack([_stated_place(base), _stated_place(rover)])
        )


def _simulated_pair(folder: Path) -> Pair:
    front_end = FrontEnd(rate_hz=2.6e6, encoding="sign-magnitude", bits=2)
    scenario = make_clean(PLACE, START_GPST, receivers=2, duration_s=DURATION_S, front_end=front_end, seed=12)
    base, rover = write(scenario, make_nominal_constellation(START_GPST), folder)
    places = [ecef_from_geodetic(*receiver.geodetic_rad) for receiver in scenario.receivers]
    return Pair("simulated", "two receivers that skyproof simulates", (base, rover), np.stack(places))


def _baselines(pair: Pair, folder: Path) -> Iterator[str]:
    """How often RTKLIB finds the whole cycles of the carrier between two receivers, and how far it is from the truth
    then. Half a cycle that is open or wrong is never whole: one such satellite leaves nothing fixed."""
    yield ""
    yield f"{pair.title}, {np.linalg.norm(np.diff(pair.places_ecef_m, axis=0)):.1f} m apart, copies a"
    if not readers.rtklib_found():
        return
    result = receive(pair.paths, out=folder)
    base, rover = (folder / f"{reception.samples.name}.obs" for reception in result.receptions)
    navigation = next(folder.glob("*.rnx"))
    for mode in readers.BASELINE_MODES:
        positions_m, fixed = readers.rtklib_baseline(rover, base, navigation, pair.places_ecef_m[0], mode)
        off_m = np.linalg.norm(positions_m - pair.places_ecef_m[1], axis=-1)[fixed]
        yield (
            f"    RTKLIB, {mode}: {fixed.sum()} of {fixed.size} epochs fixed ({fixed.mean():.1%}), the rover then "
            f"{1e3 * np.median(off_m) if fixed.any() else np.nan:.1f} mm off in the median, "
            f"{1e3 * off_m.max(initial=0.0):.1f} mm at most"
        )


def _truth(scenario: Scenario) -> Tracks:
    """What a receiver without noise and with a perfect clock would have measured."""
    sky = make_scene(scenario, make_nominal_constellation(scenario.start_gpst)).skies[0]
    true_s = np.arange(0.2, scenario.duration_s, 0.2)
    carrier_s = sky.carrier_delay_s(true_s)
    return Tracks(
        name="truth",
        signals=tuple(heard.id.sat + heard.id.copy for heard in sky.signals),
        label_s=week_and_tow(scenario.start_gpst)[1] + true_s,
        pseudorange_m=SPEED_OF_LIGHT_M_S * sky.code_delay_s(true_s),
        carrier_cyc=L1_HZ * carrier_s,
        doppler_hz=-L1_HZ * sky.carrier_delay_rate(true_s),
        cn0_dbhz=sky.cn0_dbhz(true_s),
    )


def _report(case: Case, folder: Path) -> Iterator[str]:
    samples = open_raw(case.path)
    yield ""
    yield f"{case.title}: {samples.duration_s:.0f} s at {samples.rate_hz / 1e6:g} Msps, {samples.format}"
    before = resource.getrusage(resource.RUSAGE_SELF)
    reception = receive(case.path, out=folder / "ours").receptions[0]
    after = resource.getrusage(resource.RUSAGE_SELF)
    if reception.observations is None:
        yield f"  skyproof: {reception.left_out}"
        return
    files = sorted((folder / "ours").glob("*.obs"), key=lambda path: (len(path.name), path.name))
    navigation = next((folder / "ours").glob("*.rnx"), None)
    ours = read_tracks(files, "skyproof")
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    yield f"  skyproof: {len(ours.signals)} signals, {cpu_s:.1f} s of CPU"
    fixed = fix(reception.observations, reception.decoded, signals=select_first_copies(reception.observations))
    place_m = case.place_ecef_m if case.place_ecef_m is not None else np.nanmedian(fixed.position_ecef_m, axis=0)
    yield _offset("skyproof's own position of the copies a", fixed.position_ecef_m, place_m)
    for file in files:
        yield from _read_elsewhere("skyproof", file, navigation, place_m)
    if case.truth is not None:
        yield from _table("skyproof - truth", compare.compare(case.truth, ours), case.truth)
    for peer in (peer for peer in PEERS if peer.find()):
        try:
            received = peer.receive(samples, folder / peer.NAME)
        except (RuntimeError, ValueError) as error:
            yield f"  {peer.NAME}: skipped: {error}"
            continue
        yield f"  {peer.NAME}: {len(received.sats)} satellites tracked, {received.cpu_s:.1f} s of CPU"
        if received.observations is None:
            yield "    it wrote no observations: it found no position"
            continue
        theirs = read_tracks([received.observations], peer.NAME)
        yield _offset(f"{peer.NAME}'s own position", received.positions_ecef_m, place_m)
        yield from _read_elsewhere(peer.NAME, received.observations, received.navigation, place_m)
        yield from _table(f"{peer.NAME} - skyproof", compare.compare(ours, theirs), ours)
        if case.truth is not None:
            yield from _table(f"{peer.NAME} - truth", compare.compare(case.truth, theirs), case.truth)


def _table(title: str, rows: list[compare.Row], reference: Tracks) -> Iterator[str]:
    yield f"  {title}, where both measured"
    if not rows:
        yield "    no two satellites agree on what the clocks differ by: nothing can be compared"
        return
    yield compare.header(reference.name)
    yield from compare.text(rows)
    heard = {row.signal for row in rows if row.on}
    sats = sorted({signal[:3] for signal in reference.signals})
    yield f"    only with {reference.name}: {' '.join(sat for sat in sats if sat not in heard) or 'none'}"
    on = [row.on[0][0][3:] for row in rows if row.on]
    if len({signal[3:] for signal in reference.signals}) > 1:
        yield "    locked on: " + ", ".join(f"copy {copy} of {on.count(copy)} satellites" for copy in sorted(set(on)))


def _read_elsewhere(who: str, observations: Path, navigation: Path | None, place_m: np.ndarray) -> Iterator[str]:
    if readers.rtklib_found() and navigation is not None:
        positions_m = readers.rtklib_positions_ecef_m(observations, navigation)
        yield _offset(f"RTKLIB's position from {who}'s {observations.name}", positions_m, place_m)
    if readers.georinex_found():
        epochs, sats, ranges = readers.georinex_counts(observations)
        track = read_tracks([observations], who)
        reported = track.label_s.size, len(track.signals), int(np.isfinite(track.pseudorange_m).sum())
        same = "as we do" if (epochs, sats, ranges) == reported else f"but we read {reported}"
        yield f"    georinex reads {observations.name}: {epochs} epochs, {sats} satellites, {ranges} ranges, {same}"


def _offset(what: str, positions_ecef_m: np.ndarray, place_m: np.ndarray) -> str:
    """East, north, up of the median and the spread of single epochs, metres."""
    there = positions_ecef_m[np.isfinite(positions_ecef_m).all(axis=-1)]
    if there.size == 0:
        return f"    {what}: none"
    lat_rad, lon_rad, _ = geodetic_from_ecef(place_m)
    enu_m = (there - place_m) @ rot_enu_ecef(lat_rad, lon_rad).T
    bias, spread = np.median(enu_m, axis=0), 1.4826 * np.median(np.abs(enu_m - np.median(enu_m, axis=0)), axis=0)
    figures = ", ".join(f"{b:+.2f} ± {s:.2f}" for b, s in zip(bias, spread, strict=True))
    return f"    {what}: east, north, up {figures} m off, {len(there)} epochs"


if __name__ == "__main__":
    main(sys.argv[1:])
