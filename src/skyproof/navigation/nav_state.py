"""Interpolate a body's state between the times at which it is stated."""

from dataclasses import replace

import numpy as np
import scipy

from skyproof.arrays import Booleans, Instants, Reals
from skyproof.gnss.time import seconds_between
from skyproof.records import NavState

__all__ = ["interpolate_state", "mark_covered"]


def mark_covered(state: NavState, gpst: Instants) -> Booleans:
    """Mark the instants (n,) between the state's first and last, both included."""
    return np.asarray((gpst >= state.gpst[0]) & (gpst <= state.gpst[-1]))


def interpolate_state(state: NavState, gpst: Instants) -> NavState:
    """Interpolate the state at instants (n,) that it covers: linear, and by the shortest turn.

    Linear positions are off by an eighth of the acceleration times the square of the time between states.
    """
    if state.gpst.size == 1:
        return replace(state.select(np.zeros(gpst.size, np.intp)), gpst=gpst)
    at_s, known_s = (seconds_between(each, state.gpst[0]) for each in (gpst, state.gpst))
    after = np.clip(np.searchsorted(known_s, at_s, side="right"), 1, known_s.size - 1)
    share = (at_s - known_s[after - 1]) / (known_s[after] - known_s[after - 1])

    def between(values: Reals) -> Reals:
        part = share.reshape(-1, *(1,) * (values.ndim - 1))
        with np.errstate(invalid="ignore"):  # an infinite variance times nothing
            mixed = (1.0 - part) * values[after - 1] + part * values[after]
        return np.asarray(np.where(values[after - 1] == values[after], values[after], mixed))

    transform = scipy.spatial.transform  # loaded by its first use
    return NavState(
        gpst=gpst,
        position_ecef_m=between(state.position_ecef_m),
        velocity_ecef_m_s=between(state.velocity_ecef_m_s),
        attitude=transform.Slerp(known_s, transform.Rotation.from_matrix(state.attitude))(at_s).as_matrix(),
        covariance=None if state.covariance is None else between(state.covariance),
    )
