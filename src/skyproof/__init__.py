"""skyproof tells true satellite-navigation signals from false ones, and gives the true position and time back.

    import skyproof as sp

    verdict = sp.protect(["rx1.bin", "rx2.bin"], nav="brdc0010.22n")
    observations = sp.receive("rx1.bin", nav="brdc0010.22n").observations

The vocabulary is `skyproof.records` and `skyproof.verdict`. Frames are ECEF WGS-84, instants are GPS time as
numpy.datetime64[ns], angles are radians inside and degrees where a name says so, units stand in the names.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from skyproof.app.protect import protect as _protect
from skyproof.app.receive import receive
from skyproof.verdict import Verdict

__all__ = ["protect", "receive"]


def protect(
    inputs: str | Path | Sequence[str | Path], *, nav: str | Path | None = None, out: str | Path | None = None,
    **options: Any,
) -> Verdict:
    """The verdict on recordings of one or several receivers; with `out`, all output files as well.

    Parameters and errors are those of `skyproof.app.protect.protect`, which also gives everything behind the verdict.
    """
    paths = [inputs] if isinstance(inputs, str | Path) else list(inputs)
    return _protect(paths, nav=nav, out=out, **options).verdict
