"""Tables 2 to 4 of the paper as arrays: ranges without errors in several geometries, the errors, and both decisions.

Base 59 N, 17 E; a meaconer 500 m from rx1 on the line of most of the others, 400 m of delay; both signals present all
the time. The almanac is not given: the 24 slots of GPS, at sixteen of the times of a day at which just seven satellites
stand above 10 degrees. Ranges are geometric; clocks and atmosphere cancel in what is tested.
"""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from skyproof.detectors.double_difference import Tested, counting_rule, pairs_rejected
from skyproof.detectors.group_choice import (
    choose,
    fraction_test,
    known_baseline_test,
    pairings,
    span_test,
    split_skies,
)
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import Ephemeris
from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.gnss.nominal import nominal_constellation
from skyproof.gnss.orbits import satellite_state_s
from skyproof.gnss.time import week_and_tow

__all__ = [
    "ALPHA_OURS", "ALPHA_PAPER", "CARRIER_PER_CODE", "NOISES", "PLACES", "SATS", "Geometry", "Kept", "Noise",
    "carrier_decision", "errors_of", "geometries", "group_decision", "paper_decision", "ranges_of",
]  # fmt: skip

Reals = NDArray[np.float64]

SATS = 7
GEOMETRIES = 16
ALPHA_PAPER, ALPHA_OURS = 0.01, 0.001
CARRIER_PER_CODE = 0.002  # 2 mm of carrier for each metre of code
CARRIER_BOUND_M = 0.005  # slow error of a carrier track that is allowed for, one sigma
WAVELENGTH_M = SPEED_OF_LIGHT_M_S / L1_HZ

_BASE_GEODETIC = np.radians(59.0), np.radians(17.0), 100.0
_LINE = np.array([-1.0, 1.0, 0.0]) / np.sqrt(2.0)  # from rx1 to the north-west
_ACROSS = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)  # to the north-east
_ALONG_M = {"rx1": 0.0, "rx2": 100.0, "rx5": 1.0, "rx6": 5.0, "rx7": 10.0, "rx8": 20.0, "rx9": 35.0, "rx10": 50.0}
PLACES = {name: along_m * _LINE for name, along_m in _ALONG_M.items()}
PLACES |= {"rx3": -50.0 * _ACROSS, "rx4": 50.0 * _ACROSS}
_MEACONER_ENU_M = -500.0 * _LINE
_DELAY_M = 400.0
_FIRST, _STEP_MIN = np.datetime64("2012-07-01T20:00:16", "ns"), 10
# The nominal constellation has three slots split in two (GPS SPS Performance Standard, 2020, table 3.2-2): one of each
# two moves to the slot of table 3.2-1 (B1, D2, F2), the other is left out, and so are the spares.
_MOVED_DEG = {"G05": 80.956 - 94.916, "G15": 265.446 - 282.676, "G24": 345.226 - 360.456}
_LEFT_OUT = frozenset({"G06", "G16", "G25", "G28", "G29", "G30", "G31"})
_LONGEST_S = 360


class Noise(NamedTuple):
    """Of one track at one epoch: sigma_m, AR(1) coefficient from second to second, sigma of a constant error."""

    sigma_m: float = 1.0
    phi: float = 0.0
    constant_m: float = 0.0


NOISES = {
    "white": Noise(), "white 2 m": Noise(sigma_m=2.0), "AR(1) 0.5": Noise(phi=0.5), "AR(1) 0.9": Noise(phi=0.9),
    "1 m per track": Noise(constant_m=1.0),
}  # fmt: skip


class Geometry(NamedTuple):
    """Seven satellites: unit_enu (7, 3) in the middle of the longest window; sat_enu_m (361, 7, 3) second by second."""

    unit_enu: Reals
    sat_enu_m: Reals


class Kept(NamedTuple):
    """Of seven true and seven false signals in a receiver, how many are kept, each (windows,), mean over receivers."""

    true: Reals
    false: Reals


@lru_cache(maxsize=1)
def geometries() -> tuple[Geometry, ...]:
    """Sixteen skies of seven satellites, as far apart in time as they come; always the same."""
    base_ecef_m, rot = ecef_from_geodetic(*_BASE_GEODETIC), rot_enu_ecef(*_BASE_GEODETIC[:2])
    times = [_FIRST + np.timedelta64(minute, "m") for minute in range(0, 1440, _STEP_MIN)]

    def sats_enu_m(orbits: list[Ephemeris], when: np.datetime64, seconds: Reals) -> Reals:
        week, tow_s = week_and_tow(when)
        ecef_m = np.stack([satellite_state_s(o, week, tow_s + seconds).position_ecef_m for o in orbits], axis=1)
        return np.asarray((ecef_m - base_ecef_m) @ rot.T)

    seen = []
    for when in times:
        orbits = _slots(when)
        up = _units(sats_enu_m(orbits, when, np.array([0.5 * _LONGEST_S]))[0])[:, 2]
        above = [orbit for orbit, sine in zip(orbits, up, strict=True) if sine > np.sin(np.radians(10.0))]
        seen += [(when, above)] if len(above) == SATS else []
    made = []
    for k in np.linspace(0, len(seen) - 1, GEOMETRIES).round().astype(int):
        sat_enu_m = sats_enu_m(seen[k][1], seen[k][0], np.arange(_LONGEST_S + 1.0))
        made.append(Geometry(_units(sat_enu_m[_LONGEST_S // 2]), sat_enu_m))
    return tuple(made)


def _slots(when: np.datetime64) -> list[Ephemeris]:
    """Orbits in the 24 slots."""
    orbits = [orbit for orbit in nominal_constellation(when).ephemerides if isinstance(orbit, Ephemeris)]
    return [replace(orbit, m0=orbit.m0 + np.radians(_MOVED_DEG.get(orbit.sat, 0.0)))
            for orbit in orbits if orbit.sat not in _LEFT_OUT]  # fmt: skip


def _units(vectors: Reals) -> Reals:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def ranges_of(geometry: Geometry, receivers: tuple[str, ...], window_s: int) -> Reals:
    """Ranges (N, 7, R, 2) of true and false tracks, less those of the base, without errors; a second an epoch."""
    sat_enu_m = geometry.sat_enu_m[:window_s, :, None, :]
    places_m = np.array([PLACES[name] for name in receivers])
    base_m = np.linalg.norm(sat_enu_m, axis=-1)
    true_m = np.linalg.norm(sat_enu_m - places_m, axis=-1) - base_m
    shown_m = np.linalg.norm(sat_enu_m - _MEACONER_ENU_M, axis=-1) - base_m
    way_m = np.linalg.norm(places_m - _MEACONER_ENU_M, axis=-1) + _DELAY_M
    return np.stack([true_m, shown_m + way_m], axis=-1)


def errors_of(noise: Noise, shape: tuple[int, ...], rng: np.random.Generator) -> Reals:
    """Errors (windows, N, ...) in metres of stationary AR(1) and a constant."""
    unit = rng.standard_normal(shape)
    if noise.phi:
        unit[:, 1:] *= np.sqrt(1.0 - noise.phi**2)
        unit = lfilter([1.0], [1.0, -noise.phi], unit, axis=1)
    constant = noise.constant_m * rng.standard_normal((shape[0], 1, *shape[2:])) if noise.constant_m else 0.0
    return np.asarray(noise.sigma_m * unit + constant)


def paper_decision(range_m: Reals, *, tested: Tested) -> Kept:
    """Detector 1b ("line" of code) or 2b ("slope" of carrier) at 1 % and the counting rule with K = 4.

    range_m : (windows, N, 7, R, 2).
    """
    receivers = range_m.shape[3]
    tracks = pairings(receivers)  # here: which track of each receiver a single difference is made of
    chosen = np.stack([range_m[..., np.arange(receivers), track] for track in tracks], axis=3)  # (W, N, 7, 2^R, R)
    sd_m = chosen[..., 1:] - chosen[..., :1]
    flat = np.moveaxis(sd_m.reshape(*sd_m.shape[:2], SATS * len(tracks), receivers - 1), 1, 2)
    rule = counting_rule(pairs_rejected(flat, ALPHA_PAPER, tested=tested), np.repeat(np.arange(SATS), len(tracks)),
                         np.tile(tracks, (SATS, 1)))  # fmt: skip
    kept = np.sum(~rule.removed, axis=-2).mean(axis=1)
    return Kept(kept[:, 0], kept[:, 1])


def group_decision(range_m: Reals, geometry: Geometry, places_m: Reals | None = None) -> Kept:
    """The recommended one, by windows' means of code. range_m : (windows, N, 7, R, 2); places_m : (R, 3) if known."""
    skies = _skies(range_m.mean(axis=1), geometry)
    p_values = []
    for g in pairings(range_m.shape[3]):
        one, other = _pairing(skies.mean_m, g), _pairing(skies.mean_m, 1 - g)
        if places_m is None:
            p_values.append(span_test(one, other, geometry.unit_enu).p_value)
        else:
            p_values.append(known_baseline_test(one, other, geometry.unit_enu, places_m[1:] - places_m[0]))
    return _kept(skies.first_is_false, choose(np.stack(p_values, axis=-1), ALPHA_OURS).which)


def carrier_decision(range_m: Reals, carrier_m: Reals, geometry: Geometry) -> Kept:
    """Skies by code, the choice by fractions of cycles. Two receivers; arrays as of `group_decision`.

    The sigma is what the carriers scatter by themselves from second to second, and 5 mm of slow error of each track.
    """
    skies = _skies(range_m.mean(axis=1), geometry)
    n = range_m.shape[1]
    bends_m = np.diff(carrier_m, n=2, axis=1)
    thermal_m = np.sqrt(np.mean(bends_m**2, axis=(1, 2, 3, 4)) / 6.0 / n)
    sigma_cyc = np.sqrt(2.0) * np.hypot(thermal_m, CARRIER_BOUND_M) / WAVELENGTH_M
    mean_cyc = _sorted(carrier_m.mean(axis=1), skies.first) / WAVELENGTH_M
    p_values = []
    for g in pairings(2):
        one = _pairing(mean_cyc, g)
        p_values.append(fraction_test(one[..., 1] - one[..., 0], sigma_cyc).p_value)
    return _kept(skies.first_is_false, choose(np.stack(p_values, axis=-1), ALPHA_OURS).which)


class _Skies(NamedTuple):
    """mean_m : (W, 7, R, 2), last axis now the sky. first : (W, R, 7). first_is_false : (W, 7, R) of the tracks."""

    mean_m: Reals
    first: NDArray[np.intp]
    first_is_false: NDArray[np.bool_]


def _skies(mean_m: Reals, geometry: Geometry) -> _Skies:
    first = split_skies(np.swapaxes(mean_m, 1, 2), geometry.unit_enu).first  # (W, R, 7)
    return _Skies(_sorted(mean_m, first), first, np.swapaxes(first, 1, 2) == 1)


def _sorted(values: Reals, first: NDArray[np.intp]) -> Reals:
    """(W, 7, R, 2) from tracks to skies."""
    track = np.swapaxes(first, 1, 2)[..., None]
    return np.take_along_axis(values, np.concatenate([track, 1 - track], axis=-1), axis=-1)


def _pairing(values: Reals, skies: NDArray[np.intp]) -> Reals:
    """(W, 7, R): of each receiver the sky that the pairing takes."""
    return values[..., np.arange(values.shape[2]), skies]


def _kept(first_is_false: NDArray[np.bool_], which: NDArray[np.intp]) -> Kept:
    """What the complement of the chosen pairing holds; nothing where none was chosen."""
    receivers = first_is_false.shape[2]
    kept_sky = 1 - pairings(receivers)[np.maximum(which, 0)]  # (W, R)
    false = first_is_false ^ (kept_sky[:, None, :] == 1)
    decided = which >= 0
    count = np.where(decided, false.sum(axis=1).mean(axis=1), 0.0)
    return Kept(np.where(decided, SATS - count, 0.0), count)
