"""Find cells that no satellite and receiver can give: misread ones, by their numbers alone.

A pseudorange is c times the time of travel by two clocks. Its bounds are those of the satellite's orbit, seen from the
Earth's surface or the air, widened by what a receiver's clock may be off. A clock that is off further shifts all ranges
of an epoch alike: where nearly all of them fit by one such shift, it is the clock.

Nothing that an attack can make is left out. False ranges, a code that moves away from its carrier, and a Doppler that
contradicts either are what detectors look for; here they are reported at most. A whole type is left out where its rates
are those of another unit or sign: no transmitter makes all satellites' carriers move by metres in place of cycles.
docs/design/plausible-cells.md says more.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from skyproof.arrays import Booleans, Indices, Reals
from skyproof.formats.bounds import describe_first
from skyproof.gnss.constants import FASTEST_M_S, SPEED_OF_LIGHT_M_S, WGS84_A_M
from skyproof.gnss.ephemeris import GEOSTATIONARY
from skyproof.gnss.signals import rinex_attribute
from skyproof.records import SignalId
from skyproof.remarks import Remark, RemarkKind

__all__ = ["LETTERS", "Implausible", "describe_impossible", "leave_out_impossible"]

_GEOSYNCHRONOUS_KM: Final = 41_900.0, 42_500.0
_ORBITS_KM: Final = {
    "G": (25_700.0, 27_400.0),  # semi-major axis 26,560 km, eccentricity up to 0.03; IS-GPS-200N, table 20-IV
    "R": (25_200.0, 25_800.0),  # 25,508 km, up to 0.01; GLONASS ICD 5.1, 1.2
    "E": (23_300.0, 32_700.0),  # 29,600 km; two in orbits of 27,977 km and 0.166; OS SIS ICD 2.1
    "C": (27_600.0, 43_100.0),  # 27,906 km, and inclined geosynchronous ones to 0.02; BDS-SIS-ICD-B1I-3.0, 3.1
    "J": (38_300.0, 46_100.0),  # 42,164 km, up to 0.09; IS-QZSS-PNT-005, 3.1
    "I": _GEOSYNCHRONOUS_KM,
    "S": _GEOSYNCHRONOUS_KM,
}
"""Least and greatest distance of a system's satellites from the Earth's centre."""
_HEIGHT_M: Final = 1e5  # of a receiver over the ellipsoid, at most
_CLOCK_S: Final = 0.01
"""By which a receiver's clock may be off: most step it at a millisecond; some count whole code periods from a start
that they know to a few of them."""
_SHIFTED_CELLS: Final = 4  # that show a clock further off: so many unknowns have position and clock
_SHIFTED_SHARE: Final = 0.9  # of an epoch's cells, that must fit by one shift
_CN0_DBHZ: Final = 0.0, 70.0  # 70 is 15 dB over what any satellite of these systems gives on the ground
_MOVING_M_S: Final = 50.0  # at which a rate shows its unit through the noise of codes
_SATELLITES: Final = 3  # of an epoch, whose rates are compared
_PAIRS: Final = 10  # of neighbouring epochs, of all satellites of a type, that show one
_MEDIAN_NEAR, _CELLS_NEAR, _CELLS_SHARE = 0.05, 0.3, 0.8
"""How near the median of ratios and the ratios of so many cells come to what another unit makes."""
_AGREEING: Final = 0.5  # of the rate, and of the cells, that agree at least
_MISREAD: Final = 0.9  # of a type's pseudoranges: when so many are impossible, its columns are others'
LETTERS: Final = {"pseudorange_m": "C", "carrier_cyc": "L", "doppler_hz": "D", "cn0_dbhz": "S"}
"""Of a type's name in RINEX 3, by what it measures."""


@dataclass(frozen=True)
class Implausible:
    """Cells that were left out.

    counts : cells by type, such as "G C2W". misread : types that were left out as a whole, and why. remarks : on types
    that were kept. ranges : (n_epochs, n_signals), where a pseudorange of a kept type is missing now.
    """

    counts: dict[str, int] = field(default_factory=dict)
    misread: dict[str, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    ranges: Booleans = field(default_factory=lambda: np.zeros((0, 0), np.bool_))


def leave_out_impossible(
    cells: Mapping[str, Reals],
    *,
    signals: Sequence[SignalId],
    elapsed_s: Reals,
    carrier_hz: Reals,
    misread: Mapping[str, str] | None = None,
) -> tuple[dict[str, Reals], Implausible]:
    """Return the cells without those that are impossible, and what these were.

    Parameters
    ----------
    cells : pseudorange_m, carrier_cyc, doppler_hz and cn0_dbhz, each (n_epochs, n_signals), NaN where there is none.
    elapsed_s : (n_epochs,) of each epoch. carrier_hz : (n_signals,), NaN where it is not known.
    misread : `Implausible.misread` of an earlier part of the same file, whose types are left out here as well.
    """
    kept = {name: np.array(values) for name, values in cells.items()}
    wavelength_m = SPEED_OF_LIGHT_M_S / carrier_hz
    lowest_dbhz, highest_dbhz = _CN0_DBHZ
    possible = {
        "pseudorange_m": _mark_possible_ranges(kept["pseudorange_m"], signals),
        "doppler_hz": ~(np.abs(kept["doppler_hz"] * wavelength_m) > FASTEST_M_S),
        "cn0_dbhz": ~((kept["cn0_dbhz"] < lowest_dbhz) | (kept["cn0_dbhz"] > highest_dbhz)),
    }
    types = _group_by_type(signals)
    impossible_types = [name for name, columns in types.items() if _are_mostly_impossible(kept, possible, columns)]
    for name, fits in possible.items():
        kept[name][~fits] = np.nan
    faults, remarks, counts = dict(misread or {}), list[str](), dict[str, int]()
    ranges = ~possible["pseudorange_m"]
    for name, columns in types.items():
        called = {observable: f"{name[0]} {letter}{name[1:]}" for observable, letter in LETTERS.items()}
        rates = _Rates.of(kept, columns, elapsed_s, wavelength_m)
        for observable, words, out in _find_faults(rates, of_others=name in impossible_types):
            if out:
                faults.setdefault(called[observable], words)
            elif called[observable] not in faults:
                remarks.append(Remark(f"{called[observable]} {words}", RemarkKind.BEARS))
        for observable, values in kept.items():
            if called[observable] in faults:
                values[:, columns] = np.nan
                if observable == "pseudorange_m":
                    ranges[:, columns] = False
            gone = np.isfinite(cells[observable][:, columns]) & ~np.isfinite(values[:, columns])
            if gone.any():
                counts[called[observable]] = int(gone.sum())
    ranges[:, [column for name in impossible_types for column in types[name]]] = False
    return kept, Implausible(counts, faults, tuple(remarks), ranges)


def describe_impossible(counts: Mapping[str, int], misread: Mapping[str, str]) -> list[str]:
    """Describe what is omitted: the number of cells by type, and whole types with the reason."""
    if not counts:
        return []
    most = sorted(counts, key=lambda name: -counts[name])
    listed = ", ".join(describe_first(most, lambda name: f"{name} {counts[name]}"))
    reasons = [f"{', '.join(describe_first(names, str))} {words}" for words, names in _group_by_words(misread).items()]
    counted = f"{sum(counts.values())} cells hold no value that a receiver can measure and are left out: {listed}"
    return [Remark(words, RemarkKind.BEARS) for words in (counted, *reasons)]


def _group_by_words(misread: Mapping[str, str]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for name, words in misread.items():
        found.setdefault(words, []).append(name)
    return found


def _group_by_type(signals: Sequence[SignalId]) -> dict[str, Indices]:
    """Group columns by system, band and code, such as "G2W"."""
    names = np.array([f"{s.sat[0]}{rinex_attribute(s.sat, s.band, s.code) or s.band + s.code}" for s in signals])
    return {str(name): np.flatnonzero(names == name) for name in np.unique(names)}


# --- each cell by itself


def _compute_range_bounds_m(signals: Sequence[SignalId]) -> tuple[Reals, Reals]:
    """Return the least and the greatest range of each signal's satellite, from overhead and from the horizon."""
    orbits_km = [_GEOSYNCHRONOUS_KM if s.sat in GEOSTATIONARY else _ORBITS_KM[s.sat[0]] for s in signals]
    lowest_m, highest_m = 1e3 * np.array(orbits_km).reshape(-1, 2).T
    top_m = WGS84_A_M + _HEIGHT_M
    beyond_horizon_m = np.sqrt(top_m**2 - WGS84_A_M**2)
    return lowest_m - top_m, np.sqrt(highest_m**2 - WGS84_A_M**2) + beyond_horizon_m


def _mark_possible_ranges(range_m: Reals, signals: Sequence[SignalId]) -> Booleans:
    """Return where a range is possible, or missing."""
    least_m, most_m = _compute_range_bounds_m(signals)
    clock_m = _CLOCK_S * SPEED_OF_LIGHT_M_S
    missing = np.isnan(range_m)
    possible = missing | ((range_m >= least_m - clock_m) & (range_m <= most_m + clock_m))
    count = (~missing).sum(axis=1)
    rows = np.flatnonzero(((~possible).sum(axis=1) > 0.5 * count) & (count >= _SHIFTED_CELLS))
    if rows.size:
        least_shift_m = np.nanpercentile(range_m[rows] - most_m, 100.0 * _SHIFTED_SHARE, axis=1, keepdims=True)
        most_shift_m = np.nanpercentile(range_m[rows] - least_m, 100.0 * (1.0 - _SHIFTED_SHARE), axis=1, keepdims=True)
        right_m = range_m[rows] - 0.5 * (least_shift_m + most_shift_m)
        fits = (right_m >= least_m) & (right_m <= most_m)
        shifted = fits.sum(axis=1) >= _SHIFTED_SHARE * count[rows]
        possible[rows[shifted]] = fits[shifted] | missing[rows[shifted]]
    return np.asarray(possible)


def _are_mostly_impossible(cells: Mapping[str, Reals], possible: Mapping[str, Booleans], columns: Indices) -> bool:
    count = int(np.isfinite(cells["pseudorange_m"][:, columns]).sum())
    wrong = int((~possible["pseudorange_m"][:, columns]).sum())
    return count >= _PAIRS and wrong >= _MISREAD * count


# --- types as a whole, by their rates


@dataclass(frozen=True, eq=False)
class _Rates:
    """Range rates in m/s of one type, (n_epochs - 1, n_columns), as code, carrier and Doppler show them.

    wavelength_m : of the type. strengths : whether all its Dopplers are numbers that C/N0 has.
    """

    code: Reals
    carrier: Reals
    doppler: Reals
    wavelength_m: float
    strengths: bool

    @classmethod
    def of(cls, cells: Mapping[str, Reals], columns: Indices, elapsed_s: Reals, wavelength_m: Reals) -> "_Rates":
        """Return those between neighbouring epochs."""
        apart_s = np.diff(elapsed_s)[:, None]
        doppler_hz = cells["doppler_hz"][:, columns]
        known = wavelength_m[columns][np.isfinite(wavelength_m[columns])]
        measured = doppler_hz[np.isfinite(doppler_hz)]
        return cls(
            code=np.diff(cells["pseudorange_m"][:, columns], axis=0) / apart_s,
            carrier=np.diff(cells["carrier_cyc"][:, columns], axis=0) / apart_s * wavelength_m[columns],
            doppler=-0.5 * (doppler_hz[1:] + doppler_hz[:-1]) * wavelength_m[columns],
            wavelength_m=float(known.mean()) if known.size else np.nan,
            strengths=bool(measured.size and ((measured > 0.0) & (measured <= _CN0_DBHZ[1])).all()),
        )


def _find_faults(rates: _Rates, *, of_others: bool) -> list[tuple[str, str, bool]]:
    """Return observable, words, and whether it is to be left out, for each fault of a type.

    of_others : whether its pseudoranges are impossible, so that its columns may be those of other types.
    """
    if of_others and not _do_agree(rates.doppler, rates.carrier):
        words = "left out: the pseudoranges are impossible, carrier and Doppler do not agree: columns of other types"
        return [(observable, words, True) for observable in ("carrier_cyc", "doppler_hz")]
    faults = list[tuple[str, str, bool]]()
    unit = _find_unit(rates.carrier, rates.code, rates.wavelength_m)
    if unit == "metres" and _do_agree(rates.doppler, rates.carrier):
        faults.append(("pseudorange_m", "left out: cycles of the carrier, expected metres", True))
    elif unit:
        faults.append(("carrier_cyc", f"left out: {unit}, expected cycles that grow with the range", True))
    elif _do_disagree(rates.carrier, rates.code):
        faults.append(("carrier_cyc", "does not follow the pseudoranges; kept, for an attack can do that", False))
    wrong = any(observable == "carrier_cyc" and out for observable, _, out in faults)
    of_carrier = bool(np.isfinite(rates.carrier).any()) and not wrong
    reference, reference_name = (rates.carrier, "carrier phases") if of_carrier else (rates.code, "pseudoranges")
    unit = _find_unit(rates.doppler, reference, rates.wavelength_m)
    if unit:
        words = unit.replace("cycles", "hertz").replace("metres", "metres a second")
        faults.append(("doppler_hz", f"left out: {words}, expected hertz that fall as the range rate grows", True))
    elif _do_disagree(rates.doppler, reference) and rates.strengths:
        faults.append(("doppler_hz", "left out: numbers as of C/N0, expected hertz", True))
    elif _do_disagree(rates.doppler, reference):
        faults.append(("doppler_hz", f"does not follow the {reference_name}; kept, for an attack can do that", False))
    return faults


def _compute_ratios(rate: Reals, reference: Reals) -> Reals:
    """Return one rate over the other, where satellites move apart: each off the mean of its epoch.

    So a drift of the receiver's clock does not matter, which some receivers take out of one observable alone.
    """
    usable = np.isfinite(rate) & np.isfinite(reference)
    usable &= usable.sum(axis=1, keepdims=True) >= _SATELLITES
    count = np.maximum(usable.sum(axis=1, keepdims=True), 1)
    rate, reference = (
        np.where(usable, x, 0.0) - np.where(usable, x, 0.0).sum(axis=1, keepdims=True) / count
        for x in (rate, reference)
    )
    used = usable & (np.abs(reference) > _MOVING_M_S)
    return np.asarray(rate[used] / reference[used])


def _find_unit(rate: Reals, reference: Reals, wavelength_m: float) -> str:
    """Return the unit and sign, other than the right ones, that make the rate what it is; "" if none does."""
    ratios = _compute_ratios(rate, reference)
    if ratios.size < _PAIRS:
        return ""
    median = float(np.median(ratios))
    units = {
        "metres": wavelength_m,
        "metres of the other sign": -wavelength_m,
        "cycles of the other sign": -1.0,
        "half cycles": 2.0,
    }
    for unit, ratio in units.items():
        near = np.abs(ratios - ratio) < _CELLS_NEAR * abs(ratio)
        if abs(median - ratio) < _MEDIAN_NEAR * abs(ratio) and near.mean() > _CELLS_SHARE:
            return unit
    return ""


def _do_agree(rate: Reals, reference: Reals) -> bool:
    ratios = _compute_ratios(rate, reference)
    return ratios.size >= _PAIRS and bool(np.mean(np.abs(ratios - 1.0) < _AGREEING) > _AGREEING)


def _do_disagree(rate: Reals, reference: Reals) -> bool:
    ratios = _compute_ratios(rate, reference)
    return ratios.size >= _PAIRS and not np.mean(np.abs(ratios - 1.0) < _AGREEING) > _AGREEING
