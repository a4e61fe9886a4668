"""Hold what correlators give beside measurements, and what a detector asks of them."""

from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import ComplexFloats, Instants, Reals
from skyproof.records.shapes import Channels, Selectable, freeze
from skyproof.records.signals import SignalId
from skyproof.short_repr import ShortRepr

__all__ = [
    "Asked",
    "Ccaf",
    "CcafAsked",
    "Taps",
    "TapsAsked",
    "TimeSliced",
]

T_co = TypeVar("T_co", covariant=True)


class TimeSliced(Protocol[T_co]):
    """What a receiver has beside its measurements over a run, read in stretches: a record, or pieces on a disk."""

    @property
    def receiver(self) -> str: ...

    def select_between(self, begin_s: float, end_s: float, /) -> T_co:
        """Select what has begin <= `elapsed_s` < end, as one record."""


@dataclass(frozen=True, kw_only=True)
class TapsAsked:
    """Which `Taps` a detector asks a receiver for.

    delays_chips : beside early, prompt and late, ahead of prompt positive. every_s, coherent_s : means over so much of
        every so much.
    """

    delays_chips: tuple[float, ...]
    every_s: float
    coherent_s: float


@dataclass(frozen=True, kw_only=True)
class CcafAsked:
    """Which `Ccaf` a detector asks a receiver for.

    reach_chips : of delays to both sides of what is tracked, as near as the band's correlation needs. dopplers_hz : off
        the tracked carrier. coherent_s : of each interval; the message's bits are taken off. intervals : one after the
        other, taken `every_s`, and `soon_s` apart while the signals' strengths change together.
    """

    reach_chips: float
    every_s: float
    soon_s: float
    dopplers_hz: tuple[float, ...] = (0.0,)
    coherent_s: float = 0.02
    intervals: int = 4


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What a detector asks receivers for beside observations."""

    taps: TapsAsked | None = None
    ccaf: CcafAsked | None = None


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Taps(ShortRepr, Selectable, Channels):
    """Correlator outputs of one receiver at common receiver times, carrier and data bits wiped off.

    elapsed_s : (n_epochs,) as in `Observations`, the middle of what each value is the mean of.
    delays_chips : (n_delays,) of the replica ahead of the tracked code; dopplers_hz : (n_dopplers,) off the carrier.
    value : (n_epochs, n_channels, n_dopplers, n_delays) complex64, correlation a sample, so in the samples' own unit;
        NaN where nothing is tracked. The prompt is real but for noise.
    first_power : (n_epochs, n_channels) of the prompt on the first antenna alone, where `value` is of the weighted sum
        of several; None of one antenna.
    """

    BY_ROW = ("elapsed_s", "value", "first_power")
    CELLS = ("value", "first_power")
    TIME = "elapsed_s"

    receiver: str
    signals: tuple[SignalId, ...]
    elapsed_s: Reals
    delays_chips: Reals
    dopplers_hz: Reals
    value: ComplexFloats
    first_power: Reals | None = None

    def __post_init__(self) -> None:
        shapes: dict[str, tuple[str, ...]] = {
            "elapsed_s": ("epoch",),
            "delays_chips": ("delay",),
            "dopplers_hz": ("doppler",),
            "value": ("epoch", "channel", "doppler", "delay"),
        }
        freeze(self, shapes | ({} if self.first_power is None else {"first_power": ("epoch", "channel")}))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Ccaf(ShortRepr, Channels):
    """One receiver's complex correlation over a grid of delays and Dopplers (cross ambiguity function), with its noise.

    gpst, elapsed_s : (n_epochs,) middle of each coherent interval of `coherent_s`, as in `Observations`.
    delays_chips : (n_delays,) of the replica behind the reference, positive for a longer way; dopplers_hz :
        (n_dopplers,) above the reference's. Phases are those at mid-interval.
    reference_m, reference_hz : (n_epochs, n_channels) pseudorange and Doppler of the grid's zero.
    value : (n_epochs, n_channels, n_dopplers, n_delays) complex, correlation a sample; NaN where there is none.
    noise_variance : (n_epochs, n_channels) mean square of one value's noise. Between the values at (tau1, f1) and
        (tau2, f2) the covariance is that times R(tau1 - tau2) sinc((f1 - f2) coherent_s), sinc(x) = sin(pi x) / (pi x),
        with R the code's correlation in the band of `band_hz` (two-sided).
    noise_samples : independent complex samples that each variance is estimated from; None if it is known.
    """

    CELLS = ("reference_m", "reference_hz", "value", "noise_variance")

    receiver: str
    signals: tuple[SignalId, ...]
    gpst: Instants
    elapsed_s: Reals
    coherent_s: float
    band_hz: float
    delays_chips: Reals
    dopplers_hz: Reals
    reference_m: Reals
    reference_hz: Reals
    value: NDArray[np.complexfloating[Any, Any]]
    noise_variance: Reals
    noise_samples: int | None = None

    def __post_init__(self) -> None:
        cell = ("epoch", "channel")
        freeze(
            self,
            {
                "gpst": ("epoch",),
                "elapsed_s": ("epoch",),
                "delays_chips": ("delay",),
                "dopplers_hz": ("doppler",),
                "reference_m": cell,
                "reference_hz": cell,
                "noise_variance": cell,
                "value": ("epoch", "channel", "doppler", "delay"),
            },
        )
