"""Pairs of signals of one satellite, all of whose factors are drawn at once, through a receiver with joint channels.

Each draw takes for every factor one of a few values, the ends of its range among them: separation, power, difference of
Doppler, C/N0 of the first. One draw a combination: what the cells of `pairs.py` show of one factor at a time holds of
combinations, or it does not. Draws are counted in three groups: within the aim (from 0.5 chip on, from 0.2 chip at
25 Msps, -6 to +6 dB), nearer, and of other powers.

`python bench/pairs_drawn.py --rate 5.0037e6 --draws 60` prints each pair that was not followed as two, and the table.
"""

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pair_trials import Outcome, trial
from waves import SAT, Cell

from skyproof.arrays import Reals
from skyproof.receiver.tracking import ReceiverSettings

APART_CHIPS = (0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5)
POWERS_DB = (-10.0, -6.0, -3.0, 0.0, 3.0, 6.0, 10.0)
DIFFERENCES_HZ = (0.0, 2.0, 10.0, 50.0)
STRENGTHS_DBHZ = (40.0, 42.5, 45.0, 47.5, 50.0)
NEAREST_CHIPS = {5.0: 0.5, 10.0: 0.5, 25.0: 0.2}  # of the aim, by Msps
MOST_DB = 6.0


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A pair and what came of it."""

    cell: Cell
    outcome: Outcome

    @property
    def group(self) -> str:
        """Within the aim, or what takes it out."""
        nearest = NEAREST_CHIPS.get(round(1e-6 * self.cell.rate_hz), 0.5)
        if self.cell.apart_chips < nearest:
            return f"nearer than {nearest:g} chip"
        return "other powers" if abs(self.cell.relative_db) > MOST_DB else "within the aim"


def drawn(number: int, rate_hz: float) -> Drawn:
    """The pair of this number."""
    rng = np.random.default_rng([number, round(1e-6 * rate_hz)])
    cell = Cell(
        apart_chips=float(rng.choice(APART_CHIPS)),
        relative_db=float(rng.choice(POWERS_DB)),
        apart_hz=float(rng.choice(DIFFERENCES_HZ)),
        cn0_dbhz=float(rng.choice(STRENGTHS_DBHZ)),
        rate_hz=rate_hz,
    )
    return Drawn(cell=cell, outcome=trial(rng, cell, ReceiverSettings(sats=(SAT,), joint=True)))


def missed(one: Drawn) -> bool:
    """Whether a pair was followed otherwise than as two signals under their own letters."""
    outcome = one.outcome
    return not outcome.both or outcome.swapped or outcome.others > 0 or not outcome.followed.all()


def words_of(one: Drawn) -> str:
    """A pair in a line."""
    cell, outcome = one.cell, one.outcome
    what = f"{cell.apart_chips:g} chip {cell.relative_db:+.0f} dB {cell.apart_hz:g} Hz {cell.cn0_dbhz:g} dB-Hz"
    share = f"followed {outcome.followed.mean():.2f}" if outcome.both else "one of them"
    return f"{what}: {share}, others {outcome.others}, pulled {outcome.pulled}, swapped {outcome.swapped}"


HEAD = (
    "| Msps | group | both | others | pulled | swapped | wait median / most, s | followed | code over bound "
    "| bound, m |\n|" + " --- |" * 10
)


def line_of(group: str, rate_hz: float, found: Sequence[Drawn]) -> str:
    """A group as a row of the table."""
    outcomes = [one.outcome for one in found]
    good = [one for one in outcomes if one.both]
    waits = [one.wait_s for one in good]
    cells = [f"{1e-6 * rate_hz:.3g}", group, f"{len(good)}/{len(found)}"]
    cells += [str(sum(getattr(one, name) for one in outcomes)) for name in ("others", "pulled", "swapped")]
    if not good:
        return "| " + " | ".join([*cells, *["–"] * 4]) + " |"
    cells += [f"{np.median(waits):.2f} / {max(waits):.2f}", f"{_joined([one.followed for one in good]).mean():.3f}"]
    over = [_rms(_joined([one.code_m[i] / one.bound_m[i] for one in good])) for i in (0, 1)]
    bounds = [_rms(_joined([one.bound_m[i] for one in good])) for i in (0, 1)]
    return "| " + " | ".join([*cells, f"{over[0]:.2f} / {over[1]:.2f}", f"{bounds[0]:.1f} / {bounds[1]:.1f}"]) + " |"


def _joined(values: Sequence[Reals]) -> Reals:
    return np.concatenate(values)


def _rms(values: Reals) -> float:
    """Of those that are finite: a row that does not determine a delay has no bound."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else math.nan


def main() -> None:
    """The pairs that were missed, and the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--rate", type=float, default=5.0037e6, help="samples a second")
    options.add_argument("--draws", type=int, default=60, help="pairs")
    options.add_argument("--first", type=int, default=0, help="number of the first")
    asked = options.parse_args()
    found = []
    for number in range(asked.first, asked.first + asked.draws):
        found.append(drawn(number, asked.rate))
        if missed(found[-1]):
            print(f"  {number}: {words_of(found[-1])}", flush=True)
    print(HEAD)
    for group in sorted({one.group for one in found}, reverse=True):
        print(line_of(group, asked.rate, [one for one in found if one.group == group]), flush=True)


if __name__ == "__main__":
    main()
