"""Decide window by window: causes compete for what failed, and each receiver's word follows from the one before.

Forward in time and in bounded state, so that a file and a live stream give the same words. The transitions, of each
receiver, by what a window shows:

    word before      an attack   its going on fails   another test fails   true signals   nothing fails
    --------------   ---------   ------------------   ------------------   ------------   --------------
    authentic        spoofed     suspect, lasting     suspect              authentic      no attack seen
    no attack seen   spoofed     suspect, lasting     suspect              authentic      no attack seen
    suspect          spoofed     suspect, lasting     suspect              authentic      no attack seen
    suspect, lasting spoofed     suspect, lasting     suspect, lasting     authentic      suspect, lasting
    spoofed          spoofed     spoofed              spoofed              authentic      spoofed

What breaks may have become another sky's, which passes every test from then on: only positive evidence ends
that. A run's word is the worst of its receivers' words so far.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Final

import numpy as np

from skyproof.fusion.policy import POLICY
from skyproof.records import WORDS, Cause, Finding, Hypothesis, ObservationLog, SignalRef, VerdictWord

__all__ = [
    "DETECTOR",
    "Deciding",
    "WindowWord",
    "decide",
    "decide_all",
    "find_worst_word",
    "select_common_causes",
    "weigh",
]

DETECTOR: Final = "decision"


@dataclass(frozen=True, kw_only=True)
class WindowWord:
    """Hold the word of one receiver over windows in a row that have the same one.

    causes : benign causes that explain all that failed, alone or with another one, the likeliest first: in each of
        them, or in one of them where none does in each.
    """

    receiver: str
    start_gpst: np.datetime64
    end_gpst: np.datetime64
    word: VerdictWord
    causes: tuple[Cause, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Deciding:
    """Hold what is carried from window to window.

    words : of all receivers so far, in the order in which they began. latest : of each receiver, its word as an index
    of `words`. lasting : receivers whose word only positive evidence ends.
    """

    words: tuple[WindowWord, ...] = ()
    latest: Mapping[str, int] = field(default_factory=dict)
    lasting: frozenset[str] = frozenset()

    @property
    def word(self) -> VerdictWord | None:
        """Return the run's word so far: the worst of its receivers'; None before the first window."""
        return find_worst_word(word.word for word in self.words)


def find_worst_word(words: Iterable[VerdictWord]) -> VerdictWord | None:
    """Return the word that promises least; None without any."""
    return max(words, key=WORDS.index, default=None)


def decide(
    state: Deciding,
    findings: Sequence[Finding],
    receivers: Iterable[str],
    start_gpst: np.datetime64,
    end_gpst: np.datetime64,
) -> tuple[Deciding, list[Finding]]:
    """Return the state after a window, and what its findings show together.

    findings : of this window. receivers : that were received in it.
    """
    together = [found for receiver in receivers if (found := weigh(findings, receiver)) is not None]
    for receiver in receivers:
        about = [e for e in (*findings, *together) if any(ref.receiver == receiver for ref in e.signals)]
        word, lasting = _step(about, receiver, state)
        causes = _list_causes(about) if word == "suspect" else ()
        state = _append_word(
            state,
            WindowWord(receiver=receiver, start_gpst=start_gpst, end_gpst=end_gpst, word=word, causes=causes),
            lasting=lasting,
        )
    return state, together


def _step(about: Sequence[Finding], receiver: str, state: Deciding) -> tuple[VerdictWord, bool]:
    """Return a receiver's word after a window, and whether only positive evidence ends it: the table above."""
    before = state.words[state.latest[receiver]].word if receiver in state.latest else None
    lasting = receiver in state.lasting
    if any(e.says in ("spoofed", "attack") for e in about):
        return "spoofed", True
    true = {ref for e in about if e.says == "authentic" for ref in e.signals if ref.receiver == receiver}
    if failed := [e for e in about if e.failed and (e.overrules or not _is_outweighed(e, receiver, true))]:
        lasting = lasting or any(e.overrules for e in failed)
        return "spoofed" if before == "spoofed" else "suspect", lasting
    if len(true) >= POLICY.fix_signals:
        return "authentic", False
    return (before, True) if lasting and before is not None else ("no_attack_seen", False)


def select_common_causes(causes: Iterable[tuple[Cause, ...]]) -> tuple[Cause, ...]:
    """Return the causes that all name that name any; all of them where they have none in common.

    A cause that has to be another one from window to window is a poorer explanation than one that lasts.
    """
    each = [named for named in causes if named]
    every = dict.fromkeys(cause for named in each for cause in named)
    return tuple(cause for cause in every if all(cause in named for named in each)) or tuple(every)


def _is_outweighed(e: Finding, receiver: str, true: set[SignalRef]) -> bool:
    """Return whether nearly all signals that failed a test together are shown to be the sky's."""
    tested = {ref for ref in e.signals if ref.receiver == receiver}
    return len(tested & true) >= POLICY.nearly_all_share * len(tested)


def _append_word(state: Deciding, window: WindowWord, *, lasting: bool) -> Deciding:
    """Return the state with one more word of a receiver, joined to the one before where nothing changes."""
    place = state.latest.get(window.receiver)
    words, latest = state.words, state.latest
    if place is not None and words[place].word == window.word:
        causes = select_common_causes((words[place].causes, window.causes))
        longer = replace(words[place], end_gpst=window.end_gpst, causes=causes)
        words = (*words[:place], longer, *words[place + 1 :])
    else:
        latest = {**latest, window.receiver: len(words)}
        words = (*words, window)
    kept = state.lasting | {window.receiver} if lasting else state.lasting - {window.receiver}
    return Deciding(words=words, latest=latest, lasting=kept)


def decide_all(evidence: Sequence[Finding], observations: Sequence[ObservationLog]) -> Deciding:
    """Decide all windows of a run, in order."""
    windows: dict[tuple[np.datetime64, np.datetime64], list[Finding]] = {}
    for e in evidence:
        windows.setdefault((e.start_gpst, e.end_gpst), []).append(e)
    state = Deciding()
    for start, end in sorted(windows):
        received = [o.receiver for o in observations if np.diff(np.searchsorted(o.gpst, [start, end]))[0] > 0]
        state, _ = decide(state, windows[start, end], received, start, end)
    return state


# --- causes


def weigh(findings: Sequence[Finding], receiver: str) -> Finding | None:
    """Return that no benign cause, nor two together, explains all that failed of a receiver in a window; else None.

    A cause explains what failed if no test rejects it. Under one of them, or a pair, each test rejects it with its own
    probability at most, so that all do with their sum: an intersection–union test takes no more of the budget than the
    tests do by themselves (Berger, Technometrics 24(4), 1982). A test that does not list a cause does not exclude it.
    Late copies of one or two satellites are ordinary, and ask for no cause.
    """
    about = [e for e in findings if e.p and Cause.CLEAN in e.p and {ref.receiver for ref in e.signals} == {receiver}]
    failed = [e for e in about if e.failed]
    if not failed or any(e.says in ("spoofed", "attack") for e in about):
        return None
    alpha = sum(e.alpha or 0.0 for e in failed)
    causes = sorted({cause for e in failed for cause in e.p} - {Cause.CLEAN})
    p = {
        causes_of: min(1.0, alpha * min(_find_largest_p(e, causes_of) / (e.alpha or 1.0) for e in failed))
        for number in (1, 2)
        for causes_of in combinations(causes, number)
    }
    if max(p.values()) >= alpha:
        return None
    signals: set[SignalRef] = {ref for e in failed for ref in e.signals}
    clean = min(1.0, alpha * min(_find_largest_p(e, ()) / (e.alpha or 1.0) for e in failed))
    by_cause = {cause: max(value for key, value in p.items() if cause in key) for cause in causes}
    dated = [e.dated_gpst for e in failed if e.dated_gpst is not None]
    return Finding(
        detector=DETECTOR,
        start_gpst=failed[0].start_gpst,
        end_gpst=failed[0].end_gpst,
        signals=tuple(sorted(signals)),
        hypothesis=Hypothesis.ONE_CAUSE,
        code="no_cause_left",
        p={Cause.CLEAN: clean} | dict(sorted(by_cause.items(), key=lambda item: -item[1])),
        alpha=alpha,
        data={"tests": tuple(dict.fromkeys(e.detector for e in failed)), "threshold": alpha},
        dated_gpst=min(dated, default=None),
    )


def _find_largest_p(e: Finding, causes: tuple[Cause, ...]) -> float:
    """Return a test's largest p-value under any of some causes: at least that of a clean sky."""
    return max(e.p[Cause.CLEAN], *(e.p.get(cause, 1.0) for cause in causes)) if causes else e.p[Cause.CLEAN]


def _list_causes(about: Sequence[Finding]) -> tuple[Cause, ...]:
    """Return the causes that tests name of all that failed, the likeliest first; else those of pairs that all name."""
    failed = [e for e in about if e.failed]
    causes = list(dict.fromkeys(cause for e in failed for cause in e.may_also_be))
    likeliest = sorted(causes, key=lambda cause: -min(e.p.get(cause, 1.0) for e in failed))
    for number in (1, 2):
        explain = [
            group for group in combinations(likeliest, number) if all(set(group) & set(e.may_also_be) for e in failed)
        ]
        if explain:
            return tuple(dict.fromkeys(cause for group in explain for cause in group))
    return tuple(likeliest)
