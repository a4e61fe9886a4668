"""Name a signal, and a signal in one receiver."""

from collections.abc import Iterable
from dataclasses import dataclass
from operator import attrgetter
from typing import Final

from skyproof.gnss.signals import SignalPlan, plan_of, time_scale_of

__all__ = [
    "BY_NAME",
    "Kind",
    "SignalId",
    "SignalRef",
    "Transmission",
    "list_refs",
]

Transmission = tuple[str, str, str]
"""Satellite, band and code, as `SignalId.transmission` gives them."""
Kind = tuple[str, str, str]
"""Time scale, band and code, as `SignalId.kind` gives them."""


@dataclass(frozen=True, order=True, slots=True)
class SignalId:
    """One received signal. `copy` numbers several signals of one satellite in order of finding, nothing more."""

    sat: str  # "G05"
    band: str = "L1"
    code: str = "CA"
    copy: str = "a"

    @property
    def transmission(self) -> Transmission:
        """Return satellite, band and code: sent once, and possibly received several times."""
        return self.sat, self.band, self.code

    @property
    def kind(self) -> Kind:
        """Return time scale, band and code. All signals of a kind share one path through a receiver, and its delay."""
        return time_scale_of(self.sat), self.band, self.code

    @property
    def plan(self) -> SignalPlan:
        """Return the signal's carrier, chips and message. Raises ValueError for a band that no system has."""
        return plan_of(self.sat[0], self.band, self.code)

    def __reduce__(self) -> tuple[type["SignalId"], tuple[str, str, str, str]]:
        """Unpickle by a call: a frozen dataclass with slots sets its fields one by one, ten times as slowly."""
        return SignalId, (self.sat, self.band, self.code, self.copy)

    def __str__(self) -> str:
        return f"{self.sat} {self.band} {self.code} {self.copy}"


BY_NAME: Final = attrgetter("sat", "band", "code", "copy")
"""Key that sorts signals as they compare, and faster."""


@dataclass(frozen=True, order=True, slots=True)
class SignalRef:
    """A signal in one receiver."""

    receiver: str
    signal: SignalId

    def __reduce__(self) -> tuple[type["SignalRef"], tuple[str, SignalId]]:
        """Unpickle by a call, as `SignalId` does."""
        return SignalRef, (self.receiver, self.signal)

    def __str__(self) -> str:
        return f"{self.receiver}:{self.signal}"


def list_refs(receiver: str, signals: Iterable[SignalId]) -> tuple[SignalRef, ...]:
    """Return signals as those of one receiver, in their order."""
    return tuple(SignalRef(receiver, signal) for signal in signals)
