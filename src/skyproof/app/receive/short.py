"""What a receiver received in a recording too short to follow signals: all of it at once, on all its antennas.

No message can be read in so short a time, so that orbits and a rough time have to come from elsewhere. Without them
each code's phase is known, and no range; where an antenna stands beside the others is in the phases of the carriers all
the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import special

from skyproof.app.common.progress import Progress
from skyproof.app.common.settings import Settings
from skyproof.app.inspect import inspect_recording
from skyproof.app.receive.bridge import bridged
from skyproof.app.receive.diagnosis import diagnosis
from skyproof.app.receive.reception import Reception, nothing_found
from skyproof.app.receive.snapshot import CROSS_DB, RoughKnowledge, searched, solved
from skyproof.app.receive.tracker import carrier_at_hz, cleaned
from skyproof.arrays import Floats, Instants, Reals
from skyproof.errors import NotEnoughData
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.gnss.time import GPS_EPOCH
from skyproof.navigation.coarse_time import CoarseFix
from skyproof.navigation.whole_periods import whole_ranges_m
from skyproof.receiver.acquisition import Peak
from skyproof.receiver.array_snapshot import SnapshotSignal, snapshot_signal
from skyproof.receiver.observables import phases_with_lines
from skyproof.records import (
    AntennaArray,
    ArrayPhases,
    CellStatus,
    MeasurementSource,
    NavigationData,
    Observations,
    Samples,
    SignalId,
)

__all__ = ["is_short", "observe_short", "require_some"]

_LONGEST_S: Final = 1.0
"""A longer recording is followed, though no time of week is read in less than some ten seconds."""
_LEAST_S: Final = 0.004
_BLOCK_S: Final = 0.1
"""Summed up at once, at most; a recording up to `_WHOLE_S` is one block."""
_WHOLE_S: Final = 0.15
_MOST_BLOCKS: Final = 4
_NOISE: Final = 1e-12
"""Chance that noise has a signal's energy, at one delay, Doppler and message; thousands of those are tried."""
_NOTHING_NEW: Final = 2
_LEAST_TO_VOTE: Final = 3
_APART_CHIPS: Final = 0.5
_OVERLAP_CHIPS: Final = 1.2  # two codes, and what the front end adds to the flanks of their peaks
_APART_HZ: Final = 300.0
_PERIOD_S: Final = GPS_L1_CA.period_s


@dataclass(frozen=True, eq=False, kw_only=True)
class _Found:
    """One signal, and what each block measured of it; None where it did not measure it."""

    signal: SignalId
    blocks: tuple[SnapshotSignal | None, ...]

    @property
    def first(self) -> SnapshotSignal:
        return next(block for block in self.blocks if block is not None)


def is_short(source: MeasurementSource) -> bool:
    """Whether a source is a recording too short for a signal to be followed."""
    return isinstance(source, Samples) and source.duration_s < _LONGEST_S


def observe_short(
    samples: Samples,
    navigation: NavigationData | None,
    settings: Settings,
    progress: Progress,
    array: AntennaArray | None = None,
) -> Reception:
    """What one short recording holds.

    array : where its antennas are, if it has several and that is known.
    """
    clean, words = cleaned(samples)
    whole, filled = bridged(clean, begun_s=settings.start_s)
    remarks = [*words, *filled]
    blocks = _blocks(whole)
    found: list[_Found] = []
    lost: list[int] = []
    if blocks:
        with progress.stage(f"searching {samples.name}", float(len(blocks))) as stage:
            peaks: list[Peak] = []
            for number, (first, count) in enumerate(blocks):
                planes = whole.read_all(first, count)
                if number == 0:
                    peaks = _peaks(planes, whole, settings.doppler_max_hz)
                found = _with_block(found, peaks, planes, whole, first, number)
                stage.advance(number + 1.0)
        found, lost = _of_all(_credible(found, remarks))
        remarks += [
            f"antenna {number + 1} does not receive what the others do, and its phases are not used: check it, its "
            "line, and that all antennas were recorded together"
            for number in lost
        ]
    examined_s = sum(count for _, count in blocks) / whole.rate_hz
    reception = Reception(
        source=samples,
        observations=None,
        decoded=NavigationData(ephemerides=(), source=samples.path or samples.name),
        n_signals=len(found),
        examined_s=examined_s,
        remarks=tuple(remarks),
    )
    if not found:
        why = nothing_found(samples, examined_s)
        why += f"; {diagnosis(samples, settings.doppler_max_hz, lambda: inspect_recording(samples)).cure}"
        return replace(reception, left_out=why, remarks=(*remarks, f"left out: {why}"))
    measured, phases = _records(found, blocks, whole, array, lost)
    measured, words = _with_ranges(measured, found, whole, navigation, settings)
    if examined_s < 0.9 * whole.duration_s:
        words += (f"{len(blocks)} stretches of it were looked at, {examined_s:.3g} s of {whole.duration_s:.3g} s",)
    words += (f"too short to follow signals: {examined_s:.3g} s were summed up at once",)
    phases = None if phases is None else replace(phases, gpst=measured.gpst)
    return replace(reception, observations=measured, array_phases=phases, remarks=(*remarks, *words))


def require_some(receptions: Sequence[Reception]) -> None:
    """Raise NotEnoughData if none of several short recordings holds a signal."""
    if receptions and not any(r.n_signals for r in receptions):
        paths = ", ".join(r.source.path or r.source.name for r in receptions)
        raise NotEnoughData(f"{paths}: {receptions[0].left_out}")


# ---------------------------------------------------------------------- signals


def _blocks(samples: Samples) -> list[tuple[int, int]]:
    """First sample and number of samples of each stretch that is summed up at once."""
    if samples.duration_s < _LEAST_S:
        return []
    if samples.duration_s <= _WHOLE_S:
        return [(0, samples.n_samples)]
    count = round(_BLOCK_S * samples.rate_hz)
    number = min(_MOST_BLOCKS, samples.n_samples // count)
    return [(int(first), count) for first in np.linspace(0, samples.n_samples - count, number).astype(np.int64)]


def _peaks(planes: Floats, samples: Samples, doppler_max_hz: float) -> list[Peak]:
    """What searches of single antennas find, each signal once: as on the antenna that has it strongest.

    Antennas are searched, from one end of the array to the other and then between, until `_NOTHING_NEW` in a row find
    nothing that others have not found: each further search costs as much as the first.
    """
    kept: list[Peak] = []
    idle = 0
    for antenna in _spread(len(planes)):
        if not planes[antenna].any():
            continue
        found = searched(planes[antenna], samples.rate_hz, carrier_at_hz(samples), doppler_max_hz)
        fresh = [peak for peak in found if not any(_is_one(one, peak) for one in kept)]
        same = [(one, peak) for one in kept for peak in found if _is_one(one, peak)]
        better = {id(one): peak for one, peak in same if peak.cn0_dbhz > one.cn0_dbhz}
        kept = [better.get(id(one), one) for one in kept] + fresh
        idle = 0 if fresh or not kept else idle + 1
        if idle == _NOTHING_NEW:
            break
    return sorted(kept, key=lambda peak: -peak.cn0_dbhz)


def _spread(count: int) -> list[int]:
    """All numbers below `count`, each far from those before it: in the order of their bits reversed."""
    bits = max(count - 1, 1).bit_length()
    return sorted(range(count), key=lambda number: int(f"{number:0{bits}b}"[::-1], 2))


def _is_one(one: Peak, other: Peak) -> bool:
    if one.sat != other.sat:
        return False
    apart_s = (one.delay_s - other.delay_s + 0.5 * _PERIOD_S) % _PERIOD_S - 0.5 * _PERIOD_S
    near = abs(apart_s) * GPS_L1_CA.chip_rate_hz < _APART_CHIPS
    return near and abs(one.doppler_hz - other.doppler_hz) < _APART_HZ


def _with_block(
    found: list[_Found], peaks: Sequence[Peak], planes: Floats, samples: Samples, first: int, number: int
) -> list[_Found]:
    """The signals with what one more block measures of them; the first block says which there are."""
    rate_hz, if_hz = samples.rate_hz, carrier_at_hz(samples)

    def measured(sat: str, delay_s: float, doppler_hz: float) -> SnapshotSignal | None:
        one = snapshot_signal(planes, rate_hz, if_hz, sat, delay_s % _PERIOD_S, doppler_hz)
        least = float(special.gammainccinv(len(planes), _NOISE))
        return one if one.code.found and one.energy > least else None

    if number == 0:
        seen = [(peak.sat, measured(peak.sat, peak.delay_s, peak.doppler_hz)) for peak in peaks]
        return _lettered([(sat, one) for sat, one in seen if one is not None])
    after = []
    for one in found:
        code = one.first.code
        at_s = code.elapsed_s - first / rate_hz  # the middle that it was measured in, from this block's first sample
        delay_s = at_s - code.code_s / (1.0 + code.doppler_hz / GPS_L1_CA.carrier_hz)
        block = measured(one.signal.sat, delay_s, code.doppler_hz)
        after.append(replace(one, blocks=(*one.blocks, block)))
    return after


def _lettered(seen: Sequence[tuple[str, SnapshotSignal]]) -> list[_Found]:
    """Signals of a satellite by letter, the strongest first; of two that turn out to be one, one."""
    kept: dict[str, list[SnapshotSignal]] = {}
    for sat, one in sorted(seen, key=lambda pair: -pair[1].energy):
        if not any(_is_same(one, other) for other in kept.setdefault(sat, [])):
            kept[sat].append(one)
    return [
        _Found(signal=SignalId(sat, copy=chr(ord("a") + letter)), blocks=(one,))
        for sat in sorted(kept)
        for letter, one in enumerate(kept[sat])
    ]


def _is_same(one: SnapshotSignal, other: SnapshotSignal) -> bool:
    near = abs(_apart_s(one, other)) * GPS_L1_CA.chip_rate_hz < _APART_CHIPS
    return near and abs(one.code.doppler_hz - other.code.doppler_hz) < _APART_HZ


def _apart_s(one: SnapshotSignal, other: SnapshotSignal) -> float:
    return (one.code.code_s - other.code.code_s + 0.5 * _PERIOD_S) % _PERIOD_S - 0.5 * _PERIOD_S


def _credible(found: Sequence[_Found], remarks: list[str]) -> list[_Found]:
    """Those that are too strong for a cross-correlation of the strongest."""
    strongest_dbhz = max((one.first.code.cn0_dbhz for one in found), default=0.0)
    kept = []
    for one in found:
        below_db = strongest_dbhz - one.first.code.cn0_dbhz
        if below_db > CROSS_DB:
            remarks.append(
                f"{one.signal}: {below_db:.1f} dB below the strongest, as its cross-correlation would be; left out"
            )
        else:
            kept.append(one)
    return kept


def _of_all(found: Sequence[_Found]) -> tuple[list[_Found], list[int]]:
    """The signals, and which antennas have fewer than half of those that most antennas have; without signals that only
    such antennas have."""
    if not found or found[0].first.cn0_dbhz.size < _LEAST_TO_VOTE:
        return list(found), []
    there = np.array([one.first.there for one in found])
    common = there.mean(axis=1) > 0.5
    if not common.any():
        return list(found), []
    lost = there[common].mean(axis=0) < 0.5
    kept = [one for one, own in zip(found, there, strict=True) if own[~lost].any()]
    return kept, np.flatnonzero(lost).tolist()


# ---------------------------------------------------------------------- records


def _records(
    found: Sequence[_Found],
    blocks: Sequence[tuple[int, int]],
    samples: Samples,
    array: AntennaArray | None,
    lost: Sequence[int],
) -> tuple[Observations, ArrayPhases | None]:
    """Every part of every block as an epoch, without ranges: `pseudorange_m` holds nothing."""
    n_parts = found[0].first.middle_s.size
    shape = (n_parts * len(blocks), len(found))
    n_antennas = 1 + len(samples.others)
    own = {name: np.full(shape, np.nan) for name in ("doppler_hz", "cn0_dbhz", "doppler_sigma_hz")}
    phase_cyc, sigma_cyc = (np.full((*shape, n_antennas), np.nan) for _ in range(2))
    for column, one in enumerate(found):
        for number, block in enumerate(one.blocks):
            if block is None:
                continue
            rows = slice(number * n_parts, (number + 1) * n_parts)
            own["doppler_hz"][rows, column] = block.code.doppler_hz
            own["doppler_sigma_hz"][rows, column] = block.code.doppler_sigma_hz
            own["cn0_dbhz"][rows, column] = 10.0 * np.log10(np.mean(10.0 ** (0.1 * block.cn0_dbhz)))
            if not _is_overlapped(one, found):
                phase_cyc[rows, column], sigma_cyc[rows, column] = block.phase_cyc, block.sigma_cyc
    phase_cyc[..., lost] = sigma_cyc[..., lost] = np.nan
    # Parts end where code periods do, which each signal has elsewhere, by less than a period.
    at_s = found[0].first.middle_s
    elapsed_s = np.concatenate([first / samples.rate_hz + at_s for first, _ in blocks])
    gpst = _instants(GPS_EPOCH if samples.start_gpst is None else samples.start_gpst, elapsed_s)
    signals = tuple(one.signal for one in found)
    nothing = np.full(shape, np.nan)
    there = np.isfinite(own["doppler_hz"])
    observations = Observations(
        receiver=samples.name,
        signals=signals,
        gpst=gpst,
        elapsed_s=elapsed_s,
        pseudorange_m=nothing,
        carrier_cyc=nothing,
        pseudorange_sigma_m=nothing,
        carrier_sigma_cyc=nothing,
        **own,
        status=np.where(there, CellStatus.NO_RANGE, CellStatus.NOT_TRACKED).astype(np.uint8),
        found_elapsed_s=np.zeros(len(found)),
        missed_elapsed_s=np.full(len(found), np.nan),
        carrier_hz=np.array(GPS_L1_CA.carrier_hz),
        averaged_s=float(np.diff(at_s).mean()),
    )
    if array is None:
        return observations, None
    return observations, phases_with_lines(
        samples.name, signals, gpst, elapsed_s, phase_cyc, sigma_cyc, array=array, carrier_hz=GPS_L1_CA.carrier_hz
    )


def _is_overlapped(one: _Found, found: Sequence[_Found]) -> bool:
    """Whether another signal of the satellite stands so near that each antenna's sum holds both: its phases are then
    those of neither direction."""
    return any(
        other is not one
        and other.signal.sat == one.signal.sat
        and abs(_apart_s(one.first, other.first)) * GPS_L1_CA.chip_rate_hz < _OVERLAP_CHIPS
        for other in found
    )


def _instants(begin: np.datetime64, elapsed_s: Reals) -> Instants:
    return np.asarray(begin + np.rint(elapsed_s * 1e9).astype("timedelta64[ns]"))


def _with_ranges(
    o: Observations, found: Sequence[_Found], samples: Samples, navigation: NavigationData | None, settings: Settings
) -> tuple[Observations, tuple[str, ...]]:
    """The measurements with ranges and their time, where orbits, a rough time and a position that fits give them; and
    what is to be said of that."""
    if samples.start_gpst is None:
        return o, (
            f"no start_gpst is stated: instants count as if it had begun at {str(GPS_EPOCH)[:19]}, and there is no "
            "position",
        )
    if navigation is None:
        return o, ("no position: in so short a time no orbits are received; give a navigation file (--nav)",)
    at_gpst = _instants(samples.start_gpst, np.array([found[0].first.code.elapsed_s]))[0]
    because = ""
    for some in _one_a_satellite(found):
        words: list[str] = []
        coarse, used = solved([one.first.code for one in some], at_gpst, navigation, _known(settings), words)
        if coarse.status == 0:
            names = {code.sat for code in used}
            shows = [one in some and one.signal.sat in names for one in found]
            return _ranged(o, found, coarse, shows, navigation), tuple(words)
        because = because or coarse.because
    return o, (f"no position: {because}",)


def _one_a_satellite(found: Sequence[_Found]) -> list[list[_Found]]:
    """Signals that may show one position: the strongest of each satellite, or the weakest, or those that are alone.

    Where a transmitter imitates some satellites of a sky, and all its signals are stronger than the true ones or all
    are weaker, one of the three is true, or false, throughout.
    """
    of_sat: dict[str, list[_Found]] = {}
    for one in sorted(found, key=lambda f: -f.first.energy):
        of_sat.setdefault(one.signal.sat, []).append(one)
    sats = sorted(of_sat)
    if all(len(ones) == 1 for ones in of_sat.values()):
        return [[of_sat[sat][0] for sat in sats]]
    alone = [of_sat[sat][0] for sat in sats if len(of_sat[sat]) == 1]
    return [[of_sat[sat][0] for sat in sats], [of_sat[sat][-1] for sat in sats], alone]


def _known(settings: Settings) -> RoughKnowledge:
    if settings.place_deg is None:
        return RoughKnowledge()
    lat_deg, lon_deg = settings.place_deg
    return RoughKnowledge(place_ecef_m=ecef_from_geodetic(np.radians(lat_deg), np.radians(lon_deg), 0.0))


def _ranged(
    o: Observations,
    found: Sequence[_Found],
    coarse: CoarseFix,
    shows: Sequence[bool],
    navigation: NavigationData,
) -> Observations:
    gpst = _instants(coarse.gpst, o.elapsed_s - found[0].first.code.elapsed_s)
    code_s, sigma_s = (np.full(o.status.shape, np.nan) for _ in range(2))
    n_parts = found[0].first.middle_s.size
    for column, one in enumerate(found):
        for number, block in enumerate(one.blocks):
            if block is None:
                continue
            rows = slice(number * n_parts, (number + 1) * n_parts)
            # From the middle of the signal's own periods to the epoch that all have in common.
            later_s = o.elapsed_s[rows] - o.elapsed_s[rows][0] + found[0].first.middle_s[0] - block.middle_s
            code_s[rows, column] = block.code_s + later_s * (1.0 + block.code.doppler_hz / GPS_L1_CA.carrier_hz)
            sigma_s[rows, column] = block.code_sigma_s
    range_m = whole_ranges_m(
        np.mod(code_s, _PERIOD_S),
        [one.signal.sat for one in found],
        gpst,
        coarse.position_ecef_m,
        navigation,
        shows=shows,
    )
    there = np.isfinite(range_m)
    return replace(
        o,
        gpst=gpst,
        pseudorange_m=range_m,
        pseudorange_sigma_m=np.where(there, SPEED_OF_LIGHT_M_S * sigma_s, np.nan),
        status=np.where(there, CellStatus.OK, o.status).astype(np.uint8),
    )
