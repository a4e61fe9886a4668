"""Observation files as inputs: what one receiver measured itself, read instead of tracked."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from skyproof.app.common.windows import take
from skyproof.app.receive.reception import Reception
from skyproof.errors import InputError
from skyproof.formats.bounds import REMARKS
from skyproof.formats.byte_io import FileBytes, size_of
from skyproof.formats.rinex_obs_pieces import PIECE_BYTES, joined_observations, obs_pieces
from skyproof.gnss.time import iso, seconds_between
from skyproof.navigation.clock import unstepped
from skyproof.navigation.rates import with_dopplers
from skyproof.records import NavigationData, Observations, SignalId

__all__ = ["ObservedFile", "epochs_of", "observed", "open_observations", "same_measurements"]

NO_SAMPLES = (
    "holds measurements and no samples: no correlation is drawn, second signals of a satellite and the receiver's own "
    "noise cannot be looked for"
)
MOST_STEPS_TOLD = 3
SYSTEMS = "GECRJ"


@dataclass(frozen=True, eq=False, kw_only=True)
class ObservedFile:
    """One receiver's observation file, open: a `Source` that gives observations.

    observations : as they stand in the file, of the stretch that was asked for.
    """

    name: str
    path: str
    format: str
    observations: Observations
    file: FileBytes
    remarks: tuple[str, ...] = ()

    @property
    def start_gpst(self) -> np.datetime64:
        """The first epoch."""
        start: np.datetime64 = self.observations.gpst[0]
        return start

    @property
    def duration_s(self) -> float:
        """From the first epoch to the last."""
        return float(seconds_between(self.observations.gpst[-1], self.observations.gpst[0]))


def open_observations(path: Path, glonass_channels: Mapping[str, int] | None = None) -> ObservedFile:
    """Read an observation file.

    Raises
    ------
    InputError : it cannot be read, is no RINEX observation file, or holds nothing that is judged.
    """
    size = size_of(path)
    file = FileBytes(path)
    file.sum_as_read()
    blocks = (file[at : at + PIECE_BYTES].tobytes() for at in range(0, size, PIECE_BYTES))
    pieces = list(obs_pieces(blocks, source=str(path), keep=_is_judged, glonass_channels=glonass_channels))
    if not pieces:
        raise InputError(
            f"{path}: the observation file holds no measurement of a satellite of GPS, Galileo, BeiDou, GLONASS or "
            "QZSS; give the file that the receiver wrote"
        )
    plain = path.with_suffix("") if path.suffix.lower() == ".gz" else path
    remarks = list(dict.fromkeys(remark for piece in pieces for remark in piece.remarks))
    more = (f"{len(remarks) - REMARKS} further remarks",) if len(remarks) > REMARKS else ()
    return ObservedFile(
        name=plain.stem,
        path=str(path),
        format=f"RINEX {pieces[0].version:g} observations",
        observations=replace(joined_observations([piece.observations for piece in pieces]), receiver=plain.stem),
        file=file,
        remarks=(*remarks[:REMARKS], *more, NO_SAMPLES),
    )


def _is_judged(signal: SignalId) -> bool:
    """Whether orbits of the signal's system are read: those of GPS, Galileo, BeiDou, GLONASS and QZSS."""
    return signal.sat[0] in SYSTEMS


def same_measurements(a: ObservedFile, b: ObservedFile) -> bool:
    """Whether two files hold the same pseudoranges at common epochs: noise never repeats itself to the millimetre."""
    one, other = a.observations, b.observations
    _, rows, columns = np.intersect1d(one.gpst, other.gpst, return_indices=True)
    common = [s for s in one.signals if s in other.signals]
    if not (rows.size and common):
        return False
    ours = one.pseudorange_m[rows][:, [one.signals.index(s) for s in common]]
    theirs = other.pseudorange_m[columns][:, [other.signals.index(s) for s in common]]
    both = np.isfinite(ours) & np.isfinite(theirs)
    return bool(both.any()) and float(np.mean(ours[both] == theirs[both])) > 0.5


def epochs_of(source: ObservedFile, start_s: float, duration_s: float | None) -> ObservedFile:
    """The part of a file from `start_s` on, `duration_s` long at most.

    Raises
    ------
    InputError : nothing is left.
    """
    elapsed_s = source.observations.elapsed_s
    rows = elapsed_s >= start_s
    if duration_s is not None:
        rows &= elapsed_s < start_s + duration_s
    if not rows.any():
        raise InputError(
            f"{source.path}: lasts {source.duration_s:.3f} s, but start_s is {start_s:g}"
            + ("" if duration_s is None else f" and duration_s {duration_s:g}")
            + ", in which no epoch lies; give less or more"
        )
    if rows.all():
        return source
    kept = take(source.observations, rows)
    begun_s = kept.elapsed_s[0]
    missed_s = kept.missed_elapsed_s - begun_s
    cut = replace(
        kept,
        elapsed_s=kept.elapsed_s - begun_s,
        found_elapsed_s=np.maximum(kept.found_elapsed_s - begun_s, 0.0),
        missed_elapsed_s=np.where(missed_s >= 0.0, missed_s, np.nan),
    )
    return replace(source, observations=cut)


def observed(source: ObservedFile) -> Reception:
    """What a receiver measured, made ready to be compared: its clock without steps, Dopplers where it gave none."""
    steady, steps = unstepped(source.observations)
    whole, derived = with_dopplers(steady)
    remarks = []
    if steps:
        times = ", ".join(iso(step.gpst, 0)[11:] for step in steps[:MOST_STEPS_TOLD])
        more = f" and {len(steps) - MOST_STEPS_TOLD} more" if len(steps) > MOST_STEPS_TOLD else ""
        remarks.append(
            f"the receiver's clock steps by whole milliseconds at {times}{more}; it is taken as if it did not"
        )
    if derived:
        remarks.append(f"Dopplers of {derived:.0%} of the cells are missing and taken from the carrier phase")
    return Reception(
        source=source,
        observations=whole,
        told=NavigationData(ephemerides=(), source=source.path),
        n_signals=len(whole.signals),
        examined_s=source.duration_s,
        remarks=tuple(remarks),
    )
