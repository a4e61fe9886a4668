"""Interference over a run: what windows show of it, joined to spells of a receiver."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from skyproof.gnss.received_power import JammerToNoise, estimate_jammer_to_noise
from skyproof.records import Finding, InterferenceSign, NoiseRise, ObservationLog

__all__ = ["Spell", "join_spells"]


@dataclass(frozen=True, kw_only=True)
class Spell:
    """Interference of one receiver without a break.

    carriers : in the order in which it reached them. until_gpst : its last epoch; None while it lasts.
    fall_db, sigma_db : the largest fall of C/N0, and its one sigma.
    level_db, level_sigma_db : the largest rise of the front end's level, and its one sigma; None if that is not known.
    lost : signals, the most at once.
    may_be_shade : no window tells it from shade of the whole antenna.
    """

    receiver: str
    carriers: tuple[str, ...]
    since_gpst: np.datetime64
    until_gpst: np.datetime64 | None
    fall_db: float
    sigma_db: float
    level_db: float | None
    lost: int
    signs: tuple[InterferenceSign, ...]
    may_be_shade: bool
    level_sigma_db: float | None = None

    @property
    def jammer(self) -> JammerToNoise | None:
        """Estimate its power over the receiver's noise, by C/N0 and by the level of the front end.

        Where most signals are lost C/N0 gives a lower bound, and the level alone counts if it is known.
        """
        level = None if self.level_db is None or self.level_sigma_db is None else (self.level_db, self.level_sigma_db)
        least = "lost" in self.signs
        fall = None if least and level else (self.fall_db, self.sigma_db)
        rises = [rise for rise in (fall, level) if rise is not None]
        return estimate_jammer_to_noise(*zip(*rises, strict=True), at_least=least and level is None)


def join_spells(evidence: Sequence[Finding], observations: Sequence[ObservationLog]) -> tuple[Spell, ...] | None:
    """Join what windows show of interference; None if no test looked for it.

    Windows of one receiver belong to one spell where one begins before the other ended, or in the next window.
    """
    looked = [e for e in evidence if e.interference is not None]
    if not looked:
        return None
    ends = {o.receiver: o.gpst[-1] for o in observations}
    found: dict[str, list[tuple[Spell, np.datetime64]]] = {}
    for e in looked:
        for rise in e.interference or ():
            spells = found.setdefault(rise.receiver, [])
            if spells and e.start_gpst <= spells[-1][1]:
                spells[-1] = _join_spell(spells[-1][0], rise), max(spells[-1][1], e.end_gpst)
            else:
                spells.append((_begin_spell(rise), e.end_gpst))
    closed = [
        replace(spell, until_gpst=None) if spell.until_gpst == ends.get(receiver) else spell
        for receiver, spells in found.items()
        for spell, _ in spells
    ]
    return tuple(sorted(closed, key=lambda spell: (spell.since_gpst, spell.receiver)))


def _begin_spell(rise: NoiseRise) -> Spell:
    return Spell(
        receiver=rise.receiver,
        carriers=(rise.carrier,),
        since_gpst=rise.from_gpst,
        until_gpst=rise.to_gpst,
        fall_db=rise.fall_db,
        sigma_db=rise.sigma_db,
        level_db=rise.level_db,
        lost=rise.lost,
        signs=rise.signs,
        may_be_shade=rise.may_be_shade,
        level_sigma_db=rise.level_sigma_db,
    )


def _join_spell(spell: Spell, rise: NoiseRise) -> Spell:
    """Return a spell joined with the next one."""
    further = _begin_spell(rise)
    strongest = max(spell, further, key=lambda one: one.fall_db)
    levels = [(of.level_db, of.level_sigma_db) for of in (spell, rise) if of.level_db is not None]
    level_db, level_sigma_db = max(levels, key=lambda level: level[0], default=(None, None))
    assert spell.until_gpst is not None
    return replace(
        spell,
        carriers=tuple(dict.fromkeys((*spell.carriers, *further.carriers))),
        since_gpst=min(spell.since_gpst, rise.from_gpst),
        until_gpst=max(spell.until_gpst, rise.to_gpst),
        fall_db=strongest.fall_db,
        sigma_db=strongest.sigma_db,
        level_db=level_db,
        level_sigma_db=level_sigma_db,
        lost=max(spell.lost, rise.lost),
        signs=tuple(dict.fromkeys((*spell.signs, *rise.signs))),
        may_be_shade=spell.may_be_shade and rise.may_be_shade,
    )
