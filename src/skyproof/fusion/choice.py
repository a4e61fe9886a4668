"""Which of two skies of a receiver is true, where nothing else decides it: the one that was to be expected.

Two skies within one receiver cannot both be true, so that one is false is evidence already; which one, a foresight
says (`navigation.foresight`), by `navigation.prediction.choose`. It rests on an assumption that no measurement shows:
that the signals were true until a certain time.

- Where the second sky was seen from its first moment on, farther from the first than a search can hide: until then.
  Every window before has to go on from those before it as the foresight expects.
- Where it may have been hidden in the first one for any time, or a window does not go on so: for the first
  `clean_start_s` seconds of the run only. What was received in between may have been led away by a false sky already,
  and no prediction learns of it.
- Where it was there from the first moment, or an alarm was: not at all; then nothing but a surveyed place chooses.

What is chosen is evidence, window by window: the chosen sky is authentic under those assumptions, the others are
spoofed. Above the limit of the probability of a wrong choice the window stays open.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Final

import numpy as np

from skyproof.fusion.labels import FalseSource
from skyproof.fusion.skies import sky_onset
from skyproof.fusion.timeline import Onset
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import iso
from skyproof.navigation.foresight import Foresight, SkyFix
from skyproof.navigation.known import KNOWN, Known
from skyproof.navigation.prediction import Choice, choose
from skyproof.records import ConsistentSet, Evidence, ObservationLog, SignalId, SignalRef

__all__ = ["DETECTOR", "ChoiceRules", "choices"]

DETECTOR: Final = "prediction"
_REFUSED: Final = 1e-3
"""Probability that the true sky is refused in a window because it does not fit."""
_GOES_ON: Final = 1e-6
"""And that a window which is taken for true, or a chosen sky that is alone again, does not go on."""
_MOSTLY: Final = 0.75
"""Share of its signals by which a set is the sky that was chosen before."""
_MS_M: Final = 1e-3 * SPEED_OF_LIGHT_M_S
_LEAST_SHOWN: Final = 1e-12

_Kind = tuple[str, str, str]


@dataclass(frozen=True, kw_only=True)
class ChoiceRules:
    """most_wrong : probability of a wrong choice above which nothing is chosen. clean_start_s : for so long from the
    start of the run the signals are taken as true, unless there is a sign against it."""

    most_wrong: float = 1e-3
    clean_start_s: float = 30.0


@dataclass(frozen=True, eq=False)
class _Window:
    """One receiver's sets that are no late copies of another one.

    attacked : there is evidence of an attack; doubted : or a second set, or a failed test.
    """

    start: np.datetime64
    end: np.datetime64
    sets: tuple[ConsistentSet, ...]
    attacked: bool
    doubted: bool


@dataclass(frozen=True, eq=False)
class _State:
    """What is carried from window to window.

    kind : of the signals whose clock is compared. bias_s : of the last fix that was taken for true. chosen, refused :
    the signals of the skies called true and false last.
    """

    foresight: Foresight
    kind: _Kind | None = None
    bias_s: float = 0.0
    chosen: frozenset[SignalId] = field(default_factory=frozenset)
    refused: frozenset[SignalId] = field(default_factory=frozenset)


def choices(
    skies: Sequence[FalseSource],
    evidence: Sequence[Evidence],
    observations: Sequence[ObservationLog],
    sets: Sequence[ConsistentSet],
    foresights: Mapping[str, Foresight],
    rules: ChoiceRules,
) -> list[Evidence]:
    """Evidence by prediction on the receivers of which `skies` are open and a foresight is there."""
    found: list[Evidence] = []
    for o in observations:
        own = [sky for sky in skies if any(ref.receiver == o.receiver for ref in sky.signals)]
        if len(own) > 1 and o.receiver in foresights:
            windows = _windows(o, evidence, sets)
            found += _of_receiver(o, own, windows, foresights[o.receiver], rules)
    return found


def _of_receiver(
    o: ObservationLog,
    skies: Sequence[FalseSource],
    windows: Sequence[_Window],
    foresight: Foresight,
    rules: ChoiceRules,
) -> list[Evidence]:
    doubted = min((w.start for w in windows if w.doubted), default=o.gpst[0])
    windows = [w for w in windows if w.sets]
    start_end = o.gpst[0] + np.timedelta64(round(rules.clean_start_s * 1e9), "ns")
    onset = _second_onset(skies, o)
    if onset is None or onset.from_start:
        latest = o.gpst[0]
    else:
        latest = start_end if onset.earliest is None else onset.earliest
    for until in (min(latest, doubted), min(start_end, latest, doubted)):
        before = [w for w in windows if w.end <= until]
        learned = _learned(_State(foresight), before, o)
        if learned is not None:
            return _walk(o, learned, before, windows[len(before) :], rules)
    return []  # it does not go on within the run's first windows: then nothing is known of it


def _second_onset(skies: Sequence[FalseSource], o: ObservationLog) -> Onset | None:
    """When the first of the skies came that joined another one."""
    onsets = [onset for sky in skies if (onset := sky_onset(sky, [o])) is not None]
    return sorted(onsets, key=lambda onset: onset.seen)[1] if len(onsets) > 1 else None


def _windows(o: ObservationLog, evidence: Sequence[Evidence], sets: Sequence[ConsistentSet]) -> list[_Window]:
    """The receiver's windows, in order; evidence is read once, for it may be too much to hold."""
    said: dict[tuple[np.datetime64, np.datetime64], tuple[set[SignalId], list[bool]]] = {}
    for e in evidence:
        own = {ref.signal for ref in e.subject if ref.receiver == o.receiver}
        if own:
            late, (attacked, doubted) = said.setdefault((e.start_gpst, e.end_gpst), (set(), [False, False]))
            late |= own if e.says == "multipath" else set()
            attacked |= e.says == "attack"
            said[e.start_gpst, e.end_gpst] = late, [attacked, doubted or e.says in ("attack", "spoofed") or e.failed]
    mine = sorted((s for s in sets if s.receiver == o.receiver), key=lambda s: s.gpst)
    middles = np.array([s.gpst for s in mine], "datetime64[ns]")
    found: list[_Window] = []
    for (start, end), (late, (attacked, doubted)) in sorted(said.items(), key=lambda item: item[0]):
        if found and start < found[-1].end:
            continue
        here = mine[slice(*(int(row) for row in np.searchsorted(middles, np.array([start, end]))))]
        kept = tuple(s for s in here if len(late.intersection(s.signals)) < 0.5 * len(s.signals))
        found.append(_Window(start, end, kept, attacked, doubted or len(kept) > 1))
    return found


def _learned(state: _State, windows: Sequence[_Window], o: ObservationLog) -> _State | None:
    """The state after windows that are taken for true; None where one does not go on from those before it."""
    for window in windows:
        (only,) = window.sets[:1]
        state = replace(state, kind=state.kind or _reference_kind(only))
        shown = _shown(only, state, o)
        expected = state.foresight.at(shown.whole.gpst)
        if expected is not None and _fit(expected, shown.whole) < _GOES_ON:
            return None
        state = replace(state, foresight=state.foresight.learned(shown), bias_s=only.clock_bias_s)
    return state


def _walk(
    o: ObservationLog, state: _State, before: Sequence[_Window], windows: Sequence[_Window], rules: ChoiceRules
) -> list[Evidence]:
    assumes = state.foresight.assumes
    if before:
        until = iso(before[-1].end, 0)[11:]
        assumes = (f"the signals of {o.receiver} were true until {until}, before a second sky was seen", *assumes)
    found = [_taken_for_true(o, window, end, assumes) for window, end in _spans(before)]
    for window in windows:
        said, state = _judged(o, window, state, assumes, rules, first=not state.chosen)
        found += said
    return found


def _spans(windows: Sequence[_Window]) -> list[tuple[_Window, np.datetime64]]:
    """Each window with the start of the next one, up to which it speaks: of a long run not every window is kept."""
    return [*((one, two.start) for one, two in pairwise(windows)), *((w, w.end) for w in windows[-1:])]


def _taken_for_true(o: ObservationLog, window: _Window, end_gpst: np.datetime64, assumes: tuple[str, ...]) -> Evidence:
    return Evidence(
        detector=DETECTOR,
        start_gpst=window.start,
        end_gpst=end_gpst,
        subject=tuple(SignalRef(o.receiver, signal) for signal in window.sets[0].signals),
        says="authentic",
        because=f"the only sky of {o.receiver}, before a second one was seen",
        assumes=assumes,
    )


def _judged(
    o: ObservationLog, window: _Window, state: _State, assumes: tuple[str, ...], rules: ChoiceRules, *, first: bool
) -> tuple[list[Evidence], _State]:
    shown = [_shown(s, state, o) for s in window.sets]
    expected = state.foresight.at(shown[0].whole.gpst)
    near = [replace(one, whole=_wrapped(one.whole, expected)) for one in shown] if expected is not None else []
    if expected is None or not all(set(expected.there) & set(one.whole.there) for one in near):
        return [], state
    if len(near) == 1:
        return _alone(o, window, near[0], expected, state, assumes)
    if not window.attacked:
        return [], state
    choice = choose(
        expected, [one.whole for one in near], most_wrong=rules.most_wrong, false_alarm_probability=_REFUSED
    )
    if choice.chosen is None:
        return [_open(o, window, near, choice, state.foresight, rules)], state
    taken = window.sets[choice.chosen]
    state = replace(
        state,
        foresight=state.foresight.followed(near[choice.chosen]),
        bias_s=taken.clock_bias_s,
        chosen=frozenset(taken.signals),
        refused=frozenset(signal for s in window.sets if s is not taken for signal in s.signals),
    )
    return _chosen(o, window, near, choice, state.foresight, assumes, first=first), state


def _alone(
    o: ObservationLog, window: _Window, shown: SkyFix, expected: Known, state: _State, assumes: tuple[str, ...]
) -> tuple[list[Evidence], _State]:
    """A sky without another one beside it, after the second was seen: it is taken if it is the one chosen before."""
    (only,) = window.sets
    same = len(state.chosen.intersection(only.signals)) >= _MOSTLY * len(only.signals)
    if not same or state.refused.intersection(only.signals) or _fit(expected, shown.whole) < _GOES_ON:
        return [], state
    said = replace(
        _taken_for_true(o, window, window.end, assumes),
        because=f"the signals of {o.receiver} that were chosen before go on as expected by {state.foresight.by}",
    )
    return [said], replace(
        state,
        foresight=state.foresight.followed(shown),
        bias_s=only.clock_bias_s,
        chosen=state.chosen.union(only.signals),
    )


# ---------------------------------------------------------------------- fixes


def _reference_kind(s: ConsistentSet) -> _Kind:
    """The kind of signal that the set's clock is of."""
    return next((kind for kind, off_s in s.offsets_s.items() if off_s == 0.0), s.signals[0].kind)


def _shown(s: ConsistentSet, state: _State, o: ObservationLog) -> SkyFix:
    """What a set shows, at the instant that the receiver's label is less the clock bias that was last taken for true:
    a false sky's own time is of no account."""
    gpst = s.gpst - np.timedelta64(round(state.bias_s * 1e9), "ns")
    clock_m = SPEED_OF_LIGHT_M_S * s.clock_of_s(state.kind or _reference_kind(s))
    mean, covariance = np.zeros(KNOWN), np.diag(np.full(KNOWN, np.inf))
    rows = np.array([0, 1, 2, 6])[: 4 if np.isfinite(clock_m) else 3]
    mean[rows] = np.append(s.position_ecef_m, clock_m)[: rows.size]
    covariance[np.ix_(rows, rows)] = s.covariance_m2[: rows.size, : rows.size]
    return SkyFix(whole=Known(gpst=gpst, mean=mean, covariance=covariance))


def _wrapped(fix: Known, expected: Known) -> Known:
    """A fix with its clock within half a millisecond of the expected one: receivers set theirs by whole ones."""
    mean = fix.mean.copy()
    mean[6] -= _MS_M * np.rint((mean[6] - expected.mean[6]) / _MS_M) if 6 in expected.there else 0.0
    return replace(fix, mean=mean)


def _fit(expected: Known, fix: Known) -> float:
    """p-value of a fix's distance from what was expected; 1 where nothing of it was."""
    if not set(expected.there) & set(fix.there):
        return 1.0
    return float(choose(expected, [_wrapped(fix, expected)]).fits[0])


# ---------------------------------------------------------------------- words


def _chosen(
    o: ObservationLog,
    window: _Window,
    shown: Sequence[SkyFix],
    choice: Choice,
    foresight: Foresight,
    assumes: tuple[str, ...],
    *,
    first: bool,
) -> list[Evidence]:
    assert choice.chosen is not None
    wrong = max(choice.wrong_probability, _LEAST_SHOWN)
    fits = {number: float(fit) for number, fit in enumerate(choice.fits)}
    true_fit = fits.pop(choice.chosen)
    words = f"of {len(shown)} skies of {o.receiver}, {_apart(shown, choice)}, "
    stated = f"the probability that this is the wrong choice is {wrong:.0e} or less"
    common = Evidence(
        detector=DETECTOR,
        start_gpst=window.start,
        end_gpst=window.end,
        subject=_refs(o, window.sets[choice.chosen]),
        says="authentic",
        because=f"{words}this one fits {foresight.by}; {stated}",
        false_alarm_probability=_REFUSED,
        p_value=max(fits.values()),
        log_likelihood_ratio=float(np.log1p(-wrong) - np.log(wrong)),
        assumes=assumes,
    )
    seen = iso(window.start, 0)[11:]
    noted = replace(
        common,
        because=f"which of {len(shown)} skies of {o.receiver} is true was chosen from {seen} on by {foresight.by}; "
        f"{stated}",
        noted=True,
    )
    others = [
        replace(
            common,
            subject=_refs(o, window.sets[number]),
            says="spoofed",
            because=f"{words}this one does not fit {foresight.by} (p = {fit:.0e}), and another one does (p = "
            f"{true_fit:.2g}); {stated}",
            p_value=fit,
            assumes=(),
            whole_sky=True,
        )
        for number, fit in fits.items()
    ]
    return [noted if first else common, *others]


def _open(
    o: ObservationLog,
    window: _Window,
    shown: Sequence[SkyFix],
    choice: Choice,
    foresight: Foresight,
    rules: ChoiceRules,
) -> Evidence:
    fit = float(np.max(choice.fits))
    if fit < _REFUSED:
        why = f"none of them fits {foresight.by} (p = {fit:.0e})"
    elif choice.wrong_probability > rules.most_wrong:
        why = (
            f"by {foresight.by} the likelier one is wrong with a probability of {choice.wrong_probability:.2g}, more "
            f"than the limit of {rules.most_wrong:g}"
        )
    else:
        why = f"in what {foresight.by} shows they do not differ by more than their noise"
    return Evidence(
        detector=DETECTOR,
        start_gpst=window.start,
        end_gpst=window.end,
        subject=tuple(ref for s in window.sets for ref in _refs(o, s)),
        says="undecided",
        because=f"of {len(shown)} skies of {o.receiver}, {_apart(shown, choice)}, none is chosen: {why}",
        false_alarm_probability=_REFUSED,
        p_value=fit,
        would_need="skies that part farther, or a better prediction: an inertial unit, a better oscillator, a surveyed "
        "position",
    )


def _apart(shown: Sequence[SkyFix], choice: Choice) -> str:
    """How far the likeliest two are from each other."""
    one, other = (shown[k].whole for k in np.argsort(-choice.probabilities)[:2])
    off = one.mean - other.mean
    return f"{np.linalg.norm(off[:3]):.0f} m and {abs(off[6]) / SPEED_OF_LIGHT_M_S * 1e9:.0f} ns apart"


def _refs(o: ObservationLog, s: ConsistentSet) -> tuple[SignalRef, ...]:
    return tuple(SignalRef(o.receiver, signal) for signal in s.signals)
