"""The signals of a recording too short to follow any: searched for and measured stretch by stretch, on all antennas."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import special

from skyproof.app.common.progress import Stage
from skyproof.app.receive.policy import POLICY
from skyproof.app.receive.snapshot import searched
from skyproof.app.receive.tracker import carrier_at_hz
from skyproof.arrays import Booleans, Complexes, Floats, Indices
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver.acquisition import Peak
from skyproof.receiver.array_snapshot import MOST_LATE, SnapshotSignal, snapshot_signal
from skyproof.receiver.snapshot import CodePhase
from skyproof.receiver.snapshot_changes import Change, change_within
from skyproof.records import Samples, SignalId
from skyproof.remarks import Remark, RemarkKind

__all__ = ["PERIOD_S", "Found", "credible", "divided", "late_antennas", "of_all", "signals_in", "stretches"]

PERIOD_S: Final = GPS_L1_CA.period_s
_BLOCK_S: Final = 0.1
"""Summed up at once, at most, of a recording that is not summed whole."""
_MOST_BLOCKS: Final = 4
_NOTHING_NEW: Final = 2


@dataclass(frozen=True, eq=False, kw_only=True)
class Found:
    """One signal, and what each block measured of it.

    blocks : its code as in `CodePhase`, from the first sample of the recording on; None where it is not there.
    sums : (n_blocks, n_parts, n_antennas) as of `SnapshotSignal`, of every block. there : (n_blocks, n_parts) the parts
    that are this signal's. change : what begins or ends it within the recording.
    """

    signal: SignalId
    blocks: tuple[SnapshotSignal | None, ...]
    sums: Complexes
    there: Booleans
    change: Change | None = None

    @property
    def first(self) -> SnapshotSignal:
        return next(block for block in self.blocks if block is not None)

    @property
    def energy(self) -> float:
        return max(block.energy for block in self.blocks if block is not None)

    @property
    def cn0_dbhz(self) -> float:
        """While it is there, of the antennas' sum."""
        best = max((block for block in self.blocks if block is not None), key=lambda block: block.energy)
        return best.code.cn0_dbhz + 20.0 * float(np.log10(self.share(self.blocks.index(best))))

    def share(self, number: int) -> float:
        """By how much its amplitude is greater in the parts of a block that are its own than it is in all of it."""
        amplitude = np.linalg.norm(self.sums[number], axis=1)
        own = self.there[number]
        return max(float(amplitude[own].mean() / amplitude.mean()), 1.0) if own.any() else 1.0

    def overlaps(self, other: "Found") -> bool:
        """Whether another signal of the satellite stands so near that each antenna's sum holds both."""
        if other is self or other.signal.sat != self.signal.sat or not (self.there & other.there).any():
            return False
        apart_s = _wrapped_s(self.code_at(0.0).code_s - other.code_at(0.0).code_s)
        return abs(apart_s) * GPS_L1_CA.chip_rate_hz < POLICY.overlap_chips

    def code_at(self, elapsed_s: float) -> CodePhase:
        """Its code at another instant."""
        return _at(self.first.code, elapsed_s)


def stretches(samples: Samples) -> list[tuple[int, int]]:
    """First sample and number of samples of each stretch that is summed up at once."""
    if samples.duration_s < POLICY.least_s:
        return []
    if samples.duration_s <= POLICY.one_block_s:
        return [(0, samples.n_samples)]
    count = round(_BLOCK_S * samples.rate_hz)
    number = min(_MOST_BLOCKS, samples.n_samples // count)
    return [(int(first), count) for first in np.linspace(0, samples.n_samples - count, number).astype(np.int64)]


def signals_in(samples: Samples, blocks: Sequence[tuple[int, int]], doppler_max_hz: float, stage: Stage) -> list[Found]:
    """All signals of the blocks. Looked for is where each begins, and at the very end: what is there for a part of a
    recording only is there at one of them, if it lasts to its end or from one to the next."""
    known: list[tuple[str, list[SnapshotSignal]]] = []
    for number, (first, count) in enumerate(blocks):
        planes = samples.read_all(first, count)
        at = _measurer(planes, samples, first)
        for sat, seen in known:
            seen.append(at(sat, seen[-1].code if _is_sound(seen[-1]) else _best(seen).code))
        tail = max(count - round(POLICY.searched_s * samples.rate_hz), 0)
        looks = sorted({0, tail} if number == len(blocks) - 1 else {0})
        fresh: list[tuple[str, SnapshotSignal]] = []
        for peak in _peaks(planes, samples, looks, doppler_max_hz):
            one = at(peak.sat, _code_of(peak, first / samples.rate_hz))
            if _is_sound(one) and not any(sat == peak.sat and _is_same(seen[-1], one) for sat, seen in known):
                fresh.append((peak.sat, one))
        known += [(sat, [one]) for sat, one in _different(fresh)]
        stage.advance(number + 1.0)
    for number in reversed(range(len(blocks) - 1)):  # what came to light later, before
        if lacking := [(sat, seen) for sat, seen in known if len(seen) < len(blocks) - number]:
            at = _measurer(samples.read_all(*blocks[number]), samples, blocks[number][0])
            for sat, seen in lacking:
                seen.insert(0, at(sat, seen[0].code))
    return _lettered(known)


def _measurer(planes: Floats, samples: Samples, first: int) -> Callable[[str, CodePhase], SnapshotSignal]:
    """What measures a signal in a block by its code at another instant."""

    def measured(sat: str, code: CodePhase) -> SnapshotSignal:
        begin_s = first / samples.rate_hz
        pace = 1.0 + code.doppler_hz / GPS_L1_CA.carrier_hz
        middle_s = 0.5 * (planes.shape[-1] - 1) / samples.rate_hz
        delay_s = middle_s - _at(code, begin_s + middle_s).code_s / pace
        one = snapshot_signal(planes, samples.rate_hz, carrier_at_hz(samples), sat, delay_s, code.doppler_hz)
        return replace(one, code=replace(one.code, elapsed_s=begin_s + one.code.elapsed_s))

    return measured


def _code_of(peak: Peak, begin_s: float) -> CodePhase:
    """A peak of a search that began so long after the first sample."""
    return CodePhase(
        sat=peak.sat,
        elapsed_s=begin_s + peak.delay_s,
        code_s=0.0,
        code_sigma_s=0.0,
        doppler_hz=peak.doppler_hz,
        doppler_sigma_hz=0.0,
        cn0_dbhz=peak.cn0_dbhz,
        found=True,
    )


def _at(code: CodePhase, elapsed_s: float) -> CodePhase:
    later_s = (elapsed_s - code.elapsed_s) * (1.0 + code.doppler_hz / GPS_L1_CA.carrier_hz)
    return replace(code, elapsed_s=elapsed_s, code_s=float(np.mod(code.code_s + later_s, PERIOD_S)))


def _is_sound(one: SnapshotSignal) -> bool:
    return one.code.found and one.energy > float(special.gammainccinv(one.sums.shape[1], POLICY.noise_probability))


def _best(seen: Sequence[SnapshotSignal]) -> SnapshotSignal:
    return max(seen, key=lambda one: one.energy if one.code.found else -1.0)


def _peaks(planes: Floats, samples: Samples, looks: Sequence[int], doppler_max_hz: float) -> list[Peak]:
    """What searches from each of `looks` on find on single antennas, each signal once: as where it is strongest.

    Antennas are searched, from one end of the array to the other and then between, until `_NOTHING_NEW` in a row find
    nothing that others have not found: each further search costs as much as the first.
    """
    kept: list[Peak] = []
    for look in looks:
        idle = 0
        for antenna in _spread(len(planes)):
            if not planes[antenna].any():
                continue
            found = searched(planes[antenna, :, look:], samples.rate_hz, carrier_at_hz(samples), doppler_max_hz)
            found = [_earlier(peak, look / samples.rate_hz) for peak in found]
            fresh = [peak for peak in found if not any(_is_one(one, peak) for one in kept)]
            same = [(one, peak) for one in kept for peak in found if _is_one(one, peak)]
            better = {id(one): peak for one, peak in same if peak.cn0_dbhz > one.cn0_dbhz}
            kept = [better.get(id(one), one) for one in kept] + fresh
            idle = 0 if fresh or not kept else idle + 1
            if idle == _NOTHING_NEW:
                break
    return sorted(kept, key=lambda peak: -peak.cn0_dbhz)


def _earlier(peak: Peak, by_s: float) -> Peak:
    """A peak as of a search that began so much earlier."""
    return replace(peak, delay_s=(peak.delay_s + by_s) % (PERIOD_S / (1.0 + peak.doppler_hz / GPS_L1_CA.carrier_hz)))


def _spread(count: int) -> list[int]:
    """All numbers below `count`, each far from those before it: in the order of their bits reversed."""
    bits = max(count - 1, 1).bit_length()
    return sorted(range(count), key=lambda number: int(f"{number:0{bits}b}"[::-1], 2))


def _is_one(one: Peak, other: Peak) -> bool:
    near = abs(_wrapped_s(one.delay_s - other.delay_s)) * GPS_L1_CA.chip_rate_hz < POLICY.same_signal_chips
    return one.sat == other.sat and near and abs(one.doppler_hz - other.doppler_hz) < POLICY.same_signal_hz


def _is_same(one: SnapshotSignal, other: SnapshotSignal) -> bool:
    """Of one block."""
    near = abs(_wrapped_s(one.code.code_s - other.code.code_s)) * GPS_L1_CA.chip_rate_hz < POLICY.same_signal_chips
    return near and abs(one.code.doppler_hz - other.code.doppler_hz) < POLICY.same_signal_hz


def _wrapped_s(apart_s: float) -> float:
    return (apart_s + 0.5 * PERIOD_S) % PERIOD_S - 0.5 * PERIOD_S


def _different(seen: Sequence[tuple[str, SnapshotSignal]]) -> list[tuple[str, SnapshotSignal]]:
    """Of two that turn out to be one, the stronger."""
    kept: list[tuple[str, SnapshotSignal]] = []
    for sat, one in sorted(seen, key=lambda pair: -pair[1].energy):
        if not any(sat == other and _is_same(one, known) for other, known in kept):
            kept.append((sat, one))
    return kept


def _lettered(known: Sequence[tuple[str, Sequence[SnapshotSignal]]]) -> list[Found]:
    """Signals of a satellite by letter, the strongest first."""
    found = []
    for sat in sorted({sat for sat, _ in known}):
        of_sat = sorted((seen for other, seen in known if other == sat), key=lambda seen: -_best(seen).energy)
        for letter, seen in enumerate(of_sat):
            sums = np.stack([block.sums for block in seen])
            found.append(
                Found(
                    signal=SignalId(sat, copy=chr(ord("a") + letter)),
                    blocks=tuple(block if _is_sound(block) else None for block in seen),
                    sums=sums,
                    there=np.ones(sums.shape[:2], np.bool_),
                )
            )
    return found


# ---------------------------------------------------------------------- what does not belong there


def credible(found: Sequence[Found], remarks: list[str]) -> list[Found]:
    """Those that are too strong for a cross-correlation of the strongest."""
    strongest_dbhz = max((one.cn0_dbhz for one in found), default=0.0)
    kept = []
    for one in found:
        below_db = strongest_dbhz - one.cn0_dbhz
        if below_db > POLICY.cross_db:
            weak = f"{one.signal}: {below_db:.1f} dB below the strongest, as its cross-correlation would be; left out"
            remarks.append(Remark(weak, RemarkKind.BEARS))
        else:
            kept.append(one)
    return kept


def of_all(found: Sequence[Found]) -> tuple[list[Found], list[int]]:
    """The signals, and which antennas have fewer than half of those that most antennas have; without signals that only
    such antennas have."""
    if not found or found[0].first.cn0_dbhz.size < POLICY.vote_antennas:
        return list(found), []
    there = np.array([one.first.there for one in found])
    common = there.mean(axis=1) > 0.5
    if not common.any():
        return list(found), []
    lost = there[common].mean(axis=0) < 0.5
    kept = [one for one, own in zip(found, there, strict=True) if own[~lost].any()]
    return kept, np.flatnonzero(lost).tolist()


def late_antennas(found: Sequence[Found]) -> dict[int, int]:
    """Antennas whose samples begin later than those of the others, by so many code periods: less than a bit or two, so
    that their codes agree and their data bits do not."""
    blocks = [block for one in found for block in one.blocks if block is not None]
    if not blocks or len(blocks[0].later) < 2:
        return {}
    better = np.sum([block.later for block in blocks], axis=0)
    ahead = better.argmax(axis=1)
    return {k: int(ahead[k]) - MOST_LATE for k in np.flatnonzero(better.max(axis=1) > POLICY.late_likelihood).tolist()}


# ---------------------------------------------------------------------- changes


def divided(found: Sequence[Found], lost: Sequence[int]) -> list[Found]:
    """The signals with the parts that are theirs: one that comes from elsewhere from a part on is two, before and
    after. Where but for one antenna nothing would come from elsewhere, that antenna fails, and nothing is divided.

    lost : antennas that are not to be used.
    """
    if not found:
        return []
    good = np.setdiff1d(np.arange(found[0].sums.shape[2]), lost)
    changes = _changes(found, good)
    turned = sum(change is not None and change.kind == "turns" for change in changes)
    if turned > 1 and good.size > 2:
        for antenna in good:
            without = _changes(found, np.setdiff1d(good, [antenna]))
            if not any(change is not None and change.kind == "turns" for change in without):
                changes = without
                break
    kept = []
    letters = {one.signal.sat: 0 for one in found}
    for one in found:
        letters[one.signal.sat] += 1
    for one, change in zip(found, changes, strict=True):
        if change is None:
            kept.append(one)
            continue
        after = (np.arange(one.there.size) >= change.part).reshape(one.there.shape)
        own = after if change.kind == "begins" else ~after
        kept.append(_part(one, own, change))
        if change.kind == "turns":
            letter = chr(ord("a") + letters[one.signal.sat])
            letters[one.signal.sat] += 1
            kept.append(_part(replace(one, signal=replace(one.signal, copy=letter)), after, change))
    return sorted((one for one in kept if any(one.blocks)), key=lambda one: one.signal)


def _changes(found: Sequence[Found], antennas: Indices) -> list[Change | None]:
    return [change_within(one.sums[..., antennas].reshape(-1, antennas.size)) for one in found]


def _part(one: Found, own: Booleans, change: Change) -> Found:
    blocks = tuple(block if there.any() else None for block, there in zip(one.blocks, own, strict=True))
    return replace(one, blocks=blocks, there=own, change=change)
