"""Make the data of a scene: samples, measurements, inertial readings, and the truth about all of them."""

import json
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from skyproof.app.common.folder import claim, require_free
from skyproof.app.common.progress import Progress, Silent
from skyproof.app.common.rinex import write_channels
from skyproof.app.scenes.scene_page import PAGE, write_page
from skyproof.errors import InputError, OutputError, ScenarioError, SettingsError
from skyproof.formats.atomic_write import write_lines, write_whole
from skyproof.formats.documents import read_json
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.time import utc_from_gpst
from skyproof.logs.ubx_write import ubx_log
from skyproof.navigation.fix import fix
from skyproof.records import NavigationData, Observations, ReceiverFixes, SignalId
from skyproof.short_repr import ShortRepr, write_notebook_html
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.files import (
    Container,
    choose_container,
    count_sample_octets,
    estimate_series_octets,
    list_sample_names,
    list_series_names,
    write_samples,
    write_series,
    write_truth,
)
from skyproof.simulator.measurements import draw, make_ideal_measurements
from skyproof.simulator.ordinary import follow_strongest
from skyproof.simulator.received import Scene
from skyproof.simulator.scenario import Scenario, read_scenario
from skyproof.simulator.scenes import load_ready_made, read_ready_made
from skyproof.simulator.sky import make_scene
from skyproof.simulator.standalone import NAVIGATION, Standalone, collect_standalone, override
from skyproof.simulator.truth_document import FORMAT, build_truth

__all__ = [
    "Depth",
    "ReceiverLog",
    "SimulateResult",
    "load_ready_made",
    "load_scenario",
    "read_earlier_scene",
    "simulate",
    "write_document_json",
    "write_ready_made_json",
]

Depth = Literal["samples", "measurements", "all"]
ReceiverLog = Literal["ubx"]

_SCENARIO: Final = "scenario.toml"
_TRUTH: Final = "truth.json"
_EARLIER: Final = "an earlier scene"
_INTERVAL_S: Final = 1.0  # of observations
_STREAM: Final = 1 << 23  # sets the noise of measurements apart from other random numbers of one seed
_OBS_OCTETS: Final = 72  # of a satellite's line in RINEX, with its share of the epoch's
_UBX_OCTETS: Final = 48  # of a signal's cell in RXM-RAWX, with its share of the rest
_SPARE: Final = 1.02  # of the room on a disk: what a file system takes for itself


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class SimulateResult(ShortRepr):
    """What was made. `files` are the names of all in `folder`; `recordings`, `observations`, `logs` are among them."""

    scenario: Scenario
    folder: Path
    files: tuple[str, ...]
    recordings: tuple[Path, ...]
    observations: tuple[Path, ...]
    logs: tuple[Path, ...] = ()
    interrupted: bool = False

    def _repr_html_(self) -> str:
        """Show what was made in a notebook."""
        made = self.scenario
        attacks = ", ".join(made.attack_names) or "none"
        legend = (
            f"{made.description} {made.duration_s:g} s from {made.start_gpst} GPS time; receivers: "
            f"{', '.join(r.name for r in made.receivers)}; attacks: {attacks}."
        )
        listed = [(name, self.folder / name) for name in self.files]
        rows = [(name, _size(path.stat().st_size)) for name, path in listed if path.exists()]
        return write_notebook_html(f"Scene {made.name}", [legend.strip()], ((f"file in {self.folder}", "size"), rows))


@dataclass(frozen=True, eq=False)
class _Measured:
    """A file of observations: the copies of one letter at one antenna."""

    name: str
    observations: Observations
    signals: tuple[SignalId, ...]
    label: str


@dataclass(frozen=True, eq=False)
class _Logged:
    """A receiver's log: of each transmission the strongest copy."""

    name: str
    observations: Observations


def simulate(
    scenario: str | Path | Scenario,
    *,
    out: str | Path,
    seed: int | None = None,
    duration_s: float | None = None,
    depth: Depth = "all",
    container: Container | None = None,
    log: ReceiverLog | None = None,
    plot: bool = False,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> SimulateResult:
    """Write the data of a scene, and the truth about them, into `out`, which is made if need be.

        made = sp.simulate("takeover", out="scene", duration_s=20.0)
        print(made.recordings)

    Ctrl-C ends it early; what is there then is whole.

    Parameters
    ----------
    scenario : a TOML file, the name of a ready-made scene, or a Scenario.
    out : the folder.
    seed, duration_s : in place of the scenario's.
    depth : "samples", "measurements" (RINEX observations), or both; the truth and inertial readings come with each.
    container : of samples, "sigmf" or "raw"; without it SigMF where that can hold them.
    log : also write what an ordinary receiver logs at each antenna, which follows the strongest copy of each signal:
        "ubx" for measurements, messages and fixes as of u-blox.
    plot : write the page that shows the scene as well.
    overwrite : whether what an earlier run wrote there may be removed first: two runs never mix.
    progress : is called with how far the work is.

    Returns
    -------
    SimulateResult : the scene, and the names of all files that were written.

    Raises
    ------
    ScenarioError : the scenario cannot be read, is not known, or makes no sense.
    SettingsError : SigMF cannot hold such samples, or a log is wanted without measurements.
    OutputError : the folder cannot be written, holds what would be overwritten, or has not room enough for all.
    """
    progress, folder = progress or Silent(), Path(out)
    made = override(load_scenario(scenario), seed=seed, duration_s=duration_s)
    alone = collect_standalone(made)
    with claim(folder):
        older = read_earlier_scene(folder)[1]
        require_free(folder, (), [path.name for path in older], _EARLIER, overwrite=overwrite)
        return _make(made, alone, folder, older, depth, container, log, plot, progress)


def _make(
    made: Scenario,
    alone: Standalone,
    folder: Path,
    older: Sequence[Path],
    depth: Depth,
    container: Container | None,
    log: ReceiverLog | None,
    plot: bool,
    progress: Progress,
) -> SimulateResult:
    """Write the data of a scene into a folder, in place of `older` files. Other arguments are those of `simulate`."""
    with_samples, with_measurements = depth != "measurements", depth != "samples"
    if log is not None and not with_measurements:
        raise SettingsError(
            f"log {log!r} is made of measurements, but depth is {depth!r}; give depth measurements or all"
        )
    kind = choose_container(made.front_end, container if with_samples else None)
    navigation = make_navigation(made)
    scene = make_scene(made, navigation)
    measured = _measure(scene, required=depth == "measurements", progress=progress) if with_measurements else []
    logged = _log_strongest(measured) if log is not None else []
    files = (
        _SCENARIO,
        NAVIGATION,
        *sorted(set(alone.files) - {NAVIGATION}),
        _TRUTH,
        *list_series_names(scene),
        *(output.name for output in measured),
        *(output.name for output in logged),
        *(list_sample_names(scene, kind) if with_samples else ()),
        *((PAGE,) * plot),
    )
    _require_different(files)
    octets = estimate_series_octets(scene) + (count_sample_octets(made) if with_samples else 0)
    octets += _OBS_OCTETS * sum(output.observations.gpst.size * len(output.signals) for output in measured)
    octets += sum(_UBX_OCTETS * output.observations.pseudorange_m.size for output in logged)
    taken = [name for name in files if (folder / name).exists()]
    require_free(folder, taken, [path.name for path in older], _EARLIER, overwrite=True)
    _require_room(folder, octets, older)
    progress.say(f"scene {made.name}: {_size(octets)} in {len(files)} files will be written to {folder}")
    interrupted = False
    try:
        _remove(older)
        orbits = navigation.source if made.navigation is None else NAVIGATION
        write_truth(folder, build_truth(scene, scenario=alone.table, files=files, navigation=orbits))
        _write_inputs(folder, scene, alone)
        with progress.stage("writing truth and inertial readings", 1.0) as stage:
            write_series(scene, folder, progress=lambda done, total: stage.advance(done / total))
        for output in measured:
            _write_measured(folder, scene, output)
        for receiver in logged:
            _write_log(folder / receiver.name, receiver.observations, navigation)
        if plot:
            write_page(folder / PAGE, made, navigation)
        if with_samples:
            stage_name = f"rendering samples, {len(scene.skies)} antenna{'s' * (len(scene.skies) > 1)}"
            with progress.stage(stage_name, 1.0) as stage:
                write_samples(scene, folder, kind, progress=lambda done, total: stage.advance(done / total))
    except KeyboardInterrupt:
        interrupted = True
    written = tuple(name for name in files if (folder / name).exists())
    return SimulateResult(
        scenario=made,
        folder=folder,
        files=written,
        interrupted=interrupted,
        recordings=tuple(folder / name for name in written if name.endswith((".bin", ".sigmf-meta"))),
        observations=tuple(folder / output.name for output in measured if output.name in written),
        logs=tuple(folder / output.name for output in logged if output.name in written),
    )


# --- which scene


def load_scenario(scenario: str | Path | Scenario) -> Scenario:
    """Read a scenario from a file, or take a ready-made one by its name. Raises ScenarioError."""
    if isinstance(scenario, Scenario):
        return scenario
    path, name = Path(scenario), str(scenario)
    if name in load_ready_made():
        return read_ready_made(name)
    if path.suffix == ".toml" or len(path.parts) > 1 or path.is_file():
        return read_scenario(path)
    near = get_close_matches(name, load_ready_made(), 1, cutoff=0.4)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise ScenarioError(
        f"{name!r} is neither a ready-made scene nor a file; {hint}`skyproof simulate --list` shows them; a scenario's "
        "own file ends in .toml"
    )


# --- measurements


def _measure(scene: Scene, *, required: bool, progress: Progress) -> list[_Measured]:
    """Measure every copy without samples, in a file per antenna and letter as of `receive`."""
    duration_s, needed_s = scene.scenario.duration_s, 2.0 * _INTERVAL_S
    if duration_s < needed_s:
        words = f"duration_s: {duration_s:g} s; measurements are means over {_INTERVAL_S:g} s and need {needed_s:g} s"
        if required:
            raise ScenarioError(f"{words}; give a longer one, or ask for samples only")
        progress.say(f"{words}: there are none")
        return []
    rng = np.random.default_rng(np.random.SeedSequence(scene.scenario.seed, spawn_key=(_STREAM,)))
    observations, labels = draw(make_ideal_measurements(scene, interval_s=_INTERVAL_S), rng=rng)
    measured = []
    for o in observations:
        label_of = {ref.signal: label for ref, label in labels.items() if ref.receiver == o.receiver}
        for number, letter in enumerate(sorted({signal.copy for signal in o.signals})):
            signals = tuple(signal for signal in o.signals if signal.copy == letter)
            name = f"{o.receiver}.obs" if number == 0 else f"{o.receiver}-{number + 1}.obs"
            its_labels = " and ".join(sorted({label_of[signal] for signal in signals}))
            measured.append(_Measured(name, o, signals, its_labels))
    return measured


def _write_measured(folder: Path, scene: Scene, one: _Measured) -> None:
    sky = next(sky for sky in scene.skies if sky.name == one.observations.receiver)
    stands = sky.receiver.path is None and sky.antenna.spin is None
    place = sky.point(np.array([sky.receiver.start_offset_s])).position_ecef_m[0] if stands else None
    write_channels(folder / one.name, one.observations, one.label, place, one.signals)


def _log_strongest(measured: Sequence[_Measured]) -> list[_Logged]:
    every = {output.observations.receiver: output.observations for output in measured}
    return [_Logged(f"{name}.ubx", follow_strongest(o)) for name, o in every.items()]


def _write_log(path: Path, o: Observations, navigation: NavigationData) -> None:
    """Write a receiver's log with the fixes that the signals it follows give."""
    found = fix(o, navigation)
    n_used = np.isfinite(found.residual_m).sum(axis=1)
    sigma_m = np.sqrt(np.trace(found.covariance_m2[:, :3, :3], axis1=1, axis2=2) / 3.0)  # of each axis, at the mean
    fixes = ReceiverFixes(
        gpst=o.gpst,
        position_ecef_m=found.position_ecef_m,
        velocity_ecef_m_s=found.velocity_ecef_m_s,
        horizontal_sigma_m=sigma_m,
        vertical_sigma_m=sigma_m,
        clock_bias_s=found.clock_bias_s,
        clock_drift=found.clock_drift,
        satellites=n_used,
    )
    with write_whole(path) as file:
        file.writelines(ubx_log(o, navigation, fixes))


# --- what the scene is made of


def _write_inputs(folder: Path, scene: Scene, alone: Standalone) -> None:
    for name, octets in alone.files.items():
        with write_whole(folder / name) as file:
            file.write(octets)
    if NAVIGATION not in alone.files:
        write_nav(folder / NAVIGATION, scene.navigation, created=utc_from_gpst(scene.scenario.start_gpst))
    comments = (
        f"everything that made the scene, by skyproof {version('skyproof')}",
        "the same again: skyproof simulate scenario.toml --out FOLDER",
    )
    write_lines(folder / _SCENARIO, alone.lines(*comments), encoding="utf-8")


# --- the folder


def read_earlier_scene(folder: Path) -> tuple[str, list[Path]]:
    """Read name and files of the scene that an earlier run wrote here; "" and none without a truth.json."""
    try:
        truth = read_json(folder / _TRUTH, "the truth", "name another folder")
    except InputError:
        return "", []
    if not isinstance(truth, Mapping) or truth.get("format") != FORMAT:
        return "", []
    names = truth.get("files")
    names = names if isinstance(names, list) else []
    plain = [name for name in (_TRUTH, *names) if isinstance(name, str) and Path(name).name == name]
    return str(truth.get("scene")), [folder / name for name in dict.fromkeys(plain) if (folder / name).is_file()]


def _require_different(files: Sequence[str]) -> None:
    for name in files:
        if files.count(name) > 1:
            raise ScenarioError(f"two files would have the name {name}; give receivers and antennas other names")


def _remove(files: Iterable[Path]) -> None:
    for path in files:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(
                f"{path}: what an earlier run wrote cannot be removed ({error.strerror}); name another folder with "
                "--out"
            ) from error


def _require_room(folder: Path, octets: int, older: Sequence[Path]) -> None:
    free = shutil.disk_usage(folder).free + sum(path.stat().st_size for path in older)
    if free < _SPARE * octets:
        raise OutputError(
            f"{folder}: {_size(octets)} would be written, but there is room for {_size(free)} only; free space, name "
            "another folder with --out, or make less with --duration-s or --depth measurements"
        )


def _size(octets: float) -> str:
    for unit in ("kB", "MB", "GB"):
        octets /= 1e3
        if octets < 999.5 or unit == "GB":
            return f"{octets:.3g} {unit}" if octets < 999.5 else f"{octets:.0f} {unit}"
    raise AssertionError


# --- in words of JSON


def write_document_json(result: SimulateResult) -> str:
    """Write what was made as one JSON document."""
    made = result.scenario
    document: dict[str, Any] = {
        "format": "skyproof-simulate/1",
        "version": version("skyproof"),
        "interrupted": result.interrupted,
        "scene": made.name,
        "description": made.description,
        "seed": made.seed,
        "duration_s": made.duration_s,
        "receivers": [receiver.name for receiver in made.receivers],
        "attacks": made.attack_names,
        "folder": str(result.folder),
        "recordings": [path.name for path in result.recordings],
        "observations": [path.name for path in result.observations],
        "files": list(result.files),
    }
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def write_ready_made_json() -> str:
    """List the ready-made scenes as one JSON document."""
    listed = [
        {"name": scene.name, "description": scene.title, "source": scene.source} for scene in load_ready_made().values()
    ]
    document = {"format": "skyproof-scenes/1", "version": version("skyproof"), "scenes": listed}
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"
