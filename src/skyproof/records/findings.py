"""Hold what one test found in one window."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Final, Literal

import numpy as np

from skyproof.records.estimates import (
    Baseline,
    Direction,
    NoiseRise,
    NoticedAttack,
    OverlappingSkies,
    WeakStart,
)
from skyproof.records.needs import Need
from skyproof.records.signals import SignalRef
from skyproof.short_repr import ShortRepr

__all__ = [
    "UNTESTED",
    "AnyFinding",
    "Cause",
    "CauseName",
    "Datum",
    "Evidence",
    "Finding",
    "Hypothesis",
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


class Hypothesis(StrEnum):
    """The null hypothesis that a test holds measurements against."""

    CONTINUOUS = "continuous"
    """Position, velocity, clock and carriers are continuous, within what a platform and an oscillator can do."""
    ONE_OF_SKIES = "one_of_skies"
    """One of several skies is where it is expected."""
    PREDICTED = "predicted"
    """The fix is where an inertial unit, an oscillator or the fixes before put it."""
    AS_STATED = "as_stated"
    """What the user states of places, distances or antennas holds."""
    ONE_POSITION = "one_position"
    """All pseudoranges fit one position and one clock."""
    ONE_SKY = "one_sky"
    """Each satellite is received once, but for reflections."""
    ONE_COMPONENT = "one_component"
    """A correlation holds one signal, but for reflections."""
    UNDISTORTED = "undistorted"
    """A correlation has the shape of one signal in noise."""
    CODE_FOLLOWS_CARRIER = "code_follows_carrier"
    """Codes move as their carriers do, and bands as the ionosphere lets them."""
    INDEPENDENT_ERRORS = "independent_errors"
    """The signals' errors have nothing in common but the receiver's clock and motion."""
    WHOLE_TRACKING = "whole_tracking"
    """Satellites are tracked as orbits, horizon and noise let them be."""
    STEADY_LEVELS = "steady_levels"
    """C/N0 and front-end levels are those of the sky and the receiver's own past."""
    TRUE_MESSAGES = "true_messages"
    """Navigation messages are those that the system sends at this time."""
    OWN_FIX = "own_fix"
    """The receiver's own fixes are those of its measurements, and move as a platform can."""
    SEPARATE_ORIGINS = "separate_origins"
    """Late and weak copies of several satellites do not come from one direction."""
    SKY_DIRECTIONS = "sky_directions"
    """Signals arrive from the directions of their satellites."""
    ONE_ANTENNA = "one_antenna"
    """Signals come from one transmit antenna; rejected, they come from the sky."""
    FALSE_SKY = "false_sky"
    """The sky is a false one; rejected, it is the true one under the stated assumptions."""
    ONE_CAUSE = "one_cause"
    """One benign cause, or two together, explain all that failed in a window."""


class Cause(StrEnum):
    """A state of the world that a finding gives a p-value for: a clean sky, a benign cause, or a false sky."""

    CLEAN = "clean"
    REFLECTIONS = "reflections"
    INTERFERENCE = "interference"
    GAIN = "gain"
    SHADE = "shade"
    OSCILLATOR = "oscillator"
    MOTION = "motion"
    FAULT = "fault"
    ORBITS = "orbits"
    STATEMENT = "statement"
    MISSING_SAMPLES = "missing_samples"
    JOINED = "joined"
    FALSE_SKY = "false_sky"


UNTESTED: Final = 1.0
"""p-value under a cause that may have spoilt everything that a test looks at: nothing is left to test."""
CauseName = Literal[
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
    "joined",
]
"""A benign cause as `Evidence` names it."""

Null = Literal["sky", "one antenna"]
"""What a test may reject: that the signals are the sky's, or that they come from one transmit antenna."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False, slots=True)
class StatementTest(ShortRepr):
    """What signals say of a statement of the user: key, its receivers, and whether they agree with it.

    one_place : carriers put the receivers' antennas into one place, to millimetres and not by chance. shown : what the
        signals show instead, over the window. p_value : of the statement, where the signals do not decide.
    fitting : codes of slips that carriers fit, none if they fit the statement, None if they do not tell.
    p_elsewhere : of "the antennas stand elsewhere than stated, and did so before", when they were seen as stated.
    """

    key: str
    receivers: tuple[str, ...]
    agrees: bool
    one_place: bool = False
    shown: Baseline | None = None
    p_value: float | None = None
    fitting: tuple[str, ...] | None = None
    p_elsewhere: float = 1.0


@dataclass(frozen=True, kw_only=True)
class WrongStatement:
    """How a statement of the user may be untrue: code, what it is about, words, and what would be right."""

    code: str
    about: str
    words: str
    value: str | None = None

    @property
    def sentence(self) -> str:
        """State what may be wrong, and what would be right."""
        fits = f"; {self.value} would fit" if self.value else ""
        return f"{self.about} may be wrong ({self.words}{fits})"


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
    may_also_be: tuple[CauseName, ...] = ()
    dated_gpst: np.datetime64 | None = None
    interference: tuple[NoiseRise, ...] | None = None
    statement: StatementTest | None = None
    wrong_statements: tuple[WrongStatement, ...] = ()

    @property
    def failed(self) -> bool:
        """Test whether a test rejected that the signals are the sky's, and the cause is open."""
        asked = self.false_alarm_probability
        rejected = self.p_value is not None and asked is not None and self.p_value < asked
        return rejected and self.says == "undecided" and self.null == "sky"


Datum = str | float | int | bool | tuple[str, ...] | tuple[float, ...]


@dataclass(frozen=True, eq=False, kw_only=True, repr=False, slots=True)
class Finding(ShortRepr):
    """What one test measured in one window: numbers about a named hypothesis, no word and no sentence.

    Parameters
    ----------
    signals : that were tested.
    hypothesis : the null.
    p : largest p-value of these measurements under a clean sky and under each benign cause that the test can see, the
        likeliest cause first; of a test for authenticity, under a false sky. Exact or conservative. A cause that may
        have spoilt everything that was tested has 1. Empty where nothing could be tested.
    alpha : the test's share of the false-alarm probability.
    singled_out : each of `signals` is rejected alone; else some of them are, and it is open which.
    estimates : what was measured, by name: see the properties.
    code : short name of what was found, or of why nothing could be tested; `skyproof.explain` puts it in words.
    data : numbers and names for those words, and "statistic", "threshold" and "log_likelihood_ratio" of the test.
    dated_gpst : epoch from which on the null fails, where the test dates it.
    """

    detector: str
    start_gpst: np.datetime64
    end_gpst: np.datetime64
    signals: tuple[SignalRef, ...]
    hypothesis: Hypothesis
    code: str
    p: Mapping[Cause, float] = field(default_factory=dict)
    alpha: float | None = None
    singled_out: bool = False
    estimates: Mapping[str, Any] = field(default_factory=dict)
    data: Mapping[str, Datum] = field(default_factory=dict)
    dated_gpst: np.datetime64 | None = None

    # --- estimates

    @property
    def directions(self) -> tuple[Direction, ...]:
        """Return where the signals come from, all that fit, the likeliest first."""
        return tuple(self.estimates.get("directions", ()))

    @property
    def baselines(self) -> tuple[Baseline, ...]:
        """Return where the antennas stand by these signals, over the whole window first and then over parts of it."""
        return tuple(self.estimates.get("baselines", ()))

    @property
    def withheld(self) -> tuple[SignalRef, ...]:
        """Return signals that fit the others, and that the test leaves out as false ones could take their place."""
        return tuple(self.estimates.get("withheld", ()))

    @property
    def overlapping(self) -> tuple[OverlappingSkies, ...]:
        """Return the skies that signals were taken apart into, instant by instant."""
        return tuple(self.estimates.get("overlapping", ()))

    @property
    def interference(self) -> tuple[NoiseRise, ...] | None:
        """Return the interference that the window shows, a carrier each; None of a test that does not look for it."""
        found: tuple[NoiseRise, ...] | None = self.estimates.get("interference")
        return found

    @property
    def weak_start(self) -> tuple[WeakStart, ...]:
        """Return the carriers that are weak from a receiver's first window on."""
        return tuple(self.estimates.get("weak_start", ()))

    @property
    def noticed(self) -> tuple[NoticedAttack, ...]:
        """Return what the test would have noticed of attacks, each kind by its size."""
        return tuple(self.estimates.get("noticed", ()))

    @property
    def statement(self) -> StatementTest | None:
        """Return what the signals say of a statement of the user that the finding rests on or contradicts."""
        found: StatementTest | None = self.estimates.get("statement")
        return found

    @property
    def wrong_statements(self) -> tuple[WrongStatement, ...]:
        """Return the slips in statements that would explain what was found, the likeliest first."""
        return tuple(self.estimates.get("wrong_statements", ()))

    # --- what the decision reads

    @property
    def lacking(self) -> tuple[Need, ...]:
        """Return the records that the test needs and did not get."""
        names: Any = self.data.get("lacking", ())
        return tuple(Need(name) for name in names)

    @property
    def says(self) -> Says:
        """Return the word that the p-values give: the union of all causes is rejected, the clean sky alone, or none."""
        alpha = 0.0 if self.alpha is None else self.alpha
        if not self.p:
            return "authentic" if self.by_assumption else "undecided"
        if Cause.FALSE_SKY in self.p:
            return "authentic" if self.p[Cause.FALSE_SKY] < alpha else "undecided"
        if self.p[Cause.CLEAN] >= alpha:
            return "clean"
        if self.may_also_be == (Cause.REFLECTIONS,) and self.singled_out:
            return "multipath"
        return "undecided" if self.may_also_be else "spoofed" if self.singled_out else "attack"

    @property
    def p_value(self) -> float | None:
        """Return the p-value of what `says` rejects, or did not: of the union of causes for an attack."""
        if not self.p:
            return None
        if Cause.FALSE_SKY in self.p:
            return self.p[Cause.FALSE_SKY]
        return max(self.p.values()) if self.says in ("spoofed", "attack") else self.p[Cause.CLEAN]

    @property
    def by_assumption(self) -> bool:
        """Return whether what is assumed excludes a false sky, without a test."""
        return self.hypothesis is Hypothesis.FALSE_SKY and bool(self.data.get("assumes")) and not self.p

    @property
    def may_also_be(self) -> tuple[Cause, ...]:
        """Return the benign causes that explain what a clean sky does not, the likeliest first."""
        alpha = 0.0 if self.alpha is None else self.alpha
        if Cause.FALSE_SKY in self.p or self.p.get(Cause.CLEAN, 1.0) >= alpha:
            return ()
        return tuple(cause for cause, p in self.p.items() if cause is not Cause.CLEAN and p >= alpha)

    @property
    def failed(self) -> bool:
        """Tell whether the test rejects a clean sky and leaves a benign cause open."""
        return bool(self.may_also_be) and self.says == "undecided"

    @property
    def overrules(self) -> bool:
        """Return whether the signals stay open by this finding whatever other tests say of them."""
        return self.failed and self.hypothesis in _OVERRULING

    @property
    def group(self) -> int | None:
        """Return the number within its window that findings of one decision share."""
        number: Any = self.data.get("group")
        return None if number is None else int(number)

    @property
    def whole_sky(self) -> bool:
        """Return whether the signals are one sky of two that cannot both be true, of antennas unknown in number."""
        return bool(self.data.get("whole_sky", False))

    @property
    def statistic(self) -> float | None:
        """Return the test's statistic."""
        return self._number("statistic")

    @property
    def threshold(self) -> float | None:
        """Return the statistic's threshold at `alpha`."""
        return self._number("threshold")

    @property
    def log_likelihood_ratio(self) -> float | None:
        """Return that of what is rejected against its opposite, natural logarithm, where there is a model for both."""
        return self._number("log_likelihood_ratio")

    def _number(self, name: str) -> float | None:
        value: Any = self.data.get(name)
        return None if value is None else float(value)


_OVERRULING: Final = frozenset(
    {
        Hypothesis.CONTINUOUS,
        Hypothesis.PREDICTED,
        Hypothesis.AS_STATED,
        Hypothesis.CODE_FOLLOWS_CARRIER,
        Hypothesis.INDEPENDENT_ERRORS,
        Hypothesis.WHOLE_TRACKING,
        Hypothesis.TRUE_MESSAGES,
        Hypothesis.OWN_FIX,
        Hypothesis.SEPARATE_ORIGINS,
    }
)
"""Nulls whose failure is about the receiver as a whole, so that tests of its single signals do not outweigh it."""


AnyFinding = Finding | Evidence
"""What a test gives, of this contract or of the one before."""
