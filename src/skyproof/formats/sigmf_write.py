"""Write SigMF metadata beyond how to read the samples, and collections of recordings.

Signal Metadata Format, specification 1.2.6: sections Global Object, Captures Array, Annotations Array and Collection
Format. `skyproof.formats.sigmf.meta_from_layout` writes how to read the samples.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

from skyproof.formats.layout import Encoding
from skyproof.formats.raw import SampleLayout
from skyproof.formats.sigmf import meta_from_layout

__all__ = ["fits_sigmf", "make_annotation", "make_geolocation", "write_collection_json", "write_recording_json"]

_PLAIN: Final[tuple[Encoding, ...]] = ("int", "float")


def fits_sigmf(encoding: str, bits: int) -> bool:
    """Return whether SigMF's own data types hold such numbers, so that any reader of SigMF can read them."""
    return encoding in _PLAIN and bits >= 8


def make_annotation(first: int, count: int | None, label: str, comment: str) -> dict[str, Any]:
    """Make an annotation of a stretch of samples with a label; to the end without `count`."""
    of_samples = {} if count is None else {"core:sample_count": count}
    return {"core:sample_start": first} | of_samples | {"core:label": label, "core:comment": comment}


def make_geolocation(lat_deg: float, lon_deg: float, height_m: float) -> dict[str, Any]:
    """Make a point of GeoJSON (RFC 7946): longitude first, height over the ellipsoid."""
    return {"type": "Point", "coordinates": [lon_deg, lat_deg, height_m]}


def write_recording_json(
    layout: SampleLayout,
    *,
    sha512: str,
    place: Mapping[str, Any],
    moves: bool,
    description: str,
    recorder: str,
    hw: str,
    annotations: Sequence[Mapping[str, Any]] = (),
    collection: str | None = None,
) -> str:
    """Write the text of NAME.sigmf-meta.

    place : a `make_geolocation`, of the whole recording, or of its first sample if the receiver `moves`.
    annotations : in any order; they are written by their first sample.
    collection : the name, without ending, of the collection that it belongs to.
    """
    meta = meta_from_layout(layout)
    general, (capture,) = meta["global"], meta["captures"]
    general |= {"core:sha512": sha512, "core:description": description, "core:recorder": recorder, "core:hw": hw}
    if collection is not None:
        general["core:collection"] = collection
    (capture if moves else general)["core:geolocation"] = dict(place)
    meta["annotations"] = sorted(map(dict, annotations), key=lambda one: one["core:sample_start"])
    return json.dumps(meta, indent=1, ensure_ascii=False) + "\n"


def write_collection_json(recordings: Mapping[str, bytes], *, description: str) -> str:
    """Write NAME.sigmf-collection: recordings by name without ending, each with its metadata's bytes.

    Order is kept.
    """
    streams = [{"name": name, "hash": hashlib.sha512(meta).hexdigest()} for name, meta in recordings.items()]
    head = {"core:version": "1.2.6", "core:description": description}
    return json.dumps({"collection": head | {"core:streams": streams}}, indent=1, ensure_ascii=False) + "\n"
