"""One module a paper: its figures, and ours beside them. `studies` finds them all."""

import importlib
import pkgutil

from skyproof.studies.base import Study

__all__ = ["studies"]

_PAPERS = (
    "multi_receiver",
    "multi_receiver_power",
    "jammer_to_noise",
    "dccaf",
    "inverse_raim",
    "vector_sqm",
    "ins_array",
    "spin",
)
"""Order in which papers are listed; others come after them, by name."""


def studies() -> dict[str, Study]:
    """Collect every study by its name, paper by paper, in the order of each module's `STUDIES`.

    Raises
    ------
    ValueError : two studies have the same name.
    """
    names = [found.name for found in pkgutil.iter_modules(__path__)]
    names.sort(key=lambda name: (_PAPERS.index(name) if name in _PAPERS else len(_PAPERS), name))
    found: dict[str, Study] = {}
    for name in names:
        for study in getattr(importlib.import_module(f"{__name__}.{name}"), "STUDIES", ()):
            if study.name in found:
                raise ValueError(f"two studies are named {study.name}")
            found[study.name] = study
    return found
