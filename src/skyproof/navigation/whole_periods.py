"""Complete ranges to whole code periods by a position, for signals with a known code phase only."""

from collections.abc import Sequence

import numpy as np

from skyproof.arrays import Instants, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.orbits import compute_satellite_state
from skyproof.records import NavigationData

__all__ = ["complete_ranges_m"]

_TRAVEL: np.timedelta64 = np.timedelta64(75, "ms")  # of a signal, to 15 ms, in which a satellite moves by 60 m


def complete_ranges_m(
    code_s: Reals,
    sats: Sequence[str],
    gpst: Instants,
    position_ecef_m: Reals,
    navigation: NavigationData,
    *,
    shows: Sequence[bool],
    period_s: float,
) -> Reals:
    """Compute pseudoranges (n_epochs, n_signals) from code phases and the nearest whole periods.

    A range is c times label minus the time that the code shows. Its whole code periods are the nearest to the
    prediction by the position; NaN without an ephemeris.

    Right for every signal whose range and clock are less than half a period (150 km for GPS C/A) off those of the
    signals that show the position.

    Parameters
    ----------
    code_s : (n_epochs, n_signals) what each code shows at the epochs, modulo its period. gpst : (n_epochs,) labels.
    position_ecef_m : (3,). shows : which signals it was found from: by them the receiver's clock is set.
    period_s : of the codes.
    """
    period_ns = round(period_s * 1e9)
    label_s = (gpst.astype("datetime64[ns]").astype(np.int64) % period_ns) * 1e-9
    predicted_s = np.full(code_s.shape, np.nan)
    for column, sat in enumerate(sats):
        if (ephemeris := navigation.best(sat, gpst[0])) is not None:
            state = compute_satellite_state(ephemeris, gpst - _TRAVEL)
            away_m = np.linalg.norm(state.position_ecef_m - position_ecef_m, axis=-1)
            predicted_s[:, column] = away_m / SPEED_OF_LIGHT_M_S - state.clock_s
    over_s = label_s[:, None] - code_s - predicted_s
    known = np.flatnonzero(np.asarray(shows) & np.isfinite(over_s).all(axis=0))
    turns = np.exp(2j * np.pi * over_s[:, known] / period_s).sum()
    common_s = float(np.angle(turns)) / (2.0 * np.pi) * period_s
    rest_s = over_s - common_s
    return np.asarray(SPEED_OF_LIGHT_M_S * (predicted_s + common_s + rest_s - period_s * np.rint(rest_s / period_s)))
