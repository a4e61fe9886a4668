"""Sources of false signals, and open skies, as the document has them: from where, at which distance, how late."""

from typing import Any

import numpy as np

from skyproof.app.protect.bearings import Bearing, ellipse_95
from skyproof.app.protect.outcome import DIGITS, Outcome
from skyproof.app.protect.positions import Track, place_of
from skyproof.fusion.fuse import Decision
from skyproof.fusion.labels import FalseSource
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.time import format_iso
from skyproof.records import (
    Direction,
)
from skyproof.verdict import Source as SourceModel
from skyproof.verdict import (
    SourceDirection,
    SourcePlace,
)

__all__ = ["describe_direction", "describe_distance", "describe_origin", "list_sources"]


def list_sources(outcome: Outcome) -> list[SourceModel]:
    models = []
    for source in (*outcome.decision.sources, *outcome.decision.skies):
        tracks = [r.tracks[source.name] for r in outcome.receivers if source.name in r.tracks]
        places = [track.last.position_ecef_m[0] for track in tracks]
        models.append(
            SourceModel(
                name=source.name,
                kind=_kind(source, outcome.decision),
                sats=tuple(sorted({ref.signal.sat for ref in source.signals})),
                **describe_origin(source, outcome),
                stands=_describe_place(outcome.bearings.get(source.name)),
                shows=place_of(places[0]) if places else None,
                shows_gpst=format_iso(tracks[0].last.gpst[0], DIGITS) if tracks else None,
                time_offset_s=_estimate_delay_s(source.name, outcome),
            )
        )
    return models


def _describe_place(bearing: Bearing | None) -> SourcePlace | None:
    """Describe the place where a source's rays meet."""
    if bearing is None or bearing.meets is None:
        return None
    place = place_of(bearing.meets.position_ecef_m)
    lat, lon, _ = geodetic_from_ecef(bearing.meets.position_ecef_m)
    up = rot_enu_ecef(lat, lon)[2]
    major_m, minor_m, azimuth_deg = ellipse_95(bearing.meets)
    return SourcePlace(
        lat_deg=place.lat_deg,
        lon_deg=place.lon_deg,
        height_m=place.height_m,
        sigma_up_m=float(np.sqrt(up @ bearing.meets.covariance_m2 @ up)),
        ellipse_major_m=major_m,
        ellipse_minor_m=minor_m,
        ellipse_azimuth_deg=azimuth_deg,
    )


def describe_distance(bearing: Bearing | None) -> str:
    """Describe how far away the rays meet, if they do."""
    if bearing is None or bearing.meets is None:
        return ""
    away_m = [np.linalg.norm(bearing.meets.position_ecef_m - ray.place_ecef_m) for ray in bearing.last.values()]
    return f", {float(min(away_m)) / 1e3:.2g} km away at last"


def describe_origin(source: FalseSource, outcome: Outcome) -> dict[str, Any]:
    """Describe from where a source's signals come, by the window with the best directions.

    What windows share does not average out.
    """
    signals = frozenset(source.signals)
    seen = [e.directions for e in outcome.evidence if e.directions and signals.issuperset(e.signals)]
    best = min(seen, key=lambda directions: directions[0].sigma_rad, default=())
    directions = tuple(_source_direction(direction) for direction in best)
    keys = dict.fromkeys(("azimuth_deg", "elevation_deg", "direction_sigma_deg"))
    if len(directions) != 1:
        return {**keys, "directions": directions}
    (only,) = directions
    body = "body_" if only.frame == "body" else ""
    angles = {f"{body}azimuth_deg": only.azimuth_deg, f"{body}elevation_deg": only.elevation_deg}
    return {**keys, **angles, "direction_sigma_deg": float(np.degrees(best[0].sigma_rad)), "directions": directions}


def describe_direction(seen: dict[str, Any]) -> str:
    """Describe where a source is seen, if that is one direction; empty else."""
    for body, whose in (("", ""), ("body_", " of the body")):
        azimuth_deg, elevation_deg = seen.get(f"{body}azimuth_deg"), seen.get(f"{body}elevation_deg")
        if azimuth_deg is not None and elevation_deg is not None:
            return (
                f" at azimuth {azimuth_deg:.0f}, elevation {elevation_deg:.0f} degrees{whose} "
                f"(one sigma {seen['direction_sigma_deg']:.1f})"
            )
    return ""


def _source_direction(direction: Direction) -> SourceDirection:
    along, up = np.sqrt(np.diag(direction.covariance_rad2))
    return SourceDirection(
        frame="ground" if direction.frame == "enu" else "body",
        azimuth_deg=float(np.degrees(direction.azimuth_rad)),
        elevation_deg=float(np.degrees(direction.elevation_rad)),
        along_sigma_deg=float(np.degrees(along)),
        up_sigma_deg=float(np.degrees(up)),
        correlation=float(np.clip(direction.covariance_rad2[0, 1] / (along * up), -1.0, 1.0)),
    )


def _kind(source: FalseSource, decision: Decision) -> str:
    if source in decision.skies:
        return "a consistent sky; whether the true one is not decided"
    return (
        "one antenna" if source.one_antenna else "a false sky beside the true one; from how many antennas is not known"
    )


def _estimate_delay_s(name: str, outcome: Outcome) -> float | None:
    """Estimate how late a source's signals are, by the first receiver that shows it.

    Its clock bias from them minus that from authentic ones; with open skies, minus that from the sky that arrives
    first.
    """
    for r in outcome.receivers:
        trusted, tracks = r.tracks.get("trusted"), r.shown
        if name not in tracks or (trusted is None and len(tracks) < 2):
            continue
        reference = [trusted] if trusted is not None else list(tracks.values())
        offsets = [_median_difference_s(tracks[name], other) for other in reference]
        known = [offset for offset in offsets if offset is not None]
        if known:
            return max(known) if trusted is None else known[0]
    return None


def _median_difference_s(a: Track, b: Track) -> float | None:
    difference = a.clock_bias_s - b.clock_bias_s
    difference = difference[np.isfinite(difference)]
    return float(np.median(difference)) if difference.size else None
