"""What is in a receiver's log or observation file, and what it should hold besides."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from skyproof.app.inspect.inspection import make_plain
from skyproof.app.inspect.policy import POLICY
from skyproof.arrays import Integers
from skyproof.formats.bounds import limit_remarks
from skyproof.formats.byte_io import FileBytes, measure_size, report_reading
from skyproof.formats.rinex_obs_pieces import PIECE_BYTES, read_obs_pieces
from skyproof.formats.rinex_obs_read import holds_observations
from skyproof.gnss.time import GPS_EPOCH, format_iso, seconds_between
from skyproof.logs.content import Beside, LogPiece
from skyproof.logs.kinds import HEAD_BYTES, kind_of_log
from skyproof.logs.orbits import OrbitCollector
from skyproof.logs.wanted import WantedMessage, configure, missing_messages, protocol_of
from skyproof.records import Observations
from skyproof.short_repr import ShortRepr, write_notebook_html

__all__ = ["LogInspection", "LoggedSignals", "holds_measurements", "inspect_log"]


@dataclass(frozen=True, kw_only=True)
class LoggedSignals:
    """Signals of one kind: satellites that it was measured of in all, the most at one epoch, and their mean C/N0."""

    system: str
    band: str
    code: str
    satellites: int
    most_at_once: int
    cn0_dbhz: float


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class LogInspection(ShortRepr):
    """What `inspect` finds in a log or an observation file.

    start_gpst : of the first epoch; None without any. interval_s : between epochs, the usual one. gaps : intervals that
    last more than twice as long. ranged : there are ranges, not C/N0 alone. messages : how many of each name, none of
    an observation file. orbits : how many satellites have orbits in it. fixes, levels, states : how many rows of the
    receiver's own. alarms : states in which the receiver claims jamming, spoofing or a failed authentication.
    missing : messages that would help. configuration : lines that turn those on.
    """

    path: str
    format: str
    start_gpst: np.datetime64 | None
    duration_s: float
    epochs: int
    interval_s: float | None
    gaps: int
    signals: tuple[LoggedSignals, ...]
    ranged: bool
    messages: dict[str, int]
    orbits: int
    fixes: int
    levels: int
    states: int
    alarms: int
    damaged_frames: int
    cut: bool
    remarks: tuple[str, ...]
    missing: tuple[WantedMessage, ...]
    configuration: tuple[str, ...]

    @property
    def summary(self) -> str:
        """Describe in a sentence what is there."""
        if not self.epochs:
            return f"{self.format} without measurements of satellites"
        sats = {system: max(s.satellites for s in self.signals if s.system == system) for system in self.systems}
        every = "" if self.interval_s is None else f", one epoch every {self.interval_s:.3g} s"
        held = ", ".join(f"{count} {system}" for system, count in sats.items())
        return f"{self.format}, {self.duration_s:.1f} s with {self.epochs} epochs{every}; satellites: {held}"

    @property
    def systems(self) -> tuple[str, ...]:
        """List the letters of the systems, in order."""
        return tuple(dict.fromkeys(s.system for s in self.signals))

    @property
    def advice(self) -> str:
        """Describe what `protect` can do with it, and what would make it stronger."""
        if not self.epochs:
            return "`protect` can do nothing with it: it holds no measurements."
        if not self.ranged:
            needs = ["measurements with ranges (UBX-RXM-RAWX, SBF MeasEpoch, RTCM MSM7): without, only jumps show"]
        else:
            needs = [] if self.orbits else ["--nav, for it holds no orbits"]
        if max((s.most_at_once for s in self.signals), default=0) < POLICY.test_satellites:
            needs.append("a better view of the sky")
        if self.duration_s < POLICY.log_s:
            needs.append(f"{POLICY.log_s:.0f} s or more")
        if not np.isfinite([s.cn0_dbhz for s in self.signals]).any():
            needs.append("C/N0, which shows interference")
        needs += [f"{wanted.name} ({wanted.gives})" for wanted in self.missing]
        needs.append("a second receiver some metres away and the distance")
        return f"`protect` takes it; stronger with {'; '.join(needs)}."

    def document(self) -> dict[str, Any]:
        """Return the document that `--json` prints: keys in order, numbers unrounded, None for what is absent."""
        document = {
            "format": "skyproof-inspect-log/1",
            "path": self.path,
            "log_format": self.format,
            "start_gpst": None if self.start_gpst is None else format_iso(self.start_gpst),
            "duration_s": self.duration_s,
            "epochs": self.epochs,
            "interval_s": self.interval_s,
            "gaps": self.gaps,
            "signals": [vars(entry) for entry in self.signals],
            "ranged": self.ranged,
            "messages": self.messages,
            "satellites_with_orbits": self.orbits,
            "receiver": {"fixes": self.fixes, "levels": self.levels, "states": self.states, "alarms": self.alarms},
            "damaged_frames": self.damaged_frames,
            "cut": self.cut,
            "remarks": list(self.remarks),
            "missing": [vars(entry) for entry in self.missing],
            "configuration": list(self.configuration),
            "summary": self.summary,
            "advice": self.advice,
        }
        cleaned: dict[str, Any] = make_plain(document)
        return cleaned

    def _repr_html_(self) -> str:
        """Show the log and its signals in a notebook."""
        rows = [
            (s.system, s.band, s.code, str(s.satellites), str(s.most_at_once), f"{s.cn0_dbhz:.1f}")
            for s in self.signals
        ]
        head = ("system", "band", "code", "satellites", "most at once", "C/N0, dB-Hz")
        return write_notebook_html(
            self.path, [self.summary, *self.remarks, self.advice, *self.configuration], (head, rows)
        )


def holds_measurements(path: Path) -> bool:
    """Tell by its first bytes whether a file is a receiver's log or an observation file."""
    if not path.is_file():
        return False
    with report_reading(path), open(path, "rb") as file:
        head = file.read(HEAD_BYTES)
    return kind_of_log(head) is not None or holds_observations(path)


def inspect_log(path: Path) -> LogInspection:
    """Describe what is in a log or an observation file; damage is counted, and no log is too bare.

    Raises InputError if it cannot be read.
    """
    with report_reading(path), open(path, "rb") as file:
        kind = kind_of_log(file.read(HEAD_BYTES))
    content = FileBytes(path)

    def read_blocks() -> Iterator[bytes]:
        return (content[at : at + PIECE_BYTES].tobytes() for at in range(0, measure_size(path), PIECE_BYTES))

    counted = _Counted(str(path))
    if kind is None:
        for piece in read_obs_pieces(read_blocks(), source=str(path)):
            counted.version = counted.version or piece.version
            counted.remarks += piece.remarks
            counted.measure(piece.observations)
    else:
        near = kind.first_instant(read_blocks())
        for logged in kind.read(
            read_blocks(), path.stem, Beside(near=near, first_day=GPS_EPOCH if near is None else None)
        ):
            counted.take(logged)
    return counted.inspection()


@dataclass
class _Kind:
    """What is counted of one kind of signals."""

    sats: set[str] = field(default_factory=set)
    most: int = 0
    cn0_sum: float = 0.0
    cn0_count: int = 0


class _Counted:
    """What a log holds, as its pieces pass: numbers of it alone."""

    def __init__(self, path: str) -> None:
        self.version = 0.0
        self.remarks: tuple[str, ...] = ()
        self._path = path
        self._kinds: dict[tuple[str, str, str], _Kind] = {}
        self._messages: dict[str, int] = {}
        self._orbits = OrbitCollector()
        self._first: np.datetime64 | None = None
        self._last: np.datetime64 | None = None
        self._epochs = self._damaged = self._undated = self._fixes = self._levels = self._states = self._alarms = 0
        self._intervals: dict[int, int] = {}
        self._cut = self._ranged = False

    def take(self, piece: LogPiece) -> None:
        """Count a piece of a log."""
        for name, count in piece.messages.items():
            self._messages[name] = self._messages.get(name, 0) + count
        self._damaged += piece.damaged_frames
        self._cut |= piece.cut
        self._undated += piece.undated_epochs
        self.remarks += piece.remarks
        self._fixes += 0 if piece.fixes is None else piece.fixes.gpst.size
        self._levels += 0 if piece.levels is None else piece.levels.gpst.size
        self._states += 0 if piece.states is None else piece.states.gpst.size
        self._alarms += 0 if piece.states is None else int(piece.states.alarm.sum())
        self._orbits.take(piece.frames, {})
        self._orbits.add(piece.ephemerides)
        if piece.observations is not None:
            self.measure(piece.observations)

    def measure(self, o: Observations) -> None:
        """Count epochs and signals."""
        if not o.gpst.size:
            return
        self._first = o.gpst[0] if self._first is None else self._first
        times = o.gpst if self._last is None else np.concatenate([[self._last], o.gpst])
        steps_ms = np.rint(np.diff(times).astype(np.int64) / 1e6).astype(np.int64)
        self._count_intervals(steps_ms)
        self._last, self._epochs = o.gpst[-1], self._epochs + o.gpst.size
        self._ranged |= bool(np.isfinite(o.pseudorange_m).any())
        columns: dict[tuple[str, str, str], list[int]] = {}
        for column, signal in enumerate(o.signals):
            columns.setdefault((signal.sat[0], signal.band, signal.code), []).append(column)
        measured = o.measured
        for key, columns_of_kind in columns.items():
            present = measured[:, columns_of_kind]
            if not present.any():
                continue
            kind = self._kinds.setdefault(key, _Kind())
            kind.sats |= {o.signals[k].sat for k in np.array(columns_of_kind)[present.any(axis=0)].tolist()}
            kind.most = max(kind.most, int(present.sum(axis=1).max()))
            levels = o.cn0_dbhz[:, columns_of_kind][present]
            kind.cn0_sum += float(np.nansum(levels))
            kind.cn0_count += int(np.isfinite(levels).sum())

    def _count_intervals(self, steps_ms: Integers) -> None:
        for step, count in zip(*np.unique(steps_ms, return_counts=True), strict=True):
            self._intervals[int(step)] = self._intervals.get(int(step), 0) + int(count)

    def inspection(self) -> LogInspection:
        """Return what was counted."""
        usual_ms = max(self._intervals, key=lambda step: self._intervals[step], default=None)
        interval_s = None if usual_ms is None or usual_ms <= 0 else 1e-3 * usual_ms
        gaps = 0 if usual_ms is None else sum(n for step, n in self._intervals.items() if step > 2 * usual_ms)
        missing = missing_messages(self._messages)
        protocols = sorted({protocol_of(name) for name in self._messages})
        if self._undated:
            self.remarks += (f"{self._undated} epochs without the week: `protect` takes it from --nav",)
        lasts_s = 0.0 if self._first is None else float(seconds_between(self._last, self._first))
        return LogInspection(
            path=self._path,
            format=f"RINEX {self.version:g} observations" if self.version else f"log ({', '.join(protocols)})",
            start_gpst=self._first,
            duration_s=lasts_s,
            epochs=self._epochs,
            interval_s=interval_s,
            gaps=gaps,
            signals=tuple(_signals(self._kinds.items())),
            ranged=self._ranged,
            messages=dict(sorted(self._messages.items(), key=lambda one: -one[1])),
            orbits=len({ephemeris.sat for ephemeris in self._orbits.navigation(self._path).ephemerides}),
            fixes=self._fixes,
            levels=self._levels,
            states=self._states,
            alarms=self._alarms,
            damaged_frames=self._damaged,
            cut=self._cut,
            remarks=limit_remarks(tuple(dict.fromkeys(str(remark) for remark in self.remarks)), "further remarks"),
            missing=missing,
            configuration=tuple(configure(missing, interval_s)),
        )


def _signals(kinds: Iterable[tuple[tuple[str, str, str], _Kind]]) -> Iterator[LoggedSignals]:
    for (system, band, code), kind in sorted(kinds, key=lambda one: one[0]):
        mean = kind.cn0_sum / kind.cn0_count if kind.cn0_count else float("nan")
        yield LoggedSignals(
            system=system,
            band=band,
            code=code,
            satellites=len(kind.sats),
            most_at_once=kind.most,
            cn0_dbhz=mean,
        )
