"""Write observations as a RINEX 3.05 observation file.

Tables A2 (header), A3 (records) and 4 to 10 (names of signals) of "RINEX: The Receiver Independent Exchange Format,
version 3.05" (IGS and RTCM SC-104, 2020-12-01).
"""

import os
import textwrap
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Booleans, Instants, Reals
from skyproof.formats.atomic_write import write_whole
from skyproof.formats.rinex_fields import bound_bytes, lay_out
from skyproof.gnss.signals import frequency_number_of, rinex_attribute
from skyproof.gnss.time import format_rinex_date, leap_seconds, utc_from_gpst
from skyproof.records import ObservationLog, Observations, SignalId

__all__ = ["write_obs"]

_STRETCH_EPOCHS: Final = 1024  # formatted at once, so that memory does not grow with the run
_TICK_NS: Final = 100  # an epoch's last digit: seconds are F11.7
_LOWEST, _HIGHEST = -1e9 + 1e-3, 1e10 - 1e-3  # what F14.3 holds
_COLUMNS: Final = ("pseudorange_m", "carrier_cyc", "doppler_hz", "cn0_dbhz")
_KINDS: Final = "CLDS"  # in the names of the same
_SYSTEMS: Final = {"G": "GPS", "R": "GLONASS", "E": "Galileo", "C": "BDS", "J": "QZSS", "S": "SBAS", "I": "NavIC/IRNSS"}
_TYPES_A_LINE: Final = 13
_SLOTS_A_LINE: Final = 8
_BLOCK_EPOCHS: Final = 64  # laid out at once


def write_obs(
    path: str | os.PathLike[str],
    observations: ObservationLog,
    *,
    signals: Sequence[SignalId],
    holds: str,
    marker: str,
    version: str,
    mask: Booleans | None = None,
    position_ecef_m: ArrayLike | None = None,
    comments: Sequence[str] = (),
    created_utc: np.datetime64 | None = None,
) -> None:
    """Write the named channels of `observations` to `path`, as a RINEX 3.05 observation file.

    Epochs are the receiver's own (`observations.gpst`, to 100 ns) and its clock bias is not taken off. The phase has
    the sign of the range, and Doppler is positive for an approaching satellite, as in the record. An epoch without a
    measurement is left out, and so is a satellite without one, and a number too long for its field. The loss-of-lock
    indicator of the phase is the sum of 1 where it does not continue that of the epoch before, and 2 where it may be
    half a cycle off (table A3).

    Parameters
    ----------
    signals : which channels; at every epoch at most one of each transmission (satellite, band and code).
    holds : the label that these signals have, "authentic" for instance; comments name it and list the signals.
    marker : name of the site or receiver.
    version : of this program.
    mask : (n_epochs, n_channels) of all channels of `observations`, which cells to write; all by default.
    position_ecef_m : (3,), approximate; without it the file has none, as for a moving receiver (table A2).
    created_utc : the header's date; if not given that of the first epoch, so that equal observations make equal bytes.

    Raises
    ------
    ValueError : a signal is not in the observations or has no name in RINEX, two channels have one transmission at
        one epoch, or nothing was measured on any of them; nothing is written then.
    OutputError : the file cannot be written.
    """
    channels = _find_channels(observations, signals)
    sent = [(observations.signals[k].sat, _find_name(observations.signals[k])) for k in channels]

    def stretches() -> Iterator[_Stretch]:
        for first in range(0, observations.gpst.size, _STRETCH_EPOCHS):
            part = observations.read(first, min(first + _STRETCH_EPOCHS, observations.gpst.size))
            yield _make_stretch(
                part, channels, None if mask is None else mask[first : first + part.gpst.size, channels]
            )

    kept: list[Instants] = []
    for stretch in stretches():
        for sat, name in sorted(transmission for transmission, count in Counter(sent).items() if count > 1):
            if (stretch.there[:, [transmission == (sat, name) for transmission in sent]].sum(axis=1) > 1).any():
                raise ValueError(
                    f"two of the signals of {sat} ({name}) are there at one epoch; write them to separate files"
                )
        kept.append(stretch.ticks[stretch.there.any(axis=1)])
    if not any(ticks.size for ticks in kept):
        raise ValueError(f"{marker}: no measurement on any of the {len(channels)} signals; there is nothing to write")

    types = {
        system: tuple(sorted({name for sat, name in sent if sat[0] == system}))
        for system in sorted({sat[0] for sat, _ in sent})
    }
    listed = ", ".join(_list_name(signal) for signal in sorted(signals))
    header = _write_header(
        np.concatenate(kept),
        marker=marker,
        version=version,
        position_ecef_m=position_ecef_m,
        created_utc=created_utc,
        comments=(f"Signals labelled {holds}: {listed}", *comments),
        types=types,
        slots=_find_slots(observations, channels),
    )
    with write_whole(path) as file:
        file.writelines((line + "\n").encode("ascii", "replace") for line in header)
        file.writelines(_write_blocks(stretches(), sent, types))


@dataclass(frozen=True, eq=False)
class _Stretch:
    """Of the channels written: ticks (n_epochs,); values (n_epochs, n, 4), NaN where they are missing or too long;
    there, slipped and half_open (n_epochs, n)."""

    ticks: Instants
    values: Reals
    there: Booleans
    slipped: Booleans
    half_open: Booleans


def _make_stretch(part: Observations, channels: list[int], mask: Booleans | None) -> _Stretch:
    values = np.stack([getattr(part, name)[:, channels] for name in _COLUMNS], axis=-1)
    values[~((values > _LOWEST) & (values < _HIGHEST))] = np.nan
    if mask is not None:
        values[~mask] = np.nan
    return _Stretch(
        ticks=_round_to_ticks(part.gpst),
        values=values,
        there=np.isfinite(values[..., :3]).any(axis=-1),
        slipped=part.slipped[:, channels],
        half_open=part.half_cycle_open[:, channels],
    )


def _find_channels(observations: ObservationLog, signals: Sequence[SignalId]) -> list[int]:
    """Find the columns of the signals, by satellite, band and code."""
    columns = {signal: column for column, signal in enumerate(observations.signals)}
    for signal in signals:
        if signal not in columns:
            raise ValueError(f"{signal} is not among the signals of {observations.receiver}")
    return [columns[signal] for signal in sorted(set(signals))]


def _find_name(signal: SignalId) -> str:
    """Return a signal's name in RINEX: "1C" for GPS L1 C/A."""
    name = rinex_attribute(signal.sat, signal.band, signal.code)
    if name is None:
        raise ValueError(f"{signal} has no name in RINEX")
    return name


def _list_name(signal: SignalId) -> str:
    """Name a signal in a comment: G05a, and E05 E1 Ca where it is not GPS L1 C/A."""
    usual = signal.kind == ("G", "L1", "CA") and signal.sat[0] == "G"
    return f"{signal.sat}{signal.copy}" if usual else f"{signal.sat} {signal.band} {signal.code}{signal.copy}"


def _find_slots(observations: ObservationLog, channels: Sequence[int]) -> dict[str, int]:
    """Return the frequency numbers of GLONASS satellites."""
    numbers = {
        observations.signals[k].sat: frequency_number_of(observations.signals[k].band, float(hz))
        for k, hz in zip(channels, observations.carrier_hz[channels], strict=True)
    }
    return {sat: number for sat, number in sorted(numbers.items()) if number is not None}


def _round_to_ticks(instants: Instants) -> Instants:
    ns = instants.astype("datetime64[ns]").astype(np.int64)
    return ((ns + _TICK_NS // 2) // _TICK_NS * _TICK_NS).astype("datetime64[ns]")


class _Lock:
    """Where a transmission's phase does not continue that of the epoch before: a slip, a gap, or another channel."""

    def __init__(self, sent: Sequence[tuple[str, str]]) -> None:
        self._sent = sent
        self._before = np.zeros(len(sent), np.bool_)  # whether the phase was there at the last epoch
        self._seen: set[tuple[str, str]] = set()  # whose phase was there at all: nothing came before the first

    def mark_lost(self, slip: Booleans, phase: Booleans) -> Booleans:
        """Mark losses of lock in the stretch that follows, (n_epochs, n)."""
        begins = phase & ~np.vstack([self._before, phase[:-1]])
        columns: dict[tuple[str, str], list[int]] = {}
        for column, transmission in enumerate(self._sent):
            columns.setdefault(transmission, []).append(column)
        for transmission in columns.keys() - self._seen:
            own_columns = np.array(columns[transmission])
            epochs = np.flatnonzero(phase[:, own_columns].any(axis=1))
            if epochs.size:
                begins[epochs[0], own_columns] = False
                self._seen.add(transmission)
        self._before = phase[-1]
        return np.asarray(phase & (slip | begins))


# --- the header: 60 columns of text, 20 of label (table A2)


def _write_header(
    epochs: Instants,
    *,
    marker: str,
    version: str,
    position_ecef_m: ArrayLike | None,
    comments: Sequence[str],
    created_utc: np.datetime64 | None,
    types: Mapping[str, Sequence[str]],
    slots: Mapping[str, int],
) -> Iterator[str]:
    created = format_rinex_date(utc_from_gpst(epochs[0]) if created_utc is None else created_utc)
    system = f"{next(iter(types))}: {_SYSTEMS[next(iter(types))]}" if len(types) == 1 else "M: Mixed"
    yield _format_line(f"{3.05:9.2f}{'':11}{'OBSERVATION DATA':20}{system:20}", "RINEX VERSION / TYPE")
    yield _format_line(f"{f'skyproof {version}':20.20}{'':20}{created:20}", "PGM / RUN BY / DATE")
    for comment in comments:
        for part in textwrap.wrap(comment, 60):
            yield _format_line(part, "COMMENT")
    yield _format_line(marker, "MARKER NAME")
    yield _format_line("NON_GEODETIC", "MARKER TYPE")
    yield _format_line("", "OBSERVER / AGENCY")
    yield _format_line(f"{'':20}{'skyproof':20}{version:20.20}", "REC # / TYPE / VERS")
    yield _format_line("", "ANT # / TYPE")
    if position_ecef_m is not None:
        x_m, y_m, z_m = np.asarray(position_ecef_m, np.float64)
        yield _format_line(f"{x_m:14.4f}{y_m:14.4f}{z_m:14.4f}", "APPROX POSITION XYZ")
    yield _format_line(f"{0.0:14.4f}{0.0:14.4f}{0.0:14.4f}", "ANTENNA: DELTA H/E/N")
    for letter, names in types.items():
        types_here = [kind + name for name in names for kind in _KINDS]
        for first in range(0, len(types_here), _TYPES_A_LINE):
            begin = f"{letter}  {len(types_here):3d}" if first == 0 else " " * 6
            yield _format_line(f"{begin} {' '.join(types_here[first : first + _TYPES_A_LINE])}", "SYS / # / OBS TYPES")
    yield _format_line("DBHZ", "SIGNAL STRENGTH UNIT")
    if epochs.size > 1:
        interval_s = float(np.median(np.diff(epochs).astype(np.int64))) / 1e9
        yield _format_line(f"{interval_s:10.3f}", "INTERVAL")
    for epoch, label in ((epochs[0], "TIME OF FIRST OBS"), (epochs[-1], "TIME OF LAST OBS")):
        year, month, day, hour, minute, second_ticks = _split_calendar(epoch)
        yield _format_line(
            f"{year:6d}{month:6d}{day:6d}{hour:6d}{minute:6d}{_format_seconds(second_ticks):>13}{'':5}{'GPS':3}", label
        )
    yield _format_line(f"{0:6d}", "RCV CLOCK OFFS APPL")
    for letter, names in types.items():
        for name in names:
            yield _format_line(f"{letter} L{name}  0.00000", "SYS / PHASE SHIFT")
    if "R" in types:
        listed = [f"{sat}{number:3d}" for sat, number in slots.items()]
        for first in range(0, max(len(listed), 1), _SLOTS_A_LINE):
            begin = f"{len(listed):3d}" if first == 0 else " " * 3
            yield _format_line(f"{begin} {' '.join(listed[first : first + _SLOTS_A_LINE])}", "GLONASS SLOT / FRQ #")
        yield _format_line("", "GLONASS COD/PHS/BIS")  # blank: not known (table A2)
    yield _format_line(f"{leap_seconds(epochs[0]):6d}", "LEAP SECONDS")
    yield _format_line("", "END OF HEADER")


def _format_line(text: str, label: str) -> str:
    plain = "".join(letter if letter.isprintable() else " " for letter in text)
    return f"{plain:60.60}{label:20}"


# --- the records (table A3)


def _write_blocks(
    stretches: Iterable[_Stretch], sent: Sequence[tuple[str, str]], types: Mapping[str, Sequence[str]]
) -> Iterator[bytes]:
    lock = _Lock(sent)
    sats = sorted({sat for sat, _ in sent})
    sat_of = np.array([sats.index(sat) for sat, _ in sent], np.int64)
    names = np.frombuffer("".join(sats).encode("ascii"), np.uint8).reshape(-1, 3).copy()
    slot = np.array([types[sat[0]].index(name) for sat, name in sent], np.int64)
    slots = np.array([len(types[sat[0]]) for sat in sats], np.int64)
    for stretch in stretches:
        phase = np.isfinite(stretch.values[..., 1])
        indicator = 1 * lock.mark_lost(stretch.slipped, phase) + 2 * (phase & stretch.half_open)
        for first in range(0, len(stretch.ticks), _BLOCK_EPOCHS):
            rows = slice(first, first + _BLOCK_EPOCHS)
            heads = np.array([list(_format_head(tick)) for tick in stretch.ticks[rows]], np.uint8)
            out = np.empty(len(heads) * bound_bytes(heads.shape[1], slots), np.uint8)
            whole = (np.ascontiguousarray(cells[rows]) for cells in (stretch.values, stretch.there, indicator))
            yield out[: lay_out(*whole, heads, sat_of, names, slot, slots, out)].tobytes()


def _format_head(instant: np.datetime64) -> bytes:
    """Write an epoch's line up to the number of satellites."""
    year, month, day, hour, minute, ticks = _split_calendar(instant)
    return f"> {year:4d} {month:02d} {day:02d} {hour:02d} {minute:02d}{_format_seconds(ticks):>11}  0".encode("ascii")


def _split_calendar(instant: np.datetime64) -> tuple[int, int, int, int, int, int]:
    """Split an instant into year, month, day, hour, minute and ticks of the second."""
    minute = instant.astype("datetime64[m]")
    moment = minute.item()
    ticks = int((instant - minute).astype(np.int64)) // _TICK_NS
    return moment.year, moment.month, moment.day, moment.hour, moment.minute, ticks


def _format_seconds(ticks: int) -> str:
    whole, fraction = divmod(ticks, 10_000_000)
    return f"{whole:3d}.{fraction:07d}"
