"""Check whether samples are plausible, from a few stretches of a recording in any container."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from skyproof.arrays import Floats, Reals
from skyproof.errors import InputError
from skyproof.formats.layout import PackedSamples
from skyproof.records import Samples
from skyproof.remarks import Remark, RemarkKind

__all__ = ["add_levels", "check_levels", "drop_dead", "open_channels"]

_STRETCHES, _STRETCH_SAMPLES = 16, 32768  # what the check of levels looks at: at most half a million samples
_DC_LIMIT = 0.05  # of the rms; above that the line at zero frequency costs acquisition more than 0.01 dB
_IMBALANCE_LIMIT_DB = 0.2
_FEW_LEVELS = 4
_SATURATED, _SATURATED_FEW_LEVELS = 0.10, 0.60
"""Shares at the extreme codes. With up to four levels a good gain control puts 30 to 40 % there, with more under 10 %
(Max, IRE Trans. Inf. Theory 6, 1960: 32 % with 4, 8 % with 8 equally spaced levels of least distortion)."""


def open_channels(one: Samples, packed: Sequence[PackedSamples], stated_by: str) -> list[Samples]:
    """Open each channel of a recording as a recording; those that never change are `dead`.

    one : the recording but for `read`; its name and antenna get the channel's number where there are several.
    """
    opened: list[Samples] = []
    for number, channel in enumerate(packed, 1):
        samples = replace(one, read=channel.read)
        if len(packed) > 1:
            samples = replace(samples, name=f"{one.name}-{number}", antenna=f"{one.antenna}-{number}")
        try:
            opened.append(add_levels(samples, channel, stated_by))
        except InputError as error:
            dead = f"{samples.name}: {error}" if len(packed) > 1 else str(error)
            opened.append(replace(samples, read=_make_silence(samples.n_samples), dead=dead))
    return opened


def drop_dead(channels: Sequence[Samples]) -> tuple[Samples, ...]:
    """Select the channels that change; they report the others as left out. Raises InputError if none does."""
    dead = [channel.dead for channel in channels if channel.dead]
    if len(dead) == len(channels):
        raise InputError(dead[0])
    words = tuple(Remark(f"left out: {why}", RemarkKind.BEARS) for why in dead)
    return tuple(replace(channel, remarks=(*channel.remarks, *words)) for channel in channels if not channel.dead)


def _make_silence(n_samples: int) -> Callable[[int, int], Floats]:
    return lambda start, count: np.zeros((2, max(0, min(count, n_samples - start))), np.float32)


def add_levels(samples: Samples, packed: PackedSamples, stated_by: str) -> Samples:
    """Add remarks on a recording's levels.

    stated_by : what says how to read it, for the words: "encoding and bits of rx.toml".

    Raises
    ------
    InputError : no stretch that was looked at changes, or none holds finite numbers.
    """
    finite = _report_not_finite(samples, packed, stated_by) if packed.packing.encoding == "float" else ()
    levels = check_levels(samples, kind=packed.packing.kind, stated_by=stated_by)
    return replace(samples, remarks=(*samples.remarks, *finite, *levels))


def check_levels(
    samples: Samples, *, kind: Literal["real", "complex"] = "complex", stated_by: str = "what says how to read it"
) -> tuple[str, ...]:
    """Report on the levels of the samples, from at most 16 stretches spread over the recording.

    Remarks on stretches that do not change, saturation, DC offset and I/Q imbalance, in words.

    Raises
    ------
    InputError : no stretch changes at all.
    """
    stretches = [samples.read(start, count) for start, count in _choose_stretches(samples.n_samples)]
    planes = np.concatenate(stretches, axis=1)[: 2 if kind == "complex" else 1].astype(np.float64)
    still = [bool((stretch == stretch[:, :1]).all()) for stretch in stretches]
    if all(still):
        finding = "all samples are zero" if not planes.any() else f"all samples are {planes[0, 0]:g}"
        raise InputError(
            f"{samples.path or samples.name}: {finding} in {_count_words(len(stretches))} looked at; there is nothing "
            f"to receive: check the recorder, and {stated_by}"
        )
    remarks = []
    if any(still):
        first_s = _choose_stretches(samples.n_samples)[still.index(True)][0] / samples.rate_hz
        remarks.append(
            Remark(
                f"the samples do not change in {sum(still)} of {len(still)} stretches looked at, first at "
                f"{first_s:.3f} s: the recorder left gaps, or the front end was off",
                RemarkKind.BEARS,
            )
        )
    return (*remarks, *_report_saturation(planes), *_report_offsets(planes, stated_by))


def _count_words(n_stretches: int) -> str:
    return "the one stretch" if n_stretches == 1 else f"each of the {n_stretches} stretches"


def _choose_stretches(n_samples: int) -> list[tuple[int, int]]:
    if n_samples <= _STRETCHES * _STRETCH_SAMPLES:
        return [(start, min(_STRETCH_SAMPLES, n_samples - start)) for start in range(0, n_samples, _STRETCH_SAMPLES)]
    starts = np.linspace(0, n_samples - _STRETCH_SAMPLES, _STRETCHES).astype(np.int64)
    return [(int(start), _STRETCH_SAMPLES) for start in starts]


def _report_saturation(planes: Reals) -> list[str]:
    levels = np.unique(planes[:, :_STRETCH_SAMPLES]).size
    extreme = np.mean((planes == planes.max()) | (planes == planes.min()))
    if levels <= 2 or extreme <= (_SATURATED_FEW_LEVELS if levels <= _FEW_LEVELS else _SATURATED):
        return []
    return [
        f"saturated: {extreme:.0%} of the samples are at the extreme codes {planes.min():g} and {planes.max():g}; "
        "lower the gain"
    ]


def _report_offsets(planes: Reals, stated_by: str) -> list[str]:
    mean, deviation = planes.mean(axis=1), planes.std(axis=1)
    names = "IQ"[: len(planes)]
    if not deviation.all():
        dead = names[int(np.argmin(deviation))]
        return [f"{dead} never changes: check {stated_by}, and the front end"]
    offset = mean / deviation
    remarks = []
    if np.abs(offset).max() > _DC_LIMIT:
        remarks.append(
            "DC offset "
            + " and ".join(f"{o:+.2f} in {n}" for o, n in zip(offset, names, strict=True))
            + " (1 is the rms)"
        )
    if len(planes) == 2 and abs(imbalance_db := 20.0 * np.log10(deviation[0] / deviation[1])) > _IMBALANCE_LIMIT_DB:
        remarks.append(f"I/Q imbalance {imbalance_db:+.1f} dB (I over Q)")
    return remarks


def _report_not_finite(samples: Samples, packed: PackedSamples, stated_by: str) -> tuple[str, ...]:
    planes = np.concatenate(
        [packed.read_as_stored(*stretch) for stretch in _choose_stretches(packed.n_samples)], axis=1
    )
    bad = 1.0 - np.isfinite(planes).all(axis=0).mean()
    if bad == 0.0:
        return ()
    finding = f"{bad:.2%} of the samples looked at are not finite numbers"
    if bad == 1.0:
        raise InputError(f"{samples.path}: {finding}; check {stated_by}")
    return (Remark(f"{finding} and read as zero: check {stated_by}, and the recorder", RemarkKind.BEARS),)
