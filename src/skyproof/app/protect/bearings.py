"""From where the sources of false signals are seen, as rays on the ground, and where those meet."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from skyproof.app.protect.positions import Track
from skyproof.arrays import Reals
from skyproof.fusion.labels import FalseSource
from skyproof.fusion.policy import POLICY
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.time import seconds_between
from skyproof.navigation.bearings import BearingRay, Meeting, locate_transmitter
from skyproof.records import Direction, Finding

__all__ = ["Bearing", "ellipse_95", "find_bearings"]

_FAR_M: Final = 10e3
"""Rays are drawn so far where nothing says how far they go."""
_EDGE_SIGMAS: Final = 2.0
_RADIUS_95: Final = 2.4477  # of two degrees, in sigmas
_RING: Final = 36


@dataclass(frozen=True, eq=False, kw_only=True)
class Bearing:
    """A source, the last ray to it from each receiver, and where its rays meet, if they do."""

    source: FalseSource
    last: dict[str, BearingRay]
    meets: Meeting | None

    def draw(self) -> Iterator[tuple[str, Reals, Reals]]:
        """Yield the shapes of each receiver's ray: the ray (2, 3) and a wedge (4, 3), in ECEF.

        The wedge spans two sigmas to either side; both are level with the receiver.
        """
        for receiver, ray in self.last.items():
            reach_m = _FAR_M if self.meets is None else np.linalg.norm(self.meets.position_ecef_m - ray.place_ecef_m)
            edge_rad = _EDGE_SIGMAS * float(np.sqrt(ray.covariance_rad2[0, 0])) / max(np.cos(ray.elevation_rad), 0.1)
            here = ray.place_ecef_m
            ahead, left, right = (
                _level(ray, ray.azimuth_rad + turn, float(reach_m)) for turn in (0.0, -edge_rad, edge_rad)
            )
            yield f"{self.source.name} from {receiver}", np.stack([here, ahead]), np.stack([here, left, right, here])

    def ring(self) -> Reals | None:
        """Return the ellipse (n, 3) around the source with 95 % horizontally, in ECEF; None if rays do not meet."""
        if self.meets is None:
            return None
        east_north, turn = _horizontal(self.meets)
        values, vectors = np.linalg.eigh(east_north)
        angle = np.linspace(0.0, 2.0 * np.pi, _RING + 1)
        circle = np.stack([np.cos(angle), np.sin(angle)]) * (_RADIUS_95 * np.sqrt(values))[:, None]
        return np.asarray(self.meets.position_ecef_m + (vectors @ circle).T @ turn[:2])


def find_bearings(
    sources: Sequence[FalseSource], evidence: Sequence[Finding], trusted: Mapping[str, Track]
) -> Iterator[Bearing]:
    """Yield the bearing of every source seen in one direction by receivers at trusted places.

    trusted : by the receiver's name.
    """
    for source in sources:
        rays = _list_rays(source, evidence, trusted)
        if rays:
            some = [rays[k][1] for k in np.unique(np.linspace(0, len(rays) - 1, POLICY.rays).astype(int))]
            found = locate_transmitter(some)
            meets = found is not None and found.p_value >= POLICY.moved_p_value
            yield Bearing(source=source, last=dict(rays), meets=found if meets else None)


def ellipse_95(found: Meeting) -> tuple[float, float, float]:
    """Return half axes and azimuth of the ellipse that holds 95 % horizontally.

    Half axes in metres, the greater first; its azimuth in degrees.
    """
    values, vectors = np.linalg.eigh(_horizontal(found)[0])
    azimuth_deg = float(np.degrees(np.arctan2(*vectors[:, 1]))) % 180.0
    return _RADIUS_95 * float(np.sqrt(values[1])), _RADIUS_95 * float(np.sqrt(values[0])), azimuth_deg


def _horizontal(found: Meeting) -> tuple[Reals, Reals]:
    """Return the covariance (2, 2) to the east and north, and the rotation from ECEF to east, north, up."""
    lat, lon, _ = geodetic_from_ecef(found.position_ecef_m)
    turn = rot_enu_ecef(lat, lon)
    return np.asarray((turn @ found.covariance_m2 @ turn.T)[:2, :2]), turn


def _level(ray: BearingRay, azimuth_rad: float, reach_m: float) -> Reals:
    lat, lon, _ = geodetic_from_ecef(ray.place_ecef_m)
    east_north = reach_m * np.array([np.sin(azimuth_rad), np.cos(azimuth_rad)])
    return np.asarray(ray.place_ecef_m + east_north @ rot_enu_ecef(lat, lon)[:2])


def _list_rays(
    source: FalseSource, evidence: Sequence[Finding], trusted: Mapping[str, Track]
) -> list[tuple[str, BearingRay]]:
    """List the source's rays with their receivers, in the order of time."""
    signals = frozenset(source.signals)
    rays = []
    for e in evidence:
        if e.says != "spoofed" or len(e.directions) != 1 or not signals.issuperset(e.signals):
            continue
        receiver, direction = e.signals[0].receiver, e.directions[0]
        if direction.frame == "enu" and receiver in trusted:
            middle = e.start_gpst + (e.end_gpst - e.start_gpst) // 2
            half_s = 0.5 * seconds_between(e.end_gpst, e.start_gpst)
            if (ray := _build_ray(trusted[receiver], middle, half_s + POLICY.ray_beside_s, direction)) is not None:
                rays.append((receiver, ray))
    return rays


def _build_ray(track: Track, gpst: np.datetime64, within_s: float, direction: Direction) -> BearingRay | None:
    """Build the ray from where the receiver was nearest to an instant."""
    fixed = np.flatnonzero(track.fixed)
    apart_s = np.abs(seconds_between(track.gpst[fixed], gpst))
    if not fixed.size or apart_s.min() > within_s:
        return None
    return BearingRay(
        place_ecef_m=track.position_ecef_m[fixed[np.argmin(apart_s)]],
        place_covariance_m2=track.last.covariance_m2[0, :3, :3],
        azimuth_rad=direction.azimuth_rad,
        elevation_rad=direction.elevation_rad,
        covariance_rad2=direction.covariance_rad2,
        body="platform",
    )
