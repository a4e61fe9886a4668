"""From pseudoranges to ranges: where each satellite was when it sent, its clock, and the delays on the way."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skyproof.gnss.atmosphere import klobuchar_delay_s, troposphere_delay_m
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.orbits import satellite_state_s
from skyproof.gnss.time import gpst as instant
from skyproof.gnss.time import seconds_between, week_and_tow
from skyproof.records import Ephemeris, Instants, Klobuchar, NavigationData, Reals, SignalId

__all__ = ["Delays", "Ranges", "atmosphere", "corrected_ranges"]

_MAX_AGE_S = 7500.0  # half of the usual fit interval and the time that a change of ephemeris may take
_NIGHT = Klobuchar(alpha=(0.0, 0.0, 0.0, 0.0), beta=(0.0, 0.0, 0.0, 0.0))  # leaves 5 ns times the obliquity
_UNKNOWN_IN_NIGHTS = 2.0  # 3 m at the zenith: between the 1.5 m of any night and the 5 m of an ordinary day


@dataclass(frozen=True, eq=False, kw_only=True)
class Ranges:
    """The satellites' side of every cell (epoch, channel); NaN without a pseudorange or an ephemeris.

    week, transmission_tow_s : GPS time of transmission; the week is that of the epoch, (epoch,), and the seconds may
        run over its ends. Good to a tenth of a nanosecond, which moves a satellite by less than a micrometre.
    satellite_ecef_m, satellite_velocity_ecef_m_s : (epoch, channel, 3) at transmission, in the frame of transmission.
    satellite_drift : rate of the satellite's clock.
    range_m : pseudorange plus c times the satellite's clock: geometric range, receiver clock and atmosphere.
    """

    week: NDArray[np.int64]
    transmission_tow_s: Reals
    satellite_ecef_m: Reals
    satellite_velocity_ecef_m_s: Reals
    satellite_drift: Reals
    range_m: Reals


@dataclass(frozen=True, eq=False, kw_only=True)
class Delays:
    """elevation_rad, delay_m of ionosphere and troposphere, and sigma_m of what the models leave, all (..., k)."""

    elevation_rad: Reals
    delay_m: Reals
    sigma_m: Reals


def corrected_ranges(
    signals: tuple[SignalId, ...], gpst: Instants, pseudorange_m: Reals, navigation: NavigationData
) -> Ranges:
    """Satellite positions and corrected ranges of all cells; one orbit computation per satellite and ephemeris in use.

    The time of transmission is the receiver's label minus pseudorange over c, so an error of the label cancels: a clock
    that is wrong by a second still puts the satellites where they were. Ephemerides are those nearest in time among the
    healthy ones (at most 7500 s away), the same for all copies of a satellite.

    Parameters
    ----------
    gpst : (n_epochs,) labels. pseudorange_m : (n_epochs, n_channels), one column a signal. GPS L1 C/A; the columns of
        other signals come out as NaN.
    """
    pseudorange_m = np.asarray(pseudorange_m, np.float64)
    week, tow_s = week_and_tow(gpst)
    shown_tow_s = tow_s[:, None] - pseudorange_m / SPEED_OF_LIGHT_M_S  # by the satellite's clock
    shape = pseudorange_m.shape
    transmission_tow_s, drift, range_m = (np.full(shape, np.nan) for _ in range(3))
    position, velocity = np.full((*shape, 3), np.nan), np.full((*shape, 3), np.nan)
    columns: dict[str, list[int]] = {}
    for column, signal in enumerate(signals):
        if (signal.band, signal.code) == ("L1", "CA"):
            columns.setdefault(signal.sat, []).append(column)
    for ephemeris, rows, sat in _in_use(navigation, tuple(columns), gpst):
        cells = np.ix_(rows, np.array(columns[sat]))
        sent_week, sent_tow_s = week[rows][:, None], shown_tow_s[cells]
        sent_tow_s = sent_tow_s - _clock_polynomial_s(ephemeris, sent_week, sent_tow_s)
        state = satellite_state_s(ephemeris, sent_week, sent_tow_s)
        transmission_tow_s[cells] = sent_tow_s
        position[cells], velocity[cells] = state.position_ecef_m, state.velocity_ecef_m_s
        drift[cells] = state.clock_drift
        # IS-GPS-200N, 20.3.3.3.3.2: the user of one frequency takes the group delay off the clock.
        range_m[cells] = pseudorange_m[cells] + SPEED_OF_LIGHT_M_S * (state.clock_s - ephemeris.tgd)
    return Ranges(
        week=week,
        transmission_tow_s=transmission_tow_s,
        satellite_ecef_m=position,
        satellite_velocity_ecef_m_s=velocity,
        satellite_drift=drift,
        range_m=range_m,
    )


def atmosphere(
    position_ecef_m: Reals,
    satellite_ecef_m: Reals,
    tow_s: Reals,
    ionosphere: Klobuchar | None,
    *,
    ionosphere_share: float = 0.25,
) -> Delays:
    """Delays of L1 code at `position_ecef_m` (..., 3) from satellites (..., k, 3) in the frame of reception.

    `sigma_m` is `ionosphere_share` of the ionosphere's delay: the broadcast model takes away about half of it
    (IS-GPS-200N, 20.3.3.5.2.5), and position and clock take up about half of what it leaves, which is alike for all
    satellites. Without the model's parameters 3 m at the zenith are taken, with a sigma of as much. Satellites below
    the horizon get the delay of the horizon. Above 11 km the troposphere thins out with a scale height of 6.3 km.
    """
    lat_rad, lon_rad, height_m = (value[..., None] for value in geodetic_from_ecef(position_ecef_m))
    # As `sky.azimuth_elevation`, which would find the place once more: the dearest step where candidates are many.
    enu_m = (satellite_ecef_m - position_ecef_m[..., None, :]) @ np.swapaxes(
        rot_enu_ecef(lat_rad, lon_rad)[..., 0, :, :], -1, -2
    )
    az_rad = np.arctan2(enu_m[..., 0], enu_m[..., 1])
    el_rad = np.arctan2(enu_m[..., 2], np.hypot(enu_m[..., 0], enu_m[..., 1]))
    above_rad = np.maximum(el_rad, 0.0)
    place = (lat_rad, lon_rad, az_rad, above_rad, np.asarray(tow_s)[..., None])
    if ionosphere is None:
        ionosphere_m = _UNKNOWN_IN_NIGHTS * SPEED_OF_LIGHT_M_S * klobuchar_delay_s(_NIGHT, *place)
        ionosphere_sigma_m = ionosphere_m
    else:
        ionosphere_m = SPEED_OF_LIGHT_M_S * klobuchar_delay_s(ionosphere, *place)
        ionosphere_sigma_m = ionosphere_share * ionosphere_m
    thin = np.exp(-np.clip(height_m - 11000.0, 0.0, 1e6) / 6340.0)
    return Delays(
        elevation_rad=el_rad,
        delay_m=ionosphere_m + thin * troposphere_delay_m(lat_rad, height_m, above_rad),
        sigma_m=ionosphere_sigma_m,
    )


def _in_use(
    navigation: NavigationData, sats: tuple[str, ...], gpst: Instants
) -> list[tuple[Ephemeris, NDArray[np.intp], str]]:
    """Every (ephemeris, rows of `gpst` that it serves, satellite): the nearest in time of ephemeris, as `best` does."""
    uses = []
    for sat in sats:
        candidates = [e for e in navigation.ephemerides if e.sat == sat and e.health == 0]
        if not candidates:
            continue
        toe = instant(np.array([e.week for e in candidates]), np.array([e.toe for e in candidates]))
        age_s = np.abs(seconds_between(gpst[:, None], toe))
        nearest = np.argmin(age_s, axis=1)
        fresh = np.take_along_axis(age_s, nearest[:, None], axis=1)[:, 0] <= _MAX_AGE_S
        uses += [(candidates[k], np.flatnonzero(fresh & (nearest == k)), sat) for k in np.unique(nearest[fresh])]
    return uses


def _clock_polynomial_s(ephemeris: Ephemeris, week: NDArray[np.int64], tow_s: Reals) -> Reals:
    """IS-GPS-200N, 20.3.3.3.3.1, without relativity, whose 50 ns do not move a satellite by a millimetre."""
    dt_s = (week - ephemeris.toc_week) * 604800.0 + (tow_s - ephemeris.toc)
    return np.asarray(ephemeris.af0 + ephemeris.af1 * dt_s + ephemeris.af2 * dt_s**2)
