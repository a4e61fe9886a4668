"""Pairs of signals of one satellite through the whole receiver, and second signals where there are none.

A satellite is tracked alone; then a second signal of it begins, with the same data bits, so much later or earlier. The
place in the code, the sign of the separation, the carriers' phases, the bits and the noise are drawn anew in each
trial. Errors are those of the measurements 2 to 3 s after the second signal was found, rms, beside their stated
(thermal) sigma and beside the pull: what the correlation of the other signal, side lobes included, does to a loop and a
discriminator without noise. Where the tops of the two correlations touch, a loop need not have a place to stay near the
weaker one; `stays` is the share of phases between the carriers for which it has.

`followed` is the share of epochs, from the one at which the second signal was found until errors were taken, that have
both, each within a quarter of a chip of the truth and nearer to its own than to the other.
`swapped` counts trials at whose end the letter of the first signal is not on it.

`python bench/pairs.py --trials 20` writes the whole table as markdown.
"""

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from time import process_time

import numpy as np
import second_signals
from pair_trials import trial
from pulls import pulls, stays
from waves import RATE_HZ, Cell

from skyproof.arrays import Reals

SEPARATIONS_CHIPS = (0.5, 0.75, 1.0, 1.5, 2.0, 4.0, 8.0)
POWERS_DB = (-10.0, -6.0, 0.0, 6.0, 10.0)
DIFFERENCES_HZ = (0.0, 2.0, 10.0, 50.0)


@dataclass(frozen=True, kw_only=True)
class Row:
    """A cell's trials in figures. Of first and second signal: rms of the errors, of the sigmas, and the pulls."""

    cell: Cell
    trials: int
    found: int
    others: int
    pulled: int
    swapped: int
    followed: float  # share of epochs
    wait_s: tuple[float, float]  # median and most
    stays: float
    code_m: tuple[tuple[float, float, float], ...]
    doppler_hz: tuple[tuple[float, float, float], ...]


def table(
    trials: int,
    separations_chips: Sequence[float] = SEPARATIONS_CHIPS,
    powers_db: Sequence[float] = POWERS_DB,
    differences_hz: Sequence[float] = DIFFERENCES_HZ,
    rate_hz: float = RATE_HZ,
    cn0_dbhz: float = 45.0,
) -> Iterator[Row]:
    """Row by row. A cell's trials are its own whatever other cells are asked for."""
    for apart_chips, relative_db, apart_hz in product(separations_chips, powers_db, differences_hz):
        cell = Cell(
            apart_chips=apart_chips, relative_db=relative_db, apart_hz=apart_hz, cn0_dbhz=cn0_dbhz, rate_hz=rate_hz
        )
        yield row_of(cell, trials)


def row_of(cell: Cell, trials: int) -> Row:
    """The trials of one cell."""
    rng = np.random.default_rng([round(100 * cell.apart_chips), round(cell.relative_db) + 100, round(cell.apart_hz)])
    outcomes = [trial(rng, cell) for _ in range(trials)]
    good = [item for item in outcomes if item.both]
    waits = [item.wait_s for item in good]
    pulls_of = [pulls(cell, of_second) for of_second in (False, True)]

    def rms(of: int, errors: str) -> float:
        values = [getattr(item, errors)[of] for item in good]
        return _rms(np.concatenate(values)) if good else math.nan

    return Row(
        cell=cell,
        trials=trials,
        found=len(good),
        others=sum(item.others for item in outcomes),
        pulled=sum(item.pulled for item in outcomes),
        swapped=sum(item.swapped for item in good),
        followed=float(np.mean(np.concatenate([item.followed for item in good]))) if good else 0.0,
        wait_s=(float(np.median(waits)), max(waits)) if good else (math.nan, math.nan),
        stays=min(stays(cell, of_second)[0] for of_second in (False, True)) if cell.apart_chips < 2.0 else 1.0,
        code_m=tuple((rms(i, "code_m"), rms(i, "code_sigma_m"), pulls_of[i][0]) for i in (0, 1)),
        doppler_hz=tuple((rms(i, "doppler_hz"), rms(i, "doppler_sigma_hz"), pulls_of[i][1]) for i in (0, 1)),
    )


def _rms(values: Reals) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else math.nan


def _text(row: Row) -> str:
    cell = row.cell
    head = f"  {cell.apart_chips:4.2f} chips {cell.relative_db:+3.0f} dB {cell.apart_hz:2.0f} Hz"
    share = f"{row.found}/{row.trials} (stays {row.stays:4.2f}) others {row.others} pulled {row.pulled}"
    if not row.found:
        return f"{head}: {share}"
    code = ", ".join("{:.1f} ({:.1f}, {:.1f})".format(*item) for item in row.code_m)
    doppler = ", ".join("{:.2f} ({:.2f}, {:.2f})".format(*item) for item in row.doppler_hz)
    return f"{head}: {share}  {row.wait_s[0]:.1f} to {row.wait_s[1]:.1f} s  code {code} m  Doppler {doppler} Hz"


def _markdown(row: Row) -> str:
    cell = row.cell
    cells = [f"{1e-6 * cell.rate_hz:.3g}", f"{cell.cn0_dbhz:g}", f"{cell.apart_chips:g}", f"{cell.relative_db:+.0f}"]
    cells += [f"{cell.apart_hz:g}", f"{row.found}/{row.trials}", f"{row.stays:.2f}"]
    cells += [str(row.others), str(row.pulled), str(row.swapped)]
    if row.found:
        cells += ["{:.2f} / {:.2f}".format(*row.wait_s), f"{row.followed:.3f}"]
        cells += ["{:.1f} ({:.1f}; {:.1f})".format(*item) for item in row.code_m]
        cells += ["{:.2f} ({:.2f}; {:.2f})".format(*item) for item in row.doppler_hz]
    else:
        cells += ["–"] * 6
    return "| " + " | ".join(cells) + " |"


MARKDOWN_HEAD = (
    "| Msps | dB-Hz | apart, chips | second, dB | Doppler, Hz | both | stays | others | pulled | swapped "
    "| wait median / most, s | followed | first, code m | second, code m | first, Doppler Hz | second, Doppler Hz |\n"
    "|" + " --- |" * 16
)


def report(trials: int = 1) -> Iterator[str]:
    """Rows of the table."""
    begin = process_time()
    yield (
        "pairs of one satellite, first 45 dB-Hz, 2.6 Msps: both followed; share of phases for which a loop can stay; "
        "wait; rms errors of first and second (thermal sigma, pull)"
    )
    for row in table(trials):
        yield _text(row)
    yield f"  {process_time() - begin:.0f} s of CPU"
    yield from second_signals.report(trials)
    yield f"  {process_time() - begin:.0f} s of CPU"


def main() -> None:
    """The whole table as markdown, with as many trials as wanted."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--trials", type=int, default=10, help="of each cell")
    options.add_argument("--apart", type=float, nargs="*", default=SEPARATIONS_CHIPS, help="separations, chips")
    options.add_argument("--power", type=float, nargs="*", default=POWERS_DB, help="of the second, dB")
    options.add_argument("--hz", type=float, nargs="*", default=DIFFERENCES_HZ, help="between the Dopplers")
    options.add_argument("--cn0", type=float, default=45.0, help="of the first signal, dB-Hz")
    options.add_argument("--rate", type=float, default=RATE_HZ, help="samples a second")
    chosen = options.parse_args()
    print(MARKDOWN_HEAD)
    for row in table(chosen.trials, chosen.apart, chosen.power, chosen.hz, chosen.rate, chosen.cn0):
        print(_markdown(row), flush=True)


if __name__ == "__main__":
    main()
