"""Hold what a receiver's fixes made of its inertial navigator."""

from dataclasses import dataclass

import numpy as np

from skyproof.navigation.inertial_predictor import Inertial
from skyproof.records import Kind

__all__ = ["CorrectedNavigator"]


@dataclass(frozen=True, eq=False, kw_only=True)
class CorrectedNavigator:
    """A receiver's navigator, and the windows whose fixes corrected it.

    kind : of the signals of the first of them. early : starts of those of the clean start. until : the end of the last;
    None before any. bias_s : the receiver's clock in it. hidden_m : by how much drags that none of them would have
    noticed may have led it away since the clean start. hidden_m_s : by how much the velocity, if one has just begun.
    clean : the navigator that only the clean start corrected, which none has led away; None while there is no other.
    """

    predictor: Inertial
    kind: Kind | None
    early: tuple[np.datetime64, ...]
    until: np.datetime64 | None
    bias_s: float
    hidden_m: float = 0.0
    hidden_m_s: float = 0.0
    clean: Inertial | None = None
