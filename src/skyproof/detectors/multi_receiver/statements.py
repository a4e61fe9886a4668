"""Judge signals that contradict the stated antennas: are they false, or is the statement?

If no window of the run confirms a statement, the signals cannot tell: antennas that stand elsewhere than stated show
the same as one captured receiver. So an untrue statement competes with an attack. It is excluded if

- another window shows the receivers as stated: the statement is true then, unless antennas were turned;
- an earlier window, in which they may have stood as stated, does not show them where this one does;
- carriers put the antennas into one place, to millimetres: two antennas cannot stand there, one transmitter can;
- the signals put them farther apart than they may be (`max_separation_m`), and than a decimal point explains.

A likely slip in the statement (`gnss.slips`) may explain what all windows show. Then only carriers that show one place
exclude an untrue statement.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

import numpy as np

from skyproof.detectors.base import leave_open
from skyproof.detectors.multi_receiver.known_geometry import GeometrySlip, consistency_p_value
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
            return _add_causes(e, self._list_doubts(test))
        turned = self._list_turned(test)
        borne_out = all((test.key, ref.receiver) in self.borne_out for ref in e.signals)
        true = not turned and (borne_out or test.p_elsewhere < self.settings.false_alarm_probability)
        slips = [slip for slip in self._list_fitting(test) if not true or slip.code == _TURNED]
        if not turned and not slips and (true or not self._is_near_enough(test)):
            return e if borne_out or not true else replace(e, p={**e.p, Cause.STATEMENT: test.p_elsewhere})
        causes = turned or self._causes(slips) or (self._build_unlisted(test),)
        if e.says == "undecided":
            return _add_causes(e, causes)
        other_causes: dict[Cause, float] = {cause: p for cause, p in e.p.items() if cause is not Cause.CLEAN}
        return replace(
            _add_causes(e, causes),
            hypothesis=Hypothesis.AS_STATED,
            code="statement_or_false",
            p={Cause.CLEAN: e.p[Cause.CLEAN], **leave_open((Cause.STATEMENT,)), **other_causes},
            singled_out=False,
            data={name: value for name, value in e.data.items() if name not in ("group", "assumes")}
            | {"found": e.code},
        )

    def _list_doubts(self, test: StatementTest) -> tuple[WrongStatement, ...]:
        """List what may be wrong with a statement that signals contradict, though they may not be from the sky.

        If carriers can tell, it is the slips that they fit in all windows, while they fit the statement in none. Else
        it is what code shows, if that contradicts the statement beyond chance for all windows together.
        """
        tests = self._open[test.key, test.receivers]
        geometry = self.settings.geometry(test.receivers)
        told = [set(window_test.fitting) for window_test in tests if window_test.fitting is not None]
        if told and geometry is not None:
            common = set.intersection(*told)
            return self._causes([slip for slip in geometry.slips(test.receivers) if slip.code in common])
        borne_out = any((test.key, name) in self.borne_out for name in test.receivers)
        least = len(tests) * min(p for window_test in tests if (p := window_test.p_value) is not None)
        if borne_out or least >= self.settings.accept_probability:
            return ()
        return self._causes(self._list_fitting(test)) or (self._build_unlisted(test),)

    def _list_turned(self, test: StatementTest) -> tuple[WrongStatement, ...]:
        """Return that the attitude may be wrong, where it places the antennas and they show their distances.

        No window bears out the attitude of another one.
        """
        body_m, shown = self.settings.antennas_body_m, test.shown
        if body_m is None or self.settings.antennas_enu_m is not None or shown is None:
            return ()
        first_m = body_m[test.receivers[0]]
        apart_m = [float(np.linalg.norm(body_m[name] - first_m)) for name in test.receivers[1:]]
        own_m = float(np.sqrt(2.0)) * self.settings.antennas_body_sigma_m
        fits = all(
            abs(d_m - true_m) <= POLICY.statement_sigmas * float(np.hypot(sigma_m, own_m))
            for (d_m, sigma_m), true_m in zip(shown.distances_m, apart_m, strict=True)
        )
        words = "the antennas are as far apart as stated in another direction: the attitude is wrong"
        return (WrongStatement(code=_TURNED, about="attitude", words=words, value=None),) if fits else ()

    def _causes(self, slips: Iterable[GeometrySlip]) -> tuple[WrongStatement, ...]:
        return tuple(WrongStatement(code=s.code, about=s.about, words=s.words, value=s.value or None) for s in slips)

    def _list_fitting(self, test: StatementTest) -> list[GeometrySlip]:
        """List the slips that explain what all windows show."""
        key = test.key, test.receivers
        geometry, baselines = self.settings.geometry(test.receivers), self.shown.get(key)
        if key not in self._slips:
            accept = self.settings.accept_probability
            every = () if geometry is None or not baselines else geometry.slips(test.receivers)
            self._slips[key] = [slip for slip in every if consistency_p_value(slip.fit, baselines or ()) >= accept]
        return self._slips[key]

    def _is_near_enough(self, test: StatementTest) -> bool:
        """Tell if the antennas may stand where they are shown, for all that is known but for the statement."""
        if test.shown is None:
            return True
        geometry = self.settings.geometry(test.receivers)
        stated_m = self.settings.antenna_separation_m if geometry is None else geometry.farthest_m(test.receivers)
        most_m = max(self.settings.max_separation_m, POLICY.decimal_slip * stated_m)
        return all(d_m - POLICY.statement_sigmas * sigma_m <= most_m for d_m, sigma_m in test.shown.distances_m)

    def _build_unlisted(self, test: StatementTest) -> WrongStatement:
        words, value = "it is untrue from the first moment, by no amount that is usual", None
        if test.shown is not None:
            far = ", ".join(f"{d_m:.1f} ± {sigma_m:.1f} m" for d_m, sigma_m in test.shown.distances_m)
            value = f"antennas {far} apart"
        about = "antenna_separation_m" if test.key == SEPARATION else test.key
        return WrongStatement(code=UNLISTED, about=about, words=words, value=value)


def _add_causes(e: Finding, causes: tuple[WrongStatement, ...]) -> Finding:
    """Return the finding with what may be wrong of the statement."""
    return replace(e, estimates={**e.estimates, "wrong_statements": causes}) if causes else e
