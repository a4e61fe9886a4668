"""Tables 2 to 4 of the paper as arrays: ranges without errors in several geometries, the errors, and both decisions.

Base 59 N, 17 E; a meaconer 500 m from rx1 on the line of most of the others, 400 m of delay; both signals present all
the time. The lines run from south-east to north-west and from south-west to north-east; which end is which is not said.
Here the receivers follow from rx1 to the south-east, rx4 is in the south-west, the meaconer in the north-west: as the
sky stands in the south, true differences then lie farther from false ones (half of them more than 1.1 of the distance
away) than in the scene turned round (0.9). The almanac is not given: the 24 slots of GPS, at sixteen of the times of a
day at which just seven satellites stand above 10 degrees. Ranges are geometric; clocks and atmosphere cancel in what is
tested.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import special
from scipy.signal import lfilter

from skyproof.arrays import Booleans, Reals
from skyproof.detectors.multi_receiver.along_baselines import span_test
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import Ephemeris
from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.orbits import compute_satellite_state_s
from skyproof.gnss.time import week_and_tow
from skyproof.statistics.distributions import f_threshold, noncentral_f_survival
from skyproof.studies.double_difference import Tested, counting_rule, reject_pairs
from skyproof.studies.group_choice import (
    check_known_baseline,
    choose,
    fraction_test,
    pairings,
    split_skies,
)
from skyproof.studies.roc import chi_square_power

__all__ = [
    "ALPHA_OURS",
    "ALPHA_PAPER",
    "BASE_GEODETIC",
    "CARRIER_PER_CODE",
    "DELAY_M",
    "MEACONER_ENU_M",
    "NOISES",
    "PLACES",
    "SATS",
    "Bound",
    "Groups",
    "Kept",
    "Noise",
    "SatelliteTracks",
    "Split",
    "bound_decided",
    "carrier_decision",
    "compute_ranges",
    "draw_errors",
    "geometries",
    "group_decision",
    "mean_variance_m2",
    "paper_decision",
    "skies",
    "split",
]

SATS = 7
GEOMETRIES = 16
ALPHA_PAPER, ALPHA_OURS = 0.01, 0.001
CARRIER_PER_CODE = 0.002  # 2 mm of carrier for each metre of code
CARRIER_BOUND_M = 0.005  # slow error of a carrier track that is allowed for, one sigma
WAVELENGTH_M = SPEED_OF_LIGHT_M_S / L1_HZ

BASE_GEODETIC = np.radians(59.0), np.radians(17.0), 100.0
_LINE = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)  # from rx1 to the south-east, away from the meaconer
_ACROSS = np.array([-1.0, -1.0, 0.0]) / np.sqrt(2.0)  # to the south-west
_ALONG_M = {"rx1": 0.0, "rx2": 100.0, "rx5": 1.0, "rx6": 5.0, "rx7": 10.0, "rx8": 20.0, "rx9": 35.0, "rx10": 50.0}
PLACES = {name: along_m * _LINE for name, along_m in _ALONG_M.items()}
PLACES |= {"rx3": -50.0 * _ACROSS, "rx4": 50.0 * _ACROSS}
MEACONER_ENU_M = -500.0 * _LINE
DELAY_M = 400.0
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
    "white": Noise(),
    "white 2 m": Noise(sigma_m=2.0),
    "AR(1) 0.5": Noise(phi=0.5),
    "AR(1) 0.9": Noise(phi=0.9),
    "1 m per track": Noise(constant_m=1.0),
}


class SatelliteTracks(NamedTuple):
    """Seven satellites: sat_enu_m (361, 7, 3) second by second."""

    sat_enu_m: Reals

    def unit_enu(self, window_s: int) -> Reals:
        """Return the unit vectors (7, 3) from receiver to satellite, mean over the window.

        False positions 500 m away would feel the middle of a longer one by metres.
        """
        return np.asarray(_units(self.sat_enu_m[:window_s]).mean(axis=0))


class Kept(NamedTuple):
    """Of seven true and seven false signals in a receiver, how many are kept, each (windows,), mean over receivers."""

    true: Reals
    false: Reals


class Split(NamedTuple):
    """first_is_false : (W, 7, R) of the tracks of the first sky. pairing_m : (W, 2^R, 7, R) the means of each pairing.
    unit_enu : (7, 3)."""

    first_is_false: Booleans
    pairing_m: Reals
    unit_enu: Reals


class Groups(NamedTuple):
    """first_is_false : (W, 7, R) of the tracks of the first sky. p_values : (W, 2^R) "one antenna" of each pairing."""

    first_is_false: Booleans
    p_values: Reals

    def count_kept(self, rate: float = ALPHA_OURS) -> Kept:
        """Count what the complement of the chosen pairing holds, at a rate of wrong choices; else nothing."""
        which = choose(self.p_values, rate).which
        kept_sky = 1 - pairings(self.first_is_false.shape[2])[np.maximum(which, 0)]  # (W, R)
        false = self.first_is_false ^ (kept_sky[:, None, :] == 1)
        count = np.where(which >= 0, false.sum(axis=1).mean(axis=1), 0.0)
        return Kept(np.where(which >= 0, SATS - count, 0.0), count)


class Bound(NamedTuple):
    """The largest share of windows that a test of means with a stated rate can decide, if the sigma of the means is
    given to it, and if not."""

    noise_given: float
    noise_unknown: float


@lru_cache(maxsize=1)
def skies() -> tuple[tuple[np.datetime64, tuple[Ephemeris, ...]], ...]:
    """Find sixteen times with seven satellites above 10 degrees, far apart, and their orbits."""
    times = [_FIRST + np.timedelta64(minute, "m") for minute in range(0, 1440, _STEP_MIN)]
    seen = []
    for when in times:
        orbits = _slots(when)
        up = _units(_sats_enu_m(orbits, when, np.array([0.5 * _LONGEST_S]))[0])[:, 2]
        above = tuple(orbit for orbit, sine in zip(orbits, up, strict=True) if sine > np.sin(np.radians(10.0)))
        seen += [(when, above)] if len(above) == SATS else []
    return tuple(seen[k] for k in np.linspace(0, len(seen) - 1, GEOMETRIES).round().astype(int))


@lru_cache(maxsize=1)
def geometries() -> tuple[SatelliteTracks, ...]:
    """Compute where the satellites of the sixteen skies are; always the same."""
    return tuple(SatelliteTracks(_sats_enu_m(orbits, when, np.arange(_LONGEST_S + 1.0))) for when, orbits in skies())


def _sats_enu_m(orbits: Sequence[Ephemeris], when: np.datetime64, seconds: Reals) -> Reals:
    week, tow_s = week_and_tow(when)
    ecef_m = np.stack([compute_satellite_state_s(o, week, tow_s + seconds).position_ecef_m for o in orbits], axis=1)
    base_ecef_m, rot = ecef_from_geodetic(*BASE_GEODETIC), rot_enu_ecef(*BASE_GEODETIC[:2])
    return np.asarray((ecef_m - base_ecef_m) @ rot.T)


def _slots(when: np.datetime64) -> list[Ephemeris]:
    """List the orbits in the 24 slots."""
    orbits = [orbit for orbit in make_nominal_constellation(when).ephemerides if isinstance(orbit, Ephemeris)]
    return [
        replace(orbit, m0=orbit.m0 + np.radians(_MOVED_DEG.get(orbit.sat, 0.0)))
        for orbit in orbits
        if orbit.sat not in _LEFT_OUT
    ]


def _units(vectors: Reals) -> Reals:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def compute_ranges(geometry: SatelliteTracks, receivers: tuple[str, ...], window_s: int) -> Reals:
    """Compute ranges (N, 7, R, 2) of true and false tracks, less those of the base, without errors."""
    sat_enu_m = geometry.sat_enu_m[:window_s, :, None, :]
    places_m = np.array([PLACES[name] for name in receivers])
    base_m = np.linalg.norm(sat_enu_m, axis=-1)
    true_m = np.linalg.norm(sat_enu_m - places_m, axis=-1) - base_m
    shown_m = np.linalg.norm(sat_enu_m - MEACONER_ENU_M, axis=-1) - base_m
    way_m = np.linalg.norm(places_m - MEACONER_ENU_M, axis=-1) + DELAY_M
    return np.stack([true_m, shown_m + way_m], axis=-1)


def draw_errors(noise: Noise, shape: tuple[int, ...], rng: np.random.Generator) -> Reals:
    """Draw errors (windows, N, ...) in metres of stationary AR(1) and a constant."""
    unit = rng.standard_normal(shape)
    if noise.phi:
        unit[:, 1:] *= np.sqrt(1.0 - noise.phi**2)
        unit = lfilter([1.0], [1.0, -noise.phi], unit, axis=1)
    constant = noise.constant_m * rng.standard_normal((shape[0], 1, *shape[2:])) if noise.constant_m else 0.0
    return np.asarray(noise.sigma_m * unit + constant)


def paper_decision(range_m: Reals, *, tested: Tested, rate: float = ALPHA_PAPER) -> Kept:
    """Decide by detector 1b ("line" of code) or 2b ("slope" of carrier) and the counting rule.

    range_m : (windows, N, 7, R, 2).
    """
    receivers = range_m.shape[3]
    tracks = pairings(receivers)  # here: which track of each receiver a single difference is made of
    chosen = np.stack([range_m[..., np.arange(receivers), track] for track in tracks], axis=3)  # (W, N, 7, 2^R, R)
    sd_m = chosen[..., 1:] - chosen[..., :1]
    flat = np.moveaxis(sd_m.reshape(*sd_m.shape[:2], SATS * len(tracks), receivers - 1), 1, 2)
    rule = counting_rule(
        reject_pairs(flat, rate, tested=tested),
        np.repeat(np.arange(SATS), len(tracks)),
        np.tile(tracks, (SATS, 1)),
    )
    kept = np.sum(~rule.removed, axis=-2).mean(axis=1)
    return Kept(kept[:, 0], kept[:, 1])


def split(range_m: Reals, geometry: SatelliteTracks) -> Split:
    """Split skies by windows' means of code. range_m : (windows, N, 7, R, 2)."""
    unit_enu, mean_m = geometry.unit_enu(range_m.shape[1]), range_m.mean(axis=1)
    first = split_skies(np.swapaxes(mean_m, 1, 2), unit_enu).first  # (W, R, 7)
    first_is_false = np.swapaxes(first, 1, 2) == 1  # or true: which is which is left to the choice
    return Split(first_is_false, _by_pairing(_sort_tracks(mean_m, first_is_false)), unit_enu)


def group_decision(skies: Split, places_m: Reals | None = None) -> Groups:
    """Decide by code, as recommended. places_m : (R, 3) if known."""
    pairing, complement = skies.pairing_m, skies.pairing_m[:, ::-1]
    if places_m is None:
        p_values = span_test(pairing, complement, skies.unit_enu).p_value
    else:
        p_values = check_known_baseline(pairing, complement, skies.unit_enu, places_m[1:] - places_m[0])
    return Groups(skies.first_is_false, p_values)


def carrier_decision(code: Groups, carrier_m: Reals) -> Groups:
    """Decide by fractions of cycles, with skies by code; where those coincide by chance, by code.

    Two receivers.

    Either may reject a pairing, at half of the rate. The sigma is what the carriers scatter from second
    to second, and 5 mm of slow error of each track. carrier_m : (windows, N, 7, R, 2).
    """
    bends_m = np.diff(carrier_m, n=2, axis=1)
    thermal_m = np.sqrt(np.mean(bends_m**2, axis=(1, 2, 3, 4)) / 6.0 / carrier_m.shape[1])
    sigma_cyc = np.sqrt(2.0) * np.hypot(thermal_m, CARRIER_BOUND_M) / WAVELENGTH_M
    one_cyc = _by_pairing(_sort_tracks(carrier_m.mean(axis=1), code.first_is_false)) / WAVELENGTH_M
    by_fractions = fraction_test(one_cyc[..., 1] - one_cyc[..., 0], sigma_cyc[:, None]).p_value
    return Groups(code.first_is_false, np.minimum(1.0, 2.0 * np.minimum(by_fractions, code.p_values)))


def mean_variance_m2(noise: Noise, window_s: int) -> float:
    """Compute the variance of a track's mean over the window."""
    lags = np.arange(1, window_s)
    correlated = 1.0 + 2.0 * np.sum((1.0 - lags / window_s) * noise.phi**lags)
    return float(noise.sigma_m**2 * correlated / window_s + noise.constant_m**2)


def bound_decided(
    receivers: tuple[str, ...], window_s: int, variance_m2: float, rate: float, *, known: bool, one_true: bool = True
) -> Bound:
    """Bound what any test of the windows' means can decide at this rate of errors.

    With the baseline known or not; mean over the geometries.

    variance_m2 : of the mean of each track, the same for all. Baseline unknown: the sky's mean square along baselines,
    3(R-1) dimensions, is the uniformly most powerful invariant statistic; chi-square if the noise is given, else F over
    all other dimensions that hold noise under both hypotheses, 2R(7-4) + 3(R-1). Baseline known: the most powerful test
    between two points, Gaussian, or Student's t over all other dimensions.
    """
    squares = np.array(_squares_m2(receivers, window_s)) / variance_m2
    squares = np.minimum(squares, 2000.0)  # beyond it the power is 1
    along = 3 * (len(receivers) - 1)
    noise = 2 * len(receivers) * (SATS - 4) + along
    if known:
        mean, dof = np.sqrt(squares * (2.0 if one_true else 1.0)), noise + along - 1
        power = special.ndtr(mean - special.ndtri(1.0 - rate))
        unknown = 1.0 - special.nctdtr(dof, mean, special.stdtrit(dof, 1.0 - rate))
    else:
        power = chi_square_power(rate, along, squares)
        unknown = noncentral_f_survival(f_threshold(rate, along, noise), along, noise, squares)
    return Bound(float(np.mean(power)), float(np.mean(unknown)))


@lru_cache
def _squares_m2(receivers: tuple[str, ...], window_s: int) -> tuple[float, ...]:
    """Compute what the sky shows along baselines in each geometry, squared, without errors."""
    places_m = np.array([PLACES[name] for name in receivers])
    squares = []
    for geometry in geometries():
        moved_m = geometry.unit_enu(window_s) @ places_m.T  # (7, R)
        # What a satellite has in common in all receivers, and a receiver in all satellites, is not seen.
        seen_m = moved_m - moved_m.mean(axis=0) - moved_m.mean(axis=1, keepdims=True) + moved_m.mean()
        squares.append(float(np.sum(seen_m**2)))
    return tuple(squares)


def _sort_tracks(values: Reals, first_is_false: Booleans) -> Reals:
    """Sort tracks to skies, (W, 7, R, 2)."""
    track = first_is_false[..., None].astype(np.intp)
    return np.take_along_axis(values, np.concatenate([track, 1 - track], axis=-1), axis=-1)


def _by_pairing(values: Reals) -> Reals:
    """Take each pairing's sky from each receiver: (W, 2^R, 7, R) from (W, 7, R, 2)."""
    receivers = np.arange(values.shape[2])
    return np.stack([values[..., receivers, skies] for skies in pairings(receivers.size)], axis=1)
