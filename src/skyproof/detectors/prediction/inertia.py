"""Test whether a fix departs from the inertial prediction.

Fixes of every window that follows its prediction and in which no other test fails correct the navigator, and the last
fix of the next, position and velocity, is held against it: the squared distance over both covariances is chi-square if
the signals are true and the unit errs no more than is stated of it (`navigation.inertial_predictor`). So is that fix
with the velocity of the whole window: where a drag lasts, it shows above the noise of one. From the first window on
that departs, or in which any receiver is attacked, the unit runs free. Clocks are not compared here, and correct the
navigator for the first `clean_start_s` only: inertia does not see one that is pushed.

A drag that is slower than what one window notices draws the navigator along. So some navigators run free beside it,
from before the last windows on: each fix is held against all of them, and as old ones notice slow drags better, up to
an age at which their drift outweighs it, those are kept that notice slower ones than all younger do; and that from
before a window that is refused without failing, as long as one of so many windows is not refused so by chance. Once the
signals part, the unit goes back to the youngest navigator that all older ones predict, one window earlier at least and
before any such window, and that dates the parting. The younger ones still notice best, and fixes are held against them,
too; without some satellites only against those that no such window corrected, which the same satellites may have put
off. The slowest drag that any of them notices stands in each finding: what is slower may have led the navigator away
all the time (`CorrectedNavigator`).

What leaves it may be false signals, reflections or the unit. It is an attack only where the rest shows it too without
any two of the satellites, for reflections are some satellites', and the unit is not to blame. Whatever a unit errs by
stands in position and velocity alike: positions part by what velocities part by, added up over time. Codes that are
dragged alone break that, for velocities stay. Else the unit is not to blame only where

- it has gone on with the signals before, through changes of velocity at least half as large as those that it
  shows while they part: a log with wrong axes, units, times or gains errs where it is moved;
- the velocities part within two seconds and stay so for four: what a unit errs by adds up for as long as it errs;
- no single reading is to blame.

Else it stays undecided, with the reason.
"""

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from skyproof.detectors.base import NotTested, Reporter
from skyproof.detectors.prediction.walk import Walk
from skyproof.errors import require_probability
from skyproof.fusion.candidates import FixMaker, select_candidates
from skyproof.fusion.corrected import CorrectedNavigator
from skyproof.gnss.time import timedelta_from_s
from skyproof.records import Finding, Hypothesis, Need, Records, list_refs

__all__ = ["Inertia", "InertiaSettings", "list_navigators"]

_UNTRIED: Final = NotTested("not_aligned")


@dataclass(frozen=True)
class InertiaSettings:
    """Settings of `Inertia`.

    false_alarm_probability : of each receiver and window. clean_start_s : for so long clocks correct the navigator.
    multipath_sigma_m : of one pseudorange, one sigma. elevation_mask_deg : satellites below are left out of fixes.
    """

    false_alarm_probability: float = 1e-3
    clean_start_s: float = 30.0
    multipath_sigma_m: float = 1.0
    elevation_mask_deg: float = 5.0

    def __post_init__(self) -> None:
        require_probability("inertia", "false_alarm_probability", self.false_alarm_probability)


class Inertia:
    """The detector: see the module's text. It remembers the navigator of each receiver, and those that run free."""

    name = "inertia"
    needs = (Need.INERTIAL, Need.SETS, Need.FINDINGS)

    def __init__(self, settings: InertiaSettings | None = None) -> None:
        self.settings = settings or InertiaSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return a finding for each receiver in a window that its navigator predicts."""
        report = Reporter(self, records, Hypothesis.PREDICTED)
        lacking = report.name_missing()
        walks: dict[str, Walk] = dict(state or {})
        # Whoever attacks one receiver is within reach of the others.
        attacked = min((_date(e) for e in records.findings if e.says in ("attack", "spoofed")), default=None)
        found = list(lacking)  # an attack counts in a window without sets, too
        for o in records.observations:
            if o.receiver not in records.inertial:
                continue
            maker = FixMaker.build_for_window(o, records, self.settings)
            if o.receiver in walks:
                walk = replace(walks[o.receiver], maker=maker, report=report)
            else:
                until = o.gpst[0] + timedelta_from_s(self.settings.clean_start_s)
                walk = Walk(predictor=records.inertial[o.receiver], clock_until=until, maker=maker, report=report)
            walks[o.receiver] = walk
            about = [e for e in records.findings if any(ref.receiver == o.receiver for ref in e.signals)]
            failed = min((_date(e) for e in about if e.failed), default=None)
            finding = walk.examine(select_candidates(records, o.receiver), attacked, failed)
            if finding is not None:
                found.append(finding)
            elif not lacking:
                found.append(report.pass_over(list_refs(o.receiver, o.signals), _UNTRIED))
        return found, walks


def list_navigators(state: Any) -> dict[str, CorrectedNavigator]:
    """Return the navigator of each receiver. state : of `Inertia` after some windows."""
    walks: dict[str, Walk] = state or {}
    return {receiver: walk.navigator for receiver, walk in walks.items()}


def _date(e: Finding) -> np.datetime64:
    """Return from when on a finding doubts the signals."""
    return e.start_gpst if e.dated_gpst is None else min(e.start_gpst, e.dated_gpst)
