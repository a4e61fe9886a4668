"""Measurements as logs give them, a row a signal and epoch, to `Observations`."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from skyproof.arrays import Booleans, Instants, Integers, Octets, Reals
from skyproof.compiled import compiled
from skyproof.gnss.signals import carrier_hz_of
from skyproof.gnss.thermal_noise import carrier_sigma_cyc, code_sigma_m, doppler_sigma_hz
from skyproof.records import OBSERVABLES, CellStatus, Observations, SignalId

__all__ = ["SignalRows", "epochs_without_signals", "observations_from_rows"]

_UNKNOWN_CN0_DBHZ: Final = 40.0  # of a cell without one, for its sigmas alone


@dataclass(frozen=True, eq=False, kw_only=True)
class SignalRows:
    """Measurements of one receiver, a row a signal and epoch, in any order; NaN where there is none.

    instant_ns : (n_rows,) what the receiver's clock shows, nanoseconds of GPS time since 1970.
    signal : (n_rows,) index into `signals`. frequency_numbers : of GLONASS's satellites, by name.
    carrier_cyc : grows when the range grows. doppler_hz : falls with a growing range rate.
    pseudorange_sigma_m, carrier_sigma_cyc, doppler_sigma_hz : as the receiver states them; NaN takes thermal noise.
    slipped, half_cycle_open : (n_rows,) of the carrier.
    """

    signals: tuple[SignalId, ...]
    frequency_numbers: dict[str, int]
    instant_ns: Integers
    signal: Integers
    pseudorange_m: Reals
    carrier_cyc: Reals
    doppler_hz: Reals
    cn0_dbhz: Reals
    pseudorange_sigma_m: Reals
    carrier_sigma_cyc: Reals
    doppler_sigma_hz: Reals
    slipped: Booleans
    half_cycle_open: Booleans


def observations_from_rows(rows: SignalRows, receiver: str) -> Observations | None:
    """Put rows into a grid of epochs and signals; None where no row holds a measurement.

    Of two rows of one signal and epoch the first counts. Zero is no measurement of a code or a carrier.
    """
    columns = np.stack([np.asarray(getattr(rows, name), np.float64) for name in OBSERVABLES])
    signal = np.ascontiguousarray(rows.signal, np.int64)
    measured = np.empty(signal.size, np.bool_)
    counts = np.zeros(len(rows.signals), np.int64)
    _find_measured(columns, signal, measured, counts)
    if not counts.any():
        return None
    names = sorted({rows.signals[k] for k in np.flatnonzero(counts)})
    column_of = {name: k for k, name in enumerate(names)}
    place = np.array([column_of.get(name, -1) for name in rows.signals])
    instant_ns, epoch = _epochs_of(np.ascontiguousarray(rows.instant_ns, np.int64), measured)
    shape = instant_ns.size, len(names)
    grids = np.full((len(OBSERVABLES), *shape), np.nan)
    status = np.full(shape, CellStatus.NOT_TRACKED, np.uint8)
    half_open = np.zeros(shape, np.bool_)
    chip_m = np.array([s.plan.chip_m for s in names])
    _fill(
        columns,
        place[signal],
        epoch,
        measured,
        np.ascontiguousarray(rows.slipped, np.bool_),
        np.ascontiguousarray(rows.half_cycle_open, np.bool_),
        chip_m,
        _THERMAL,
        grids,
        status,
        half_open,
    )
    elapsed_s = (instant_ns - instant_ns[0]) * 1e-9
    found = (status != CellStatus.NOT_TRACKED).argmax(axis=0)
    return Observations(
        receiver=receiver,
        signals=tuple(names),
        gpst=instant_ns.astype("datetime64[ns]"),
        elapsed_s=elapsed_s,
        **dict[str, Any](zip(OBSERVABLES, grids, strict=True)),
        status=status,
        half_cycle_open=half_open,
        found_elapsed_s=elapsed_s[found],
        missed_elapsed_s=np.where(found > 0, elapsed_s[np.maximum(found - 1, 0)], np.nan),
        carrier_hz=np.array([carrier_hz_of(s.band, rows.frequency_numbers.get(s.sat)) for s in names]),
    )


_LOWEST_DBHZ, _HIGHEST_DBHZ, _STEPS_A_DB = 15.0, 60.0, 64  # finer than receivers write
_LEVELS_DBHZ: Final = np.arange(_LOWEST_DBHZ, _HIGHEST_DBHZ + 0.5 / _STEPS_A_DB, 1.0 / _STEPS_A_DB)
_THERMAL: Final = np.stack(
    [code_sigma_m(_LEVELS_DBHZ, 1.0), carrier_sigma_cyc(_LEVELS_DBHZ), doppler_sigma_hz(_LEVELS_DBHZ)]
)
"""Noise of code in chips, carrier and Doppler by C/N0: a power a cell would take longer than all else."""


_OK, _SLIP = int(CellStatus.OK), int(CellStatus.SLIP)


@compiled
def _find_measured(columns: Reals, signal: Integers, measured: Booleans, counts: Integers) -> None:
    """Fill in which rows have a code, a carrier or a Doppler, and how many of each signal have; zeros become NaN."""
    for k in range(signal.size):
        for which in range(2):
            if columns[which, k] == 0.0:
                columns[which, k] = np.nan
        measured[k] = np.isfinite(columns[0, k]) or np.isfinite(columns[1, k]) or np.isfinite(columns[2, k])
        counts[signal[k]] += measured[k]


@compiled
def _fill(
    columns: Reals,
    column: Integers,
    epoch: Integers,
    measured: Booleans,
    slipped: Booleans,
    half_open: Booleans,
    chip_m: Reals,
    thermal: Reals,
    grids: Reals,
    status: Octets,
    half_grid: Booleans,
) -> None:
    """Fill the grids with the rows, the first one of a cell last. What has no stated sigma takes thermal noise."""
    for k in range(measured.size - 1, -1, -1):
        if not measured[k]:
            continue
        e, c = epoch[k], column[k]
        for which in range(4):
            grids[which, e, c] = columns[which, k]
        level_dbhz = columns[3, k] if np.isfinite(columns[3, k]) else _UNKNOWN_CN0_DBHZ
        level_dbhz = min(max(level_dbhz, _LOWEST_DBHZ), _HIGHEST_DBHZ)
        step = int((level_dbhz - _LOWEST_DBHZ) * _STEPS_A_DB + 0.5)
        for which in range(3):
            if not np.isfinite(columns[which, k]):
                grids[4 + which, e, c] = np.nan
            elif np.isfinite(columns[4 + which, k]):
                grids[4 + which, e, c] = columns[4 + which, k]
            else:
                grids[4 + which, e, c] = thermal[which, step] * (chip_m[c] if which == 0 else 1.0)
        status[e, c] = _SLIP if slipped[k] else _OK
        half_grid[e, c] = half_open[k]


def _epochs_of(instant_ns: Integers, measured: Booleans) -> tuple[Integers, Integers]:
    """Return the distinct instants of measured rows in order, and the number of that of each row."""
    distinct, epoch = np.empty(instant_ns.size, np.int64), np.zeros(instant_ns.size, np.int64)
    n = _number_epochs(instant_ns, measured, distinct, epoch)
    if n >= 0:  # as receivers write them: no sorting
        return distinct[:n].copy(), epoch
    found, numbers = np.unique(instant_ns[measured], return_inverse=True)
    epoch[measured] = numbers
    return found, epoch


@compiled
def _number_epochs(instant_ns: Integers, measured: Booleans, distinct: Integers, epoch: Integers) -> int:
    """Fill in instants and numbers of rows in order of time; return how many instants, -1 for another order."""
    n = 0
    for k in range(instant_ns.size):
        if not measured[k]:
            continue
        if n == 0 or instant_ns[k] > distinct[n - 1]:
            distinct[n] = instant_ns[k]
            n += 1
        elif instant_ns[k] < distinct[n - 1]:
            return -1
        epoch[k] = n - 1
    return n


def epochs_without_signals(instants: Instants, receiver: str) -> Observations | None:
    """Return the epochs of a log that says where it was and not what it received; None without any.

    instants : (n,) in any order. What is not later than all before is left out.
    """
    if not instants.size:
        return None
    gpst = instants[np.append(True, instants[1:] > np.maximum.accumulate(instants)[:-1])]
    none, no_signal = np.empty((gpst.size, 0)), np.empty(0)
    cells: dict[str, Any] = dict.fromkeys(OBSERVABLES, none)
    return Observations(
        receiver=receiver,
        signals=(),
        gpst=gpst,
        elapsed_s=(gpst - gpst[0]).astype(np.int64) * 1e-9,
        status=none.astype(np.uint8),
        found_elapsed_s=no_signal,
        missed_elapsed_s=no_signal,
        carrier_hz=no_signal,
        **cells,
    )
