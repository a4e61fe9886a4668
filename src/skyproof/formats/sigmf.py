"""SigMF recordings (Signal Metadata Format, specification 1.2.6): NAME.sigmf-meta and its samples, or an archive.

Read are all data types (real and complex f32 f64 i32 i16 i8 u32 u16 u8, either byte order), interleaved channels, any
number of captures, and data sets that do not conform (core:dataset, core:header_bytes, core:trailing_bytes). Unsigned
numbers are offset binary: v has the value 2v - (2^bits - 1), so that the middle of the range is zero.

- Each channel is a recording of its own, NAME-1, NAME-2, ...
- Captures of one tuning are one recording; another tuning is another recording, NAME-1575.42MHz, ...
- Where core:global_index runs ahead of the samples, samples are missing: a `SampleGap`.
- core:datetime is UTC and becomes `start_gpst`, carried back to the first sample.
- A capture without core:frequency, or another key of its tuning, keeps that of the capture before.
- Without core:frequency in any capture so far the samples are taken to be centred on L1, which is reported.

What SigMF has no word for stands in keys of the namespace skyproof; the first three in a capture, or in the global
object for all captures; the others in the global object.

    skyproof:if_hz       where core:frequency lies in the samples; real samples need it, and a negative one means an
                         inverted spectrum. Complex samples have it at zero
    skyproof:conjugate   true if the spectrum of complex samples is inverted (Q is negated then)
    skyproof:swap_iq     true if Q comes before I
    skyproof:encoding    "sign", "sign-magnitude", ... of skyproof.formats.layout, in place of what core:datatype says;
                         of the data type "c" or "r" still counts, and the byte order
    skyproof:bits        of one number; needs skyproof:encoding. With fewer than 8, several numbers fill a byte
    skyproof:bit_order   "msb-first" or "lsb-first"
    skyproof:antenna     the antenna's name
"""

import math
import os
import re
import tarfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Any, Final

import numpy as np

from skyproof.errors import InputError, make_readable
from skyproof.formats.bounds import METADATA_BYTES
from skyproof.formats.byte_io import FileBytes, compute_digest, measure_size, read_content, report_reading, require_size
from skyproof.formats.layout import FITTING_BITS, Chunk, Encoding, PackedSamples, Packing
from skyproof.formats.levels import drop_dead, open_channels
from skyproof.formats.raw import SampleLayout
from skyproof.formats.sigmf_keys import (
    DATATYPE,
    LARGEST,
    Capture,
    Global,
    Meta,
    check_keys,
    describe_expected,
    format_value,
    join_some,
    parse_meta,
)
from skyproof.gnss.constants import L1_HZ
from skyproof.gnss.time import (
    FIRST_YEAR,
    GPS_EPOCH,
    LAST_YEAR,
    format_iso,
    gpst_from_utc,
    seconds_between,
    timedelta_from_s,
    utc_from_gpst,
)
from skyproof.records import SampleGap, Samples
from skyproof.remarks import Remark, RemarkKind

__all__ = ["check_sha512", "meta_from_layout", "open_sigmf"]

_SMALL_DATA: Final = 1 << 26  # bytes; a check of them is done in passing, in a tenth of a second
_MOST_TUNINGS: Final = 32
_TUNING_KEYS: Final = ("frequency", "if_hz", "conjugate", "swap_iq")
_CLOCK_S: Final = 0.1  # to which a recorder's dates of its captures may differ from its count of samples
_ISO_UTC: Final = re.compile(
    r"(\d{4})-(\d\d)-(\d\d)[T ](\d\d):(\d\d):(\d\d)(?:[.,](\d+))? ?(?:[Zz]|([+-])(\d\d):?(\d\d))?", re.ASCII
)


# --- what the metadata mean


@dataclass(frozen=True)
class _Tuning:
    centre_hz: float | None
    if_hz: float
    conjugate: bool
    swap_iq: bool


@dataclass(frozen=True)
class _Segment:
    """The samples of one capture, as far as the file has them."""

    capture: Capture
    chunk: Chunk
    index: int  # of its first sample in the stream that was recorded
    place: str  # in the metadata, for words


def _read_packing(general: Global, where: str, remarks: list[str]) -> Packing:
    """Read what the bytes mean, but for swapped or inverted Q, which a capture may state."""
    match = DATATYPE.fullmatch(general.datatype)
    assert match is not None  # checked with the other keys
    encoding: Encoding = {"f": "float", "i": "int", "u": "offset-binary"}[match[2][0]]  # type: ignore[assignment]
    bits = int(match[2][1:])
    if (general.encoding is None) != (general.bits is None):
        raise InputError(f"{where}: global.skyproof:encoding and global.skyproof:bits go together; give both or none")
    if general.encoding is not None and general.bits is not None:
        encoding, bits = general.encoding, general.bits
        if bits not in FITTING_BITS[encoding]:
            fitting = ", ".join(map(str, FITTING_BITS[encoding]))
            raise InputError(
                f"{where}: global.skyproof:bits = {bits} does not go with global.skyproof:encoding = "
                f'"{encoding}", expected {fitting}'
            )
    if bits > 8 and bits % 8 == 0 and match[3] is None:
        remarks.append(f"core:datatype {general.datatype} does not state the byte order; read as little-endian")
    return Packing(
        kind="complex" if match[1] == "c" else "real",
        encoding=encoding,
        bits=bits,
        bit_order=general.bit_order,
        byte_order="big" if match[3] == "b" else "little",
        n_channels=general.num_channels,
    )


def _read_tuning(general: Global, segment: _Segment, packing: Packing, where: str) -> _Tuning:
    def stated(key: str) -> Any:
        value = getattr(segment.capture, key)
        return value if value is not None else getattr(general, key)

    if packing.kind == "real" and stated("if_hz") is None:
        raise InputError(
            f"{where}: {segment.place}.skyproof:if_hz is missing, and real samples need it: give where core:frequency "
            "lies in them, in hertz, negative if the spectrum is inverted"
        )
    if packing.kind == "real" and (stated("conjugate") or stated("swap_iq")):
        raise InputError(
            f"{where}: {segment.place}: skyproof:conjugate and skyproof:swap_iq need complex samples; for an inverted "
            "spectrum of real samples give a negative skyproof:if_hz"
        )
    if_hz = math.remainder(stated("if_hz") or 0.0, general.sample_rate)  # sampling folds it so
    return _Tuning(segment.capture.frequency, if_hz, bool(stated("conjugate")), bool(stated("swap_iq")))


def _carry_tuning(segments: Sequence[_Segment], general: Global, remarks: list[str]) -> list[_Segment]:
    """Return the segments, each with the tuning of the one before where its capture states none.

    The specification leaves open whether a value carries over (sigmf/SigMF issue 124). A recorder that is tuned again
    states it; one that begins a capture for another reason, a gap for one, often does not.
    """
    carried: list[_Segment] = []
    silent: list[str] = []
    for segment in segments:
        before = carried[-1].capture if carried else segment.capture
        missing = {key: getattr(before, key) for key in _TUNING_KEYS if getattr(segment.capture, key) is None}
        update = {key: v for key, v in missing.items() if v is not None and getattr(general, key, None) is None}
        if "frequency" in update:
            silent.append(segment.place)
        carried.append(replace(segment, capture=segment.capture.model_copy(update=update)) if update else segment)
    if silent:
        listed = ", ".join(join_some(silent, ", "))
        remarks.append(f"no core:frequency is given in {listed}: that of the capture before goes on")
    return carried


def _find_segments(meta: Meta, packing: Packing, size: int, where: str, remarks: list[str]) -> list[_Segment]:
    """Find the captures in a data set of `size` bytes. Samples before the first belong to the first."""
    general, frame_bits = meta.general, packing.frame_bits
    end = size - general.trailing_bytes
    captures = list(meta.captures) or [Capture.model_validate({"core:sample_start": general.offset})]
    places = [f"captures[{number}]" for number in range(len(captures))]
    starts = [capture.sample_start - general.offset for capture in captures]
    headers = [capture.header_bytes for capture in captures]
    indices = [capture.global_index for capture in captures]
    index = captures[0].sample_start if indices[0] is None else indices[0]
    if starts[0] > 0:
        index -= starts[0]
        captures, places = [captures[0].model_copy(update={"datetime": None}), *captures], [places[0], *places]
        starts, headers, indices = [0, *starts], [0, *headers], [index, *indices]
    segments: list[_Segment] = []
    at_byte = 0
    for number, (capture, start) in enumerate(zip(captures, starts, strict=True)):
        before = starts[number - 1] if number else 0
        if start < before:
            raise InputError(
                f"{where}: {places[number]}.core:sample_start = {capture.sample_start} is less than that of the "
                "capture before it, or than core:offset; put the captures in order"
            )
        if start * frame_bits % 8:
            raise InputError(
                f"{where}: {places[number]}.core:sample_start = {capture.sample_start} does not begin with a whole "
                f"byte; give a number of which {frame_bits}-bit samples fill bytes"
            )
        at_byte += (start - before) * frame_bits // 8 + headers[number]
        stated_index = indices[number]
        index = stated_index if stated_index is not None else index + start - before
        room = (end - at_byte) * 8 // frame_bits
        last = number + 1 == len(captures)
        planned = room if last else starts[number + 1] - start
        n_samples = max(0, min(planned, room))
        segments.append(_Segment(capture, Chunk(at_byte, n_samples), index, places[number]))
        if room < planned or room < 0:
            remarks.append(
                Remark(
                    f"the data end after sample {start + n_samples + general.offset}, within {places[number]}: the "
                    "file is cut, or core:datatype, core:num_channels or core:header_bytes are wrong",
                    RemarkKind.CUT,
                )
            )
            break
        if last and (tail := end - at_byte - -(-n_samples * frame_bits // 8)):
            remarks.append(
                Remark(
                    f"the last {tail} bytes are less than one sample and left out: the file is cut, or core:datatype, "
                    "core:num_channels, core:header_bytes or core:trailing_bytes are wrong",
                    RemarkKind.CUT,
                )
            )
    if not any(segment.chunk.n_samples for segment in segments):
        raise InputError(
            f"{where}: {size} bytes of data hold no sample of {frame_bits} bits after {sum(headers)} header bytes and "
            f"before {general.trailing_bytes} trailing bytes; the data are cut, or the metadata belong to other data"
        )
    return segments


def _find_gaps(segments: Sequence[_Segment], rate_hz: float, remarks: list[str]) -> tuple[SampleGap, ...]:
    """Find where the count of the stream runs ahead of the samples of one recording."""
    gaps, missed = [], []
    at_sample = segments[0].chunk.n_samples
    for before, after in pairwise(segments):
        missing = after.index - before.index - before.chunk.n_samples
        if missing > 0:
            gaps.append(SampleGap(at_sample, missing))
            missed.append(f"{missing} before sample {at_sample} ({at_sample / rate_hz:.3f} s)")
        elif missing < 0:
            remarks.append(
                Remark(
                    f"core:global_index goes back by {-missing} samples at {after.place}: the count began anew, or "
                    "samples stand twice; what is missing there is not known",
                    RemarkKind.BEARS,
                )
            )
        at_sample += after.chunk.n_samples
    remarks += [f"samples are missing by core:global_index: {text}" for text in join_some(missed, ", ")]
    return tuple(gaps)


def _find_start(segments: Sequence[_Segment], rate_hz: float, where: str, remarks: list[str]) -> np.datetime64 | None:
    """Return the GPS time of the first sample, by the first dated capture.

    Dates that disagree with the samples are reported.
    """
    dated = [(segment, date) for segment in segments if (date := _date(segment, where, remarks)) is not None]
    if not dated:
        return None
    for (before, earlier), (after, later) in pairwise(dated):
        ahead_s = seconds_between(later, earlier) - (after.index - before.index) / rate_hz
        if abs(ahead_s) > _CLOCK_S:
            remarks.append(
                Remark(
                    f"core:datetime of {after.place} is {ahead_s:+.3f} s off what the samples since {before.place} "
                    "say: samples may be missing there that core:global_index does not show",
                    RemarkKind.BEARS,
                )
            )
    first, date = dated[0]
    back_s = (first.index - segments[0].index) / rate_hz
    start: np.datetime64 = date - timedelta_from_s(min(max(back_s, -1e9), 1e9))
    return start if start >= GPS_EPOCH else None


def _date(segment: _Segment, where: str, remarks: list[str]) -> np.datetime64 | None:
    text = segment.capture.datetime
    if text is None:
        return None
    match = _ISO_UTC.fullmatch(text.strip())
    try:
        if match is None:
            raise ValueError("another form")
        year, month, day, hour, minute, second = map(int, match.groups()[:6])
        leap_s = 1 if second == 60 else 0
        label = datetime(year, month, day, hour, minute, second - leap_s, tzinfo=UTC)
        zone = timedelta(hours=int(match[9] or 0), minutes=int(match[10] or 0))
        label += zone if match[8] == "-" else -zone
    except (ValueError, OverflowError) as error:
        raise InputError(
            f"{where}: {segment.place}.core:datetime = {format_value(text)}, expected UTC, as 2022-01-01T21:45:40.000Z"
        ) from error
    if not FIRST_YEAR <= label.year <= LAST_YEAR or np.datetime64(label.replace(tzinfo=None), "ns") < GPS_EPOCH:
        remarks.append(f"core:datetime of {segment.place}, {text}, is not a GPS time: the recorder's clock was not set")
        return None
    utc = np.datetime64(label.replace(tzinfo=None), "ns") + int(f"{match[7] or '':0<9}"[:9])
    return gpst_from_utc(utc) + np.timedelta64(leap_s, "s")


def _report_annotations(meta: Meta) -> list[str]:
    if not meta.annotations:
        return []
    labels = []
    for annotation in meta.annotations:
        label = annotation.get("core:label") if isinstance(annotation, dict) else None
        start = annotation.get("core:sample_start") if isinstance(annotation, dict) else None
        if isinstance(label, str) and label and isinstance(start, int | float) and abs(start) < LARGEST:
            labels.append(f"{format_value(label)} at {(start - meta.general.offset) / meta.general.sample_rate:.3f} s")
    texts = join_some(labels, ", ")
    return [f"{len(meta.annotations)} annotation{'s' * (len(meta.annotations) > 1)}" + "".join(f": {t}" for t in texts)]


# --- the files


@dataclass(frozen=True)
class _Source:
    """Metadata, and where the bytes of their samples are."""

    meta: Meta
    where: str  # the metadata, for words
    name: str
    data: Path
    start: int
    size: int
    remarks: tuple[str, ...] = ()
    beside: Path | None = None  # the metadata, if they are a file of their own


def open_sigmf(path: str | os.PathLike[str], *, dead: bool = False) -> tuple[Samples, ...]:
    """Open the recordings that NAME.sigmf-meta, NAME.sigmf-data or the archive NAME.sigmf holds.

    dead : as of `open_raw_channels`.

    Nothing but a few stretches of the samples, for the check of levels, is read now, however long they are; only data
    of less than 64 MiB are held against core:sha512 (`check_sha512` does it for any).

    Returns
    -------
    tuple of Samples : one for each channel and tuning, in the order of the file; `path` is the file that holds the
        samples. `gaps` is what core:global_index states; annotations and what is doubtful are reported in `remarks`. A
        channel that never changes is left out and reported, where others do.

    Raises
    ------
    InputError : a file is missing or unreadable, the metadata are wrong or need an extension that is not known, or no
        sample ever changes.
    """
    channels = [_open_recordings(source) for source in _find_sources(Path(path))]
    return tuple(channel for of_source in channels for channel in (of_source if dead else drop_dead(of_source)))


def check_sha512(path: str | os.PathLike[str], progress: Callable[[int, int], None] | None = None) -> tuple[str, ...]:
    """Report each data set that does not match its core:sha512; all their bytes are read.

    progress : called with the bytes done and the bytes in all of a data set after every 4 MiB.

    Raises InputError as `open_sigmf` for files that cannot be read.
    """
    return tuple(remark for source in _find_sources(Path(path)) for remark in _check_digest(source, progress))


def _check_digest(source: _Source, progress: Callable[[int, int], None] | None = None) -> list[str]:
    stated = source.meta.general.sha512
    if stated is None or compute_digest(source.data, "sha512", source.start, source.size, progress) == stated.lower():
        return []
    other = "the samples are not those that core:sha512 was made of: they were damaged, or changed after it was written"
    return [Remark(other, RemarkKind.BEARS)]


def _open_recordings(source: _Source) -> list[Samples]:
    meta, where, rate_hz = source.meta, source.where, source.meta.general.sample_rate
    remarks = [*source.remarks, *check_keys(meta, where)]
    packing = _read_packing(meta.general, where, remarks)
    segments = _carry_tuning(_find_segments(meta, packing, source.size, where, remarks), meta.general, remarks)
    if source.size < _SMALL_DATA:
        remarks += _check_digest(source)
    remarks += _report_annotations(meta)
    tuned: dict[_Tuning, list[_Segment]] = {}
    for segment in segments:
        if segment.chunk.n_samples:
            tuned.setdefault(_read_tuning(meta.general, segment, packing, where), []).append(segment)
    if len(tuned) > _MOST_TUNINGS:
        raise InputError(
            f"{where}: its captures have {len(tuned)} tunings, more than {_MOST_TUNINGS}; cut out those that are wanted"
        )
    if len(tuned) > 1:
        remarks.append(f"the captures have {len(tuned)} tunings: each is a recording of its own")
    octets = FileBytes(source.data, source.start, source.size)
    stated_by = f"core:datatype, core:num_channels and core:header_bytes of {where}"
    opened: list[Samples] = []
    for tuning, name in zip(tuned, _name_tunings(source.name, tuned), strict=True):
        tuning_remarks = list(remarks)
        start_gpst = _find_start(tuned[tuning], rate_hz, where, tuning_remarks)
        gaps = _find_gaps(tuned[tuning], rate_hz, tuning_remarks)
        if tuning.centre_hz is None:
            tuning_remarks.append("no core:frequency is given: the samples are taken to be centred on L1, 1575.42 MHz")
        packing_here = replace(packing, swap_iq=tuning.swap_iq, conjugate=tuning.conjugate)
        chunks = _join_chunks([segment.chunk for segment in tuned[tuning]], packing)
        packed = [PackedSamples(octets, packing_here, chunks, channel) for channel in range(packing.n_channels)]
        recording = Samples(
            name=make_readable(name),
            rate_hz=rate_hz,
            n_samples=sum(s.chunk.n_samples for s in tuned[tuning]),
            read=packed[0].read,
            centre_hz=L1_HZ if tuning.centre_hz is None else tuning.centre_hz,
            if_hz=tuning.if_hz,
            start_gpst=start_gpst,
            antenna=meta.general.antenna,
            path=make_readable(str(source.data)),
            format="SigMF",
            remarks=tuple(tuning_remarks),
            gaps=gaps,
            file=octets,
            stated_in=source.beside,
        )
        opened += open_channels(recording, packed, stated_by)
    return opened


def _name_tunings(name: str, tunings: Iterable[_Tuning]) -> list[str]:
    """Name each tuning: by the data set, with the frequency where there are several."""
    names = [name if t.centre_hz is None else f"{name}-{t.centre_hz / 1e6:.9g}MHz" for t in tunings]
    if len(names) == 1:
        return [name]
    return [text if names.count(text) == 1 else f"{text}-{number}" for number, text in enumerate(names, 1)]


def _join_chunks(chunks: Iterable[Chunk], packing: Packing) -> list[Chunk]:
    """Join chunks that follow each other without a byte between."""
    joined: list[Chunk] = []
    for chunk in chunks:
        last = joined[-1] if joined else None
        if last is not None and (chunk.at_byte - last.at_byte) * 8 == last.n_samples * packing.frame_bits:
            joined[-1] = Chunk(last.at_byte, last.n_samples + chunk.n_samples)
        else:
            joined.append(chunk)
    return joined


def _find_sources(path: Path) -> list[_Source]:
    if path.suffix == ".sigmf":
        return _open_archive(path)
    meta_path = path.with_suffix(".sigmf-meta")
    if path != meta_path:
        measure_size(path)  # the file that was asked for comes first
        if not meta_path.exists():
            raise InputError(
                f"{path}: nothing says how to read it, for there is no {meta_path} beside it; fetch that as well"
            )
    measure_size(meta_path)  # what does not exist is said as for samples
    text = read_content(meta_path, METADATA_BYTES, "the metadata of SigMF", "give the .sigmf-meta, not the samples")
    meta = parse_meta(text, str(meta_path))
    dataset = _name_dataset(meta, meta_path.stem, str(meta_path))
    data, remarks = meta_path.with_name(dataset), []
    if path != meta_path:
        if meta.general.dataset not in (None, path.name):
            remarks.append(f"core:dataset names {dataset}, but the samples were read from {path.name}")
        data = path
    elif meta.general.metadata_only and not data.exists():
        raise InputError(f"{meta_path}: metadata without samples (core:metadata_only); give a recording with samples")
    size = measure_size(data)
    if size == 0:
        raise InputError(f"{data} is empty; check the recorder or the copy")
    return [_Source(meta, str(meta_path), meta_path.stem, data, 0, size, tuple(remarks), meta_path)]


def _name_dataset(meta: Meta, stem: str, where: str) -> str:
    name = meta.general.dataset
    if name is None:
        return f"{stem}.sigmf-data"
    if not name.strip(".") or {"/", "\\", "\0"} & set(name):
        raise InputError(
            f"{where}: global.core:dataset = {format_value(name)}, expected {describe_expected('core:dataset')}"
        )
    return name


def _open_archive(path: Path) -> list[_Source]:
    """Open the recordings of an archive: its samples lie in one piece each and are read in place."""
    size = measure_size(path)
    members: dict[str, tarfile.TarInfo] = {}
    metas: dict[str, bytes] = {}
    room = METADATA_BYTES
    remarks: tuple[str, ...] = ()
    try:
        with report_reading(path), tarfile.open(path, "r:") as tar:
            try:
                for member in tar:
                    members[member.name] = member
                    if member.isfile() and member.name.endswith(".sigmf-meta"):
                        room -= member.size
                        require_size(METADATA_BYTES - room, METADATA_BYTES, f"{path}: the metadata", "unpack it")
                        file = tar.extractfile(member)
                        metas[member.name] = file.read() if file is not None else b""
            except tarfile.TarError:
                remarks = (Remark("the archive is cut or damaged: what follows the damage is lost", RemarkKind.CUT),)
    except (tarfile.TarError, ValueError, OverflowError, EOFError) as error:
        raise InputError(f"{path}: not a SigMF archive, or a damaged one ({error}); fetch it again") from error
    if not metas:
        raise InputError(f"{path}: holds no .sigmf-meta; a SigMF archive is a tar file with NAME.sigmf-meta in it")
    return [_open_member(path, size, name, text, members, remarks) for name, text in metas.items()]


def _open_member(
    path: Path, size: int, name: str, text: bytes, members: dict[str, tarfile.TarInfo], remarks: tuple[str, ...]
) -> _Source:
    where, inside = f"{path}: {name}", PurePosixPath(name)
    meta = parse_meta(text, where)
    dataset = str(inside.with_name(_name_dataset(meta, inside.stem, where)))
    member = members.get(dataset)
    if member is None or not member.isfile() or member.issparse():
        raise InputError(f"{where}: its samples, {dataset}, are not in the archive in one piece; unpack it with tar")
    present = min(member.size, size - member.offset_data)
    if present <= 0:
        raise InputError(f"{where}: no byte of its samples, {dataset}, is there; the archive is cut; fetch it again")
    if present < member.size:
        cut = f"the archive has {present} of the {member.size} bytes of {dataset}: it is cut; fetch it again"
        remarks = (*remarks, Remark(cut, RemarkKind.CUT))
    return _Source(meta, where, inside.stem, path, member.offset_data, present, remarks)


# --- and back


def meta_from_layout(layout: SampleLayout, *, n_channels: int = 1) -> dict[str, Any]:
    """Convert a sidecar to SigMF metadata, a JSON object: `open_sigmf` reads the same samples.

    n_channels : how many channels follow each other in the file.
    """
    packing = layout.packing
    letter = {"int": "i", "float": "f"}.get(packing.encoding, "u")
    plain = not packing.orders_bits and packing.encoding in ("int", "float", "offset-binary")
    order = f"_{packing.byte_order[0]}e" if packing.orders_bytes else ""
    general: dict[str, Any] = {
        "core:datatype": f"{packing.kind[0]}{letter}{8 if packing.orders_bits else packing.bits}{order}",
        "core:sample_rate": layout.rate_hz,
        "core:version": "1.2.6",
        "core:num_channels": n_channels,
    }
    capture: dict[str, Any] = {"core:sample_start": 0, "core:frequency": layout.centre_hz}
    if layout.header_bytes:
        capture["core:header_bytes"] = layout.header_bytes
    if layout.start_gpst is not None:
        capture["core:datetime"] = f"{format_iso(utc_from_gpst(layout.start_gpst), 9)}Z"
    ours: dict[str, Any] = {} if layout.antenna == "1" else {"skyproof:antenna": layout.antenna}
    if not plain:
        ours |= {
            "skyproof:encoding": packing.encoding,
            "skyproof:bits": packing.bits,
            "skyproof:bit_order": packing.bit_order,
        }
    if packing.kind == "real" or layout.if_hz:
        capture["skyproof:if_hz"] = layout.if_hz
    capture |= {f"skyproof:{key}": True for key in ("conjugate", "swap_iq") if getattr(layout, key)}
    optional = plain and not layout.conjugate and not layout.swap_iq
    if ours or any(key.startswith("skyproof:") for key in capture):
        general["core:extensions"] = [{"name": "skyproof", "version": "1.0.0", "optional": optional}]
    return {"global": general | ours, "captures": [capture], "annotations": []}
