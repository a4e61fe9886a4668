"""Keep navigators that run free beside the corrected one, and the windows that corrected it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skyproof.fusion.policy import POLICY as FUSION
from skyproof.gnss.time import seconds_between
from skyproof.navigation.inertial_predictor import Inertial
from skyproof.navigation.predictor import SkyFix

__all__ = ["FreeNavigator", "RefusedWindow", "TaughtWindow", "keep_useful"]


@dataclass(frozen=True, eq=False)
class FreeNavigator:
    """A navigator that no window has corrected since. carried : to the last window. learned : how many windows had
    corrected it, up to `until`. notices_m_s : the slowest drag that it would have noticed in the last window.
    hidden_m : see `CorrectedNavigator`."""

    predictor: Inertial
    carried: Inertial
    learned: int
    until: np.datetime64 | None
    notices_m_s: float
    hidden_m: float


@dataclass(frozen=True, eq=False, kw_only=True)
class TaughtWindow:
    """A window that corrected the navigator. number : of such windows before. bias_s, hidden_m : before it."""

    number: int
    start: np.datetime64
    end: np.datetime64
    fix: SkyFix
    bias_s: float
    hidden_m: float


@dataclass(frozen=True)
class RefusedWindow:
    """The first window that hardly follows, and the least p-value since. number : of windows that taught before it."""

    number: int
    p_value: float

    def is_chance(self, learned: int) -> bool:
        """Tell whether one of so many windows may be refused so by chance. learned : how many have taught by now."""
        return (learned - self.number) * self.p_value >= FUSION.refused_probability


def keep_useful(free: Sequence[FreeNavigator], gpst: np.datetime64) -> list[FreeNavigator]:
    """Return the navigators that each notice slower drags than the younger ones, two of any age to twice that."""
    kept = list[FreeNavigator]()
    for navigator in free:
        if not kept or navigator.notices_m_s < kept[-1].notices_m_s:
            kept.append(navigator)
    return _thin_navigators(kept, gpst)


def _thin_navigators(free: Sequence[FreeNavigator], gpst: np.datetime64) -> list[FreeNavigator]:
    """Return two navigators at most of any age to twice that age."""
    kept = list(free)
    for number in range(len(kept) - 2, 0, -1):
        younger, older = (kept[k].predictor.state for k in (number - 1, number + 1))
        assert younger is not None
        assert older is not None
        if seconds_between(gpst, older.gpst) < 2.0 * seconds_between(gpst, younger.gpst):
            del kept[number]
    return kept
