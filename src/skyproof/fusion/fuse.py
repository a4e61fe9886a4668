"""All evidence to one decision.

The words are never stronger than the evidence: *spoofed* needs evidence of an attack, *authentic* needs positive
evidence for every receiver, all the time that the receivers have in common, and no sign of an attack; everything else
is *undecided*, with what would decide it.
Nothing here knows a particular detector.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from skyproof.fusion.labels import LabelledSignal, Source, label_signals, sources_of
from skyproof.fusion.timeline import Onset, end_of, onset_of
from skyproof.records import ConsistentSet, Evidence, Observations, SignalRef

__all__ = ["Decision", "fuse"]

ENOUGH = 4  # signals for a fix
MOMENT_S = 5.0  # after a loss of all signals it takes so long until a window can speak for the new ones


@dataclass(frozen=True, eq=False, kw_only=True)
class Decision:
    """The partition of all signals and what follows from it.

    skies : under an attack that leaves open who is true, the consistent sets of signals of each receiver, linked over
        the windows; each is one position and time. Empty when the partition is decided.
    """

    verdict: Literal["authentic", "spoofed", "undecided"]
    labels: tuple[LabelledSignal, ...]
    sources: tuple[Source, ...]
    skies: tuple[Source, ...]
    onset: Onset | None
    until: np.datetime64 | None
    undecided_because: str | None


def fuse(
    evidence: Sequence[Evidence], observations: Sequence[Observations], sets: Sequence[ConsistentSet]
) -> Decision:
    """The decision that the evidence of all windows bears."""
    labels = label_signals(evidence, observations)
    sources = sources_of(evidence)
    attacked = any(e.says in ("spoofed", "attack") for e in evidence)
    false = [s for s in labels if s.label == "spoofed"]
    if attacked:
        trusted = {s.ref.receiver for s in labels if s.label == "authentic"}
        skies = _skies(sets) if not sources else ()
        onset, until = _time_line(false, skies, observations)
        everyone = trusted == {o.receiver for o in observations}
        return Decision(
            verdict="spoofed", labels=labels, sources=sources, skies=skies, onset=onset, until=until,
            undecided_because=None if everyone else _because(evidence, observations, trusted),
        )  # fmt: skip
    trusted = {o.receiver for o in observations if _always_authentic(o, labels, _common(observations))}
    if observations and trusted == {o.receiver for o in observations}:
        return Decision(
            verdict="authentic", labels=labels, sources=(), skies=(), onset=None, until=None, undecided_because=None
        )
    return Decision(
        verdict="undecided", labels=labels, sources=(), skies=(), onset=None, until=None,
        undecided_because=_because(evidence, observations, trusted),
    )  # fmt: skip


def _common(observations: Sequence[Observations]) -> tuple[np.datetime64, np.datetime64]:
    """First and last epoch of the time in which all receivers were recorded."""
    heard = [o.gpst for o in observations if o.gpst.size]
    return max(gpst[0] for gpst in heard), min(gpst[-1] for gpst in heard)


def _always_authentic(
    o: Observations, labels: Sequence[LabelledSignal], common: tuple[np.datetime64, np.datetime64]
) -> bool:
    """Whether a fix could be made of authentic signals, but for moments, whenever enough signals were received."""
    authentic = np.zeros(o.pseudorange_m.shape, np.bool_)
    for s in labels:
        if s.ref.receiver == o.receiver and s.label == "authentic":
            authentic[s.first_epoch : s.last_epoch + 1, o.signals.index(s.ref.signal)] = True
    received = np.isfinite(o.pseudorange_m)
    matters = (received.sum(axis=1) > ENOUGH) & (o.gpst >= common[0]) & (o.gpst <= common[1])
    kept_s = o.elapsed_s[~matters | ((received & authentic).sum(axis=1) >= ENOUGH)]
    edges_s = np.concatenate([o.elapsed_s[:1], kept_s, o.elapsed_s[-1:]])
    return bool(authentic.any() and np.diff(edges_s).max() <= MOMENT_S)


def _skies(sets: Sequence[ConsistentSet]) -> tuple[Source, ...]:
    """Sets of a receiver that stand beside another one in the same window, followed from window to window.

    A set goes on with the sky whose signals it has most of, and a signal belongs to the sky that it was seen in most:
    a set that takes a wrong signal for a window does not tie two skies together.
    """
    windows: dict[tuple[np.datetime64, str], list[ConsistentSet]] = {}
    for s in sets:
        windows.setdefault((s.gpst, s.receiver), []).append(s)
    skies: list[Counter[SignalRef]] = []
    for (_, receiver), rivals in sorted(windows.items()):
        members = [{SignalRef(receiver, signal) for signal in s.signals} for s in rivals if len(rivals) > 1]
        shared = [(sum(sky[r] for r in own), n, m) for n, own in enumerate(members) for m, sky in enumerate(skies)]
        goes_on: dict[int, int] = {}
        for seen, n, m in sorted(shared, reverse=True):
            if seen > 0 and n not in goes_on and m not in goes_on.values():
                goes_on[n] = m
        for n, own in enumerate(members):
            if n not in goes_on:
                skies.append(Counter())
            skies[goes_on.get(n, -1)].update(own)
    home = {ref: max(range(len(skies)), key=lambda m: skies[m][ref]) for sky in skies for ref in sky}
    return tuple(
        Source(name=f"S{number}", signals=tuple(sorted(ref for ref in skies[m] if home[ref] == m)))
        for number, m in enumerate(sorted(set(home.values())), 1)
    )


def _time_line(
    false: Sequence[LabelledSignal], skies: Sequence[Source], observations: Sequence[Observations]
) -> tuple[Onset | None, np.datetime64 | None]:
    if false:
        captured = [s for s in false if s.first_epoch > 0 and _had_another_life(s, observations)]
        onset = onset_of([s.ref for s in false if s not in captured], observations)
        for s in captured:
            o = next(o for o in observations if o.receiver == s.ref.receiver)
            moment = Onset(gpst=o.gpst[s.first_epoch], sigma_s=float(np.median(np.diff(o.elapsed_s))) * 10.0)
            onset = moment if onset is None or moment.gpst < onset.gpst else onset
        return onset, end_of(false, observations)
    if skies:
        # Who is false is open, but from when on a second sky was there is not: the last of them to appear.
        onsets = [onset_of(sky.signals, observations) for sky in skies]
        known = [onset for onset in onsets if onset is not None]
        return max(known, key=lambda onset: onset.gpst, default=None), None
    return None, None


def _had_another_life(s: LabelledSignal, observations: Sequence[Observations]) -> bool:
    """Whether the signal was measured before this stretch: a channel pulled away from what it followed."""
    o = next(o for o in observations if o.receiver == s.ref.receiver)
    column = o.signals.index(s.ref.signal)
    return bool(np.isfinite(o.pseudorange_m[: s.first_epoch, column]).any())


def _because(evidence: Sequence[Evidence], observations: Sequence[Observations], trusted: set[str]) -> str:
    """Which receivers' signals are open, why, and what would decide it: each reason once, the most frequent first.

    Evidence of an attack that needs nothing further explains the attack, not what is open about it.
    """
    if not observations:
        return "no receiver gave measurements with a time"
    reasons: dict[str, int] = {}
    for e in evidence:
        if e.says == "undecided" or (e.says == "attack" and e.would_need):
            text = e.because + (f" (would decide it: {e.would_need})" if e.would_need else "")
            reasons[text] = reasons.get(text, 0) + 1
    open_receivers = ", ".join(o.receiver for o in observations if o.receiver not in trusted)
    most = sorted(reasons, key=lambda text: -reasons[text])[:3]
    return f"which signals of {open_receivers} are true: " + ("; ".join(most) if most else "no detector could tell")
