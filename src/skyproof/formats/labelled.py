"""Convert measurements and fixes to labelled tables of pandas and xarray, which are extras of the package."""

from collections.abc import Mapping
from importlib import import_module
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from skyproof.errors import SettingsError
from skyproof.formats.tables import build_fixes_columns
from skyproof.records import OBSERVABLES, CellStatus, Fix, ObservationLog, Observations

__all__ = ["to_dataframe", "to_xarray"]

_UNITS: Final = {"m": "m", "cyc": "cycle", "hz": "Hz", "dbhz": "dB-Hz", "s": "s", "deg": "degree"}
"""By the end of a name."""
_OF_RUN: Final = ("receiver", "kind")
"""Columns of the table of fixes that one `Fix` has no rows for: they are one value, or not known to it."""


def to_dataframe(record: ObservationLog | Fix) -> Any:
    """Return measurements or fixes as a `pandas.DataFrame`. Needs the extra `skyproof[pandas]`.

        observations = sp.receive("rx1.bin", nav="brdc0010.22n").observations
        print(sp.to_dataframe(observations).groupby("sat").cn0_dbhz.median())

    Parameters
    ----------
    record : `Observations`, in memory or on a disk, or a `Fix`; of one receiver.

    Returns
    -------
    pandas.DataFrame : of observations a row an epoch and tracked signal, with the fields of `Observations`, the
        signal as `sat`, `band`, `code`, `copy`, and `status` as the name of a `CellStatus`. Of a fix a row an epoch
        that has one, with the columns of fixes.csv.

    Raises
    ------
    SettingsError : pandas is not installed.
    """
    pandas = _load_library("pandas", "to_dataframe")
    return pandas.DataFrame(_fix_rows(record) if isinstance(record, Fix) else _list_cells(record))


def to_xarray(record: ObservationLog | Fix) -> Any:
    """Return measurements or fixes as an `xarray.Dataset` along `gpst`. Needs the extra `skyproof[xarray]`.

        observations = sp.receive("rx1.bin", nav="brdc0010.22n").observations
        print(sp.to_xarray(observations).pseudorange_m.sel(signal="G05 L1 CA a"))

    Parameters
    ----------
    record : `Observations`, in memory or on a disk, or a `Fix`; of one receiver.

    Returns
    -------
    xarray.Dataset : of observations along `gpst` and `signal`, the fields of `Observations` under their names. Of a fix
        along `gpst`, the epochs that have one, with the columns of fixes.csv. Each variable has its `units`.

    Raises
    ------
    SettingsError : xarray is not installed.
    """
    xarray = _load_library("xarray", "to_xarray")
    if isinstance(record, Fix):
        columns = _fix_rows(record)
        times = columns.pop("gpst")
        columns.pop("receiver")
        variables = {name: ("gpst", column, _get_attributes(name)) for name, column in columns.items()}
        return xarray.Dataset(variables, {"gpst": times}, {"receiver": record.receiver})
    o = _read_all(record)
    cells = {
        name: (("gpst", "signal"), getattr(o, name), _get_attributes(name))
        for name in (*OBSERVABLES, "status", "half_cycle_open", "quadrature_m")
    }
    of_signals = {name: getattr(o, name) for name in ("carrier_hz", "found_elapsed_s", "missed_elapsed_s")}
    of_signals |= {name: [getattr(s, name) for s in o.signals] for name in ("sat", "band", "code", "copy")}
    coordinates = {
        "gpst": o.gpst,
        "signal": [str(signal) for signal in o.signals],
        "elapsed_s": ("gpst", o.elapsed_s, _get_attributes("elapsed_s")),
        **{name: ("signal", values, _get_attributes(name)) for name, values in of_signals.items()},
    }
    return xarray.Dataset(cells, coordinates, {"receiver": o.receiver, "averaged_s": o.averaged_s})


def _load_library(name: str, asker: str) -> Any:
    """Load a library that is there only if it was asked for."""
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise SettingsError(
            f"{asker} needs {error.name}, which is not installed; install the extra: pip install 'skyproof[{name}]'"
        ) from error


def _read_all(log: ObservationLog) -> Observations:
    return log.read(0, log.gpst.size)


def _fix_rows(fix: Fix) -> dict[str, NDArray[Any]]:
    columns = build_fixes_columns([("", fix)])
    return {"receiver": columns["receiver"]} | {name: c for name, c in columns.items() if name not in _OF_RUN}


def _list_cells(log: ObservationLog) -> dict[str, NDArray[Any]]:
    o = _read_all(log)
    rows, channels = np.nonzero(o.status != CellStatus.NOT_TRACKED)
    names = np.array([(s.sat, s.band, s.code, s.copy) for s in o.signals], np.str_).reshape(-1, 4)
    status = np.array([CellStatus(number).name for number in sorted(CellStatus)])
    return {
        "receiver": np.full(rows.size, o.receiver),
        "gpst": o.gpst[rows],
        "elapsed_s": o.elapsed_s[rows],
        **{name: names[channels, k] for k, name in enumerate(("sat", "band", "code", "copy"))},
        **{name: getattr(o, name)[rows, channels] for name in OBSERVABLES},
        "status": status[o.status[rows, channels]],
        **{name: getattr(o, name)[rows, channels] for name in ("half_cycle_open", "quadrature_m")},
        "carrier_hz": o.carrier_hz[channels],
    }


def _get_attributes(name: str) -> Mapping[str, str]:
    unit = _UNITS.get(name.rpartition("_")[2])
    return {} if unit is None else {"units": unit}
