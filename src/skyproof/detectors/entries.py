"""What is registered as a detector, and by which package; nothing of it is imported."""

from importlib.metadata import EntryPoint, entry_points
from typing import Final

__all__ = ["GROUP", "OURS", "of_others", "package_of", "registered"]

GROUP: Final = "skyproof.detectors"
OURS: Final = "skyproof"


def registered() -> list[EntryPoint]:
    """In order of name."""
    return sorted(entry_points(group=GROUP), key=lambda point: point.name)


def package_of(point: EntryPoint) -> str:
    """Name and version."""
    return f"{point.dist.name} {point.dist.version}" if point.dist is not None else "an unknown package"


def of_others() -> dict[str, str]:
    """The names of detectors that are not ours, and the package of each."""
    return {p.name: package_of(p) for p in registered() if p.dist is None or p.dist.name != OURS}
