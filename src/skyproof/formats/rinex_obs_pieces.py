"""Read an observation file in pieces, one after the other, in memory that does not grow.

The bytes may be packed by gzip and compact. A piece holds whole epochs, with the events that come before them; what an
event changes holds for the pieces that follow. Pieces put together are what `parse_obs` makes of the whole file, but
that epochs are put in order, and come once, within a piece alone.
"""

import itertools
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from skyproof.errors import InputError
from skyproof.formats.bounds import EPOCH_BYTES, OBSERVATION_BYTES, STREAM_BYTES
from skyproof.formats.byte_io import GZIP, require_size, strip_mark
from skyproof.formats.crinex import Expander, is_compact
from skyproof.formats.rinex_cells import Lines, find_heads, split_lines
from skyproof.formats.rinex_obs_header import Header, read_header
from skyproof.formats.rinex_obs_read import ObservationFile, read_body, require_text
from skyproof.records import CellStatus, Observations, SignalId
from skyproof.remarks import Remark, RemarkKind

__all__ = ["PIECE_BYTES", "continue_pieces", "read_obs_pieces"]

PIECE_BYTES: Final = 1 << 20
_DAMAGED: Final = "the observation file is a damaged gzip file"
_TELLING_BYTES: Final = 100  # whether a file is compact
_END_OF_HEADER: Final = b"END OF HEADER"


def read_obs_pieces(
    blocks: Iterable[bytes],
    *,
    source: str = "observations",
    keep: Callable[[SignalId], bool] | None = None,
    glonass_channels: Mapping[str, int] | None = None,
    piece_bytes: int = PIECE_BYTES,
) -> Iterator[ObservationFile]:
    """Read the observations in the blocks of a RINEX file's bytes, cut anywhere, piece by piece.

    A piece is what about `piece_bytes` of plain text hold; pieces without a signal that is kept and without a remark
    are left out. Each has the signals that are in it and counts its elapsed time from its own first epoch. The last one
    has the remarks on the header and on what packs the file.

    Raises
    ------
    InputError : as `rinex_obs_read.read_obs` does, when it is come upon; a gzip file that is damaged; and for more
        bytes without an epoch than `OBSERVATION_BYTES`, or unpacked than `STREAM_BYTES`. A gzip file that ends early is
        used up to there, which the remarks say.
    """
    text, header, line = b"", None, 0
    idle = 0  # bytes without an epoch
    ended = False
    plain = _Plain(source)
    plain_blocks = plain.of(blocks)
    while not ended:
        block = next(plain_blocks, None)
        ended = block is None
        text += block or b""
        if header is None:
            at = text.find(_END_OF_HEADER)
            if (at < 0 or text.find(b"\n", at) < 0) and not ended:
                if len(text) > EPOCH_BYTES:
                    raise InputError(f"{source}: no END OF HEADER in {len(text)} bytes; fetch the file again")
                continue
            header, body_at = read_header(text, source)
            text, line = text[body_at:], header.n_lines + 1
        if len(text) >= piece_bytes or ended:
            require_text(text, source)
            lines = split_lines(np.frombuffer(text, np.uint8), line)
            whole = len(lines) if ended else _count_whole(lines, header)
            if not whole and len(text) > max(EPOCH_BYTES, piece_bytes):  # no text of epochs
                whole = len(lines)
            found = read_body(
                _take_first(lines, whole), header, keep=keep, glonass_channels=glonass_channels, to_end=ended
            )
            idle = 0 if found.observations.gpst.size else idle + len(text)
            require_size(idle, OBSERVATION_BYTES, f"{source}, line {line}: what has no epoch", "fetch the file again")
            if ended:
                found = replace(found, remarks=(*plain.remarks, *header.remark_words(), *found.remarks))
            if found.observations.signals or found.remarks or found.impossible:
                yield found
            text = text[int(lines.start[whole]) :] if whole < len(lines) else b""
            line += whole


class _Plain:
    """Plain RINEX, whatever the blocks are packed by.

    remarks : on what packs them, once all have passed.
    """

    def __init__(self, source: str) -> None:
        self.remarks: tuple[str, ...] = ()
        self._source = source

    def of(self, blocks: Iterable[bytes]) -> Iterator[bytes]:
        """Unpack the blocks. Raises InputError as `read_obs_pieces` does."""
        blocks = _join_first(iter(blocks), len(GZIP))
        first = next(blocks, b"")
        packed = first.startswith(GZIP)
        blocks = itertools.chain((first,), blocks)
        text = _join_first(self._unpack(blocks) if packed else blocks, _TELLING_BYTES)
        first = strip_mark(next(text, b""), self._source)
        if not is_compact(first):
            yield first
            yield from text
            return
        expander = Expander(source=self._source)
        for block in itertools.chain((first,), text):
            yield expander.take(block)
        yield expander.rest()
        self.remarks += expander.remarks

    def _unpack(self, blocks: Iterator[bytes]) -> Iterator[bytes]:
        state, size = zlib.decompressobj(wbits=31), 0
        for block in blocks:
            rest = block
            while rest:
                if state.eof:  # members follow each other; what else follows is padding
                    if rest[:1] != GZIP[:1]:
                        break
                    state = zlib.decompressobj(wbits=31)
                try:
                    plain = state.decompress(rest, PIECE_BYTES)
                except zlib.error as error:
                    raise InputError(f"{self._source}: {_DAMAGED} ({error}); fetch or compress it again") from None
                size += len(plain)
                title = f"{self._source}: the observation file, unpacked,"
                require_size(size, STREAM_BYTES, title, "cut it into shorter ones")
                yield plain
                rest = state.unused_data if state.eof else state.unconsumed_tail
        if not state.eof:
            yield state.flush()
            self.remarks += (Remark("the gzip file is cut: it ends early; fetch it again", RemarkKind.CUT),)


def _join_first(blocks: Iterator[bytes], least: int) -> Iterator[bytes]:
    """Join the first blocks until they have `least` bytes or more, or all there are."""
    first = b""
    for block in blocks:
        first += block
        if len(first) >= least:
            break
    yield first
    yield from blocks


def _count_whole(lines: Lines, header: Header) -> int:
    """Count the lines that hold whole epochs.

    They end at the head after the last epoch but one, so that events before an epoch stay with it.
    """
    heads, measured = find_heads(lines, header.version)
    epochs = np.flatnonzero(measured)
    return int(heads[epochs[-2] + 1]) if epochs.size > 1 else 0


def _take_first(lines: Lines, count: int) -> Lines:
    return Lines(lines.text, lines.start[:count], lines.end[:count], lines.first_number)


def continue_pieces(pieces: Iterable[Observations]) -> Iterator[Observations]:
    """Join pieces of one file to one run: each continues where those before it ended.

    Epochs that do not come after those before are left out. A phase that may now be half a cycle off and was not
    before, or the reverse, is a slip, as within a piece. Time is counted from the first epoch of all.
    """
    begin: np.datetime64 | None = None
    last: np.datetime64 | None = None
    marks: dict[SignalId, bool] = {}
    for piece in pieces:
        kept = piece if last is None else _select_later(piece, last)
        if not kept.gpst.size:
            continue
        begin = kept.gpst[0] if begin is None else begin
        elapsed_s = (kept.gpst - begin) / np.timedelta64(1, "ns") * 1e-9
        present = kept.status != CellStatus.NOT_TRACKED
        first = present.argmax(axis=0)
        before_s = np.nan if last is None else (last - begin) / np.timedelta64(1, "ns") * 1e-9
        last = kept.gpst[-1]
        yield replace(
            kept,
            elapsed_s=elapsed_s,
            status=_mark_slips(kept, marks),
            found_elapsed_s=elapsed_s[first],
            missed_elapsed_s=np.where(first > 0, elapsed_s[np.maximum(first - 1, 0)], before_s),
        )


def _select_later(piece: Observations, last: np.datetime64) -> Observations:
    """Select the epochs after `last`, with the signals that they have."""
    rows = piece.gpst > last
    if rows.all():
        return piece
    later = piece.select(rows)
    return later.select_channels(np.flatnonzero((later.status != CellStatus.NOT_TRACKED).any(axis=0)))


def _mark_slips(piece: Observations, marks: dict[SignalId, bool]) -> NDArray[np.uint8]:
    """Mark as a slip each first phase whose half-cycle mark differs from the last one before.

    marks : of each signal's last phase; updated.
    """
    status = piece.status.copy()
    present = np.isfinite(piece.carrier_cyc)
    for column, signal in enumerate(piece.signals):
        rows = np.flatnonzero(present[:, column])
        if not rows.size:
            continue
        first, mark = rows[0], piece.half_cycle_open[rows, column]
        if marks.get(signal, mark[0]) != mark[0]:
            status[first, column] = CellStatus.SLIP
        marks[signal] = bool(mark[-1])
    return status
