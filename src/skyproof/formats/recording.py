"""Open any recording of samples, by what kind of file it is."""

import os
from pathlib import Path

from skyproof.errors import InputError
from skyproof.formats.npy import open_npy
from skyproof.formats.raw import open_raw_channels
from skyproof.formats.sigmf import open_sigmf
from skyproof.records import Samples

__all__ = ["open_recording"]

_PACKED = (".sigmf.gz", ".sigmf.xz", ".sigmf.zip")


def open_recording(
    path: str | os.PathLike[str], sidecar: str | os.PathLike[str] | None = None, *, dead: bool = False
) -> tuple[Samples, ...]:
    """Open the recordings that a file holds: SigMF and NumPy by its names, anything else as raw samples with a sidecar.

    Raw samples that have no sidecar NAME.toml, but NAME.sigmf-meta beside them, are read as that says.

    Parameters
    ----------
    path : NAME.sigmf-meta, NAME.sigmf-data, the archive NAME.sigmf, NAME.npy, or a file of raw samples.
    sidecar : how to read raw samples; not for SigMF, except to read NAME.sigmf-data otherwise than its metadata say.
    dead : keep channels that never change, as `open_raw_channels` does.

    Returns
    -------
    tuple of Samples : one for each channel, as `open_raw_channels` and `open_sigmf` give them.

    Raises
    ------
    InputError : as `open_raw_channels` and `open_sigmf`; a container that is not read.
    """
    path = Path(path)
    if path.name.endswith(_PACKED):
        raise InputError(f"{path}: a compressed archive would have to be unpacked as a whole; unpack it first")
    if path.suffix == ".sigmf-collection":
        raise InputError(f"{path}: a collection holds names only; give the .sigmf-meta of each recording in it")
    if path.suffix == ".toml":
        raise InputError(f"{path}: a settings file, which holds no samples; give the recording itself")
    if path.suffix == ".npy":
        return open_npy(path, sidecar, dead=dead)
    if sidecar is not None:
        if path.suffix in (".sigmf-meta", ".sigmf"):
            raise InputError(f"{path}: states itself how to read its samples; remove the sidecar {sidecar}")
        return open_raw_channels(path, sidecar, dead=dead)
    if path.suffix in (".sigmf-meta", ".sigmf-data", ".sigmf"):
        return open_sigmf(path, dead=dead)
    if path.is_file() and not path.with_suffix(".toml").exists() and path.with_suffix(".sigmf-meta").exists():
        return open_sigmf(path, dead=dead)
    return open_raw_channels(path, dead=dead)
