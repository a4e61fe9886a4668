"""Hold what one test found in one window."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from skyproof.records.estimates import Baseline, Direction, NoiseRise, OverlappingSkies
from skyproof.records.signals import SignalRef
from skyproof.records.window import Need
from skyproof.short_repr import ShortRepr

__all__ = [
    "Cause",
    "Evidence",
    "Null",
    "Says",
    "StatementTest",
    "WrongStatement",
]

Says = Literal["authentic", "spoofed", "attack", "clean", "multipath", "undecided"]
"""What a piece of evidence says of its subject.

authentic : the subject's signals come from the sky (positive evidence).
spoofed : the subject's signals are imitations.
multipath : the subject's signals are late copies of others, by a reflector or a repeater; they show no other place.
attack : some of the subject's signals are imitations; not which.
clean : no sign of an attack; no evidence of authenticity either.
undecided : the test could not tell, or could not run; `because` says why and what would help.
"""

Cause = Literal[
    "reflections",
    "interference",
    "gain",
    "shade",
    "oscillator",
    "motion",
    "fault",
    "orbits",
    "statement",
    "missing_samples",
]
"""What else than an attack may make a test fail: `fault` of one satellite or of the receiver, wrong `orbits` or clocks,
a `statement` of the user that is not true, samples that are missing or a recording that was cut and joined."""

Null = Literal["sky", "one antenna"]
"""What a test may reject: that the signals are the sky's, or that they come from one transmit antenna."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False, slots=True)
class StatementTest(ShortRepr):
    """What signals say of a statement of the user: key, of which receivers, and whether they agree with it.

    one_place : carriers put the receivers' antennas into one place, to millimetres and not by chance. shown : what the
        signals show instead, over the window. p_value : of the statement, where the signals do not decide.
    fitting : codes of slips that carriers fit, none if they fit the statement, None if they do not tell.
    """

    key: str
    receivers: tuple[str, ...]
    agrees: bool
    one_place: bool = False
    shown: Baseline | None = None
    p_value: float | None = None
    fitting: tuple[str, ...] | None = None


@dataclass(frozen=True, kw_only=True)
class WrongStatement:
    """How a statement of the user may be untrue: code, what it is about, words, and what would be right."""

    code: str
    about: str
    words: str
    value: str | None = None

    @property
    def sentence(self) -> str:
        """Say what may be wrong, and what would be right."""
        return f"{self.about} may be wrong: {self.words}" + (f" ({self.value} would fit)" if self.value else "")


@dataclass(frozen=True, eq=False, kw_only=True, repr=False, slots=True)
class Evidence(ShortRepr):
    """One test's outcome on one window: the statistic, its threshold and what it says, with the error rate asked for.

    p_value : probability of a statistic at least as extreme under the hypothesis that `says` rejects
        ("authentic" rejects "from one antenna"; "spoofed" and "attack" reject "clean sky"), or, where it says
        "undecided", that `null` names.
    log_likelihood_ratio : of what it says over its opposite, natural logarithm; None where no model is stated.
    noted : it stands beside the verdict, whatever that is.
    code : of what could not be tested, the reason's short name, which `because` puts in words. lacking : what the test
        needs and did not get.
    directions : where the subject's signals come from, if that is one place and the test can tell it: all that fit, the
        likeliest first.
    assumes : under what the word holds that the measurements cannot show, in words; each stands beside the verdict.
    baselines : what the subject's signals say of the antennas, over the whole window first and then over parts of it.
    whole_sky : of "spoofed": the subject is one sky of two that cannot both be true; from how many antennas it came is
        not known.
    overrules : of a test that failed ("undecided", and p_value below false_alarm_probability): its subject stays open
        whatever other tests say of this window, and the verdict with it.
    overlapping : skies in signals that were taken apart, instant by instant.
    may_also_be : of a test that failed, what else than an attack would explain it, the likeliest first.
    dated_gpst : of a test that failed, the epoch from which on it does, where the test dates that.
    interference : that the window shows, a carrier each; None of a test that does not look for it.
    statement : of the user, that it rests on or contradicts. wrong_statements : that would explain what it found, the
        likeliest first.
    """

    detector: str
    start_gpst: np.datetime64
    end_gpst: np.datetime64
    subject: tuple[SignalRef, ...]
    says: Says
    because: str
    statistic: float | None = None
    threshold: float | None = None
    false_alarm_probability: float | None = None
    p_value: float | None = None
    log_likelihood_ratio: float | None = None
    would_need: str | None = None
    group: int | None = None  # evidence of one group decision shares a number within its window
    overrules: bool = False
    noted: bool = False
    code: str = ""
    lacking: tuple[Need, ...] = ()
    directions: tuple[Direction, ...] = ()
    assumes: tuple[str, ...] = ()
    baselines: tuple[Baseline, ...] = ()
    whole_sky: bool = False
    overlapping: tuple[OverlappingSkies, ...] = ()
    null: Null = "sky"
    may_also_be: tuple[Cause, ...] = ()
    dated_gpst: np.datetime64 | None = None
    interference: tuple[NoiseRise, ...] | None = None
    statement: StatementTest | None = None
    wrong_statements: tuple[WrongStatement, ...] = ()

    @property
    def failed(self) -> bool:
        """Whether a test rejected that the signals are the sky's, and it is open why."""
        asked = self.false_alarm_probability
        rejected = self.p_value is not None and asked is not None and self.p_value < asked
        return rejected and self.says == "undecided" and self.null == "sky"
