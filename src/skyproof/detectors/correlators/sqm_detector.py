"""The detector of signal quality: does a second signal of the same satellite overlap the tracked one?

A reflection within a chip distorts correlators exactly as a second transmitter does. What tells them apart is how many
satellites show it at once, and on which side: a reflection comes after its signal, so one that comes before is the
weaker direct signal beside a tracked reflection, or not of the sky. Both counts are binomial if reflections come to
each satellite by themselves; only the second one says "attack".
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from skyproof.arrays import Booleans, ComplexFloats
from skyproof.detectors.base import Untested, missing, undecided
from skyproof.detectors.correlators.second_component import (
    BeatLine,
    allowed_share,
    distortion,
    earlier,
    pairs_of,
    together,
)
from skyproof.errors import SettingsError, require_probability
from skyproof.records import Asked, Evidence, Need, Records, SignalRef, Taps, TapsAsked
from skyproof.statistics.distributions import binomial_survival

__all__ = ["Sqm", "SqmSettings"]

LONGEST_S = 10.0
"""Over which a line is looked for at once: the beat of two signals drifts."""
LEAST_LOOKS = 100
SIGNAL_LEVEL = 1e-4
"""By chance a signal counts as distorted so often."""


@dataclass(frozen=True)
class SqmSettings:
    """Settings of `Sqm`.

    false_alarm_probability : of a receiver's window.
    multipath_sigma_m : error of code that a reflection causes without being counted, one sigma; 0 counts every one.
    reflection_probability : that a signal has a reflection beyond that.
    tracked_reflection_probability : that what is tracked is a reflection, with its direct signal weaker before it.
    min_signals : fewer say nothing together.
    """

    false_alarm_probability: float = 1e-3
    multipath_sigma_m: float = 1.0
    reflection_probability: float = 0.1
    tracked_reflection_probability: float = 0.01
    min_signals: int = 4

    def __post_init__(self) -> None:
        for name in ("false_alarm_probability", "reflection_probability", "tracked_reflection_probability"):
            require_probability("sqm", name, getattr(self, name))
        if self.multipath_sigma_m < 0.0:
            raise SettingsError(f"sqm: multipath_sigma_m is {self.multipath_sigma_m:g}, expected 0 or more")


@dataclass(frozen=True)
class _Signal:
    """What one signal's correlators show: the most telling line of all, and the most telling one before it."""

    ref: SignalRef
    distorted: BeatLine
    early: BeatLine


class Sqm:
    """One Evidence per receiver and window, from `taps`.

    While several signals of a satellite are tracked nothing is said of them: they distort each other, and
    `second_signals` looks at them. The counts' p-values are upper bounds. That of a single signal's distortion is exact
    with `multipath_sigma_m` = 0.
    """

    name = "sqm"
    needs = (Need.TAPS,)
    asks = Asked(taps=TapsAsked(delays_chips=(-1.0, -0.5, 0.5, 1.0), every_s=0.02, coherent_s=0.004))

    def __init__(self, settings: SqmSettings | None = None) -> None:
        self.settings = settings or SqmSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Evidence], Any]:
        """Evidence of one window; never raises for what the data lack."""
        lacking = missing(self, records)
        if lacking:
            return lacking, state
        return [self._receiver(records, taps) for taps in records.taps], state

    def _receiver(self, records: Records, taps: Taps) -> Evidence:
        signals = _examined(taps, self.settings.multipath_sigma_m)
        if len(signals) < self.settings.min_signals:
            refs = tuple(SignalRef(taps.receiver, signal) for signal in taps.signals)
            return undecided(
                self, records, refs, **_explain_few(taps, len(signals), self.settings.min_signals)._asdict()
            )
        return self._counted(records, taps.receiver, signals)

    def _counted(self, records: Records, receiver: str, signals: list[_Signal]) -> Evidence:
        settings, n = self.settings, len(signals)
        distorted = [s for s in signals if s.distorted.p_value < SIGNAL_LEVEL]
        early = [s for s in signals if s.early.p_value < SIGNAL_LEVEL]
        p_many = float(binomial_survival(len(distorted), n, settings.reflection_probability + SIGNAL_LEVEL))
        p_early = float(binomial_survival(len(early), n, settings.tracked_reflection_probability + SIGNAL_LEVEL))
        p_value, alpha = min(2.0 * p_many, 2.0 * p_early, 1.0), settings.false_alarm_probability
        certain = [s for s in signals if together(s.distorted.p_value, n) < alpha]

        def evidence(says: Any, subject: list[_Signal], because: str, **more: Any) -> Evidence:
            return Evidence(
                detector=self.name,
                start_gpst=records.start_gpst,
                end_gpst=records.end_gpst,
                subject=tuple(s.ref for s in subject),
                says=says,
                because=because,
                statistic=float(len(early) if says == "attack" else len(distorted)),
                false_alarm_probability=alpha,
                p_value=p_value,
                **more,
            )

        if 2.0 * p_early < alpha:
            return evidence(
                "attack",
                early,
                f"the correlators of {_named(early)} in {receiver}, {len(early)} of {n} signals, hold a second signal "
                "of the same satellite that comes before the tracked one, which no reflection does",
            )
        if 2.0 * p_many < alpha:
            return evidence(
                "undecided",
                distorted,
                f"the correlators of {_named(distorted)} in {receiver}, {len(distorted)} of {n} signals, are distorted "
                "at once, by reflections all around or by second signals",
                may_also_be=("reflections",),
                would_need="a second receiver nearby, or an antenna array",
            )
        if certain:
            return evidence(
                "undecided",
                certain,
                f"the correlators of {_named(certain)} in {receiver} are distorted, by a reflection or a second signal",
                would_need="a second receiver nearby, or an antenna array",
                noted=True,
            )
        return evidence(
            "clean",
            signals,
            f"the correlators of {n} signals of {receiver} are distorted no more than noise and multipath of "
            f"{settings.multipath_sigma_m:g} m explain",
        )


def _explain_few(taps: Taps, examined: int, least: int) -> Untested:
    """Say whether the correlators, their number in the window, or the signals are what is missing."""
    receiver = taps.receiver
    if not pairs_of(taps.delays_chips):
        return Untested(
            code="no_pair",
            because=f"{receiver} has no two correlators that stand evenly about the prompt",
            would_need="correlators at the prompt and evenly to both sides of it",
        )
    if taps.elapsed_s.size < LEAST_LOOKS:
        return Untested(
            code="few_looks",
            because=f"{taps.elapsed_s.size} looks at the correlators of {receiver} lie in the window; {LEAST_LOOKS} "
            "are needed",
            would_need="two seconds of signal or more",
        )
    sent = {signal.transmission for signal in taps.signals}
    if len(sent) < len(taps.signals) and len(sent) >= least:
        return Untested(
            code="several_of_a_satellite",
            because=f"{examined} of {len(sent)} satellites in {receiver} have one signal alone long enough: several "
            f"signals of a satellite distort each other, and fewer than {least} say nothing together",
            would_need=f"at least {least} satellites with one signal each",
        )
    return Untested(
        code="few_signals",
        because=f"{examined} signals of {receiver} were tracked without a break for {LEAST_LOOKS} looks; fewer than "
        f"{least} say nothing together",
        would_need=f"at least {least} satellites tracked without a break for 2 s",
    )


def _examined(taps: Taps, multipath_sigma_m: float) -> list[_Signal]:
    """Every signal that stands alone of its satellite and was tracked long enough without a break."""
    pairs, signals = pairs_of(taps.delays_chips), []
    if not pairs or taps.elapsed_s.size < LEAST_LOOKS:
        return []
    step_s = float(np.median(np.diff(taps.elapsed_s)))
    early_chips = float(np.min(np.abs(taps.delays_chips[[a for a, _, _ in pairs]])))
    value = taps.value[:, :, int(np.argmin(np.abs(taps.dopplers_hz)))]
    there: Booleans = np.asarray(np.isfinite(value).all(axis=2))
    for column in np.flatnonzero(there.any(axis=0)):
        rivals = [k for k, s in enumerate(taps.signals) if s.transmission == taps.signals[column].transmission]
        looks = _unbroken(value[:, column], there[:, column] & (there[:, rivals].sum(axis=1) == 1))
        if len(looks) < LEAST_LOOKS:
            continue
        allowed = allowed_share(multipath_sigma_m, early_chips, taps.signals[column].plan.chip_m)
        parts = np.array_split(looks, -(-len(looks) // round(LONGEST_S / step_s)))
        lines = [distortion(part, taps.delays_chips, step_s, allowed=allowed) for part in parts]
        early = [earlier(part, taps.delays_chips, step_s) for part in parts]
        ref = SignalRef(taps.receiver, taps.signals[column])
        signals.append(_Signal(ref, _most_telling(lines), _most_telling(early)))
    return signals


def _unbroken(looks: ComplexFloats, there: Booleans) -> ComplexFloats:
    """The longest run without a gap."""
    if not there.any():
        return looks[:0]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(np.int8)))
    begins, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - begins))
    return looks[begins[longest] : ends[longest]]


def _most_telling(lines: list[BeatLine]) -> BeatLine:
    best = min(lines, key=lambda line: line.p_value)
    return best._replace(p_value=together(best.p_value, len(lines)))


def _named(signals: list[_Signal]) -> str:
    return ", ".join(sorted(s.ref.signal.sat for s in signals))
