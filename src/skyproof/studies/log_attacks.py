"""Attacks and jammings put into measurements that a real receiver made, measurement by measurement.

What a receiver that follows false signals would have measured is its true measurement, noise and reflections and all,
plus what the false signals' ranges differ by. Code, carrier phase, Doppler and C/N0 change together: `delay_m` solves
for the range that puts the same residual onto the false place and time, with each satellite where it was when the false
signal would have left it. So a false sky is as consistent as the true one is.
"""

from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np

from skyproof.arrays import Booleans, Reals
from skyproof.detectors.code_motion.detector import select_primary_signals
from skyproof.formats.plausible import LETTERS, leave_out_impossible
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.navigation.fix import fix
from skyproof.navigation.least_squares import compute_line_of_sight
from skyproof.navigation.ranges import correct_ranges
from skyproof.records import OBSERVABLES, CellStatus, NavigationData, Observations

__all__ = [
    "SCOPES",
    "TORN",
    "FalseShift",
    "Jamming",
    "Tearing",
    "delay_m",
    "drop_carriers",
    "put_attack",
    "put_jamming",
    "put_tearing",
    "select_signals",
    "true_place_ecef_m",
]

Scope = Literal["all", "satellite", "band", "system", "gps_l1"]
SCOPES: Final[tuple[Scope, ...]] = ("all", "satellite", "band", "system", "gps_l1")
Tear = Literal["few", "alternate", "no_ranges", "milliseconds"]
TORN: Final[tuple[Tear, ...]] = ("few", "alternate", "no_ranges", "milliseconds")
_ROUNDS: Final = 3  # of the range that leads to the time it left: the second already agrees to a millimetre
_LOST_DBHZ: Final = 22.0
"""C/N0 below which a carrier loop loses a signal (Kaplan & Hegarty, 8.9: 25 dB-Hz for 15 Hz unaided, 3 dB aided)."""
_LOST_DB: Final = 18.0  # the same of a signal of 40 dB-Hz, where a receiver writes no C/N0
_MS_M: Final = 1e-3 * SPEED_OF_LIGHT_M_S
_UPPER_HZ: Final = 1.5e9  # above it lie L1, E1, B1 and G1, below it all other bands of navigation


@dataclass(frozen=True, kw_only=True)
class FalseShift:
    """What the false signals show beside the truth, from an onset on.

    onset_s : elapsed time from which on; 0 or less where the log begins under attack. jump_enu_m, velocity_enu_m_s :
    by how much the place is off at once, and how fast it moves, (3,). acceleration_m_s2 : at which that speed is
    reached; infinite at once. clock_s, clock_drift : the same of the time, positive where the receiver's clock seems
    ahead. power_db : by which signals are stronger. breaks : carriers are lost and found again at the onset.
    """

    onset_s: float
    jump_enu_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    velocity_enu_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    acceleration_m_s2: float = np.inf
    clock_s: float = 0.0
    clock_drift: float = 0.0
    power_db: float = 0.0
    breaks: bool = True

    def offset_enu_m(self, elapsed_s: Reals) -> Reals:
        """Return by how much the place is off, (n, 3), zero before the onset."""
        since_s = np.asarray(elapsed_s, np.float64) - self.onset_s
        speed_m_s = float(np.linalg.norm(self.velocity_enu_m_s))
        ramp_s = 0.0 if speed_m_s == 0.0 else speed_m_s / self.acceleration_m_s2
        t = np.maximum(since_s, 0.0)
        way_s = t if ramp_s == 0.0 else np.where(t < ramp_s, 0.5 * t**2 / max(ramp_s, 1e-9), t - 0.5 * ramp_s)
        jump_m = np.where(since_s >= 0.0, 1.0, 0.0)[:, None] * np.array(self.jump_enu_m)
        return np.asarray(jump_m + way_s[:, None] * np.array(self.velocity_enu_m_s))

    def offset_clock_s(self, elapsed_s: Reals) -> Reals:
        """Return by how much the clock is off, (n,), zero before the onset."""
        since_s = np.asarray(elapsed_s, np.float64) - self.onset_s
        return np.where(since_s >= 0.0, self.clock_s + self.clock_drift * np.maximum(since_s, 0.0), 0.0)


@dataclass(frozen=True, kw_only=True)
class Jamming:
    """Interference from begin_s to end_s that takes loss_db of C/N0, in the upper L band (L1, E1, B1, G1) or in all."""

    begin_s: float
    end_s: float
    loss_db: float
    upper_only: bool = False


@dataclass(frozen=True, kw_only=True)
class Tearing:
    """How a receiver is torn between true and false signals from `onset_s` on.

    few : two to six satellites at an epoch, others at the next. alternate : half of them true at one epoch and false at
    the next. no_ranges : single cells are cycles, or negative. milliseconds : single satellites are whole ms off.
    share : of the cells that are torn, 0 to 1.
    """

    onset_s: float
    how: Tear
    share: float


def select_signals(o: Observations, scope: Scope, *, satellite: str = "", system: str = "") -> Booleans:
    """Tell which signals (n_signals,) an attack takes.

    All, those of a satellite or of a system, those of the upper L band, or GPS L1 C/A alone.
    """
    if scope == "satellite":
        return np.array([signal.sat == satellite for signal in o.signals], np.bool_)
    if scope == "band":
        return np.asarray(o.carrier_hz > _UPPER_HZ)
    if scope == "system":
        return np.array([signal.sat[0] == system for signal in o.signals], np.bool_)
    if scope == "gps_l1":
        return np.array([signal.kind == ("G", "L1", "CA") for signal in o.signals], np.bool_)
    return np.ones(len(o.signals), np.bool_)


def true_place_ecef_m(o: Observations, navigation: NavigationData) -> Reals:
    """Estimate where the receiver was at each epoch, (n, 3), from its own codes; epochs between fixes interpolated.

    Raises ValueError if no epoch has a fix.
    """
    signals = select_primary_signals(o)
    if not signals:
        raise ValueError(f"{o.receiver}: no signals that give a place")
    found = fix(o, navigation, signals=signals, multipath_sigma_m=1.0, false_alarm_probability=1e-4)
    good = np.flatnonzero(np.isfinite(found.position_ecef_m).all(axis=1))
    if not good.size:
        raise ValueError(f"{o.receiver}: no epoch has a fix")
    columns = [np.interp(o.elapsed_s, o.elapsed_s[good], found.position_ecef_m[good, k]) for k in range(3)]
    return np.stack(columns, axis=1)


def delay_m(
    o: Observations, navigation: NavigationData, place_ecef_m: Reals, false_ecef_m: Reals, clock_m: Reals
) -> Reals:
    """Return what the ranges (n_epochs, n_signals) to a false place and time are longer by than the true ones.

    place_ecef_m, false_ecef_m : (n_epochs, 3). clock_m : (n_epochs,) c times what the clock is ahead by.
    NaN where there is no range or no orbit.
    """

    def compare_with_model_m(pseudorange_m: Reals, ecef_m: Reals) -> Reals:
        """Return the range that is left, and the one that geometry gives."""
        ranges = correct_ranges(o.signals, o.gpst, pseudorange_m, navigation, with_unknown_delay=True)
        _, _, distance_m = compute_line_of_sight(ranges.satellite_ecef_m, ecef_m)
        return np.asarray(ranges.range_m - distance_m)

    true_m = compare_with_model_m(o.pseudorange_m, place_ecef_m)
    longer_m = np.where(np.isfinite(true_m), 0.0, np.nan)
    for _ in range(_ROUNDS):
        shown_m = compare_with_model_m(o.pseudorange_m + longer_m, false_ecef_m)
        longer_m = longer_m - (shown_m - true_m - clock_m[:, None])
    return longer_m


def put_attack(
    o: Observations,
    navigation: NavigationData,
    shift: FalseShift,
    *,
    signals: Booleans,
    place_ecef_m: Reals,
    origin_ecef_m: Reals | None = None,
) -> Observations:
    """Return what the receiver would have measured, had it followed false signals from the onset on.

    signals : (n_signals,) those that are false. place_ecef_m : (n_epochs, 3) where the receiver is.
    origin_ecef_m : (n_epochs, 3) whose place the false sky is shifted from, the receiver's by default: two receivers
    under one transmitter show one place.
    """
    origin_m = place_ecef_m if origin_ecef_m is None else origin_ecef_m
    lat_rad, lon_rad, _ = geodetic_from_ecef(place_ecef_m)
    rotation = np.swapaxes(rot_enu_ecef(lat_rad, lon_rad), -1, -2)
    offset_m = (rotation @ shift.offset_enu_m(o.elapsed_s)[:, :, None])[:, :, 0]
    after = o.elapsed_s >= shift.onset_s
    false_m = np.where(after[:, None], origin_m + offset_m, place_ecef_m)
    clock_m = SPEED_OF_LIGHT_M_S * shift.offset_clock_s(o.elapsed_s)
    longer_m = delay_m(o, navigation, place_ecef_m, false_m, clock_m)
    chosen = after[:, None] & signals[None, :] & np.isfinite(longer_m)
    longer_m = np.where(chosen, longer_m, 0.0)
    wavelength_m = SPEED_OF_LIGHT_M_S / o.carrier_hz
    rate_m_s = np.zeros_like(longer_m)
    rows = np.flatnonzero(after)
    if rows.size > 1:
        rate_m_s[rows] = np.gradient(longer_m[rows], o.elapsed_s[rows], axis=0)
    status = o.status.copy()
    if shift.breaks and rows.size and rows[0] > 0:
        first = status[rows[0]]
        first[chosen[rows[0]] & (first == CellStatus.OK)] = CellStatus.SLIP
    return replace(
        o,
        pseudorange_m=o.pseudorange_m + longer_m,
        carrier_cyc=o.carrier_cyc + longer_m / wavelength_m,
        doppler_hz=o.doppler_hz - np.where(chosen, rate_m_s, 0.0) / wavelength_m,
        cn0_dbhz=o.cn0_dbhz + np.where(chosen, shift.power_db, 0.0),
        status=status,
    )


def put_jamming(o: Observations, jamming: Jamming, rng: np.random.Generator) -> Observations:
    """Return what the receiver would have measured under interference: weaker, noisier, and what is too weak lost."""
    rows = (o.elapsed_s >= jamming.begin_s) & (o.elapsed_s < jamming.end_s)
    reached = (o.carrier_hz > _UPPER_HZ) | (not jamming.upper_only)
    jammed = rows[:, None] & reached[None, :]
    weaker_dbhz = o.cn0_dbhz - jamming.loss_db
    lost = jammed & np.where(np.isfinite(o.cn0_dbhz), weaker_dbhz < _LOST_DBHZ, jamming.loss_db > _LOST_DB)
    noisier = np.where(jammed, 10.0 ** (jamming.loss_db / 20.0), 1.0)
    added = np.sqrt(noisier**2 - 1.0)
    cells: dict[str, Any] = {"cn0_dbhz": np.where(jammed, weaker_dbhz, o.cn0_dbhz)}
    for name, sigma in (
        ("pseudorange_m", "pseudorange_sigma_m"),
        ("carrier_cyc", "carrier_sigma_cyc"),
        ("doppler_hz", "doppler_sigma_hz"),
    ):
        spread = np.nan_to_num(getattr(o, sigma))
        cells[name] = getattr(o, name) + rng.standard_normal(o.status.shape) * spread * added
        cells[sigma] = getattr(o, sigma) * noisier
    return _empty_cells(replace(o, **cells), lost)


def put_tearing(true: Observations, false: Observations, tearing: Tearing, rng: np.random.Generator) -> Observations:
    """Return what a receiver writes that is torn between its true measurements and false ones of the same epochs."""
    rows = np.flatnonzero(true.elapsed_s >= tearing.onset_s)
    n = len(true.signals)
    sats = sorted({signal.sat for signal in true.signals})
    number = np.array([sats.index(signal.sat) for signal in true.signals])
    takes_false = np.zeros(true.status.shape, np.bool_)
    kept = np.ones(true.status.shape, np.bool_)
    code_m = np.zeros(true.status.shape)
    cycles = np.zeros(true.status.shape, np.bool_)
    negative = np.zeros(true.status.shape, np.bool_)
    for row in rows.tolist():
        torn = rng.random(len(sats))[number] < tearing.share
        if tearing.how == "few":
            chosen = rng.permutation(len(sats))[: rng.integers(2, 7)]
            kept[row] = np.isin(number, chosen)
            takes_false[row] = torn
        elif tearing.how == "alternate":
            takes_false[row] = (number + row) % 2 == 0
        elif tearing.how == "no_ranges":
            takes_false[row] = ~torn
            which = rng.random(n) < 0.5
            cycles[row], negative[row] = torn & which, torn & ~which
        else:
            takes_false[row] = ~torn
            steps = rng.integers(1, 4, len(sats)) * rng.choice([-1, 1], len(sats))
            code_m[row] = np.where(torn, _MS_M * steps[number], 0.0)
    cells: dict[str, Any] = {
        name: np.where(takes_false, getattr(false, name), getattr(true, name)) for name in OBSERVABLES
    }
    status = np.where(takes_false, false.status, true.status)
    changed = np.zeros_like(takes_false)
    changed[1:] = takes_false[1:] != takes_false[:-1]
    status[changed & (status == CellStatus.OK)] = CellStatus.SLIP
    wavelength_m = SPEED_OF_LIGHT_M_S / true.carrier_hz
    range_m = cells["pseudorange_m"] + code_m
    range_m = np.where(cycles, range_m / wavelength_m, np.where(negative, range_m - 4.0e7, range_m))
    cells["pseudorange_m"] = range_m
    torn_o = _empty_cells(replace(true, status=status.astype(np.uint8), **cells), ~kept & np.isfinite(range_m))
    read, implausible = leave_out_impossible(
        {name: getattr(torn_o, name) for name in LETTERS},
        signals=torn_o.signals,
        elapsed_s=torn_o.elapsed_s,
        carrier_hz=torn_o.carrier_hz,
    )
    impossible = np.where(implausible.ranges, np.uint8(CellStatus.IMPOSSIBLE), torn_o.status)
    return replace(torn_o, status=impossible, **dict[str, Any](read))


def drop_carriers(o: Observations) -> Observations:
    """Return what a receiver writes that has codes and levels alone."""
    none = np.full(o.status.shape, np.nan)
    names = ("carrier_cyc", "doppler_hz", "carrier_sigma_cyc", "doppler_sigma_hz")
    return replace(o, **dict[str, Any](dict.fromkeys(names, none)))


def _empty_cells(o: Observations, lost: Booleans) -> Observations:
    """Return measurements without those that are lost; what is found again begins with a slip."""
    cells: dict[str, Any] = {name: np.where(lost, np.nan, getattr(o, name)) for name in OBSERVABLES}
    status = np.where(lost, np.uint8(CellStatus.NOT_TRACKED), o.status)
    found = np.zeros_like(lost)
    found[1:] = lost[:-1] & ~lost[1:] & (status[1:] == CellStatus.OK)
    status[found] = CellStatus.SLIP
    return replace(o, status=status.astype(np.uint8), **cells)
