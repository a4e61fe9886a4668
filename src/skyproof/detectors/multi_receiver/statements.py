"""Signals that contradict what the user stated of the antennas: are they false, or is the statement?

Of a statement that no window of the run bears out the signals cannot tell: antennas that stand elsewhere than stated
show what one captured receiver shows. So a statement that is untrue competes with an attack. It is excluded where

- another window shows the receivers as stated: the statement is true then, unless antennas were turned;
- carriers put the antennas into one place, to millimetres: two antennas cannot stand there, one transmitter can;
- the signals put them farther apart than they may be (`max_separation_m`), and than a decimal point explains.

Not even then is it excluded, but by one place, if what is shown is what a likely slip makes of the statement
(`gnss.slips`), with one slip for all windows.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

from skyproof.detectors.base import leave_open
from skyproof.detectors.multi_receiver.known_geometry import GeometrySlip, agreement
from skyproof.detectors.multi_receiver.policy import POLICY
from skyproof.detectors.multi_receiver.settings import MultiReceiverSettings
from skyproof.detectors.multi_receiver.window import SEPARATION
from skyproof.gnss.slips import UNLISTED
from skyproof.records import Baseline, Cause, Finding, Hypothesis, StatementTest, WrongStatement

__all__ = ["Statements"]

_TURNED: Final = "attitude_or_axes"


class Statements:
    """What all windows of a run say of what was stated. findings : of the detector, read once."""

    def __init__(self, settings: MultiReceiverSettings, findings: Iterable[Finding]) -> None:
        self.settings = settings
        self.borne_out = set[tuple[str, str]]()
        self.shown: dict[tuple[str, tuple[str, ...]], list[Baseline]] = {}
        self._open: dict[tuple[str, tuple[str, ...]], list[StatementTest]] = {}
        for e in findings:
            test = e.statement
            if test is not None and test.agrees:
                self.borne_out.update((test.key, name) for name in test.receivers)
            elif test is not None and test.shown is not None:
                self.shown.setdefault((test.key, test.receivers), []).append(test.shown)
            if test is not None and test.p_value is not None:
                self._open.setdefault((test.key, test.receivers), []).append(test)
        self._slips: dict[tuple[str, tuple[str, ...]], list[GeometrySlip]] = {}

    def weigh(self, e: Finding) -> Finding:
        """Return the finding, undecided where the statement may be what is wrong, with that as its first cause."""
        test = e.statement
        if test is None or test.agrees or test.one_place:
            return e
        if test.p_value is not None:
            return _add_causes(e, self._doubts(test))
        true = all((test.key, ref.receiver) in self.borne_out for ref in e.signals)
        slips = [slip for slip in self._fitting(test) if not true or slip.code == _TURNED]
        if not slips and (true or not self._near_enough(test)):
            return e
        causes = self._causes(slips) or (self._unlisted(test),)
        if e.says == "undecided":
            return _add_causes(e, causes)
        others: dict[Cause, float] = {cause: p for cause, p in e.p.items() if cause is not Cause.CLEAN}
        return replace(
            _add_causes(e, causes),
            hypothesis=Hypothesis.AS_STATED,
            code="statement_or_false",
            p={Cause.CLEAN: e.p[Cause.CLEAN], **leave_open((Cause.STATEMENT,)), **others},
            singled_out=False,
            data={name: value for name, value in e.data.items() if name not in ("group", "assumes")}
            | {"found": e.code},
        )

    def _doubts(self, test: StatementTest) -> tuple[WrongStatement, ...]:
        """What may be wrong of a statement that signals contradict, though they are not sure to be of the sky.

        Where carriers tell, what these fit in all windows, but the statement in none; else by code, if that contradicts
        it by no chance for all windows together.
        """
        tests = self._open[test.key, test.receivers]
        geometry = self.settings.geometry(test.receivers)
        told = [set(one.fitting) for one in tests if one.fitting is not None]
        if told and geometry is not None:
            common = set.intersection(*told)
            return self._causes([slip for slip in geometry.slips(test.receivers) if slip.code in common])
        borne_out = any((test.key, name) in self.borne_out for name in test.receivers)
        least = len(tests) * min(p for one in tests if (p := one.p_value) is not None)
        if borne_out or least >= self.settings.accept_probability:
            return ()
        return self._causes(self._fitting(test)) or (self._unlisted(test),)

    def _causes(self, slips: Iterable[GeometrySlip]) -> tuple[WrongStatement, ...]:
        return tuple(WrongStatement(code=s.code, about=s.about, words=s.words, value=s.value or None) for s in slips)

    def _fitting(self, test: StatementTest) -> list[GeometrySlip]:
        """The slips that explain what all windows show."""
        key = test.key, test.receivers
        geometry, shown = self.settings.geometry(test.receivers), self.shown.get(key)
        if key not in self._slips:
            accept = self.settings.accept_probability
            every = () if geometry is None or not shown else geometry.slips(test.receivers)
            self._slips[key] = [slip for slip in every if agreement(slip.fit, shown or ()) >= accept]
        return self._slips[key]

    def _near_enough(self, test: StatementTest) -> bool:
        """Whether the antennas may stand where they are shown, for all that is known but for the statement."""
        if test.shown is None:
            return True
        geometry = self.settings.geometry(test.receivers)
        stated_m = self.settings.antenna_separation_m if geometry is None else geometry.farthest_m(test.receivers)
        most_m = max(self.settings.max_separation_m, POLICY.decimal_slip * stated_m)
        return all(d_m - POLICY.statement_sigmas * sigma_m <= most_m for d_m, sigma_m in test.shown.distances_m)

    def _unlisted(self, test: StatementTest) -> WrongStatement:
        words, value = "it is untrue from the first moment, by no amount that is usual", None
        if test.shown is not None:
            far = ", ".join(f"{d_m:.1f} ± {sigma_m:.1f} m" for d_m, sigma_m in test.shown.distances_m)
            value = f"antennas {far} apart"
        about = "antenna_separation_m" if test.key == SEPARATION else test.key
        return WrongStatement(code=UNLISTED, about=about, words=words, value=value)


def _add_causes(e: Finding, causes: tuple[WrongStatement, ...]) -> Finding:
    """Return the finding with what may be wrong of the statement."""
    return replace(e, estimates={**e.estimates, "wrong_statements": causes}) if causes else e
