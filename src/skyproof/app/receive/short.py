"""What a receiver received in a recording too short to follow signals: all of it at once, on all its antennas.

No message can be read in so short a time, so that orbits and a rough time have to come from elsewhere. Without them
each code's phase is known, and no range; where an antenna stands beside the others is in the phases of the carriers all
the same.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from skyproof.app.common.progress import Progress
from skyproof.app.common.settings import Settings
from skyproof.app.inspect import inspect_recording
from skyproof.app.receive.bridge import bridge_gaps
from skyproof.app.receive.diagnosis import diagnose
from skyproof.app.receive.policy import POLICY
from skyproof.app.receive.reception import Reception, explain_nothing_found
from skyproof.app.receive.short_signals import (
    PERIOD_S,
    Found,
    divide_signals,
    drop_cross_correlations,
    find_late_antennas,
    find_lost_antennas,
    find_signals,
    list_blocks,
)
from skyproof.app.receive.snapshot import RoughKnowledge, solve_position
from skyproof.app.receive.tracker import clean_antennas
from skyproof.arrays import Instants, Reals
from skyproof.errors import NotEnoughData
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.gnss.time import GPS_EPOCH, timedelta_from_s
from skyproof.navigation.coarse_time import CoarseFix, CoarseSettings
from skyproof.navigation.whole_periods import complete_ranges_m
from skyproof.receiver.observables import build_array_phases
from skyproof.receiver.snapshot_changes import CHANCE
from skyproof.records import (
    AntennaArray,
    ArrayPhases,
    CellStatus,
    MeasurementSource,
    NavigationData,
    Observations,
    Samples,
    SnapshotChange,
    SnapshotChanges,
)
from skyproof.remarks import Remark, RemarkKind

__all__ = ["is_short", "observe_short", "require_some"]


def is_short(source: MeasurementSource) -> bool:
    """Test whether a source is a recording too short to track a signal."""
    return isinstance(source, Samples) and source.duration_s < POLICY.snapshot_s


def observe_short(
    samples: Samples,
    navigation: NavigationData | None,
    settings: Settings,
    progress: Progress,
    array: AntennaArray | None = None,
) -> Reception:
    """Measure what one short recording holds.

    array : where its antennas are, if it has several and that is known.
    """
    clean, words = clean_antennas(samples)
    whole, filled = bridge_gaps(clean, begun_s=settings.start_s)
    remarks: list[str] = [*words, *filled]
    blocks = list_blocks(whole)
    found: list[Found] = []
    lost: list[int] = []
    if blocks:
        with progress.stage(f"searching {samples.name}", float(len(blocks))) as stage:
            found = find_signals(whole, blocks, settings.doppler_max_hz, stage)
        found, lost = find_lost_antennas(drop_cross_correlations(found, remarks))
        remarks += [
            Remark(
                f"antenna {number + 1} does not receive what the others do, and its phases are not used: check it, its "
                "line, and that all antennas were recorded together",
                RemarkKind.BEARS,
            )
            for number in lost
        ]
        late = {k: periods for k, periods in find_late_antennas(found).items() if k not in lost}
        remarks += [_late_remark(k, periods, samples.rate_hz) for k, periods in late.items()]
        lost = sorted({*lost, *late})
        found = divide_signals(found, lost)
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
        why = explain_nothing_found(samples, examined_s)
        why += f"; {diagnose(samples, settings.doppler_max_hz, lambda: inspect_recording(samples)).cure}"
        return replace(reception, left_out=why)
    measured, phases = _build_records(found, blocks, whole, array, lost)
    measured, words = _add_ranges(measured, found, whole, navigation, settings)
    if examined_s < 0.9 * whole.duration_s:
        some = f"{len(blocks)} stretches of it were looked at, {examined_s:.3g} s of {whole.duration_s:.3g} s"
        words += (Remark(some, RemarkKind.BEARS),)
    words += (f"too short to follow signals: {examined_s:.3g} s were summed up at once",)
    phases = None if phases is None else replace(phases, gpst=measured.gpst)
    heard = [k for k, antenna in enumerate((samples, *samples.others)) if not antenna.dead and k not in lost]
    return replace(
        reception,
        observations=measured,
        measured_on=min(heard, default=0),
        array_phases=phases,
        changes=_changes(found, measured),
        codes=tuple(signal.first.code for signal in found),
        remarks=(*remarks, *words),
    )


def _changes(found: Sequence[Found], o: Observations) -> SnapshotChanges:
    """Return which signals do not stay what they are throughout."""
    changes = tuple(
        SnapshotChange(
            signal=signal.signal,
            kind=signal.change.kind,
            gpst=o.gpst[signal.change.part],
            after_s=float(o.elapsed_s[signal.change.part]),
            p_value=signal.change.p_value,
        )
        for signal in found
        if signal.change is not None
    )
    return SnapshotChanges(signals=tuple(signal.signal for signal in found), changes=changes, chance=CHANCE)


def _late_remark(antenna: int, periods: int, rate_hz: float) -> str:
    count = round(abs(periods) * PERIOD_S * rate_hz)
    whose = "the other antennas" if periods > 0 else f"antenna {antenna + 1}"
    return Remark(
        f"antenna {antenna + 1} begins {abs(periods) * PERIOD_S * 1e3:g} ms {'after' if periods > 0 else 'before'} the "
        f"others, by its data bits, and its phases are not used: record all antennas together, or leave out the first "
        f"{count} samples of {whose}",
        RemarkKind.BEARS,
    )


def require_some(receptions: Sequence[Reception]) -> None:
    """Raise NotEnoughData if none of several short recordings holds a signal."""
    if receptions and not any(r.n_signals for r in receptions):
        paths = ", ".join(r.source.path or r.source.name for r in receptions)
        raise NotEnoughData(f"{paths}: {receptions[0].left_out}")


# ---------------------------------------------------------------------- records


def _build_records(
    found: Sequence[Found],
    blocks: Sequence[tuple[int, int]],
    samples: Samples,
    array: AntennaArray | None,
    lost: Sequence[int],
) -> tuple[Observations, ArrayPhases | None]:
    """Record every part of every block as an epoch, without ranges: `pseudorange_m` is NaN."""
    n_parts = found[0].first.middle_s.size
    shape = (n_parts * len(blocks), len(found))
    n_antennas = 1 + len(samples.others)
    columns = {name: np.full(shape, np.nan) for name in ("doppler_hz", "cn0_dbhz", "doppler_sigma_hz")}
    phase_cyc, sigma_cyc = (np.full((*shape, n_antennas), np.nan) for _ in range(2))
    for column, signal in enumerate(found):
        for number, block in enumerate(signal.blocks):
            if block is None:
                continue
            rows = number * n_parts + np.flatnonzero(signal.there[number])
            columns["doppler_hz"][rows, column] = block.code.doppler_hz
            columns["doppler_sigma_hz"][rows, column] = block.code.doppler_sigma_hz
            share, present = signal.share(number), signal.there[number]
            mean_dbhz = 10.0 * np.log10(np.mean(10.0 ** (0.1 * block.cn0_dbhz)))
            columns["cn0_dbhz"][rows, column] = mean_dbhz + 20.0 * np.log10(share)
            if not any(signal.overlaps(other) for other in found):  # phases are then those of neither direction
                phase_cyc[rows, column], sigma_cyc[rows, column] = (
                    block.phase_cyc[present],
                    block.sigma_cyc[present] / share,
                )
    phase_cyc[..., lost] = sigma_cyc[..., lost] = np.nan
    # Parts end where code periods do, which each signal has elsewhere, by less than a period.
    at_s = found[0].first.middle_s
    elapsed_s = np.concatenate([first / samples.rate_hz + at_s for first, _ in blocks])
    gpst = _instants(GPS_EPOCH if samples.start_gpst is None else samples.start_gpst, elapsed_s)
    signals = tuple(signal.signal for signal in found)
    nothing = np.full(shape, np.nan)
    present = np.isfinite(columns["doppler_hz"])
    observations = Observations(
        receiver=samples.name,
        signals=signals,
        gpst=gpst,
        elapsed_s=elapsed_s,
        pseudorange_m=nothing,
        carrier_cyc=nothing,
        pseudorange_sigma_m=nothing,
        carrier_sigma_cyc=nothing,
        **columns,
        status=np.where(present, CellStatus.NO_RANGE, CellStatus.NOT_TRACKED).astype(np.uint8),
        found_elapsed_s=np.zeros(len(found)),
        missed_elapsed_s=np.full(len(found), np.nan),
        carrier_hz=np.array(GPS_L1_CA.carrier_hz),
        averaged_s=float(np.diff(at_s).mean()),
    )
    if array is None:
        return observations, None
    return observations, build_array_phases(
        samples.name, signals, gpst, elapsed_s, phase_cyc, sigma_cyc, array=array, carrier_hz=GPS_L1_CA.carrier_hz
    )


def _instants(begin: np.datetime64, elapsed_s: Reals) -> Instants:
    return np.asarray(begin + timedelta_from_s(elapsed_s))


def _add_ranges(
    o: Observations, found: Sequence[Found], samples: Samples, navigation: NavigationData | None, settings: Settings
) -> tuple[Observations, tuple[str, ...]]:
    """Add ranges and their time, where orbits, a rough time and a position give them, and remark on it."""
    if samples.start_gpst is None:
        return o, (
            f"no start_gpst is stated: instants count as if it had begun at {str(GPS_EPOCH)[:19]}, and there is no "
            "position",
        )
    if navigation is None:
        return o, ("no position: in so short a time no orbits are received; give a navigation file (--nav)",)
    at_s = found[0].first.code.elapsed_s
    at_gpst = _instants(samples.start_gpst, np.array([at_s]))[0]
    because = ""
    for some in _list_selections(found):
        words: list[str] = []
        phases, rules = (
            [signal.code_at(at_s) for signal in some],
            CoarseSettings(multipath_sigma_m=settings.multipath_sigma_m),
        )
        coarse, used = solve_position(phases, at_gpst, navigation, _rough_knowledge(settings), words, rules)
        if coarse.status == 0:
            names = {code.sat for code in used}
            shows = [signal in some and signal.signal.sat in names for signal in found]
            return _ranges_from_fix(o, found, coarse, shows, navigation), tuple(words)
        because = because or coarse.because
    return o, (f"no position: {because}",)


def _list_selections(found: Sequence[Found]) -> list[list[Found]]:
    """List selections of signals that may show one position.

    The strongest of each satellite, or the weakest, or the satellites with one signal.

    Where a transmitter imitates some satellites of a sky, and all its signals are stronger than the true ones or all
    are weaker, one of the three is true, or false, throughout.
    """
    of_sat: dict[str, list[Found]] = {}
    for signal in sorted(found, key=lambda f: -f.energy):
        of_sat.setdefault(signal.signal.sat, []).append(signal)
    sats = sorted(of_sat)
    if all(len(ones) == 1 for ones in of_sat.values()):
        return [[of_sat[sat][0] for sat in sats]]
    alone = [of_sat[sat][0] for sat in sats if len(of_sat[sat]) == 1]
    return [[of_sat[sat][0] for sat in sats], [of_sat[sat][-1] for sat in sats], alone]


def _rough_knowledge(settings: Settings) -> RoughKnowledge:
    if settings.place_deg is None:
        return RoughKnowledge()
    lat_deg, lon_deg = settings.place_deg
    return RoughKnowledge(place_ecef_m=ecef_from_geodetic(np.radians(lat_deg), np.radians(lon_deg), 0.0))


def _ranges_from_fix(
    o: Observations,
    found: Sequence[Found],
    coarse: CoarseFix,
    shows: Sequence[bool],
    navigation: NavigationData,
) -> Observations:
    gpst = _instants(coarse.gpst, o.elapsed_s - found[0].first.code.elapsed_s)
    code_s, sigma_s = (np.full(o.status.shape, np.nan) for _ in range(2))
    n_parts = found[0].first.middle_s.size
    for column, signal in enumerate(found):
        for number, block in enumerate(signal.blocks):
            if block is None:
                continue
            present = signal.there[number]
            rows = number * n_parts + np.flatnonzero(present)
            # From the middle of the signal's own periods to the epoch that all have in common.
            later_s = found[0].first.middle_s[present] - block.middle_s[present]
            code_s[rows, column] = block.code_s[present] + later_s * (
                1.0 + block.code.doppler_hz / GPS_L1_CA.carrier_hz
            )
            sigma_s[rows, column] = block.code_sigma_s[present]
    range_m = complete_ranges_m(
        np.mod(code_s, PERIOD_S),
        [signal.signal.sat for signal in found],
        gpst,
        coarse.position_ecef_m,
        navigation,
        shows=shows,
        period_s=PERIOD_S,
    )
    present = np.isfinite(range_m)
    return replace(
        o,
        gpst=gpst,
        pseudorange_m=range_m,
        pseudorange_sigma_m=np.where(present, SPEED_OF_LIGHT_M_S * sigma_s, np.nan),
        status=np.where(present, CellStatus.OK, o.status).astype(np.uint8),
    )
