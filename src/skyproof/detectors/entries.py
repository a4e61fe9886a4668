"""List what is registered as a detector, and by which package; nothing of it is imported."""

from importlib.metadata import EntryPoint, entry_points
from typing import Final

__all__ = ["GROUP", "OURS", "list_foreign", "list_registered", "package_of"]

GROUP: Final = "skyproof.detectors"
OURS: Final = "skyproof"


def list_registered() -> list[EntryPoint]:
    """List the registered detectors in order of name."""
    return sorted(entry_points(group=GROUP), key=lambda point: point.name)


def package_of(point: EntryPoint) -> str:
    """Return the name and version of the package that registers a detector."""
    return f"{point.dist.name} {point.dist.version}" if point.dist is not None else "an unknown package"


def list_foreign() -> dict[str, str]:
    """List the names of detectors that are not ours, with their packages."""
    return {p.name: package_of(p) for p in list_registered() if p.dist is None or p.dist.name != OURS}
