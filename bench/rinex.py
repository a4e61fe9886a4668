"""How long a RINEX observation file takes, and the same by georinex where that is installed."""

import importlib
import importlib.util
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import numpy as np
from timing import Spread, line, take_turns

from skyproof.formats.rinex_obs_read import read_obs

EPOCHS, SATS = 900, 50  # a quarter of an hour at 1 Hz; a day is 96 of them
UNIT = "s/100k sat-ep"


def report() -> Iterator[str]:
    """Seconds of one core for 100 000 satellites' records of four signals with code, phase, Doppler and C/N0."""
    georinex = importlib.import_module("georinex") if importlib.util.find_spec("georinex") else None
    with TemporaryDirectory() as folder:
        whole, part = Path(folder) / "whole.rnx", Path(folder) / "part.rnx"
        _write(whole, EPOCHS)
        _write(part, 30)  # georinex needs minutes for the whole
        readers: list[tuple[str, int, Callable[[], object]]] = [
            ("all signals", EPOCHS, lambda: read_obs(whole)),
            ("L1 C/A alone", EPOCHS, lambda: read_obs(whole, keep=lambda signal: signal.code == "CA")),
        ]
        if georinex is not None:
            readers.append(("georinex, all signals", 30, lambda: georinex.load(part)))
        figures = take_turns(*(read for _, _, read in readers), runs=3, clock=process_time)
        yield f"RINEX 3.04 observations, {SATS} satellites, {whole.stat().st_size / 1e6:.0f} MB"
        for (what, epochs, _), seconds in zip(readers, figures, strict=True):
            per: Spread = seconds * (1e5 / (epochs * SATS))
            yield line(what, per, UNIT, f"a day at 1 Hz: {per.median * 864 * SATS / 1000:.0f} s")
        if georinex is None:
            yield "  georinex is not installed; `pip install georinex` to have it beside"


def _write(path: Path, epochs: int) -> None:
    """Four signals of each of the satellites of GPS at every second."""
    rng = np.random.default_rng(1)
    types = [kind + signal for signal in ("1C", "1W", "2W", "5Q") for kind in "CLDS"]
    lines = [
        f"{'     3.04           OBSERVATION DATA    G':60}RINEX VERSION / TYPE",
        f"{'        0.0000        0.0000        0.0000':60}APPROX POSITION XYZ",
        f"{'G   16 ' + ' '.join(types[:13]):60}SYS / # / OBS TYPES",
        f"{'       ' + ' '.join(types[13:]):60}SYS / # / OBS TYPES",
        f"{'  2024    10    27     0     0    0.0000000     GPS':60}TIME OF FIRST OBS",
        f"{'':60}END OF HEADER",
    ]
    record = ("{:14.3f} 7{:14.3f} 7{:14.3f}  {:14.3f}  " * 4).rstrip()
    for epoch in range(epochs):
        lines.append(f"> 2024 10 27 00 {epoch // 60:02d}{epoch % 60:11.7f}  0{SATS:3d}")
        for sat in range(SATS):
            values = (2e7 + 6e6 * rng.random(16)).tolist()
            lines.append(f"G{sat + 1:02d}" + record.format(*values))
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


if __name__ == "__main__":
    for text in report():
        print(text)
