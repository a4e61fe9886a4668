"""A scene on disk: for each receiver NAME.bin and its sidecar NAME.toml, and truth.json."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from skyproof.errors import OutputError
from skyproof.formats.raw import SampleLayout, sidecar_text
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import NavigationData
from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.gnss.time import iso
from skyproof.simulate.heard import ReceiverSky, Scene
from skyproof.simulate.platforms import Point
from skyproof.simulate.samples import BLOCK, Rendering, ahead_of, quantised, rendering_of, rough_start
from skyproof.simulate.scenario import Place, Scenario
from skyproof.simulate.sky import scene_of

__all__ = ["truth_of", "write"]

Reals = NDArray[np.float64]


def write(
    scenario: Scenario, navigation: NavigationData, folder: Path, *, progress: Callable[[int, int], None] | None = None
) -> list[Path]:
    """Render a scene into `folder`, which is made if need be; memory does not grow with the duration.

    Parameters
    ----------
    progress : called with the samples done and the samples in all receivers together.

    Returns
    -------
    list of Path : NAME.bin of each receiver; NAME.toml and truth.json lie beside them.

    Raises
    ------
    ScenarioError : as `scene_of`.
    OutputError : the folder or a file cannot be written.
    """
    scene = scene_of(scenario, navigation)
    renderings = [rendering_of(scene, index) for index in range(len(scene.skies))]
    total, done = sum(rendering.n_samples for rendering in renderings), 0
    paths = [folder / f"{rendering.sky.name}.bin" for rendering in renderings]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        truth = json.dumps(truth_of(scenario, navigation), indent=1) + "\n"
        (folder / "truth.json").write_text(truth, encoding="utf-8")
        for rendering, path in zip(renderings, paths, strict=True):
            path.with_suffix(".toml").write_text(sidecar_text(_layout(scene, rendering)), encoding="utf-8")
            with open(path, "wb") as file:
                blocks = range(-(-rendering.n_samples // BLOCK))
                for octets, count in ahead_of(partial(_packed_block, rendering), blocks):
                    file.write(octets)
                    done += count
                    if progress is not None:
                        progress(done, total)
    except OSError as error:
        raise OutputError(
            f"{error.filename or folder}: cannot be written ({error.strerror or error}); give a folder that can, with "
            f"room for {total} samples"
        ) from error
    return paths


def truth_of(scenario: Scenario, navigation: NavigationData) -> dict[str, Any]:
    """The right answers, as truth.json holds them: who is where, what is false from when to when, what it shows."""
    scene = scene_of(scenario, navigation)
    return {
        "scene": scenario.name,
        "start_gpst": iso(scenario.start_gpst, 9),
        "duration_s": scenario.duration_s,
        "scenario": scenario.model_dump(mode="json"),
        "receivers": [_receiver_truth(scene, sky) for sky in scene.skies],
        "attacks": [_attack_truth(scene, number) for number in range(len(scenario.attacks))],
    }


def _receiver_truth(scene: Scene, sky: ReceiverSky) -> dict[str, Any]:
    receiver = sky.receiver
    return {
        "name": sky.name,
        "position": _place(receiver),
        "true_start_gpst": iso(_later(scene, receiver.start_offset_s), 9),
        "clock_offset_at_start_s": receiver.clock_offset_s,
        "lo_ppm": receiver.lo_ppm,
        "signals": _signal_truths(scene, sky),
    }


def _signal_truths(scene: Scene, sky: ReceiverSky) -> list[dict[str, Any]]:
    """One row a signal; the values are those at the first and the last moment of the recording when it is there."""
    start_s, end_s = sky.receiver.start_offset_s, sky.receiver.start_offset_s + scene.scenario.duration_s
    authentic = {heard.id.sat: column for column, heard in enumerate(sky.signals) if heard.label == "authentic"}
    rows = []
    for column, heard in enumerate(sky.signals):
        ends_s = np.clip([heard.from_s, heard.until_s], start_s, end_s)
        code_m = SPEED_OF_LIGHT_M_S * sky.code_delay_s(ends_s)
        lag_m = code_m[:, column] - code_m[:, authentic[heard.id.sat]] if heard.id.sat in authentic else None
        rows.append({
            "sat": heard.id.sat, "copy": heard.id.copy, "label": heard.label, "source": heard.source,
            "from_gpst": iso(_later(scene, ends_s[0]), 9), "to_gpst": iso(_later(scene, ends_s[1]), 9),
            "cn0_dbhz_first_last": _rounded(sky.cn0_dbhz(ends_s)[:, column], 3),
            "az_deg_first_last": _rounded(_degrees(ends_s, sky.knots_s, np.unwrap(sky.az_rad[:, column])) % 360.0, 3),
            "el_deg_first_last": _rounded(_degrees(ends_s, sky.knots_s, sky.el_rad[:, column]), 3),
            "delay_to_authentic_m_first_last": None if lag_m is None else _rounded(lag_m, 4),
        })  # fmt: skip
    return rows


def _attack_truth(scene: Scene, number: int) -> dict[str, Any]:
    scenario, attack = scene.scenario, scene.scenario.attacks[number]
    name = scenario.attack_names[number]
    return {
        "name": name,
        "kind": attack.kind,
        "transmit_antenna": _place(attack.transmit),
        "onset_gpst": iso(_later(scene, attack.onset_s), 9),
        "until_gpst": None if attack.until_s is None else iso(_later(scene, attack.until_s), 9),
        "onset_means": "first wave leaves the transmit antenna at this GPS time",
        "sats": sorted({heard.id.sat for sky in scene.skies for heard in sky.signals if heard.source == name}),
        "captured_receiver_shows_position": _geodetic(scene.shown[number], attack.onset_s),
        "captured_clock_extra_s": {
            sky.name: attack.added_delay_s + float(path_m) / SPEED_OF_LIGHT_M_S
            for sky, path_m in zip(scene.skies, scene.path_m[number], strict=True)
        },
    }  # fmt: skip


def _geodetic(point: Point, at_s: float) -> dict[str, float]:
    lat_rad, lon_rad, height_m = geodetic_from_ecef(point(np.array([at_s])).position_ecef_m[0])
    return {
        "lat_deg": round(float(np.degrees(lat_rad)), 11), "lon_deg": round(float(np.degrees(lon_rad)), 11),
        "height_m": round(float(height_m), 6),
    }  # fmt: skip


def _place(place: Place) -> dict[str, float]:
    return {"lat_deg": place.lat_deg, "lon_deg": place.lon_deg, "height_m": place.height_m}


def _later(scene: Scene, true_s: float) -> np.datetime64:
    later: np.datetime64 = scene.scenario.start_gpst + np.timedelta64(round(true_s * 1e9), "ns")
    return later


def _degrees(at_s: Reals, knots_s: Reals, angle_rad: Reals) -> Reals:
    return np.degrees(np.interp(at_s, knots_s, angle_rad))


def _rounded(values: Reals, digits: int) -> list[float]:
    return [round(float(value), digits) for value in values]


def _layout(scene: Scene, rendering: Rendering) -> SampleLayout:
    front_end = rendering.front_end
    return SampleLayout.model_validate({
        "rate_hz": front_end.rate_hz, "centre_hz": rendering.sky.signal.carrier_hz, "if_hz": front_end.if_hz,
        "kind": front_end.kind, "encoding": front_end.encoding, "bits": front_end.bits, "bit_order": "msb-first",
        "start_gpst": iso(rough_start(scene, rendering.sky), 0),
    })  # fmt: skip


def _packed_block(rendering: Rendering, block: int) -> tuple[bytes, int]:
    planes = quantised(rendering, block)
    rows = planes[:1] if rendering.front_end.kind == "real" else planes
    return _packed(rows, rendering.front_end.encoding, rendering.front_end.bits), planes.shape[1]


def _packed(rows: NDArray[np.float32], encoding: str, bits: int) -> bytes:
    """Quantised values (numbers of a sample, n) as bytes, in the conventions of `skyproof.formats.raw`."""
    if bits >= 8:
        return np.ascontiguousarray(rows.T).astype(f"<{encoding[0]}{bits // 8}").tobytes()
    octets = np.empty(rows.size * bits // 8, np.uint8)
    _pack(rows, bits, octets)
    return octets.tobytes()


@numba.njit(cache=True, nogil=True)
def _pack(rows: NDArray[np.float32], bits: int, octets: NDArray[np.uint8]) -> None:
    """Sign, and with two bits magnitude (1 or 3), first number in the highest bits. NumPy takes 4 times as long."""
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
