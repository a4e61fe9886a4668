"""How far an attack may have moved a position without any test noticing it, since the last evidence against one.

Beside a test that passes stands what it would have noticed with a probability of 0.99 (`records.NoticedAttack`): in
each window codes that drag the position off at `code_drag`, carriers that do at `motion`, a jump by `position_jump`. An
attack that no window notices moves a position within a window of length T by (code_drag + motion) T at most: codes are
dragged against their carriers, and carriers against a receiver that is stated to stand. An inertial unit notices either
(`drag`), which bounds both. So from the last evidence at t0 to t

    hidden = largest jump of the windows so far + integral of (code_drag + motion), or of drag, from t0 to t

A receiver that stands is held against its place in each window, which notices any move of `displacement` or more: so
hidden is displacement + (code_drag + motion) T at most, however long it lasts.

In both t is the middle of what a fix is smoothed over, if that is later than the fix itself, which it is near t0.
Evidence that the signals come from the sky begins that again; without any, signals are taken for true at the start.
A window without a figure has that of the next one, whose test looks back; after the last one nothing is bounded.

Of a receiver that neither stands nor has an inertial unit nothing bounds codes and carriers that are dragged together,
as a takeover does. It does not cover several jumps, each too small to be noticed.
"""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from skyproof.app.protect.noticed import TestedWindows, collect_tested_windows
from skyproof.arrays import Indices, Instants, Reals
from skyproof.gnss.time import seconds_between
from skyproof.records import Finding, NoticedKind

__all__ = ["HiddenDrag", "bound_drags"]


@dataclass(frozen=True, eq=False, kw_only=True)
class HiddenDrag:
    """What the tests of one receiver would have missed, window by window.

    edges_s : (w + 1,) of the windows, from `zero`. rate_m_s, jump_m : (w,) NaN where nothing bounds it. far_m : (w,)
    from where the receiver stands, infinite where that is not tested.
    """

    zero: np.datetime64
    edges_s: Reals
    rate_m_s: Reals
    jump_m: Reals
    far_m: Reals

    def bound_between(self, since: Instants, gpst: Instants, latest: Instants) -> Reals:
        """Bound by how much a position may have been moved from `since` to `gpst`, (n,) each, metres.

        latest : of what it is smoothed over, (n,); a steady drag has moved the mean over it by as much as it has at the
            middle.
        """
        moved_m = np.concatenate([[0.0], np.cumsum(self.rate_m_s * np.diff(self.edges_s))])
        at_s, since_s, latest_s = (self._seconds(at) for at in (gpst, since, latest))
        seconds = np.maximum(at_s, 0.5 * (since_s + latest_s))
        drag_m = np.interp(seconds, self.edges_s, moved_m) - np.interp(since_s, self.edges_s, moved_m)
        window = self._window(seconds)
        since_start_m = drag_m + np.fmax.accumulate(self.jump_m)[window]
        from_place_m = self.far_m + self.rate_m_s * np.diff(self.edges_s)
        return np.asarray(np.fmin(since_start_m, from_place_m[window]))

    def rate_at(self, gpst: np.datetime64) -> float:
        """Return how fast a position may be moved then, m/s."""
        return float(self.rate_m_s[self._window(self._seconds(np.array([gpst])))][0])

    def _seconds(self, gpst: Instants) -> Reals:
        return np.asarray(seconds_between(gpst, self.zero), np.float64)

    def _window(self, seconds: Reals) -> Indices:
        return np.clip(np.searchsorted(self.edges_s, seconds, side="right") - 1, 0, self.rate_m_s.size - 1)


def bound_drags(
    findings: Iterable[Finding], *, standing: Collection[str], inertial: Collection[str] = ()
) -> dict[str, HiddenDrag]:
    """Bound for each tested receiver what its tests would have missed.

    standing : receivers that are stated to stand, whose carriers are held against that. inertial : with a unit.
    """
    windows = collect_tested_windows(findings)
    kinds: dict[str, tuple[NoticedKind, ...]] = dict.fromkeys(inertial, ("drag",))
    kinds |= dict.fromkeys(standing, ("code_drag", "motion"))
    return {receiver: _bound_drag(windows, receiver, kinds.get(receiver, ())) for receiver in windows.ends}


def _bound_drag(windows: TestedWindows, receiver: str, kinds: Sequence[NoticedKind]) -> HiddenDrag:
    """Bound what one receiver's tests would have missed.

    kinds : of drags; an attack may use all at once. Without any, nothing bounds them.
    """
    ends = windows.ends[receiver]
    starts = np.array(sorted(ends), "datetime64[ns]")

    def sizes(kind: NoticedKind, otherwise: float = np.nan) -> Reals:
        best = windows.best.get((receiver, kind), {})
        return np.array([best[start][0] if start in best else otherwise for start in starts])

    edges = np.append(starts, max(ends.values()))
    return HiddenDrag(
        zero=starts[0],
        edges_s=np.asarray(seconds_between(edges, starts[0]), np.float64),
        rate_m_s=np.sum([_fill_backward(sizes(kind)) for kind in kinds], axis=0)
        if kinds
        else np.full(starts.size, np.nan),
        jump_m=_fill_backward(sizes("position_jump")),
        far_m=sizes("displacement", np.inf),
    )


def _fill_backward(values: Reals) -> Reals:
    """Fill each NaN with the next number, (n,)."""
    known = np.isfinite(values)
    after = np.minimum.accumulate(np.where(known, np.arange(values.size), values.size)[::-1])[::-1]
    return np.append(values, np.nan)[after]
