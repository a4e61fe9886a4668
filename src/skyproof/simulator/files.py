"""Write a scene to disk: samples of each antenna, series of the truth, inertial readings, and truth.json.

    NAME.sigmf-meta, NAME.sigmf-data    samples that SigMF can hold: whole numbers of 8 and 16 bits, floats
    NAME.bin, NAME.toml                 any samples, with the sidecar of `skyproof.formats.raw`
    SCENE.sigmf-collection              the recordings of a scene, where SigMF holds several
    RECEIVER-truth.csv, .parquet        `skyproof.simulator.truth.compute_trajectory_truth`
    NAME-signals.csv, .parquet          `skyproof.simulator.truth.compute_signal_truth`
    RECEIVER-imu.csv, .parquet          `skyproof.simulator.truth.iterate_imu_blocks`
    truth.json                          `skyproof.simulator.truth_document.build_truth`

NAME is the receiver's, and with several antennas RECEIVER.ANTENNA. Every file appears when it is whole. Memory does not
grow with the duration.
"""

import hashlib
import json
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import closing
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Floats
from skyproof.compiled import compiled
from skyproof.errors import OutputError, SettingsError
from skyproof.formats.atomic_write import write_lines, write_whole
from skyproof.formats.raw import SampleLayout, write_sidecar_text
from skyproof.formats.sigmf_write import (
    fits_sigmf,
    make_annotation,
    make_geolocation,
    write_collection_json,
    write_recording_json,
)
from skyproof.formats.tables import open_growing_tables
from skyproof.gnss.ephemeris import NavigationData
from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.gnss.time import format_iso
from skyproof.simulator.inertial import ImuReadings
from skyproof.simulator.received import ReceiverSky, Scene
from skyproof.simulator.samples import BLOCK, Rendering, map_ahead, prepare_rendering, render_quantised, round_start
from skyproof.simulator.scenario import FrontEnd, Scenario
from skyproof.simulator.sky import make_scene
from skyproof.simulator.truth import (
    SIGNALS_HZ,
    TRAJECTORY_HZ,
    Table,
    convert_to_gpst,
    iterate_imu_blocks,
    iterate_signal_blocks,
    iterate_trajectory_blocks,
    simulate_imus,
)
from skyproof.simulator.truth_document import SourceWindow, build_truth, list_interference, list_windows

__all__ = [
    "Container",
    "choose_container",
    "count_sample_octets",
    "estimate_series_octets",
    "list_sample_names",
    "list_series_names",
    "write",
    "write_samples",
    "write_series",
    "write_truth",
]

Container = Literal["sigmf", "raw"]
Report = Callable[[int, int], None]
"""Called with what is done and what is to do in all."""

_ENDINGS: Final = {"sigmf": (".sigmf-data", ".sigmf-meta"), "raw": (".bin", ".toml")}
"""Of the samples, and of what states how to read them."""
_TABLES: Final = (".csv", ".parquet")
_ROW_OCTETS: Final = {"truth": 600, "signals": 330, "imu": 290}
"""In both kinds of table together, at most; measured."""


def write(
    scenario: Scenario,
    navigation: NavigationData,
    folder: Path,
    *,
    container: Container = "raw",
    progress: Report | None = None,
) -> list[Path]:
    """Render a scene into `folder`, which is made if need be: samples and truth.json.

    Parameters
    ----------
    progress : called with the samples done and the samples of all antennas together.

    Returns
    -------
    list of Path : the recording of each antenna, NAME.bin or NAME.sigmf-meta.

    Raises
    ------
    ScenarioError : as `make_scene`.
    SettingsError : SigMF cannot hold such samples.
    OutputError : the folder or a file cannot be written.
    """
    scene = make_scene(scenario, navigation)
    container = choose_container(scenario.front_end, container)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{error.filename or folder}: cannot be written ({error.strerror or error}); give a folder that can"
        ) from error
    write_truth(folder, build_truth(scene, files=list_sample_names(scene, container)))
    return write_samples(scene, folder, container, progress=progress)


# --- samples


def choose_container(front_end: FrontEnd, wanted: Container | None = None) -> Container:
    """Choose the container asked for, or one that fits: SigMF if it can hold such samples.

    Raises SettingsError if it cannot.
    """
    fits = fits_sigmf(front_end.encoding, front_end.bits)
    if wanted == "sigmf" and not fits:
        raise SettingsError(
            f"SigMF has no data type for samples of front_end.encoding {front_end.encoding!r} with {front_end.bits} "
            'bit; ask for raw, or set encoding = "int" and bits = 8 in the table front_end'
        )
    return wanted or ("sigmf" if fits else "raw")


def list_sample_names(scene: Scene, container: Container) -> list[str]:
    """List the files of `write_samples`, in its order."""
    names = [f"{sky.name}{ending}" for sky in scene.skies for ending in _ENDINGS[container]]
    return names + ([_name_collection(scene)] if _is_collection(scene, container) else [])


def count_sample_octets(scenario: Scenario) -> int:
    """Count the bytes of all samples."""
    front_end = scenario.front_end
    bits = front_end.bits * (2 if front_end.kind == "complex" else 1)
    n_antennas = sum(len(receiver.antennas) for receiver in scenario.receivers)
    return n_antennas * int(scenario.duration_s * front_end.rate_hz) * bits // 8


def write_samples(scene: Scene, folder: Path, container: Container, *, progress: Report | None = None) -> list[Path]:
    """Render every antenna; what states how to read the samples is written after them."""
    renderings = [prepare_rendering(scene, index) for index in range(len(scene.skies))]
    data_ending, meta_ending = _ENDINGS[container]
    total, done = sum(rendering.n_samples for rendering in renderings), 0
    metas: dict[str, bytes] = {}
    for rendering in renderings:
        name, digest = rendering.sky.name, hashlib.sha512()
        with write_whole(folder / f"{name}{data_ending}") as file, closing(_pack_blocks(rendering)) as blocks:
            for octets, count in blocks:
                file.write(octets)
                if container == "sigmf":
                    digest.update(octets)
                done += count
                if progress is not None:
                    progress(done, total)
        if container == "raw":
            text = write_sidecar_text(_make_layout(scene, rendering))
        else:
            text = _write_sigmf_text(scene, rendering, digest.hexdigest())
            metas[name] = text.encode()
        write_lines(folder / f"{name}{meta_ending}", [text], end="", encoding="utf-8")
    if _is_collection(scene, container):
        text = write_collection_json(metas, description=_describe(scene))
        write_lines(folder / _name_collection(scene), [text], end="", encoding="utf-8")
    return [folder / f"{sky.name}{data_ending if container == 'raw' else meta_ending}" for sky in scene.skies]


def _is_collection(scene: Scene, container: Container) -> bool:
    return container == "sigmf" and len(scene.skies) > 1


def _name_collection(scene: Scene) -> str:
    return f"{scene.scenario.name}.sigmf-collection"


def _describe(scene: Scene) -> str:
    return scene.scenario.description or f"scene {scene.scenario.name}, simulated"


def _make_layout(scene: Scene, rendering: Rendering) -> SampleLayout:
    front_end, antenna = rendering.front_end, rendering.sky.antenna.name
    return SampleLayout.model_validate(
        {
            "rate_hz": front_end.rate_hz,
            "centre_hz": rendering.sky.signal.carrier_hz,
            "if_hz": front_end.if_hz,
            "kind": front_end.kind,
            "encoding": front_end.encoding,
            "bits": front_end.bits,
            "bit_order": "msb-first",
            "start_gpst": format_iso(round_start(scene, rendering.sky), 0),
        }
        | ({} if antenna == "1" else {"antenna": antenna})
    )


def _write_sigmf_text(scene: Scene, rendering: Rendering, sha512: str) -> str:
    sky, scenario = rendering.sky, scene.scenario
    start_s = sky.receiver.start_offset_s
    lat_rad, lon_rad, height_m = geodetic_from_ecef(sky.point(np.array([start_s])).position_ecef_m[0])
    place = make_geolocation(
        round(float(np.degrees(lat_rad)), 9), round(float(np.degrees(lon_rad)), 9), round(float(height_m), 4)
    )
    received = [window for name in scenario.attack_names for window in list_windows(sky, name)]
    comments = ("false signals", "interference")
    annotations = [
        _annotate(scene, rendering, window, comment)
        for comment, windows in zip(comments, (received, list_interference(scene, sky)), strict=True)
        for window in windows
    ]
    of_several = len(scene.skies) > 1
    moves = sky.receiver.path is not None or sky.antenna.spin is not None
    return write_recording_json(
        _make_layout(scene, rendering),
        sha512=sha512,
        place=place,
        moves=moves,
        description=f"{_describe(scene)}; receiver {sky.receiver.name}, antenna {sky.antenna.name}",
        recorder=f"skyproof {version('skyproof')} simulate",
        hw="simulated: no hardware",
        annotations=[annotation for annotation in annotations if annotation is not None],
        collection=_name_collection(scene).removesuffix(".sigmf-collection") if of_several else None,
    )


def _annotate(scene: Scene, rendering: Rendering, received: SourceWindow, comment: str) -> dict[str, Any] | None:
    """Annotate a stretch of samples, from the first that holds it on; None if it is not in the recording."""
    name, *edges_s = received
    edges = np.ceil(rendering.sky.elapsed_at(np.array(edges_s)) * rendering.front_end.rate_hz)
    first, last = np.clip(edges, 0, rendering.n_samples).astype(np.int64).tolist()
    if first >= last:
        return None
    came = format_iso(convert_to_gpst(scene, edges_s[0]), 9) if np.isfinite(edges_s[0]) else "before the scene"
    return make_annotation(first, last - first, name, f"{comment}; the first wave arrives at GPS time {came}")


def _pack_blocks(rendering: Rendering) -> Generator[tuple[bytes, int], None, None]:
    yield from map_ahead(partial(_pack_block, rendering), range(-(-rendering.n_samples // BLOCK)))


def _pack_block(rendering: Rendering, block: int) -> tuple[bytes, int]:
    planes = render_quantised(rendering, block)
    rows = planes[:1] if rendering.front_end.kind == "real" else planes
    return _pack_bytes(rows, rendering.front_end.encoding, rendering.front_end.bits), planes.shape[1]


def _pack_bytes(rows: Floats, encoding: str, bits: int) -> bytes:
    """Pack quantised values (numbers of a sample, n) as bytes, in the conventions of `skyproof.formats.raw`."""
    if bits >= 8:
        return np.ascontiguousarray(rows.T).astype(f"<{encoding[0]}{bits // 8}").tobytes()
    octets = np.empty(rows.size * bits // 8, np.uint8)
    _pack(rows, bits, octets)
    return octets.tobytes()


@compiled
def _pack(rows: Floats, bits: int, octets: NDArray[np.uint8]) -> None:
    """Pack sign, and with two bits magnitude (1 or 3), first number in the highest bits.

    NumPy takes 4 times as long.
    """
    numbers = rows.shape[0]
    samples_in_octet = 8 // (bits * numbers)
    for k in range(octets.size):
        octet = np.uint8(0)
        for j in range(k * samples_in_octet, (k + 1) * samples_in_octet):
            for row in range(numbers):
                value = rows[row, j]
                octet = np.uint8(octet << 1) | np.uint8(value < 0.0)
                if bits == 2:
                    octet = np.uint8(octet << 1) | np.uint8(abs(value) > 1.0)
        octets[k] = octet


# --- series and the document


def list_series_names(scene: Scene) -> list[str]:
    """List the files of `write_series`."""
    return [f"{stem}{ending}" for stem, _, _ in _iterate_series(scene, TRAJECTORY_HZ, SIGNALS_HZ) for ending in _TABLES]


def estimate_series_octets(scene: Scene) -> int:
    """Estimate how many bytes the series take, rather more than less."""
    duration_s = scene.scenario.duration_s
    rows = {
        "truth": TRAJECTORY_HZ * len(scene.trajectories),
        "signals": SIGNALS_HZ * sum(len(sky.signals) for sky in scene.skies),
        "imu": sum(r.imu.rate_hz for r in scene.scenario.receivers if r.imu is not None),
    }
    files = 10_000 * 2 * (2 * len(scene.skies) + len(scene.trajectories))  # of a Parquet file of few rows
    return files + int(sum(_ROW_OCTETS[kind] * (duration_s * rate_hz + 1) for kind, rate_hz in rows.items()))


def write_series(
    scene: Scene,
    folder: Path,
    *,
    trajectory_hz: float = TRAJECTORY_HZ,
    signals_hz: float = SIGNALS_HZ,
    progress: Report | None = None,
) -> list[Path]:
    """Write tables of the truth and of inertial readings, as CSV and Parquet; progress in tables.

    Raises OutputError if a file cannot be written.
    """
    series = list(_iterate_series(scene, trajectory_hz, signals_hz))
    paths: list[Path] = []
    for number, (stem, metadata, blocks) in enumerate(series):
        places = [folder / f"{stem}{ending}" for ending in _TABLES]
        with open_growing_tables(places, metadata) as take:
            for block in blocks:
                take(block)
        paths += places
        if progress is not None:
            progress(number + 1, len(series))
    return paths


def _iterate_series(
    scene: Scene, trajectory_hz: float, signals_hz: float
) -> Iterator[tuple[str, dict[str, str], Iterable[Table]]]:
    """Name without ending, what is stated within the file, and the blocks of each table."""
    about = {"scene": scene.scenario.name, "seed": str(scene.scenario.seed), "skyproof": version("skyproof")}
    imus = simulate_imus(scene)
    for name in scene.trajectories:
        stated = about | {"receiver": name, "rate_hz": f"{trajectory_hz:g}"}
        yield f"{name}-truth", stated, iterate_trajectory_blocks(scene, name, trajectory_hz)
    for sky in scene.skies:
        stated = about | {"receiver": sky.receiver.name, "antenna": sky.antenna.name, "rate_hz": f"{signals_hz:g}"}
        yield f"{sky.name}-signals", stated, iterate_signal_blocks(scene, sky.name, signals_hz)
    for name, imu in imus.items():
        yield f"{name}-imu", about | _describe_imu(_find_sky(scene, name), imu), iterate_imu_blocks(scene, imu)


def _find_sky(scene: Scene, receiver: str) -> ReceiverSky:
    return next(sky for sky in scene.skies if sky.receiver.name == receiver)


def _describe_imu(sky: ReceiverSky, imu: ImuReadings) -> dict[str, str]:
    unit = sky.receiver.imu
    assert unit is not None
    return {
        "receiver": sky.receiver.name,
        "grade": unit.grade or "without error",
        "errors": "" if imu.grade is None else imu.grade.source,
        "rate_hz": f"{imu.rate_hz:g}",
        "body_m": json.dumps(unit.body_m),
        "mounting_roll_pitch_heading_deg": json.dumps(unit.mounting_deg),
        "axes": "the body's (forward, right, down), turned by heading, then pitch, then roll",
        "readings": "means over the interval that ends at each row's time; the rate is against inertial space",
    }


def write_truth(folder: Path, truth: dict[str, Any]) -> Path:
    """Write truth.json. Raises OutputError if it cannot be written."""
    path = folder / "truth.json"
    write_lines(path, [json.dumps(truth, indent=1, ensure_ascii=False, allow_nan=False)], encoding="utf-8")
    return path
