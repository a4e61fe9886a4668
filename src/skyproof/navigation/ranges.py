"""From pseudoranges to ranges: where each satellite was when it sent, its clock, and the delays on the way."""

import math
from dataclasses import dataclass

import numpy as np

from skyproof.arrays import Booleans, Indices, Instants, Integers, Reals
from skyproof.gnss.constants import L1_HZ
from skyproof.gnss.ephemeris import MAX_AGE_S
from skyproof.gnss.orbit_kernels import fill_ranges
from skyproof.gnss.signals import time_scale_of
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.fit_kernels import fill_delays
from skyproof.navigation.least_squares import merge_lead
from skyproof.records import Klobuchar, NavigationData, SignalId

__all__ = [
    "UNKNOWN_DELAY_SIGMA_M",
    "AtmosphereDelays",
    "Ranges",
    "compute_atmosphere",
    "compute_space_sigma_m",
    "correct_ranges",
    "describe_ionosphere",
    "list_time_scales",
    "time_scale",
]

_PREFERENCE = "GECR"
_SPACE_M = {"G": 0.6, "J": 0.6, "E": 0.2, "C": 1.0, "R": 2.0}
"""Error of a range by broadcast orbit and clock, rms: O. Montenbruck, P. Steigenberger and A. Hauschild, "Multi-GNSS
signal-in-space range error assessment", Advances in Space Research 61(12), 2018 (abstract); QZSS taken as GPS."""

UNKNOWN_DELAY_SIGMA_M = 5.2
"""Of a satellite's delay of a signal that no message gives: uniform within 30 ns of the mean, by so much L1 and L5 may
part (IS-GPS-705, group delay differential)."""

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
    delay_unknown : cells whose group delay no message gives; it is in `range_m` still, `UNKNOWN_DELAY_SIGMA_M`.
    """

    week: Integers
    transmission_tow_s: Reals
    satellite_ecef_m: Reals
    satellite_velocity_ecef_m_s: Reals
    satellite_drift: Reals
    range_m: Reals
    delay_unknown: Booleans


@dataclass(frozen=True, eq=False, kw_only=True)
class AtmosphereDelays:
    """elevation_rad, delay_m of ionosphere and troposphere, sigma_m of what the models leave, and ionosphere_m, the
    ionosphere's part of the delay; all (..., k)."""

    elevation_rad: Reals
    delay_m: Reals
    sigma_m: Reals
    ionosphere_m: Reals


def correct_ranges(
    signals: tuple[SignalId, ...],
    gpst: Instants,
    pseudorange_m: Reals,
    navigation: NavigationData,
    *,
    with_unknown_delay: bool = False,
) -> Ranges:
    """Compute satellite positions and corrected ranges of all cells.

    There is one orbit computation per satellite and ephemeris in use. The time of transmission is the receiver's label
    minus pseudorange over c, so an error of the label cancels: a clock that is wrong by a second still puts the
    satellites where they were. Ephemerides are the nearest in time among the healthy ones that give the signal's group
    delay, at most `MAX_AGE_S` of the system away. They are the same for all copies.

    Parameters
    ----------
    gpst : (n_epochs,) labels. pseudorange_m : (n_epochs, n_channels), one column a signal.
    with_unknown_delay : signals whose group delay no ephemeris gives keep it in their range; else they are NaN.
    """
    pseudorange_m = np.array(pseudorange_m, np.float64, order="C")  # a kernel is compiled anew for what is read-only
    week, tow_s = week_and_tow(gpst)
    shape = pseudorange_m.shape
    transmission_tow_s, drift, range_m = (np.full(shape, np.nan) for _ in range(3))
    position, velocity = np.full((*shape, 3), np.nan), np.full((*shape, 3), np.nan)
    delay_unknown = np.zeros(shape, np.bool_)
    fill_ranges(
        pseudorange_m,
        week,
        tow_s,
        np.asarray(gpst, "M8[ns]").astype(np.int64),
        *_list_ephemerides(navigation, signals, with_unknown_delay),
        navigation.orbit_rows,
        navigation.reference_ns,
        transmission_tow_s,
        position,
        velocity,
        drift,
        range_m,
        delay_unknown,
    )
    return Ranges(
        week=week,
        transmission_tow_s=transmission_tow_s,
        satellite_ecef_m=position,
        satellite_velocity_ecef_m_s=velocity,
        satellite_drift=drift,
        range_m=range_m,
        delay_unknown=delay_unknown,
    )


def time_scale(signal: SignalId) -> str:
    """Return the letter of the system whose time the signal keeps: GPS's for QZSS and SBAS."""
    return time_scale_of(signal.sat)


def list_time_scales(signals: tuple[SignalId, ...]) -> tuple[tuple[str, ...], Reals]:
    """Order the time scales that the signals keep, the preferred reference first; and who keeps which (k, c)."""
    of = [time_scale(signal) for signal in signals]
    scales = tuple(sorted(set(of), key=lambda scale: (_PREFERENCE + scale).index(scale))) or ("G",)
    return scales, np.array([[float(scale == signal_scale) for scale in scales] for signal_scale in of]).reshape(
        len(of), len(scales)
    )


def compute_space_sigma_m(signals: tuple[SignalId, ...]) -> Reals:
    """Return the error (k,) that orbit and clock of each system add to a range beyond GPS's, one sigma.

    The error of GPS itself is as large as the least multipath and is counted with it, in `multipath_sigma_m`.
    """
    rms_m = np.array([_SPACE_M.get(signal.sat[0], max(_SPACE_M.values())) for signal in signals])
    return np.asarray(np.sqrt(np.maximum(rms_m**2 - _SPACE_M["G"] ** 2, 0.0)))


def compute_atmosphere(
    position_ecef_m: Reals,
    satellite_ecef_m: Reals,
    tow_s: Reals,
    ionosphere: Klobuchar | None,
    *,
    ionosphere_share: float = 0.25,
    carrier_hz: Reals | None = None,
) -> AtmosphereDelays:
    """Compute the code delays at `position_ecef_m` (..., 3) from satellites (..., k, 3) at reception.

    `sigma_m` is `ionosphere_share` of the ionosphere's delay: the broadcast model takes away about half of it
    (IS-GPS-200N, 20.3.3.5.2.5), and position and clock take up about half of what it leaves, which is alike for all
    satellites. Without the model's parameters 3 m at the zenith are taken, with a sigma of as much. Satellites below
    the horizon get the delay of the horizon. The ionosphere's delay goes with the inverse square of `carrier_hz`
    (k,), L1 without it (IS-GPS-200N, 20.3.3.3.3.3). Above 11 km the troposphere thins out with a scale of 6.3 km.
    """
    shape = np.broadcast_shapes(satellite_ecef_m.shape[:-2], position_ecef_m.shape[:-1], np.shape(tow_s))
    k = satellite_ecef_m.shape[-2]
    delays = np.empty((math.prod(shape), k, 4))
    fill_delays(
        merge_lead(position_ecef_m, shape, 3),
        merge_lead(satellite_ecef_m, shape, k, 3),
        merge_lead(tow_s, shape),
        merge_lead(L1_HZ if carrier_hz is None else carrier_hz, shape, k),
        describe_ionosphere(ionosphere, ionosphere_share),
        delays,
    )
    elevation_rad, delay_m, sigma_m, ionosphere_m = np.moveaxis(delays.reshape(*shape, k, 4), -1, 0)
    return AtmosphereDelays(elevation_rad=elevation_rad, delay_m=delay_m, sigma_m=sigma_m, ionosphere_m=ionosphere_m)


def describe_ionosphere(ionosphere: Klobuchar | None, ionosphere_share: float) -> Reals:
    """Describe the ionosphere's delay to kernels, (10,): Klobuchar's numbers, a factor, and sigma as its share."""
    if ionosphere is None:
        return np.array((*_NIGHT.alpha, *_NIGHT.beta, _UNKNOWN_IN_NIGHTS, 1.0))
    return np.array((*ionosphere.alpha, *ionosphere.beta, 1.0, ionosphere_share))


def _list_ephemerides(
    navigation: NavigationData, signals: tuple[SignalId, ...], with_unknown_delay: bool
) -> tuple[Integers, Indices, Reals, Integers]:
    """List the ephemerides that serve each signal, as `fill_ranges` takes them.

    Returns where each signal's begin, those of all signals one after the other, their group delays, and the age to
    which they serve.
    """
    serving = []
    for signal in signals:
        rows, delay_s = navigation.find_serving(signal.sat, signal.band, signal.code)
        known = np.isfinite(delay_s)
        serving.append((rows, delay_s) if with_unknown_delay and not known.any() else (rows[known], delay_s[known]))
    first = np.cumsum([0, *(rows.size for rows, _ in serving)])
    most_ns = np.array([round(MAX_AGE_S.get(signal.sat[0], 0.0) * 1e9) for signal in signals], np.int64)
    rows, delay_s = (
        np.concatenate([np.zeros(0, kind), *(entry[k] for entry in serving)]) for k, kind in enumerate((np.intp, float))
    )
    return first, rows, delay_s, most_ns
