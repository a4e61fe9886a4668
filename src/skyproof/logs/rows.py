"""Measurements as logs give them, a row a signal and epoch, to `Observations`."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from skyproof.arrays import Booleans, Indices, Integers, Reals
from skyproof.gnss.signals import carrier_hz_of, chip_m_of
from skyproof.gnss.thermal_noise import carrier_sigma_cyc, code_sigma_m, doppler_sigma_hz
from skyproof.records import CellStatus, Observations, SignalId

__all__ = ["SignalRows", "observations_from_rows"]

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
    code_m, carrier_cyc = (np.where(values == 0.0, np.nan, values) for values in (rows.pseudorange_m, rows.carrier_cyc))
    kept = np.flatnonzero(np.isfinite(code_m) | np.isfinite(carrier_cyc) | np.isfinite(rows.doppler_hz))
    if not kept.size:
        return None
    used = np.flatnonzero(np.bincount(rows.signal[kept], minlength=len(rows.signals)))
    signals = tuple(sorted(rows.signals[k] for k in used))
    columns = {signal: k for k, signal in enumerate(signals)}
    place = np.array([columns.get(signal, -1) for signal in rows.signals])
    column = place[rows.signal[kept]]
    instant_ns, epoch = _epochs_of(rows.instant_ns[kept])
    # Of two rows of a cell the one written last stays. Copies: NumPy turns views that run backwards round again.
    backwards = epoch[::-1].copy(), column[::-1].copy()
    shape = instant_ns.size, len(signals)

    def grid(values: Any, empty: Any = np.nan) -> Any:
        cells = np.full(shape, empty, np.asarray(values).dtype)
        cells[backwards] = values[::-1].copy()
        return cells

    cn0_dbhz = rows.cn0_dbhz[kept]
    chip_m = np.array([chip_m_of(s.sat, s.band, s.code) for s in signals])[column]

    def sigma(value: Reals, stated: Reals, thermal: Callable[[Reals, Indices], Reals]) -> Reals:
        """Return what is stated of the measured cells, and thermal noise where nothing is."""
        filled = np.where(np.isfinite(value), stated, np.nan)
        lacking = np.flatnonzero(np.isfinite(value) & ~np.isfinite(stated))
        if lacking.size:
            level_dbhz = cn0_dbhz[lacking]
            filled[lacking] = thermal(np.where(np.isfinite(level_dbhz), level_dbhz, _UNKNOWN_CN0_DBHZ), lacking)
        return filled

    code_m, carrier_cyc, doppler_hz = code_m[kept], carrier_cyc[kept], rows.doppler_hz[kept]
    sigmas = {
        "pseudorange_sigma_m": sigma(
            code_m, rows.pseudorange_sigma_m[kept], lambda level, which: code_sigma_m(level, chip_m[which])
        ),
        "carrier_sigma_cyc": sigma(
            carrier_cyc, rows.carrier_sigma_cyc[kept], lambda level, _: carrier_sigma_cyc(level)
        ),
        "doppler_sigma_hz": sigma(doppler_hz, rows.doppler_sigma_hz[kept], lambda level, _: doppler_sigma_hz(level)),
    }
    elapsed_s = (instant_ns - instant_ns[0]) * 1e-9
    found = np.full(len(signals), instant_ns.size)
    np.minimum.at(found, column, epoch)
    return Observations(
        receiver=receiver,
        signals=signals,
        gpst=instant_ns.astype("datetime64[ns]"),
        elapsed_s=elapsed_s,
        pseudorange_m=grid(code_m),
        carrier_cyc=grid(carrier_cyc),
        doppler_hz=grid(doppler_hz),
        cn0_dbhz=grid(cn0_dbhz),
        **{name: grid(values) for name, values in sigmas.items()},
        status=grid(
            np.where(rows.slipped[kept], CellStatus.SLIP, CellStatus.OK).astype(np.uint8), CellStatus.NOT_TRACKED
        ),
        half_cycle_open=grid(rows.half_cycle_open[kept], False),
        found_elapsed_s=elapsed_s[found],
        missed_elapsed_s=np.where(found > 0, elapsed_s[np.maximum(found - 1, 0)], np.nan),
        carrier_hz=np.array([carrier_hz_of(s.band, rows.frequency_numbers.get(s.sat)) for s in signals]),
    )


def _epochs_of(instant_ns: Integers) -> tuple[Integers, Integers]:
    """Return the distinct instants in order, and the number of that of each row."""
    steps = np.diff(instant_ns)
    if (steps >= 0).all():  # as receivers write them: no sorting
        return instant_ns[np.append(True, steps > 0)], np.append(0, np.cumsum(steps > 0))
    distinct, epoch = np.unique(instant_ns, return_inverse=True)
    return distinct, epoch
