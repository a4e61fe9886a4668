"""Receivers' own logs as inputs: measurements, orbits from their messages, and what the receiver says of itself."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from skyproof.app.receive.observed import ObservedFile, OwnWords, gather_file
from skyproof.errors import InputError
from skyproof.formats.bounds import limit_remarks
from skyproof.formats.byte_io import FileBytes, measure_size, report_reading
from skyproof.formats.pieces import Workspace
from skyproof.formats.plausible import LETTERS, leave_out_impossible
from skyproof.formats.rinex_nav import get_glonass_channels
from skyproof.formats.rinex_obs_pieces import PIECE_BYTES
from skyproof.formats.rinex_obs_read import ObservationFile
from skyproof.gnss.signals import frequency_number_of
from skyproof.gnss.time import GPS_EPOCH
from skyproof.logs.content import Beside, InertialRows, LogPiece, ReceiverStates, join_rows
from skyproof.logs.kinds import HEAD_BYTES, LogKind, kind_of_log
from skyproof.logs.orbits import OrbitCollector
from skyproof.logs.wanted import protocol_of
from skyproof.records import CellStatus, FrontEndLevels, NavigationData, Observations, ReceiverFixes
from skyproof.remarks import Remark, RemarkKind

__all__ = ["holds_log", "open_log"]

_NAMED = 12  # messages of a log that a remark lists, the most frequent first


def holds_log(path: Path) -> bool:
    """Tell by its first bytes whether a file is a receiver's log."""
    return _kind_of(path) is not None


def _kind_of(path: Path) -> LogKind | None:
    measure_size(path)  # a folder is refused as samples are
    with report_reading(path), open(path, "rb") as file:
        return kind_of_log(file.read(HEAD_BYTES))


def open_log(
    path: Path,
    navigation: NavigationData | None = None,
    *,
    start_s: float = 0.0,
    duration_s: float | None = None,
    workspace: Workspace | None = None,
) -> ObservedFile:
    """Read a receiver's log of any kind that `skyproof.logs` knows.

    navigation : says the week, and GLONASS's frequency numbers, where the log does not.
    start_s, duration_s : of the stretch that is wanted; all of it if none is given.
    workspace : where the measurements of a long log are kept.

    Raises
    ------
    InputError : it cannot be read, or holds no measurements in that stretch.
    """
    kind = _kind_of(path)
    if kind is None:
        raise InputError(f"{path}: no receiver's log of a kind that is read; convert it to RINEX")
    file = FileBytes(path)
    file.sum_as_read()
    gathered = _Gathered(str(path))

    def read_blocks() -> Iterator[bytes]:
        return (file[at : at + PIECE_BYTES].tobytes() for at in range(0, measure_size(path), PIECE_BYTES))

    near = kind.first_instant(read_blocks())
    if near is None and navigation is not None and navigation.ephemerides:
        near = np.sort(navigation.reference_ns)[len(navigation.reference_ns) // 2].astype("M8[ns]")
    channels = None if navigation is None else get_glonass_channels(navigation)
    beside = Beside(near=near, first_day=GPS_EPOCH if near is None else None, channels=channels)
    pieces = (gathered.take(piece) for piece in kind.read(read_blocks(), path.stem, beside))

    def to_do() -> str:
        if gathered.undated:
            return (
                "the log says the time of the week and not the week; give the navigation file of that day (--nav, "
                "RINEX), or have the receiver send its orbits too (RTCM 1019, 1042, 1046)"
            )
        return f"the log holds no measurements of a satellite; {kind.to_do}"

    source = gather_file(path, file, pieces, to_do, start_s=start_s, duration_s=duration_s, workspace=workspace)
    return replace(
        source,
        format=f"receiver's log ({', '.join(gathered.protocols())})",
        remarks=(*source.remarks, *gathered.remarks()),
        decoded=gathered.orbits.navigation(str(path)),
        own=gathered.own(),
        inertial=gathered.inertial(),
        multipath_sigma_m=kind.multipath_sigma_m,
    )


class _Gathered:
    """What a log holds beside its measurements, as its pieces pass."""

    def __init__(self, source: str) -> None:
        self.orbits = OrbitCollector()
        self._source = source
        self._messages: Counter[str] = Counter()
        self.undated = 0
        self._damaged = 0
        self._cut = False
        self._remarks: dict[str, None] = {}
        self._misread: dict[str, str] = {}
        self._fixes: list[ReceiverFixes] = []
        self._levels: list[FrontEndLevels] = []
        self._states: list[ReceiverStates] = []
        self._inertial: list[InertialRows] = []

    def take(self, piece: LogPiece) -> ObservationFile:
        """Take a piece, and return its measurements without cells that are impossible."""
        self._messages.update(piece.messages)
        self._damaged += piece.damaged_frames
        self.undated += piece.undated_epochs
        self._cut |= piece.cut
        self._remarks |= dict.fromkeys(piece.remarks)
        self._fixes += [] if piece.fixes is None else [piece.fixes]
        self._levels += [] if piece.levels is None else [piece.levels]
        self._states += [] if piece.states is None else [piece.states]
        self._inertial += [] if piece.inertial is None else [piece.inertial]
        o = piece.observations
        slots = {} if o is None else _frequency_numbers(o)
        self.orbits.take(piece.frames, slots)
        self.orbits.add(piece.ephemerides)
        if o is None:
            return ObservationFile(observations=_nothing(), version=0.0)
        kept, implausible = leave_out_impossible(
            {name: getattr(o, name) for name in LETTERS},
            signals=o.signals,
            elapsed_s=o.elapsed_s,
            carrier_hz=o.carrier_hz,
            misread=self._misread,
        )
        self._misread |= implausible.misread
        status = np.where(implausible.ranges, np.uint8(CellStatus.IMPOSSIBLE), o.status)
        return ObservationFile(
            observations=replace(o, status=status, **dict[str, Any](kept)),
            version=0.0,
            impossible=implausible.counts,
            misread=implausible.misread,
            remarks=implausible.remarks,
        )

    def protocols(self) -> list[str]:
        """Return the protocols that have messages in the log."""
        return sorted({protocol_of(name) for name in self._messages})

    def own(self) -> OwnWords:
        """Return what the receiver says of itself."""
        return OwnWords(
            fixes=join_rows(self._fixes),
            levels=join_rows(self._levels),
            states=join_rows(self._states),
            messages=self.orbits.received(),
        )

    def inertial(self) -> InertialRows | None:
        """Return the readings of the inertial unit in the log."""
        return join_rows(self._inertial)

    def remarks(self) -> Iterator[str]:
        """Return what is to be said of the log."""
        listed = ", ".join(f"{name} {count}" for name, count in self._messages.most_common(_NAMED))
        n_others = len(self._messages) - _NAMED
        yield f"messages in the log: {listed}" + (f" and {n_others} more kinds" if n_others > 0 else "")
        if self._damaged:
            yield Remark(f"{self._damaged} frames fail their checksum and are left out", RemarkKind.BEARS)
        if self._cut:
            yield Remark("the log ends inside a frame: it was cut, or is still growing", RemarkKind.CUT)
        if self.undated:
            yield Remark(f"{self.undated} epochs before the week is known are left out", RemarkKind.BEARS)
        yield from limit_remarks(self._remarks, "further remarks")


def _frequency_numbers(o: Observations) -> dict[str, int]:
    """Return the frequency numbers of the GLONASS satellites that were measured."""
    numbers = {s.sat: frequency_number_of(s.band, float(hz)) for s, hz in zip(o.signals, o.carrier_hz, strict=True)}
    return {sat: number for sat, number in numbers.items() if number is not None}


def _nothing() -> Observations:
    none = np.empty((0, 0))
    return Observations(
        receiver="",
        signals=(),
        gpst=np.empty(0, "M8[ns]"),
        elapsed_s=np.empty(0),
        pseudorange_m=none,
        carrier_cyc=none,
        doppler_hz=none,
        cn0_dbhz=none,
        pseudorange_sigma_m=none,
        carrier_sigma_cyc=none,
        doppler_sigma_hz=none,
        status=none.astype(np.uint8),
        found_elapsed_s=np.empty(0),
        missed_elapsed_s=np.empty(0),
    )
