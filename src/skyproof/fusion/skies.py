"""Which consistent sets of a receiver are one sky over the windows, and from when on a sky was there."""

from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from itertools import groupby

from skyproof.fusion.labels import FalseSource
from skyproof.fusion.timeline import Onset, date_onset
from skyproof.records import ConsistentSet, ObservationLog, SignalRef

__all__ = ["date_sky", "link_skies", "name_skies"]


def link_skies(sets: Iterable[ConsistentSet], *, first: int = 1) -> tuple[FalseSource, ...]:
    """Link the sets of a receiver that stand beside another one in the same window, from window to window.

    A set continues the sky whose signals it has most of, and a signal belongs to the sky that it was seen in most:
    a set that takes a wrong signal for a window does not tie two skies together.

    sets : in the order of their windows, a receiver's together. first : number of the first in the names.
    """
    skies: list[Counter[SignalRef]] = []
    together, split = set[SignalRef](), set[str]()
    for (receiver, _), window in groupby(sets, key=lambda s: (s.receiver, s.gpst)):
        members = [{SignalRef(receiver, signal) for signal in s.signals} for s in window]
        if len(members) == 1 and receiver not in split:
            together |= members[0]
        members = members if len(members) > 1 else []
        split |= {receiver} if members else set()
        shared = [
            (sum(sky[r] for r in signals), n, m) for n, signals in enumerate(members) for m, sky in enumerate(skies)
        ]
        goes_on: dict[int, int] = {}
        for seen, n, m in sorted(shared, reverse=True):
            if seen > 0 and n not in goes_on and m not in goes_on.values():
                goes_on[n] = m
        for n, signals in enumerate(members):
            if n not in goes_on:
                skies.append(Counter())
            skies[goes_on.get(n, -1)].update(signals)
    home = {ref: max(range(len(skies)), key=lambda m: skies[m][ref]) for sky in skies for ref in sky}
    kept = [tuple(sorted(ref for ref in skies[m] if home[ref] == m)) for m in sorted(set(home.values()))]
    return name_skies(kept, together, first=first)


def name_skies(
    skies: Sequence[tuple[SignalRef, ...]], together: Collection[SignalRef], *, first: int = 1
) -> tuple[FalseSource, ...]:
    """Return skies by the signals of each. together : signals that were of one sky before. first : number of the first
    in the names."""
    sent = Counter((ref.receiver, ref.signal.transmission) for signals in skies for ref in signals)
    return tuple(
        FalseSource(
            name=f"S{number}",
            signals=signals,
            parted=_is_majority(ref in together for ref in signals)
            and all(sent[ref.receiver, ref.signal.transmission] == 1 for ref in signals),
        )
        for number, signals in enumerate(skies, first)
    )


def date_sky(
    sky: FalseSource, observations: Sequence[ObservationLog], hidden: Collection[SignalRef] | None = None
) -> Onset | None:
    """Date a sky: when half of its signals were there, for a set may have taken in some that were there before.

    None of a sky that parted from another: its channels went over from one signal to another, unseen by the search.
    hidden : see `date_onset`.
    """
    if sky.parted:
        return None
    found = sorted(
        (float(o.found_elapsed_s[o.signals.index(ref.signal)]), ref)
        for o in observations
        for ref in sky.signals
        if ref.receiver == o.receiver
    )
    return date_onset([ref for _, ref in found[(len(found) - 1) // 2 :]], observations, hidden)


def _is_majority(truths: Iterable[bool]) -> bool:
    """Tell whether more than half are true."""
    known = list(truths)
    return 2 * sum(known) > len(known)
