"""A scene as somebody with certain equipment receives it, and what that somebody states in a platform file.

The first receiver of the scene stays where it is; what it has besides is put there.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.oscillators import PLATFORM_CLASSES
from skyproof.simulator.scenario import Antenna, Scenario, SceneImu, SceneReceiver, SceneSpin
from skyproof.simulator.sites import LasVegas

__all__ = ["EQUIPMENT", "Equipped", "equip"]

APART_M: Final = 20.0
ELEMENTS_M: Final = ((0.0, 0.0, 0.0), (0.1903, 0.0, 0.0), (0.09515, 0.1648, 0.0))
"""A level triangle, a wavelength of L1 on each side."""
GRADE, ATTITUDE_DEG = "tactical", 0.5
ARM: Final = SceneSpin(radius_m=0.0951, rate_hz=0.25)
RATE_SIGMA_HZ: Final = 1e-3


@dataclass(frozen=True, kw_only=True)
class Equipped:
    """scenario : with this equipment. stated : the platform file, but for the names of files and the attitude at the
    start, which are known when the scene is made."""

    scenario: Scenario
    stated: Mapping[str, Any]

    @property
    def first(self) -> SceneReceiver:
        return self.scenario.receivers[0]

    def with_first(self, stated: Mapping[str, Any] | None = None, **changes: Any) -> "Equipped":
        """Change something at the first receiver, and in its table."""
        receivers = (self.first.model_copy(update=changes), *self.scenario.receivers[1:])
        table = dict(self.stated["receivers"][0]) | dict(stated or {})
        return Equipped(
            scenario=self.scenario.model_copy(update={"receivers": receivers}),
            stated=dict(self.stated) | {"receivers": [table, *self.stated["receivers"][1:]]},
        )

    def stating(self, **stated: Any) -> "Equipped":
        return Equipped(scenario=self.scenario, stated=dict(self.stated) | stated)


Having = Callable[[Equipped], Equipped | None]
"""None where the scene cannot have it."""


def _nothing(bare: Equipped) -> Equipped:
    return bare


def _standing(bare: Equipped) -> Equipped | None:
    """State that it stands, and what class of oscillator it has."""
    if bare.first.path is not None:
        return None
    return bare.stating(motion="static", **_oscillator(bare.first))


def _oscillator(receiver: SceneReceiver) -> dict[str, str]:
    """Find the least class of a platform file that is no better than the receiver's own."""
    known = (receiver.oscillator or "").split("-")[0]
    return {"oscillator": known} if known in PLATFORM_CLASSES else {}


def _imu(bare: Equipped) -> Equipped:
    """Add readings of 100 Hz, with the attitude at the start known to half a degree."""
    imu = SceneImu(grade=GRADE, rate_hz=100.0)
    return bare.with_first(imu=imu).stating(imu={"grade": GRADE})


def _second(bare: Equipped) -> Equipped | None:
    """Add a receiver to the east of the first, with a clock of its own; the distance is stated."""
    if isinstance(bare.first.path, LasVegas):  # its way is where it is, wherever its site is said to be
        return None
    here_m = ecef_from_geodetic(*bare.first.geodetic_rad)
    there_m = here_m + rot_enu_ecef(*bare.first.geodetic_rad[:2]).T @ np.array([APART_M, 0.0, 0.0])
    lat_rad, lon_rad, height_m = (float(value) for value in geodetic_from_ecef(there_m))
    second = bare.first.model_copy(
        update={
            "name": f"{bare.first.name}-east",
            "lat_deg": float(np.degrees(lat_rad)),
            "lon_deg": float(np.degrees(lon_rad)),
            "height_m": height_m,
            "start_offset_s": bare.first.start_offset_s + 4.3e-5,
            "clock_offset_s": bare.first.clock_offset_s - 2.6e-4,
            "lo_ppm": bare.first.lo_ppm - 0.7,
            "antennas": bare.first.antennas[:1],
            "imu": None,
        }
    )
    return Equipped(
        scenario=bare.scenario.model_copy(update={"receivers": (bare.first, second)}),
        stated=dict(bare.stated)
        | {"receivers": [*bare.stated["receivers"], {"name": second.name}]}
        | {"protect": {**bare.stated.get("protect", {}), "antenna_distance_m": APART_M}},
    )


def _three(bare: Equipped) -> Equipped:
    """Add three antennas whose places in the body are stated; line biases and attitude are not."""
    gain = bare.first.antennas[0].gain
    antennas = tuple(Antenna(name=name, body_m=at, gain=gain) for name, at in zip("ABC", ELEMENTS_M, strict=True))
    return bare.with_first({"antennas_m": ELEMENTS_M}, antennas=antennas)


def _three_and_imu(bare: Equipped) -> Equipped:
    return _imu(_three(bare))


def _spinning(bare: Equipped) -> Equipped:
    """Put the antenna on a turning arm, whose radius and rate are stated."""
    antenna = bare.first.antennas[0].model_copy(update={"spin": ARM})
    spin = {"radius_m": ARM.radius_m, "rate_hz": ARM.rate_hz, "rate_sigma_hz": RATE_SIGMA_HZ}
    return bare.with_first({"spin": spin}, antennas=(antenna,))


def _vector(bare: Equipped) -> Equipped:
    return bare.stating(protect={"tracking": "vector"})


def _everything(bare: Equipped) -> Equipped:
    """Combine all equipment: standing where it does, three antennas, an inertial unit, a second receiver."""
    whole = _three_and_imu(_standing(bare) or bare)
    return _second(whole) or whole


EQUIPMENT: Final[Mapping[str, Having]] = {
    "one receiver": _nothing,
    "standing": _standing,
    "with IMU": _imu,
    "second receiver at 20 m": _second,
    "three antennas": _three,
    "three antennas and IMU": _three_and_imu,
    "spinning": _spinning,
    "vector tracking": _vector,
    "everything": _everything,
}


def equip(scenario: Scenario, equipment: str) -> Equipped | None:
    """Build a scene with equipment of this name at its first receiver; None where it cannot have it."""
    first = scenario.receivers[0]
    plain = first.antennas[0].model_copy(update={"body_m": (0.0, 0.0, 0.0), "line_bias_cyc": 0.0, "spin": None})
    bare = first.model_copy(update={"antennas": (plain,), "imu": None})
    return EQUIPMENT[equipment](
        Equipped(
            scenario=scenario.model_copy(update={"receivers": (bare,)}), stated={"receivers": [{"name": first.name}]}
        )
    )
