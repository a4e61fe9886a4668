"""Decide windows that alone decide nothing, by several in a row."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

from skyproof.arrays import Indices, Reals
from skyproof.detectors.multi_receiver.known_geometry import AntennaGeometry, LearntDistance
from skyproof.detectors.multi_receiver.pairing import Pairing
from skyproof.detectors.multi_receiver.policy import POLICY
from skyproof.detectors.multi_receiver.runs import WindowRun, prolong, window_p_values
from skyproof.detectors.multi_receiver.window import Window, collect_estimates, describe_pairing
from skyproof.records import Cause, Datum, Finding, Hypothesis, StatementTest

__all__ = ["decide_over_time"]


def decide_over_time(
    window: Window, runs: Sequence[WindowRun], said: Sequence[Finding]
) -> tuple[list[Finding], tuple[WindowRun, ...]]:
    """Decide windows that were open, this one among them; also return the runs that continue from here.

    said : findings on the groups of this window. If they doubt that a pairing is wholly from the sky, its run starts
    again. Without a known antenna geometry there is nothing to decide.
    """
    going_on = [row for pairing in window.pairings if (row := _follow(window, pairing, runs, said)) is not None]
    found = [finding for row in going_on for finding in row.decide(going_on)]
    return found, tuple(row.run.close_decided(row.decided) for row in going_on)


def _follow(window: Window, pairing: Pairing, runs: Sequence[WindowRun], said: Sequence[Finding]) -> "_Followed | None":
    """Return a window's pairing with its run; None if it can decide nothing."""
    geometry = window.geometry(pairing)
    refs = set(pairing.subject)
    doubts = ("spoofed", "attack") if window.one_choice else ("spoofed",)  # of several skies one is false anyway
    doubted = any(refs & set(e.signals) for e in said if e.says in doubts)
    doubted |= window.one_choice and any(
        pairing.kinds & p.kinds and refs & set(p.subject) and _disagrees(window, p) for p in window.pairings
    )
    if geometry is None or doubted:
        return None
    authentic = {ref for e in said if e.says == "authentic" for ref in e.signals}
    run = prolong(runs, pairing, still_open=not refs <= authentic, least=window.settings.min_satellites)
    return _Followed(window, pairing, run, geometry)


def _disagrees(window: Window, pairing: Pairing) -> bool:
    """Tell if a pairing is not from one antenna, and not as the antennas are known to stand either."""
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
        """Return the run as one window, and its half windows."""
        joined, cells = self.run.join(self.pairing)
        miss = self.window.settings.noise(self.tests).miss_probability
        return replace(joined, noise=replace(joined.noise, miss_probability=miss)), cells

    @cached_property
    def agrees(self) -> bool:
        """Tell if the run shows the antennas where they are known to stand."""
        return self.window.agrees(self.joined[0], self.geometry)

    def decide(self, everything: Sequence["_Followed"]) -> list[Finding]:
        """Return findings of the windows that are open and can be decided.

        everything : all runs that continue, to know which is alone."""
        if len(self.run.parts) < 2 or not any(part.open for part in self.run.parts):
            return []
        accept = self.window.settings.accept_probability
        alternatives = [row for row in everything if row is not self and row.pairing.kinds & self.pairing.kinds]
        if self.agrees:
            return [] if any(row.agrees for row in alternatives) else self._find_authentic()
        could_be = self.window.one_choice and self.tests * float(self.joined[0].one_antenna.p_value) >= accept
        return self._find_spoofed() if could_be else []

    @property
    def alpha(self) -> float:
        return self.window.settings.false_alarm_probability

    def _find_authentic(self) -> list[Finding]:
        joined, cells = self.joined
        p_values = self.tests * window_p_values(joined, cells, self.geometry, "one antenna", self.alpha / self.tests)
        if self.run.parts[-1].open and p_values[-1] < self.alpha:
            self.window.skies.append(self.pairing)
        return self._find_of_open(
            "as_known_over_time",
            {Cause.FALSE_SKY: p_values},
            ("no_concert", "one_change", *self.geometry.assumes),
            self.window.build_statement(self.pairing, self.geometry, agrees=True),
        )

    def _find_spoofed(self) -> list[Finding]:
        joined, cells = self.joined
        p_values = self.tests * window_p_values(joined, cells, self.geometry, "the sky", self.alpha / self.tests)
        p_echoes = self.window.p_of_echoes(self.pairing.receivers, self.pairing)  # of one place, as long as it lasts
        learnt = isinstance(self.geometry, LearntDistance)
        return self._find_of_open(
            "one_antenna_over_time",
            {Cause.CLEAN: p_values, Cause.REFLECTIONS: p_values + p_echoes},
            self.geometry.assumes if learnt else (),
            None if learnt else self.window.build_statement(self.pairing, self.geometry, agrees=False),
        )

    def _find_of_open(
        self, code: str, p: Mapping[Cause, Reals], assumes: tuple[str, ...], statement: StatementTest | None
    ) -> list[Finding]:
        """Return one finding of each open window whose p-values, (W,) by cause, are all small."""
        found = []
        data: dict[str, Datum] = {
            **describe_pairing(self.joined[0]),
            **self.geometry.data,
            "length_s": self.run.length_s,
            "group": next(self.window.groups),
            "assumes": assumes,
        }
        for number, part in enumerate(self.run.parts):
            of_window = {cause: float(p_values[number]) for cause, p_values in p.items()}
            if part.open and max(of_window.values()) < self.alpha:
                self.decided[number] = True
                finding = self.window.report.find(
                    self.joined[0].subject,
                    code,
                    of_window,
                    hypothesis=Hypothesis.ONE_ANTENNA if Cause.FALSE_SKY in p else None,
                    singled_out=Cause.FALSE_SKY not in p,
                    data=data,
                    estimates=collect_estimates((), statement),
                )
                found.append(replace(finding, start_gpst=part.start_gpst, end_gpst=part.end_gpst))
        return found
