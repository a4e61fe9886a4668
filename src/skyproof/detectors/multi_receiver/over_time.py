"""What windows in a row say of those among them that alone say nothing."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Final

from skyproof.arrays import Indices, Reals
from skyproof.detectors.multi_receiver.known_geometry import AntennaGeometry, LearntDistance
from skyproof.detectors.multi_receiver.pairing import Pairing
from skyproof.detectors.multi_receiver.policy import POLICY
from skyproof.detectors.multi_receiver.runs import WindowRun, prolonged, window_p_values
from skyproof.detectors.multi_receiver.window import ONE_TRANSMITTER, Window, names
from skyproof.records import Evidence, Says

__all__ = ["over_time"]

ONCE: Final = "within two minutes signals do not go over from the sky to a transmitter more than once, and back"


def over_time(
    window: Window, runs: Sequence[WindowRun], said: Sequence[Evidence]
) -> tuple[list[Evidence], tuple[WindowRun, ...]]:
    """What is known now of windows that were open, this one among them; and the runs that go on from here.

    said : of the groups of this window. A pairing of which it says that it is not, or not wholly, of the sky begins
    anew. Only where it is known how the antennas stand is there anything to add.
    """
    going_on = [row for pairing in window.pairings if (row := _followed(window, pairing, runs, said)) is not None]
    found = [e for row in going_on for e in row.evidence(going_on)]
    return found, tuple(row.run.closed(row.decided) for row in going_on)


def _followed(
    window: Window, pairing: Pairing, runs: Sequence[WindowRun], said: Sequence[Evidence]
) -> "_Followed | None":
    """A window's pairing with its run; None where nothing can come of one."""
    geometry = window.geometry(pairing)
    refs = set(pairing.subject)
    doubts = ("spoofed", "attack") if window.one_choice else ("spoofed",)  # of several skies one is false anyway
    doubted = any(refs & set(e.subject) for e in said if e.says in doubts)
    doubted |= window.one_choice and any(
        pairing.kinds & p.kinds and refs & set(p.subject) and _disagrees(window, p) for p in window.pairings
    )
    if geometry is None or doubted:
        return None
    authentic = {ref for e in said if e.says == "authentic" for ref in e.subject}
    run = prolonged(runs, pairing, still_open=not refs <= authentic, least=window.settings.min_satellites)
    return _Followed(window, pairing, run, geometry)


def _disagrees(window: Window, pairing: Pairing) -> bool:
    """Whether a pairing is not of one antenna, and not as the antennas are known to stand either."""
    geometry = window.geometry(pairing)
    apart = window.p_each(pairing) < window.settings.false_alarm_probability
    return apart and geometry is not None and not window.agrees(pairing, geometry)


class _Followed:
    """A pairing and the windows before it. decided : which windows of the run are no longer open."""

    def __init__(self, window: Window, pairing: Pairing, run: WindowRun, geometry: AntennaGeometry) -> None:
        self.window, self.pairing, self.run, self.geometry = window, pairing, run, geometry
        self.tests = POLICY.longest_run_windows * window.tests
        self.decided = [False] * len(run.parts)

    @cached_property
    def joined(self) -> tuple[Pairing, Indices]:
        """The run as one window, and its half windows."""
        joined, cells = self.run.joined(self.pairing)
        miss = self.window.settings.noise(self.tests).miss_probability
        return replace(joined, noise=replace(joined.noise, miss_probability=miss)), cells

    @cached_property
    def agrees(self) -> bool:
        """Whether the run shows the antennas where they are known to stand."""
        return self.window.agrees(self.joined[0], self.geometry)

    def evidence(self, everything: Sequence["_Followed"]) -> list[Evidence]:
        """Of the windows that are open and can be decided; `everything` that goes on, to know which is alone."""
        if len(self.run.parts) < 2 or not any(part.open for part in self.run.parts):
            return []
        alpha, accept = self.window.settings.false_alarm_probability, self.window.settings.accept_probability
        rivals = [row for row in everything if row is not self and row.pairing.kinds & self.pairing.kinds]
        if self.agrees:
            return [] if any(row.agrees for row in rivals) else self._authentic(alpha)
        could_be = self.window.one_choice and self.tests * float(self.joined[0].one_antenna.p_value) >= accept
        return self._spoofed(alpha) if could_be else []

    def _authentic(self, alpha: float) -> list[Evidence]:
        joined, cells = self.joined
        because = f"{self._how()} do not come from one antenna; they agree with {self.geometry.words}"
        p_values = self.tests * window_p_values(joined, cells, self.geometry, "one antenna", alpha / self.tests)
        if self.run.parts[-1].open and p_values[-1] < alpha:
            self.window.skies.append(self.pairing)
        said = self._of_open("authentic", p_values, alpha, because)
        stated = self.window.statement(self.pairing, self.geometry, agrees=True)
        return [replace(e, assumes=(ONE_TRANSMITTER, ONCE, *self.geometry.assumes), statement=stated) for e in said]

    def _spoofed(self, alpha: float) -> list[Evidence]:
        joined, cells = self.joined
        because = f"{self._how()} come from one antenna: they do not show {self.geometry.words}"
        p_values = self.tests * window_p_values(joined, cells, self.geometry, "the sky", alpha / self.tests)
        p_values += self.window.p_of_echoes(self.pairing.receivers, self.pairing)  # of one place, as long as it lasts
        said = self._of_open("spoofed", p_values, alpha, because)
        if isinstance(self.geometry, LearntDistance):
            return [replace(e, assumes=self.geometry.assumes) for e in said]
        stated = self.window.statement(self.pairing, self.geometry, agrees=False)
        return [replace(e, statement=stated) for e in said]

    def _of_open(self, says: Says, p_values: Reals, alpha: float, because: str) -> list[Evidence]:
        """This of each open window whose p-value is small."""
        said = []
        group = next(self.window.groups)
        for number, part in enumerate(self.run.parts):
            if part.open and p_values[number] < alpha:
                self.decided[number] = True
                e = self.window.say(
                    says, self.joined[0].subject, p_value=float(p_values[number]), because=because, group=group
                )
                said.append(replace(e, start_gpst=part.start_gpst, end_gpst=part.end_gpst))
        return said

    def _how(self) -> str:
        return f"in {self.run.length_s:.0f} s together, {names(self.joined[0])}"
