"""The signals of a recording too short to follow any: searched for and measured stretch by stretch, on all antennas."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import special

from skyproof.app.common.progress import Stage
from skyproof.app.receive.policy import POLICY
from skyproof.app.receive.snapshot import search_samples
from skyproof.app.receive.tracker import carrier_at_hz
from skyproof.arrays import Booleans, Complexes, Floats, Indices
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver.acquisition import Peak
from skyproof.receiver.array_snapshot import MOST_LATE, SnapshotSignal, measure_snapshot
from skyproof.receiver.snapshot import CodePhase
from skyproof.receiver.snapshot_changes import Change, find_change
from skyproof.records import Samples, SignalId
from skyproof.remarks import Remark, RemarkKind

__all__ = [
    "PERIOD_S",
    "Found",
    "divide_signals",
    "drop_cross_correlations",
    "find_late_antennas",
    "find_lost_antennas",
    "find_signals",
    "list_blocks",
]

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
        """Return the C/N0 of the antennas' sum, in the parts where the signal is present."""
        best = max((block for block in self.blocks if block is not None), key=lambda block: block.energy)
        return best.code.cn0_dbhz + 20.0 * float(np.log10(self.share(self.blocks.index(best))))

    def share(self, number: int) -> float:
        """Return by how much the amplitude in the signal's own parts of a block exceeds that of the whole."""
        amplitude = np.linalg.norm(self.sums[number], axis=1)
        own_parts = self.there[number]
        return max(float(amplitude[own_parts].mean() / amplitude.mean()), 1.0) if own_parts.any() else 1.0

    def overlaps(self, other: "Found") -> bool:
        """Test whether another signal of the satellite is so near that each antenna's sum holds both."""
        if other is self or other.signal.sat != self.signal.sat or not (self.there & other.there).any():
            return False
        apart_s = _wrap_s(self.code_at(0.0).code_s - other.code_at(0.0).code_s)
        return abs(apart_s) * GPS_L1_CA.chip_rate_hz < POLICY.overlap_chips

    def code_at(self, elapsed_s: float) -> CodePhase:
        """Return its code phase at another instant."""
        return _at(self.first.code, elapsed_s)


def list_blocks(samples: Samples) -> list[tuple[int, int]]:
    """List first sample and number of samples of each stretch that is summed at once."""
    if samples.duration_s < POLICY.least_s:
        return []
    if samples.duration_s <= POLICY.one_block_s:
        return [(0, samples.n_samples)]
    count = round(_BLOCK_S * samples.rate_hz)
    number = min(_MOST_BLOCKS, samples.n_samples // count)
    return [(int(first), count) for first in np.linspace(0, samples.n_samples - count, number).astype(np.int64)]


def find_signals(
    samples: Samples, blocks: Sequence[tuple[int, int]], doppler_max_hz: float, stage: Stage
) -> list[Found]:
    """Find all signals of the blocks.

    Searches stand at the begin of each block and at the very end. They find every signal that lasts to the end, or from
    one block to the next.
    """
    known: list[tuple[str, list[SnapshotSignal]]] = []
    for number, (first, count) in enumerate(blocks):
        planes = samples.read_all(first, count)
        at = _make_measurer(planes, samples, first)
        for sat, seen in known:
            seen.append(at(sat, seen[-1].code if _is_sound(seen[-1]) else _best(seen).code))
        tail = max(count - round(POLICY.searched_s * samples.rate_hz), 0)
        looks = sorted({0, tail} if number == len(blocks) - 1 else {0})
        fresh: list[tuple[str, SnapshotSignal]] = []
        for peak in _search_peaks(planes, samples, looks, doppler_max_hz):
            measure = at(peak.sat, _code_from_peak(peak, first / samples.rate_hz))
            if _is_sound(measure) and not any(sat == peak.sat and _is_same(seen[-1], measure) for sat, seen in known):
                fresh.append((peak.sat, measure))
        known += [(sat, [measure]) for sat, measure in _keep_different(fresh)]
        stage.advance(number + 1.0)
    for number in reversed(range(len(blocks) - 1)):  # what came to light later, before
        if lacking := [(sat, seen) for sat, seen in known if len(seen) < len(blocks) - number]:
            at = _make_measurer(samples.read_all(*blocks[number]), samples, blocks[number][0])
            for sat, seen in lacking:
                seen.insert(0, at(sat, seen[0].code))
    return _assign_letters(known)


def _make_measurer(planes: Floats, samples: Samples, first: int) -> Callable[[str, CodePhase], SnapshotSignal]:
    """Return a function that measures a signal in a block by its code at another instant."""

    def measure(sat: str, code: CodePhase) -> SnapshotSignal:
        begin_s = first / samples.rate_hz
        pace = 1.0 + code.doppler_hz / GPS_L1_CA.carrier_hz
        middle_s = 0.5 * (planes.shape[-1] - 1) / samples.rate_hz
        delay_s = middle_s - _at(code, begin_s + middle_s).code_s / pace
        signal = measure_snapshot(planes, samples.rate_hz, carrier_at_hz(samples), sat, delay_s, code.doppler_hz)
        return replace(signal, code=replace(signal.code, elapsed_s=begin_s + signal.code.elapsed_s))

    return measure


def _code_from_peak(peak: Peak, begin_s: float) -> CodePhase:
    """Return the code phase of a peak of a search that began so long after the first sample."""
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


def _search_peaks(planes: Floats, samples: Samples, looks: Sequence[int], doppler_max_hz: float) -> list[Peak]:
    """Search single antennas from each of `looks` on, and keep each signal where it is strongest.

    Antennas are searched, from one end of the array to the other and then between, until `_NOTHING_NEW` in a row find
    nothing that others have not found: each further search costs as much as the first.
    """
    kept: list[Peak] = []
    for look in looks:
        idle = 0
        for antenna in _order_spread(len(planes)):
            if not planes[antenna].any():
                continue
            found = search_samples(planes[antenna, :, look:], samples.rate_hz, carrier_at_hz(samples), doppler_max_hz)
            found = [_shift_earlier(peak, look / samples.rate_hz) for peak in found]
            fresh = [peak for peak in found if not any(_is_one(known, peak) for known in kept)]
            same = [(known, peak) for known in kept for peak in found if _is_one(known, peak)]
            better = {id(known): peak for known, peak in same if peak.cn0_dbhz > known.cn0_dbhz}
            kept = [better.get(id(known), known) for known in kept] + fresh
            idle = 0 if fresh or not kept else idle + 1
            if idle == _NOTHING_NEW:
                break
    return sorted(kept, key=lambda peak: -peak.cn0_dbhz)


def _shift_earlier(peak: Peak, by_s: float) -> Peak:
    """Shift a peak to a search that began so much earlier."""
    return replace(peak, delay_s=(peak.delay_s + by_s) % (PERIOD_S / (1.0 + peak.doppler_hz / GPS_L1_CA.carrier_hz)))


def _order_spread(count: int) -> list[int]:
    """Order all numbers below `count`, each far from those before it: by their bits reversed."""
    bits = max(count - 1, 1).bit_length()
    return sorted(range(count), key=lambda number: int(f"{number:0{bits}b}"[::-1], 2))


def _is_one(one: Peak, other: Peak) -> bool:
    near = abs(_wrap_s(one.delay_s - other.delay_s)) * GPS_L1_CA.chip_rate_hz < POLICY.same_signal_chips
    return one.sat == other.sat and near and abs(one.doppler_hz - other.doppler_hz) < POLICY.same_signal_hz


def _is_same(one: SnapshotSignal, other: SnapshotSignal) -> bool:
    """Test whether two signals of one block are the same."""
    near = abs(_wrap_s(one.code.code_s - other.code.code_s)) * GPS_L1_CA.chip_rate_hz < POLICY.same_signal_chips
    return near and abs(one.code.doppler_hz - other.code.doppler_hz) < POLICY.same_signal_hz


def _wrap_s(apart_s: float) -> float:
    return (apart_s + 0.5 * PERIOD_S) % PERIOD_S - 0.5 * PERIOD_S


def _keep_different(seen: Sequence[tuple[str, SnapshotSignal]]) -> list[tuple[str, SnapshotSignal]]:
    """Keep the stronger of two signals that turn out to be one."""
    kept: list[tuple[str, SnapshotSignal]] = []
    for sat, signal in sorted(seen, key=lambda pair: -pair[1].energy):
        if not any(sat == other and _is_same(signal, known) for other, known in kept):
            kept.append((sat, signal))
    return kept


def _assign_letters(known: Sequence[tuple[str, Sequence[SnapshotSignal]]]) -> list[Found]:
    """Name the signals of each satellite by letters, the strongest first."""
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


def drop_cross_correlations(found: Sequence[Found], remarks: list[str]) -> list[Found]:
    """Drop signals so weak that they may be cross-correlations of the strongest."""
    strongest_dbhz = max((signal.cn0_dbhz for signal in found), default=0.0)
    kept = []
    for signal in found:
        below_db = strongest_dbhz - signal.cn0_dbhz
        if below_db > POLICY.cross_db:
            weak = (
                f"{signal.signal}: {below_db:.1f} dB below the strongest, as its cross-correlation would be; left out"
            )
            remarks.append(Remark(weak, RemarkKind.BEARS))
        else:
            kept.append(signal)
    return kept


def find_lost_antennas(found: Sequence[Found]) -> tuple[list[Found], list[int]]:
    """Find antennas with fewer than half of the common signals, and drop signals only they have."""
    if not found or found[0].first.cn0_dbhz.size < POLICY.vote_antennas:
        return list(found), []
    present = np.array([signal.first.there for signal in found])
    common = present.mean(axis=1) > 0.5
    if not common.any():
        return list(found), []
    lost = present[common].mean(axis=0) < 0.5
    kept = [signal for signal, presence in zip(found, present, strict=True) if presence[~lost].any()]
    return kept, np.flatnonzero(lost).tolist()


def find_late_antennas(found: Sequence[Found]) -> dict[int, int]:
    """Find the antennas whose samples begin some code periods later than the others'.

    By less than a bit or two, so that their codes agree and their data bits do not.
    """
    blocks = [block for signal in found for block in signal.blocks if block is not None]
    if not blocks or len(blocks[0].later) < 2:
        return {}
    better = np.sum([block.later for block in blocks], axis=0)
    ahead = better.argmax(axis=1)
    return {k: int(ahead[k]) - MOST_LATE for k in np.flatnonzero(better.max(axis=1) > POLICY.late_likelihood).tolist()}


# ---------------------------------------------------------------------- changes


def divide_signals(found: Sequence[Found], lost: Sequence[int]) -> list[Found]:
    """Divide signals that come from elsewhere from a part on in two, before and after.

    Where the change disappears without one antenna, that antenna fails, and nothing is divided.

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
    letters = {signal.signal.sat: 0 for signal in found}
    for signal in found:
        letters[signal.signal.sat] += 1
    for signal, change in zip(found, changes, strict=True):
        if change is None:
            kept.append(signal)
            continue
        after = (np.arange(signal.there.size) >= change.part).reshape(signal.there.shape)
        own_parts = after if change.kind == "begins" else ~after
        kept.append(_part(signal, own_parts, change))
        if change.kind == "turns":
            letter = chr(ord("a") + letters[signal.signal.sat])
            letters[signal.signal.sat] += 1
            kept.append(_part(replace(signal, signal=replace(signal.signal, copy=letter)), after, change))
    return sorted((signal for signal in kept if any(signal.blocks)), key=lambda s: s.signal)


def _changes(found: Sequence[Found], antennas: Indices) -> list[Change | None]:
    return [find_change(signal.sums[..., antennas].reshape(-1, antennas.size)) for signal in found]


def _part(one: Found, own: Booleans, change: Change) -> Found:
    blocks = tuple(block if present.any() else None for block, present in zip(one.blocks, own, strict=True))
    return replace(one, blocks=blocks, there=own, change=change)
