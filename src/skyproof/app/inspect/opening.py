"""A recording opened as its metadata, its sidecar or the options describe it, and where each fact comes from."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from skyproof.errors import SettingsError, describe_fault
from skyproof.formats.raw import SampleLayout, open_raw_channels, read_sidecar, write_sidecar_text
from skyproof.formats.recording import open_recording
from skyproof.gnss.time import format_iso
from skyproof.records import Samples

__all__ = ["is_described", "open_described", "open_with_keys", "read_as"]


def is_described(path: Path) -> bool:
    """Test whether SigMF or a sidecar describes a file.

    A missing file counts as described, so that their readers report it.
    """
    if ".sigmf" in path.suffix or not path.is_file():
        return True
    return any(path.with_suffix(suffix).exists() for suffix in (".toml", ".sigmf-meta"))


def open_described(
    path: Path, sidecar: str | Path | None
) -> tuple[tuple[Samples, ...], dict[str, str], SampleLayout | None]:
    """Open every channel, with the source of each fact and the layout that a sidecar gives."""
    recordings = open_recording(path, sidecar)
    if recordings[0].format != "raw":
        return recordings, _sources_of(recordings[0], SampleLayout.model_fields, "SigMF metadata"), None
    beside = Path(sidecar) if sidecar is not None else path.with_suffix(".toml")
    stated = read_sidecar(beside)
    return recordings, _sources_of(recordings[0], stated.model_fields_set, f"sidecar {beside.name}"), stated


def open_with_keys(
    path: Path, sidecar: str | Path | None, given: Mapping[str, object]
) -> tuple[tuple[Samples, ...], dict[str, str], SampleLayout | None]:
    """Open every channel with keys of [samples] given beside the sidecar, or without one. // Raises SettingsError."""
    beside = Path(sidecar) if sidecar is not None else path.with_suffix(".toml")
    stated = read_sidecar(beside).model_dump(exclude_unset=True) if sidecar is not None or beside.is_file() else {}
    stated = {key: format_iso(value) if isinstance(value, np.datetime64) else value for key, value in stated.items()}
    try:
        layout = SampleLayout.model_validate({**stated, **given})
    except ValidationError as error:
        faults = "; ".join(
            describe_fault(".".join(map(str, fault["loc"])), fault) for fault in error.errors(include_url=False)
        )
        raise SettingsError(
            f"{path}: the options do not say how to read it: {faults}; give rate_hz, kind, encoding and bits at least"
        ) from error
    recordings = _channels_as(path, layout, "options.toml")
    sources = _sources_of(recordings[0], stated, f"sidecar {beside.name}") | {key: "option" for key in given}
    return recordings, sources, layout


def _sources_of(samples: Samples, stated: Any, by: str) -> dict[str, str]:
    keys = ("encoding", "bits", "kind", "rate_hz", "centre_hz", "if_hz", "start_gpst")
    sources = {key: by if key in stated else "default" for key in keys}
    if samples.start_gpst is None:
        sources["start_gpst"] = "nothing states it"
    return sources | {"duration": "length of the file"}


def read_as(path: Path, layout: SampleLayout, name: str) -> Samples:
    """Read the first channel of raw samples by a layout, as if a sidecar of that name gave it."""
    return _channels_as(path, layout, name)[0]


def _channels_as(path: Path, layout: SampleLayout, name: str) -> tuple[Samples, ...]:
    with tempfile.TemporaryDirectory() as folder:
        written = Path(folder) / name
        written.write_text(write_sidecar_text(layout), encoding="utf-8")
        return open_raw_channels(path, written)
