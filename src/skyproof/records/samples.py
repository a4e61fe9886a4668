"""Describe an open recording, and what a receiver's measurements come from."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from skyproof.arrays import Floats
from skyproof.gnss.constants import L1_HZ
from skyproof.short_repr import ShortRepr

__all__ = [
    "MeasurementSource",
    "OpenFile",
    "SampleGap",
    "Samples",
]


@dataclass(frozen=True, order=True)
class SampleGap:
    """Samples that were never recorded: `missing_samples` of them, just before the one numbered `at_sample`."""

    at_sample: int
    missing_samples: int


class OpenFile(Protocol):
    """A file that is read and stays open, so that what is said of it holds for the bytes that were read."""

    def sum_as_read(self) -> None:
        """Sum bytes at each read from now on."""

    def sha256(self, progress: Callable[[int, int], None] | None = None) -> str | None:
        """Return the hash of the whole file, hexadecimal.

        None where the bytes that were read are not known any more.
        """

    def changes(self) -> tuple[str, ...]:
        """Report what became of the file since it was opened; one that ends otherwise is `CUT`."""


class MeasurementSource(Protocol):
    """What one receiver's measurements come from: a recording of samples, or observations of a receiver.

    name : of the receiver. path : of the file, empty where there is none. start_gpst : rough. file : what was read.
    """

    @property
    def name(self) -> str: ...
    @property
    def path(self) -> str: ...
    @property
    def format(self) -> str: ...
    @property
    def remarks(self) -> tuple[str, ...]: ...
    @property
    def start_gpst(self) -> np.datetime64 | None: ...
    @property
    def duration_s(self) -> float: ...
    @property
    def file(self) -> OpenFile | None: ...


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Samples(ShortRepr):
    """An open recording: yields any stretch of samples on demand, never the whole file.

    `read(start, count)` gives float32 of shape (2, count): I and Q (Q zero for real samples), at `rate_hz`. The radio
    frequency `centre_hz` lies at `if_hz` in them, and higher frequencies lie higher. It is short at the end only.

    gaps : what the recording itself says is missing, in order; samples are numbered as recorded, so that `read` goes
        over a gap without a sign.
    file : what `read` reads from, if it is a file; several recordings may share one.
    stated_in : the file beside it that says how to read it, if there is one.
    others : of the further antennas of the same receiver, sampled at the same instants behind the same oscillator. What
        stands here of rate, frequency and length holds for them too.
    dead : why nothing comes from it, of one whose samples never change; `read` gives zeros then.
    """

    name: str
    rate_hz: float
    n_samples: int
    read: Callable[[int, int], Floats]
    centre_hz: float = L1_HZ
    if_hz: float = 0.0
    start_gpst: np.datetime64 | None = None  # rough, by the recorder's clock
    antenna: str = "1"
    path: str = ""
    format: str = ""
    remarks: tuple[str, ...] = ()
    gaps: tuple[SampleGap, ...] = ()
    file: OpenFile | None = None
    stated_in: Path | None = None
    others: tuple["Samples", ...] = ()
    dead: str = ""

    @property
    def duration_s(self) -> float:
        return self.n_samples / self.rate_hz

    def read_all(self, start: int, count: int) -> Floats:
        """Read every antenna's samples, (n_antennas, 2, count)."""
        if not self.others:
            return self.read(start, count)[None]
        return np.stack([antenna.read(start, count) for antenna in (self, *self.others)])
