"""A scenario as a page: what is where, what is on when, what each receiver gets."""

from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import numpy as np

from skyproof.arrays import Reals
from skyproof.formats.atomic_write import write_lines
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import NavigationData
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.sky import compute_azimuth_elevation
from skyproof.gnss.time import format_instant, format_iso
from skyproof.report.pictures import SignalSeries, SkyPosition, SkySource
from skyproof.report.scene import (
    STANDS_M,
    Element,
    GroundTrack,
    PlotLine,
    ScenePage,
    SceneSky,
    Setting,
    SettingGroup,
    Switching,
    write_scene_html,
)
from skyproof.simulator.attacks import Interference, Meaconer, Spoofer, Takeover
from skyproof.simulator.platforms import Point, compute_motion, make_trajectory
from skyproof.simulator.received import ReceivedSignal, ReceiverSky, Scene
from skyproof.simulator.scenario import Antenna, Attack, Scenario, SceneReceiver
from skyproof.simulator.sites import Site
from skyproof.simulator.sky import make_scene

__all__ = ["PAGE", "write_page", "write_scene_page"]

PAGE = "scene.html"

MOMENTS = 201
_EDGE_S = 1e-6  # before a change, so that it is drawn upright
_WEAKEST_DBHZ = 20.0  # that is drawn: no receiver tracks less
_SEVERAL_SKIES = 3  # more receivers share the sky of the first

_AXES: tuple[tuple[str, Literal["authentic", "spoofed", "multipath"]], ...] = (
    ("east", "authentic"),
    ("north", "spoofed"),
    ("up", "multipath"),
)
_KINDS = {
    "meaconer": "meaconer",
    "spoofer": "spoofer",
    "takeover": "takeover",
    "cw": "line",
    "chirp": "chirp",
    "noise": "noise",
}
_UNITS = {
    "_m_s2": "m/s²",
    "_m_s": "m/s",
    "_dbhz": "dB-Hz",
    "_db": "dB",
    "_deg": "°",
    "_cyc": "cycles",
    "_hz": "Hz",
    "_ppm": "ppm",
    "_gpst": "GPS time",
    "_m": "m",
    "_s": "s",
}
_ANGLES, _PLACE = ("heading_deg", "pitch_deg", "roll_deg"), ("lat_deg", "lon_deg", "height_m")
_SINGLE = {"sat_db": "dB", "sat_code_m": "m", "sat_code_m_s": "m/s", "sat_doppler_hz": "Hz"}


def write_scene_page(scenario: Scenario, navigation: NavigationData) -> str:
    """Draw the page of a scenario.

    The same scenario and navigation data give the same characters.

    Raises ScenarioError as `skyproof.simulator.sky.make_scene` does.
    """
    scene = make_scene(scenario, navigation)
    firsts = _first_antennas(scene)
    at_s = _choose_moments(scenario)
    origin = firsts[0].point(np.array([firsts[0].receiver.start_offset_s])).position_ecef_m[0]
    lat_rad, lon_rad, _ = geodetic_from_ecef(origin)
    several = any(sky.receiver.name != sky.name for sky in scene.skies)
    return write_scene_html(
        ScenePage(
            name=scenario.name,
            description=scenario.description,
            facts=tuple(_facts(scene)),
            events=tuple(_events(scene)),
            zero="the scene’s start",
            origin=f"{_degrees(lat_rad, 'N', 'S')}, {_degrees(lon_rad, 'E', 'W')}, "
            f"where {firsts[0].receiver.name} begins",
            ways=tuple(_ways(scene, at_s, origin)),
            displacements=tuple(_plot_displacements(scene, firsts, at_s)),
            arrays=tuple(_arrays(scenario)),
            skies=tuple(_sky(scene, sky) for sky in (firsts if len(firsts) <= _SEVERAL_SKIES else firsts[:1])),
            levels=tuple(series for sky in firsts for series in _levels(sky, at_s, scenario.duration_s)),
            level_note=f"Nothing is drawn below {_WEAKEST_DBHZ:g} dB-Hz. Noise that transmitters add is taken into "
            "account, lines and chirps are not."
            + " Reflections are left out." * any(sky.rays for sky in firsts)
            + " Of several antennas, the first." * several,
            onset_s=min((attack.onset_s for attack in scenario.attacks), default=None),
            offsets=tuple((sky.receiver.name, lines) for sky in firsts if (lines := tuple(_offsets(scene, sky, at_s)))),
            disturbance=tuple(
                (sky.receiver.name, lines) for sky in firsts if (lines := tuple(_disturbance(scenario, sky, at_s)))
            ),
            reflections=tuple(
                (sky.receiver.name, lines)
                for sky in firsts
                if (lines := tuple(_reflections(sky, at_s, scenario.duration_s)))
            ),
            switching=tuple(_switching(scenario, at_s)),
            span_s=(float(at_s[0]), float(at_s[-1])),
            settings=tuple(_settings(scenario)),
            made_by=f"Drawn by skyproof {version('skyproof')}.",
        )
    )


def write_page(path: Path, scenario: Scenario, navigation: NavigationData) -> None:
    """Write the page of a scenario. Raises ScenarioError as `write_scene_page`, OutputError if it cannot be written."""
    write_lines(path, [write_scene_page(scenario, navigation)], end="", encoding="utf-8")


def _first_antennas(scene: Scene) -> list[ReceiverSky]:
    return [sky for sky in scene.skies if sky.antenna is sky.receiver.antennas[0]]


def _choose_moments(scenario: Scenario) -> Reals:
    """Space moments evenly, with one on both sides of whatever changes at once."""
    starts_s = [receiver.start_offset_s for receiver in scenario.receivers]
    first_s, last_s = min(starts_s), max(starts_s) + scenario.duration_s
    edges_s = [edge for attack in scenario.attacks for window in attack.windows_s for edge in window]
    edges_s += [edge for source in scenario.interference for edge in (source.onset_s, source.until_s) if edge]
    for transmitter in (*scenario.attacks, *scenario.interference):
        edges_s += [point[0] for point in transmitter.power_points_db]
    around_s = [edge + side for edge in edges_s for side in (-_EDGE_S, _EDGE_S) if first_s < edge < last_s]
    return np.unique([*np.linspace(first_s, last_s, MOMENTS), *around_s])


# --- words


def _facts(scene: Scene) -> Iterator[str]:
    scenario = scene.scenario
    begins = format_instant(format_iso(scenario.start_gpst, 3))
    antennas = len(scene.skies)
    receivers = _count(len(scenario.receivers), "receiver")
    if antennas > len(scenario.receivers):
        receivers += f" with {_count(antennas, 'antenna')}{' together' * (len(scenario.receivers) > 1)}"
    yield f"{begins} GPS time, {scenario.duration_s:g} s, {receivers}. Satellites: {_sky_source(scene)}."
    if scenario.source:
        yield f"Source: {scenario.source}"


def _degrees(angle_rad: Any, positive: str, negative: str) -> str:
    return f"{abs(np.degrees(angle_rad)):.6f}° {positive if angle_rad >= 0.0 else negative}"


def _sky_source(scene: Scene) -> str:
    if scene.scenario.sky.directions is not None:
        return "on circular orbits through the directions given"
    if scene.scenario.navigation is not None:
        return f"as {Path(scene.scenario.navigation).name} states"
    return "the nominal constellation, which is not that of the day"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _events(scene: Scene) -> Iterator[str]:
    scenario = scene.scenario
    if scenario.sky.until_s is not None:
        yield f"The true sky falls silent after {scenario.sky.until_s:g} s."
    for name, attack in zip(scenario.attack_names, scenario.attacks, strict=True):
        sats = sorted({received.id.sat for sky in scene.skies for received in sky.signals if received.source == name})
        antennas = "" if not attack.antennas else f" from {1 + len(attack.antennas)} antennas"
        imitated = f"{_count(len(sats), 'satellite')} ({', '.join(sats)}){antennas}"
        yield f"{name} {_does(attack)}; {imitated}, {_describe_times(attack)}."
    for source in scenario.interference:
        yield f"{source.name or source.kind} transmits {_noise(source)}, {_describe_times(source)}."
    for receiver in scenario.receivers:
        if receiver.multipath:
            yield f"{receiver.name} receives {_count(len(receiver.multipath), 'reflection')} of true signals besides."
    if not (scenario.attacks or scenario.interference):
        yield "Only the satellites transmit."


def _does(attack: Attack) -> str:
    if isinstance(attack, Meaconer):
        return f"rebroadcasts what its receive antenna receives, {1e6 * attack.delay_s:.4g} µs later"
    if isinstance(attack, Spoofer):
        return "sends the signals that a receiver at the place shown would receive"
    locked = ", carriers kept at the true ones’ frequencies" if attack.carrier == "locked" else ""
    return f"lays its signals on the true ones of {attack.target} and draws them off{locked}"


def _noise(source: Interference) -> str:
    if source.kind == "cw":
        return f"a line {source.offset_hz:g} Hz off the carrier"
    if source.kind == "chirp":
        return f"a line that sweeps over {source.sweep_hz / 1e6:g} MHz every {1e6 * source.period_s:g} µs"
    return "white noise"


def _describe_times(transmitter: Attack | Interference) -> str:
    begin = "from before the beginning" if transmitter.onset_s <= 0.0 else f"from {transmitter.onset_s:g} s"
    return begin + (" to the end" if transmitter.until_s is None else f" to {transmitter.until_s:g} s")


# --- places


def _ways(scene: Scene, at_s: Reals, origin: Reals) -> Iterator[GroundTrack]:
    scenario = scene.scenario
    rot_enu = rot_enu_ecef(*geodetic_from_ecef(origin)[:2])

    def way(name: str, role: Any, point: Point, when_s: Reals) -> GroundTrack:
        enu_m = (point(when_s).position_ecef_m - origin) @ rot_enu.T
        if np.ptp(enu_m, axis=0).max() < STANDS_M:
            enu_m = enu_m[:1]
        return GroundTrack(name=name, role=role, east_m=enu_m[:, 0], north_m=enu_m[:, 1])

    for name, trajectory in scene.trajectories.items():
        yield way(name, "receiver", lambda t_s, of=trajectory: compute_motion(of, t_s), at_s)  # type: ignore[misc]
    for name, attack, path in zip(scenario.attack_names, scenario.attacks, scene.shown, strict=True):
        until_s = np.inf if attack.until_s is None else attack.until_s
        on_s = at_s[(at_s >= attack.onset_s) & (at_s <= until_s)]
        for number, site in enumerate(attack.transmit_sites):
            several = "" if number == 0 else f" antenna {number + 1}"
            yield way(f"{name}{several}", "transmits", _point(site), at_s)
        yield way(name, "receives" if isinstance(attack, Meaconer) else "shows", path, on_s)
    for source in scenario.interference:
        yield way(source.name or source.kind, "disturbs", _point(source.transmit), at_s)


def _plot_displacements(
    scene: Scene, firsts: list[ReceiverSky], at_s: Reals
) -> Iterator[tuple[str, tuple[PlotLine, ...]]]:
    """Plot how far the place that an attack shows moves from its target receiver, or else the first."""
    scenario = scene.scenario
    for name, attack, path in zip(scenario.attack_names, scenario.attacks, scene.shown, strict=True):
        target = attack.target if isinstance(attack, Takeover) else firsts[0].receiver.name
        sky = next(sky for sky in firsts if sky.receiver.name == target)
        on = np.any([(at_s >= begin) & (at_s <= end) for begin, end in attack.windows_s], axis=0)
        here_m = sky.point(at_s).position_ecef_m
        rot_enu = rot_enu_ecef(*geodetic_from_ecef(here_m)[:2])
        away_m = np.einsum("nij,nj->ni", rot_enu, path(at_s).position_ecef_m - here_m)
        away_m[~on] = np.nan
        if np.ptp(away_m[on], axis=0).max(initial=0.0) > STANDS_M:
            lines = tuple(
                PlotLine(name=axis, kind=kind, seconds=at_s, values=away_m[:, column])
                for column, (axis, kind) in enumerate(_AXES)
            )
            yield f"What {name} shows to {target}", lines


def _point(site: Site) -> Point:
    trajectory = make_trajectory(site, "")
    return lambda t_s: compute_motion(trajectory, t_s)


def _arrays(scenario: Scenario) -> Iterator[tuple[str, tuple[Element, ...]]]:
    for receiver in scenario.receivers:
        if len(receiver.antennas) > 1 or any(a.spin is not None or any(a.body_m) for a in receiver.antennas):
            yield receiver.name, tuple(map(_element, receiver.antennas))


def _element(antenna: Antenna) -> Element:
    forward_m, right_m, down_m = antenna.body_m
    element = Element(name=antenna.name, forward_m=forward_m, right_m=right_m, down_m=down_m)
    spin = antenna.spin
    if spin is None:
        return element
    return replace(element, radius_m=spin.radius_m, start_deg=spin.start_deg, clockwise=spin.rate_hz >= 0.0)


def _sky(scene: Scene, sky: ReceiverSky) -> SceneSky:
    half_s = np.array([sky.receiver.start_offset_s + 0.5 * scene.scenario.duration_s])
    motion = sky.point(half_s)
    place = motion.position_ecef_m[0]
    row = int(np.abs(sky.knots_s - half_s).argmin())
    positions = [
        SkyPosition(
            receiver=sky.name,
            signal=str(received.id),
            label=_label(received),
            azimuth_deg=float(np.degrees(sky.az_rad[row, column])),
            elevation_deg=float(np.degrees(sky.el_rad[row, column])),
        )
        for column, received in enumerate(sky.signals)
    ]
    transmitters = [
        (name if number == 0 else f"{name} {number + 1}", site)
        for name, attack in zip(scene.scenario.attack_names, scene.scenario.attacks, strict=True)
        for number, site in enumerate(attack.transmit_sites)
    ]
    transmitters += [(source.name or source.kind, source.transmit) for source in scene.scenario.interference]
    axes: list[SkySource] = []
    if _has_attitude(sky.receiver):
        forward, right, down = motion.attitude[0].T
        axes = [
            _direction(name, place, place + 1e3 * axis)
            for name, axis in (("forward", forward), ("right", right), ("up", -down))
        ]
    return SceneSky(
        receiver=sky.receiver.name,
        positions=tuple(positions),
        axes=tuple(axes),
        sources=tuple(_direction(name, place, _point(site)(half_s).position_ecef_m[0]) for name, site in transmitters),
    )


def _label(received: ReceivedSignal) -> Any:
    return received.label


def _direction(name: str, place: Reals, target: Reals) -> SkySource:
    az_rad, el_rad = compute_azimuth_elevation(place, target)
    return SkySource(name=name, azimuth_deg=float(np.degrees(az_rad)), elevation_deg=float(np.degrees(el_rad)))


def _has_attitude(receiver: SceneReceiver) -> bool:
    angles = {"heading_deg", "pitch_deg", "roll_deg"} & receiver.model_fields_set
    extended = any(a.spin is not None or any(a.body_m) or a.gain != "isotropic" for a in receiver.antennas)
    return bool(angles) or receiver.path is not None or extended or receiver.imu is not None


# --- over time


def _is_received_at(received: ReceivedSignal, at_s: Reals) -> Any:
    return np.any([(at_s >= begin) & (at_s <= end) for begin, end in received.windows_s], axis=0)


def _levels(sky: ReceiverSky, at_s: Reals, duration_s: float) -> Iterator[SignalSeries]:
    at_s = _select_moments(sky, at_s, duration_s)
    cn0_dbhz = sky.cn0_dbhz(at_s) - 10.0 * np.log10(sky.noise_power(at_s))[:, np.newaxis]
    for column, received in enumerate(sky.signals):
        yield SignalSeries(
            receiver=sky.receiver.name,
            signal=str(received.id),
            label=_label(received),
            seconds=at_s,
            cn0_dbhz=np.where(
                _is_received_at(received, at_s) & (cn0_dbhz[:, column] >= _WEAKEST_DBHZ), cn0_dbhz[:, column], np.nan
            ),
        )


def _select_moments(sky: ReceiverSky, at_s: Reals, duration_s: float) -> Reals:
    """Select the moments within a receiver's recording."""
    start_s = sky.receiver.start_offset_s
    return np.asarray(at_s[(at_s >= start_s) & (at_s <= start_s + duration_s)])


def _offsets(scene: Scene, sky: ReceiverSky, at_s: Reals) -> Iterator[PlotLine]:
    at_s = _select_moments(sky, at_s, scene.scenario.duration_s)
    behind_m = SPEED_OF_LIGHT_M_S * sky.code_delay_s(at_s)
    true = {received.id.sat: column for column, received in enumerate(sky.signals) if received.source == "sky"}
    for column, received in enumerate(sky.signals):
        other = true.get(received.id.sat)
        if received.source == "sky" or other is None:
            continue
        received_together = _is_received_at(received, at_s) & _is_received_at(sky.signals[other], at_s)
        several = f" {received.source}" if len(scene.scenario.attacks) > 1 else ""
        yield PlotLine(
            name=f"{received.id.sat}{several}",
            kind="spoofed",
            seconds=at_s,
            values=np.where(received_together, behind_m[:, column] - behind_m[:, other], np.nan),
        )


def _disturbance(scenario: Scenario, sky: ReceiverSky, at_s: Reals) -> Iterator[PlotLine]:
    at_s = _select_moments(sky, at_s, scenario.duration_s)
    names = [
        name
        for name, attack in zip(scenario.attack_names, scenario.attacks, strict=True)
        if attack.noise_db is not None
    ]
    names += [source.name or source.kind for source in scenario.interference if source.kind == "noise"]
    names += [source.name or source.kind for source in scenario.interference if source.kind != "noise"]
    for name, source in zip(names, (*sky.noises, *sky.jammers), strict=True):
        power = source.power_at(at_s)
        yield PlotLine(
            name=name, kind="multipath", seconds=at_s, values=10.0 * np.log10(np.where(power > 0.0, power, np.nan))
        )


def _reflections(sky: ReceiverSky, at_s: Reals, duration_s: float) -> Iterator[PlotLine]:
    at_s = _select_moments(sky, at_s, duration_s)
    for ray in sky.rays:
        received = sky.signals[ray.of]
        longer_m = SPEED_OF_LIGHT_M_S * ray.further_s(at_s)
        yield PlotLine(
            name=received.id.sat,
            kind="multipath",
            seconds=at_s,
            values=np.where(_is_received_at(received, at_s), longer_m, np.nan),
        )


def _switching(scenario: Scenario, at_s: Reals) -> Iterator[Switching]:
    for name, attack in zip(scenario.attack_names, scenario.attacks, strict=True):
        on = np.any([(at_s >= begin) & (at_s <= end) for begin, end in attack.windows_s], axis=0)
        compared_with = "against the true signals"
        yield Switching(
            name=name,
            what=compared_with,
            role="transmits",
            seconds=at_s,
            power_db=np.where(on, attack.power_at_db(at_s), np.nan),
        )
    for source in scenario.interference:
        until_s = np.inf if source.until_s is None else source.until_s
        on = (at_s >= source.onset_s) & (at_s <= until_s)
        yield Switching(
            name=source.name or source.kind,
            what=f"{_KINDS[source.kind]}, over the noise",
            role="disturbs",
            seconds=at_s,
            power_db=np.where(on, source.power_at_db(at_s), np.nan),
        )


# --- settings


def _settings(scenario: Scenario) -> Iterator[SettingGroup]:
    entries = scenario.model_dump(mode="json", exclude_none=True)
    parts = {key: entries.pop(key) for key in ("receivers", "attacks", "interference", "sky", "front_end")}
    if scenario.navigation is not None:
        entries["navigation"] = Path(scenario.navigation).name
    entries["start_gpst"] = format_instant(entries["start_gpst"])
    for key in ("description", "source"):
        entries.pop(key, None)
    groups = [("Scene", entries), ("Sky", parts["sky"]), ("Front end", parts["front_end"])]
    groups += [(f"Receiver {table['name']}", table) for table in parts["receivers"]]
    groups += [(f"Attack {name}", table) for name, table in zip(scenario.attack_names, parts["attacks"], strict=True)]
    groups += [(f"Interference {table['name'] or table['kind']}", table) for table in parts["interference"]]
    for heading, table in groups:
        yield SettingGroup(heading, tuple(_list_settings(table)))


def _list_settings(table: Any, prefix: str = "") -> Iterator[Setting]:
    """Yield keys and values of the file, without empty or idle ones."""
    path = table.get("path")
    knows_places = isinstance(path, dict) and path["kind"] in ("file", "las-vegas")
    for key, value in table.items():
        if (key in _ANGLES and value == 0.0) or (knows_places and key in _PLACE):
            continue
        where = f"{prefix}{key}"
        if isinstance(value, dict):
            yield from _list_settings(value, f"{where}.")
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for number, item in enumerate(value):
                yield from _list_settings(item, f"{where}[{number}].")
        elif value not in ("", []):
            yield Setting(where, _write_value(value), _unit(where))


def _write_value(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.12g}"
    if isinstance(value, list):
        inside = [f"({_write_value(item)})" if isinstance(item, list) else _write_value(item) for item in value]
        return (" " if isinstance(value[0], list) else ", ").join(inside)
    return str(value)


def _unit(path: str) -> str:
    *before, key = path.split(".")
    if before and before[-1] in _SINGLE:
        return _SINGLE[before[-1]]
    unit = next((unit for suffix, unit in _UNITS.items() if key.endswith(suffix)), "")
    if "_points_" not in key:
        return unit
    return f"{', '.join(['s', *[unit] * (3 if '_enu_' in key else 1)])}" if not key.startswith("points") else unit
