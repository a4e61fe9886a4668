"""Write the truth of a scene as one document: who is where, what is false from when to when, what it shows."""

from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version
from typing import Any, Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import geodetic_from_ecef, heading_pitch_roll_rad
from skyproof.gnss.imu_grades import GRADES
from skyproof.gnss.time import format_iso
from skyproof.simulator.attacks import Interference, Takeover
from skyproof.simulator.platforms import Point, compute_motion
from skyproof.simulator.received import ReceiverSky, Scene
from skyproof.simulator.scenario import SceneReceiver
from skyproof.simulator.sites import Site
from skyproof.simulator.standalone import resolve
from skyproof.simulator.truth import convert_to_gpst

__all__ = ["FORMAT", "SourceWindow", "build_truth", "list_interference", "list_windows"]

SourceWindow = tuple[str, float, float]
"""What is received, and true times of its first and last wave."""

FORMAT: Final = "skyproof-truth/1"


def build_truth(
    scene: Scene, *, scenario: dict[str, Any] | None = None, files: Sequence[str] = (), navigation: str | None = None
) -> dict[str, Any]:
    """Build the right answers, as truth.json holds them.

    scenario : its table in the document; `resolve` if not given. files : the names of what lies beside it. navigation :
    where orbits and clocks come from.
    """
    made = scene.scenario
    return {
        "format": FORMAT,
        "scene": made.name,
        "description": made.description,
        "seed": made.seed,
        "start_gpst": format_iso(made.start_gpst, 9),
        "duration_s": made.duration_s,
        "navigation": navigation or scene.navigation.source,
        "versions": {name: version(name) for name in ("skyproof", "numpy")},
        "files": list(files),
        "scenario": scenario if scenario is not None else resolve(made),
        "receivers": [_describe_receiver(scene, sky) for sky in scene.skies],
        "attacks": [_describe_attack(scene, number) for number in range(len(made.attacks))],
        "interference": [_describe_interference(scene, number) for number in range(len(made.interference))],
    }


# --- what is received when


def list_windows(sky: ReceiverSky, source: str) -> list[SourceWindow]:
    """List when signals of an attack are at an antenna, in order, one window for each time it is on."""
    windows = sorted(window for received in sky.signals if received.source == source for window in received.windows_s)
    joined: list[SourceWindow] = []
    for begin_s, end_s in windows:
        if joined and begin_s <= joined[-1][2]:
            joined[-1] = source, joined[-1][1], max(joined[-1][2], end_s)
        else:
            joined.append((source, begin_s, end_s))
    return joined


def list_interference(scene: Scene, sky: ReceiverSky) -> list[SourceWindow]:
    """List from when to when each source of interference is at an antenna, in the scenario's order."""
    sources = scene.scenario.interference
    noises = iter(sky.noises[len(sky.noises) - sum(source.kind == "noise" for source in sources) :])
    lines = iter(sky.jammers)
    windows = [next(noises) if source.kind == "noise" else next(lines) for source in sources]
    return [
        (source.name or source.kind, window.from_s, window.until_s)
        for source, window in zip(sources, windows, strict=True)
    ]


# --- receivers


def _compute_ends_s(scene: Scene, sky: ReceiverSky) -> Reals:
    """Return true times of the first sample and of the end."""
    elapsed_s = np.array([0.0, scene.scenario.duration_s])
    return elapsed_s + sky.true_minus_elapsed_s(elapsed_s)


def _describe_receiver(scene: Scene, sky: ReceiverSky) -> dict[str, Any]:
    """Describe one antenna: each has samples, and observations, of its own."""
    receiver, ends_s = sky.receiver, _compute_ends_s(scene, sky)
    drift = np.full(2, receiver.lo_ppm * 1e-6)
    if sky.clock is not None:
        drift = sky.clock.drift(np.clip(ends_s - receiver.start_offset_s, 0.0, sky.clock.duration_s))
    offset_s = receiver.start_offset_s + receiver.clock_offset_s - (ends_s - [0.0, scene.scenario.duration_s])
    return {
        "name": sky.name,
        "receiver": receiver.name,
        "antenna": sky.antenna.model_dump(mode="json"),
        "position": _convert_to_geodetic(sky.point, ends_s[0]),
        "position_at_end": _convert_to_geodetic(sky.point, ends_s[1]),
        "position_is": "of this antenna at the first and the last moment of the recording",
        "path": "static" if receiver.path is None else receiver.path.kind,
        "attitude_deg": _compute_attitude_deg(scene, receiver, ends_s[0]),
        "true_start_gpst": format_iso(convert_to_gpst(scene, ends_s[0]), 9),
        "true_end_gpst": format_iso(convert_to_gpst(scene, ends_s[1]), 9),
        "clock_offset_at_start_s": receiver.clock_offset_s,
        "clock_offset_at_end_s": float(offset_s[1]),
        "clock_drift_at_start": float(drift[0]),
        "clock_drift_at_end": float(drift[1]),
        "lo_ppm": receiver.lo_ppm,
        "oscillator": receiver.oscillator,
        "imu": _describe_imu(receiver),
        "signals": _describe_signals(scene, sky),
    }


def _compute_attitude_deg(scene: Scene, receiver: SceneReceiver, at_s: float) -> dict[str, float]:
    motion = compute_motion(scene.trajectories[receiver.name], at_s)
    angles_rad = heading_pitch_roll_rad(motion.position_ecef_m, motion.attitude)
    heading, pitch, roll = (round(float(np.degrees(angle_rad[0])), 9) + 0.0 for angle_rad in angles_rad)  # no -0.0
    return {"heading_deg": heading % 360.0, "pitch_deg": pitch, "roll_deg": roll}


def _describe_imu(receiver: SceneReceiver) -> dict[str, Any] | None:
    imu = receiver.imu
    if imu is None:
        return None
    return imu.model_dump(mode="json") | {
        "readings": "means over the interval that ends at each row's time; the rate is against inertial space",
        "axes": "the body's (forward, right, down), turned by heading, then pitch, then roll of mounting_deg",
        "errors": None if imu.grade is None else asdict(GRADES[imu.grade]),
    }


def _describe_signals(scene: Scene, sky: ReceiverSky) -> list[dict[str, Any]]:
    """Describe each signal by its values at the first and the last moment of the recording when it is received."""
    start_s, end_s = _compute_ends_s(scene, sky)
    authentic = {
        received.id.sat: column for column, received in enumerate(sky.signals) if received.label == "authentic"
    }
    rows = []
    for column, received in enumerate(sky.signals):
        ends_s = np.clip([received.from_s, received.until_s], start_s, end_s)
        code_m = SPEED_OF_LIGHT_M_S * sky.code_delay_s(ends_s)
        lag_m = code_m[:, column] - code_m[:, authentic[received.id.sat]] if received.id.sat in authentic else None
        rows.append(
            {
                "sat": received.id.sat,
                "copy": received.id.copy,
                "label": received.label,
                "source": received.source,
                "from_gpst": format_iso(convert_to_gpst(scene, ends_s[0]), 9),
                "to_gpst": format_iso(convert_to_gpst(scene, ends_s[1]), 9),
                "cn0_dbhz_first_last": _round(sky.cn0_dbhz(ends_s)[:, column], 3),
                "az_deg_first_last": _round(
                    _interpolate_degrees(ends_s, sky.knots_s, np.unwrap(sky.az_rad[:, column])) % 360.0, 3
                ),
                "el_deg_first_last": _round(_interpolate_degrees(ends_s, sky.knots_s, sky.el_rad[:, column]), 3),
                "delay_to_authentic_m_first_last": None if lag_m is None else _round(lag_m, 4),
            }
        )
    return rows


# --- transmitters


def _describe_attack(scene: Scene, number: int) -> dict[str, Any]:
    scenario, attack = scene.scenario, scene.scenario.attacks[number]
    name, last_s = scenario.attack_names[number], _find_last_s(scene, attack.until_s)
    return {
        "name": name,
        "kind": attack.kind,
        "transmit_antenna": _describe_place(attack.transmit),
        "onset_gpst": format_iso(convert_to_gpst(scene, attack.onset_s), 9),
        "until_gpst": None if attack.until_s is None else format_iso(convert_to_gpst(scene, attack.until_s), 9),
        "onset_means": "first wave leaves the transmit antenna at this GPS time",
        "on_gpst": _convert_windows(scene, attack.windows_s),
        "heard": {
            sky.name: _convert_windows(scene, [(b, e) for _, b, e in list_windows(sky, name)]) for sky in scene.skies
        },
        "sats": sorted({received.id.sat for sky in scene.skies for received in sky.signals if received.source == name}),
        "captured_receiver_shows_position": _convert_to_geodetic(scene.shown[number], attack.onset_s),
        "captured_receiver_shows_position_at_end": _convert_to_geodetic(scene.shown[number], last_s),
        "captured_clock_extra_s": _compute_clock_extra_s(scene, number),
        "captured_clock_extra_grows_until_end_s": float(np.subtract(*attack.clock_s([last_s, attack.onset_s]))),
    }


def _compute_clock_extra_s(scene: Scene, number: int) -> dict[str, float]:
    """Compute, by recording, how late the clock of a receiver that believes the attack is at the onset."""
    attack, path_m = scene.scenario.attacks[number], scene.path_m[number]
    before_m = 0.0
    if isinstance(attack, Takeover):  # sent early by the way to its target
        before_m = next(
            float(way_m) for sky, way_m in zip(scene.skies, path_m, strict=True) if sky.receiver.name == attack.target
        )
    return {
        sky.name: attack.added_delay_s
        + float(attack.clock_s(attack.onset_s))
        + (float(way_m) - before_m) / SPEED_OF_LIGHT_M_S
        for sky, way_m in zip(scene.skies, path_m, strict=True)
    }


def _describe_interference(scene: Scene, number: int) -> dict[str, Any]:
    source: Interference = scene.scenario.interference[number]
    return {
        "name": source.name or source.kind,
        "kind": source.kind,
        "transmit_antenna": _describe_place(source.transmit),
        "onset_gpst": format_iso(convert_to_gpst(scene, source.onset_s), 9),
        "until_gpst": None if source.until_s is None else format_iso(convert_to_gpst(scene, source.until_s), 9),
        "heard": {
            sky.name: _convert_windows(scene, [list_interference(scene, sky)[number][1:]]) for sky in scene.skies
        },
    }


def _convert_windows(scene: Scene, windows: Sequence[tuple[float, float]]) -> list[list[str | None]]:
    """Convert windows to GPS time; None where the scene has no end of it."""
    return [
        [format_iso(convert_to_gpst(scene, edge_s), 9) if np.isfinite(edge_s) else None for edge_s in window]
        for window in windows
    ]


def _find_last_s(scene: Scene, until_s: float | None) -> float:
    end_s = max(sky.receiver.start_offset_s for sky in scene.skies) + scene.scenario.duration_s
    return end_s if until_s is None else min(until_s, end_s)


def _convert_to_geodetic(point: Point, at_s: float) -> dict[str, float]:
    lat_rad, lon_rad, height_m = geodetic_from_ecef(point(np.array([at_s])).position_ecef_m[0])
    return {
        "lat_deg": round(float(np.degrees(lat_rad)), 11),
        "lon_deg": round(float(np.degrees(lon_rad)), 11),
        "height_m": round(float(height_m), 6),
    }


def _describe_place(site: Site) -> dict[str, Any]:
    """Describe a site: for one that moves, the place that its way refers to."""
    path = {} if site.path is None else {"path": site.path.kind}
    return {"lat_deg": site.lat_deg, "lon_deg": site.lon_deg, "height_m": site.height_m} | path


def _interpolate_degrees(at_s: Reals, knots_s: Reals, angle_rad: Reals) -> Reals:
    return np.degrees(np.interp(at_s, knots_s, angle_rad))


def _round(values: Reals, digits: int) -> list[float]:
    return [round(float(value), digits) for value in values]
