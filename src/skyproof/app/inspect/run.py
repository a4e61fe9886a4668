"""What is in a recording, and is it usable: by its description, or in the reading that shows satellites."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from skyproof.app.inspect.inspection import Inspection
from skyproof.app.inspect.log import LogInspection, holds_measurements, inspect_log
from skyproof.app.inspect.opening import is_described, open_described, open_with_keys
from skyproof.app.inspect.signals import inspect_recording
from skyproof.app.inspect.undescribed import inspect_by_guess

__all__ = ["inspect"]


def inspect(
    path: str | Path,
    *,
    sidecar: str | Path | None = None,
    layout: Mapping[str, object] | None = None,
    write: bool | int = False,
) -> tuple[Inspection | LogInspection, ...]:
    """Describe what is in a recording: one `Inspection` for each channel that the file holds; or what is in a log.

        (inspection,) = sp.inspect("rx1.bin")
        print(inspection.summary, inspection.satellites)

    A receiver's log or observation file gives one `LogInspection`. Any other file that nothing describes is read in the
    way that shows satellites, if there is one.

    Parameters
    ----------
    path : any file that `skyproof.formats.recording.open_recording` opens, or raw samples that nothing describes.
    sidecar : how to read raw samples; NAME.toml beside NAME.bin if not given.
    layout : keys of a sidecar's table [samples], which go before those of the sidecar and may stand for it.
    write : whether to write NAME.toml for a file that nothing describes; a number takes that of `proposals`, from 1 on,
        in place of the best. What is there already is never overwritten.

    Returns
    -------
    tuple of Inspection : one for each channel; of a log or an observation file a `LogInspection`.

    Raises
    ------
    InputError : the file cannot be opened or read. SettingsError : the layout makes no sense.
    NotUnderstood : nothing describes the file, and nothing in it does. NotEnoughData : fewer than two code periods.
    """
    path = Path(path)
    keys = {key: value for key, value in (layout or {}).items() if value is not None}
    if keys:
        recordings, sources, used = open_with_keys(path, sidecar, keys)
    elif sidecar is not None or is_described(path):
        recordings, sources, used = open_described(path, sidecar)
    elif holds_measurements(path):
        return (inspect_log(path),)
    else:
        return (inspect_by_guess(path, write),)
    found = [inspect_recording(samples) for samples in recordings]
    return tuple(
        replace(inspection, sources=sources | _correction_sources(inspection), layout=used) for inspection in found
    )


def _correction_sources(found: Inspection) -> dict[str, str]:
    """Name the source of the value that replaces a wrong one of the description."""
    if found.given is None:
        return {}
    key = "rate_hz" if found.given.rate_hz != found.samples.rate_hz else "if_hz"
    return {key: f"measured: codes against carriers; given: {getattr(found.given, key):.12g}"}
