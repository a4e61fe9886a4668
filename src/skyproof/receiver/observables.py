"""Convert measurements and arcs to `Observations`: integer code periods become transmit times and pseudoranges.

Whole milliseconds are counted as integers and only fractions are floating point, so no digit of a range is lost.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from skyproof.arrays import Booleans, Instants, Integers, Reals
from skyproof.gnss.constants import SECONDS_PER_WEEK, SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import Ephemeris, NavigationData
from skyproof.gnss.lnav import Subframe, ephemeris_from_subframes, ionosphere_and_utc
from skyproof.gnss.time import gpst
from skyproof.receiver import measurement as m
from skyproof.receiver.channels import Arc
from skyproof.receiver.grids import GridCorrelator, Grids
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.polarity import resolve_half_cycles
from skyproof.receiver.replica import CODE_SCALE
from skyproof.records import (
    AntennaArray,
    ArrayPhases,
    Ccaf,
    CellStatus,
    ObservationLog,
    Observations,
    SignalId,
    Taps,
)

TYPICAL_TRAVEL_MS = 77
WEEK_MS = SECONDS_PER_WEEK * 1000
_LEAST_ARC_S = 1.0
"""That shows from where a signal comes."""
_AS_MEASURED = {
    "doppler_hz": (m.DOPPLER_HZ, 1.0),
    "cn0_dbhz": (m.CN0_DBHZ, 1.0),
    "pseudorange_sigma_m": (m.CODE_SIGMA_S, SPEED_OF_LIGHT_M_S),
    "carrier_sigma_cyc": (m.CARRIER_SIGMA_CYC, 1.0),
    "doppler_sigma_hz": (m.DOPPLER_SIGMA_HZ, 1.0),
    "quadrature_m": (m.QUADRATURE_S, SPEED_OF_LIGHT_M_S),
}
"""Observable to column of the measurements and factor."""


@dataclass(frozen=True, kw_only=True)
class ReceiverTimeTag:
    """What the receiver's clock shows at its first sample: whole milliseconds of a week.

    Any choice makes consistent pseudoranges; this one keeps the clock bias below some 10 ms.
    """

    week: int
    tow_ms: int


def receiver_time_tag(first: Measurements, arcs: Mapping[int, Arc], week: int) -> ReceiverTimeTag | None:
    """Return the label that puts the middle travel time at 77 ms; None while no time of week is decoded.

    first : of each arc the first measurement. week : of the first sample, or of the one nearest in time to it.
    """
    starts_ms = []
    for row, number in enumerate(first.arc.tolist()):
        tow_ms = arcs[number].tow_ms_at_period_0
        if tow_ms is not None:
            sent_ms = tow_ms + int(first.table[row, m.PERIODS]) * arcs[number].signal.plan.period_ms
            starts_ms.append(sent_ms + TYPICAL_TRAVEL_MS - round(float(first.elapsed_s[row]) * 1000))
    if not starts_ms:
        return None
    # The week may turn over between satellites: count from the first one seen.
    turned = (np.array(starts_ms) - starts_ms[0] + WEEK_MS // 2) % WEEK_MS - WEEK_MS // 2
    tow_ms = int(np.median(turned)) + starts_ms[0]
    return ReceiverTimeTag(week=week + tow_ms // WEEK_MS, tow_ms=tow_ms % WEEK_MS)


@dataclass(frozen=True, eq=False, kw_only=True)
class ArcCarrier:
    """What the whole of an arc tells of its carrier, row by row (n,): the epoch, numbered from the first sample; half
    cycles to add; whether those are unknown; and whether it slipped."""

    epoch: Integers
    added: Integers
    open: Booleans
    slipped: Booleans


def resolve_carriers(
    epoch: Integers,
    arc: Integers,
    periods: Integers,
    turned: Booleans,
    slipped: Booleans,
    arcs: Mapping[int, Arc],
    *,
    averaged_s: float,
) -> dict[int, ArcCarrier]:
    """Resolve the carrier's half cycles of each arc whose time of week is known.

    Parameters
    ----------
    epoch, arc, periods, turned, slipped : (n,) of all measurements, in order of time; of the last three the columns of
        that name, `turned` and `slipped` as truth values.
    """
    reach_periods = round(500.0 * averaged_s)  # of a millisecond
    found: dict[int, ArcCarrier] = {}
    begun: set[SignalId] = set()
    by_arc = np.argsort(arc, kind="stable")
    numbers, starts = np.unique(arc[by_arc], return_index=True)
    stops = np.append(starts[1:], by_arc.size)[: starts.size]  # nothing at all, of an antenna that receives nothing
    for number, first, stop in zip(numbers.tolist(), starts, stops, strict=True):
        rows = by_arc[first:stop]
        if arcs[number].tow_ms_at_period_0 is None:
            continue
        halves = resolve_half_cycles(periods[rows], turned[rows], slipped[rows], arcs[number].stretches, reach_periods)
        slips = halves.slipped.copy()
        # Two arcs of one signal cannot overlap, but a new one is not the old one's continuation.
        slips[0] |= arcs[number].signal in begun
        begun.add(arcs[number].signal)
        found[number] = ArcCarrier(
            epoch=epoch[rows], added=halves.added.astype(np.int8), open=halves.open, slipped=slips
        )
    return found


def assemble(
    receiver: str,
    measurements: Measurements,
    arcs: Mapping[int, Arc],
    label: ReceiverTimeTag,
    elapsed_s: Reals,
    carriers: Mapping[int, ArcCarrier],
    *,
    carrier_hz: float,
    averaged_s: float,
) -> Observations:
    """Assemble measurements as one record, one column a signal; a signal lost and found again keeps its column.

    elapsed_s : (n_epochs,) times of the rows, multiples of `averaged_s`; those without a measurement are there too.
    carriers : of whole arcs; the measurements may be a stretch of them.
    """
    signals = tuple(sorted({arc.signal for arc in arcs.values()}))
    column = {signal: i for i, signal in enumerate(signals)}
    shape = (elapsed_s.size, len(signals))
    status = np.full(shape, CellStatus.NOT_TRACKED, np.uint8)
    half_cycle_open = np.zeros(shape, np.bool_)
    cells = {name: np.full(shape, np.nan) for name in ("pseudorange_m", "carrier_cyc", *_AS_MEASURED)}
    first_epoch = round(float(elapsed_s[0]) / averaged_s) if elapsed_s.size else 0
    for number in np.unique(measurements.arc).tolist():
        arc = arcs[number]
        chosen = measurements.arc == number
        table = measurements.table[chosen]
        measured_s = measurements.elapsed_s[chosen]
        epoch = np.rint(measured_s / averaged_s).astype(np.int64)
        cell = epoch - first_epoch, column[arc.signal]
        if arc.tow_ms_at_period_0 is None:
            status[cell] = CellStatus.NO_TIME
            continue
        carrier = carriers[number]
        carrier_row = np.searchsorted(carrier.epoch, epoch)
        status[cell] = np.where(carrier.slipped[carrier_row], CellStatus.SLIP, CellStatus.OK)
        half_cycle_open[cell] = carrier.open[carrier_row]
        cells["carrier_cyc"][cell] = table[:, m.CARRIER_CYC] + 0.5 * carrier.added[carrier_row]
        sent_ms = table[:, m.PERIODS].astype(np.int64) * arc.signal.plan.period_ms
        elapsed_ms = np.rint(measured_s * 1000).astype(np.int64)
        whole_ms = label.tow_ms + elapsed_ms - arc.tow_ms_at_period_0 - sent_ms
        whole_ms = (whole_ms + WEEK_MS // 2) % WEEK_MS - WEEK_MS // 2
        cells["pseudorange_m"][cell] = SPEED_OF_LIGHT_M_S * (whole_ms * 1e-3 - table[:, m.FRACTION_S])
        for name, (index, factor) in _AS_MEASURED.items():
            cells[name][cell] = factor * table[:, index]
    found = np.full(len(signals), np.inf)
    missed = np.full(len(signals), np.nan)
    for arc in arcs.values():
        i = column[arc.signal]
        if arc.found_s < found[i]:
            found[i], missed[i] = arc.found_s, arc.missed_s
    return Observations(
        receiver=receiver,
        signals=signals,
        gpst=gpst(label.week, label.tow_ms * 1e-3 + elapsed_s),
        elapsed_s=elapsed_s,
        status=status,
        found_elapsed_s=found,
        missed_elapsed_s=missed,
        carrier_hz=np.full(len(signals), carrier_hz),
        averaged_s=averaged_s,
        half_cycle_open=half_cycle_open,
        **cells,
    )


def assemble_taps(
    receiver: str,
    measurements: Measurements,
    arcs: Mapping[int, Arc],
    elapsed_s: Reals,
    *,
    delays_chips: Reals,
    dopplers_hz: Reals,
    samples_per_period: float,
    averaged_s: float,
    look_share: float = 1.0,
    as_replica: bool = False,
) -> Taps:
    """Assemble all correlators as one record: columns as in `assemble`, a row for each look at its middle.

    elapsed_s : (n_epochs,) as in `assemble`. look_share : of each look, in which all taps were taken.
    as_replica : correlators as the replica's carrier gives them, bits removed, of guided channels alone (NaN of
        others). They keep the lead of code and carrier over where one position puts them.
    """
    rows, columns, signals = _cells(measurements, arcs, elapsed_s, averaged_s)
    n_looks, grid = measurements.taps.shape[1], (dopplers_hz.size, delays_chips.size)
    value = np.full((elapsed_s.size, n_looks, len(signals), *grid), complex(np.nan, np.nan), np.complex64)
    taken = measurements.taps.reshape(-1, n_looks, *grid) / (CODE_SCALE * samples_per_period)
    if as_replica:
        taken = taken * np.exp(-1j * measurements.turns_rad)[:, :, None, None]
    value[rows, :, columns] = taken
    first_power = np.full((elapsed_s.size, n_looks, len(signals)), np.nan)
    several = measurements.first_power.shape[1] > 0
    if several:
        first_power[rows, :, columns] = measurements.first_power / (CODE_SCALE * samples_per_period) ** 2
    middle_s = averaged_s * ((np.arange(n_looks) + 0.5 * look_share) / n_looks - 0.5)
    return Taps(
        receiver=receiver,
        signals=signals,
        elapsed_s=(elapsed_s[:, np.newaxis] + middle_s).reshape(-1),
        delays_chips=delays_chips,
        dopplers_hz=dopplers_hz,
        value=value.reshape(-1, len(signals), *grid),
        first_power=first_power.reshape(-1, len(signals)) if several else None,
    )


def assemble_grids(
    receiver: str,
    grids: Grids,
    taken: GridCorrelator,
    arcs: Mapping[int, Arc],
    label: ReceiverTimeTag,
    observations: ObservationLog,
) -> Ccaf:
    """Assemble grids as one record: columns as in `assemble`, a row for each interval.

    observations : of the same receiver, whose clock is moved by whole milliseconds as the references' is then. An arc
        without a time of week has grids and no reference.
    """
    elapsed_s, rows = np.unique(grids.elapsed_s, return_inverse=True)
    column = {signal: i for i, signal in enumerate(observations.signals)}
    row_arcs = [arcs[number] for number in grids.arc.tolist()]
    columns = np.array([column[arc.signal] for arc in row_arcs], np.int64)
    clock_shift = gpst(label.week, label.tow_ms * 1e-3 + observations.elapsed_s) - observations.gpst
    middles_s = 0.5 * (observations.elapsed_s[1:] + observations.elapsed_s[:-1])
    moved = (
        clock_shift[np.searchsorted(middles_s, elapsed_s)]
        if clock_shift.size
        else np.zeros(elapsed_s.size, "timedelta64[ns]")
    )
    timed = np.array([arc.tow_ms_at_period_0 is not None for arc in row_arcs], np.bool_)
    tow_ms = np.array([arc.tow_ms_at_period_0 or 0 for arc in row_arcs], np.int64)
    elapsed_ms = np.rint(grids.elapsed_s * 1000).astype(np.int64)
    rest_s = grids.elapsed_s - elapsed_ms * 1e-3
    whole_ms = label.tow_ms + elapsed_ms - tow_ms - grids.periods * taken.signal.period_ms
    whole_ms = whole_ms - np.rint(moved / np.timedelta64(1, "ms"))[rows]
    whole_ms = (whole_ms + WEEK_MS // 2) % WEEK_MS - WEEK_MS // 2
    shape = (elapsed_s.size, len(observations.signals))
    cells = {name: np.full(shape, np.nan) for name in ("reference_m", "reference_hz", "noise_variance")}
    range_m = SPEED_OF_LIGHT_M_S * (whole_ms * 1e-3 + rest_s - grids.fraction_s)
    cells["reference_m"][rows, columns] = np.where(timed, range_m, np.nan)
    cells["reference_hz"][rows, columns] = grids.doppler_hz
    cells["noise_variance"][rows, columns] = grids.noise_variance
    value = np.full((*shape, *grids.value.shape[1:]), complex(np.nan, np.nan), np.complex64)
    value[rows, columns] = grids.value
    return Ccaf(
        receiver=receiver,
        signals=observations.signals,
        gpst=gpst(label.week, label.tow_ms * 1e-3 + elapsed_s) - moved,
        elapsed_s=elapsed_s,
        coherent_s=taken.periods * taken.signal.period_s,
        band_hz=taken.band_hz,
        delays_chips=taken.delays_chips,
        dopplers_hz=taken.dopplers_hz,
        value=value,
        noise_samples=taken.noise_samples,
        **cells,
    )


def assemble_array_phases(
    receiver: str,
    measurements: Measurements,
    arcs: Mapping[int, Arc],
    elapsed_s: Reals,
    gpst: Instants,
    *,
    array: AntennaArray,
    carrier_hz: float,
    averaged_s: float,
) -> ArrayPhases:
    """Assemble the carrier's phase on several antennas as one record, with rows and columns as in `assemble`.

    gpst : (n_epochs,) of the epochs. Known delays of the antennas' lines are subtracted. An arc has no phases if
    neither data bits nor time were ever found, or if it does not last. A channel can follow a jammer for moments as
    well, which comes from one direction, like signals of one transmitter.
    """
    rows, columns, signals = _cells(measurements, arcs, elapsed_s, averaged_s)
    sent = {number for number, arc in arcs.items() if arc.bit_synchronised or arc.tow_ms_at_period_0 is not None}
    numbers, row, count = np.unique(measurements.arc, return_inverse=True, return_counts=True)
    lasts = count >= min(_LEAST_ARC_S / averaged_s, 0.5 * elapsed_s.size)
    told = (np.array([number in sent for number in numbers.tolist()], np.bool_) & lasts)[row]
    shape = (elapsed_s.size, len(signals), measurements.own.shape[1])
    phase_cyc, sigma_cyc = np.full(shape, np.nan), np.full(shape, np.nan)
    phase_cyc[rows[told], columns[told]] = measurements.own[told][..., m.OWN_PHASE_CYC]
    sigma_cyc[rows[told], columns[told]] = measurements.own[told][..., m.OWN_PHASE_SIGMA_CYC]
    return build_array_phases(
        receiver, signals, gpst, elapsed_s, phase_cyc, sigma_cyc, array=array, carrier_hz=carrier_hz
    )


def build_array_phases(
    receiver: str,
    signals: tuple[SignalId, ...],
    gpst: Instants,
    elapsed_s: Reals,
    phase_cyc: Reals,
    sigma_cyc: Reals,
    *,
    array: AntennaArray,
    carrier_hz: float,
) -> ArrayPhases:
    """Build the record of phases (n_epochs, n_signals, n_antennas), with the known antennas and lines.

    Side lobes of another satellite's code turn a phase by their share, for as long as their Dopplers differ by whole
    kilohertz.
    """
    return ArrayPhases(
        receiver=receiver,
        signals=signals,
        gpst=gpst,
        elapsed_s=elapsed_s,
        elements_m=array.elements_m,
        phase_cyc=phase_cyc if array.line_bias_cyc is None else phase_cyc + array.line_bias_cyc,
        sigma_cyc=sigma_cyc,
        carrier_hz=np.full(len(signals), carrier_hz),
        calibrated=array.line_bias_cyc is not None,
        elements_sigma_m=array.sigma_m,
        pattern_sigma_m=array.pattern_sigma_m,
        lasting_sigma_cyc=max((s.plan.highest_side_lobe for s in signals), default=0.0) / (2.0 * np.pi),
    )


def _cells(
    measurements: Measurements, arcs: Mapping[int, Arc], elapsed_s: Reals, averaged_s: float
) -> tuple[Integers, Integers, tuple[SignalId, ...]]:
    """Return row and column of each measurement, and the signals of the columns, as in `assemble`."""
    signals = tuple(sorted({arc.signal for arc in arcs.values()}))
    column = {signal: i for i, signal in enumerate(signals)}
    first = round(float(elapsed_s[0]) / averaged_s) if elapsed_s.size else 0
    rows = np.rint(measurements.elapsed_s / averaged_s).astype(np.int64) - first
    return rows, np.array([column[arcs[number].signal] for number in measurements.arc.tolist()], np.int64), signals


def list_differing_messages(arcs: Mapping[int, Arc]) -> list[str]:
    """List in words where signals of one satellite carry different orbits or clocks for one issue of data.

    A satellite sends one message. A repeater repeats it; a forger who generates a message may err.
    """
    seen: dict[tuple[str, int, float], dict[str, Subframe]] = {}
    for arc in arcs.values():
        for number, subframe in arc.subframes.items():
            issue = subframe.fields.get("iode", subframe.fields.get("iodc"))
            if number < 4 and issue is not None:
                seen.setdefault((arc.signal.sat, number, issue), {})[arc.signal.copy] = subframe
    words = []
    for (sat, number, _), copies in sorted(seen.items()):
        first, *other_copies = sorted(copies)
        for other in other_copies:
            a, b = copies[first].fields, copies[other].fields
            keys = sorted(key for key in a.keys() & b.keys() if a[key] != b[key])
            if keys:
                words.append(
                    f"{sat}: signals {first} and {other} send different messages (subframe {number}: {', '.join(keys)})"
                )
    return words


def time_by_range(
    arcs: Mapping[int, Arc],
    first: Measurements,
    label: ReceiverTimeTag,
    range_m: Callable[[str, float], float | None],
) -> dict[int, Arc]:
    """Add a time of week to arcs without one, by the range that their satellite should have.

    Bits begin at whole multiples of their length. So a channel that knows where its bits begin is ambiguous by these
    only (LNAV: 20 ms, 6000 km), and the predicted pseudorange resolves that. A false signal off by more than half of it
    would be wrong by a bit; it then fits no position.

    Parameters
    ----------
    first : of each arc the first measurement.
    range_m : predicted pseudorange of a satellite (name) at an epoch (elapsed_s), on the receiver's clock; None if that
        is not known.
    """
    timed = dict(arcs)
    for number, elapsed_s, row in zip(first.arc.tolist(), first.elapsed_s.tolist(), first.table, strict=True):
        arc = arcs[number]
        if arc.tow_ms_at_period_0 is not None or not arc.bit_synchronised:
            continue
        expected_m = range_m(arc.signal.sat, elapsed_s)
        if expected_m is None:
            continue
        sent_ms = label.tow_ms + elapsed_s * 1e3 - expected_m / SPEED_OF_LIGHT_M_S * 1e3
        plan = arc.signal.plan
        bit_ms, bits_ms = plan.periods_per_symbol * plan.period_ms, arc.bits_period * plan.period_ms
        at_period_0_ms = sent_ms - row[m.PERIODS] * plan.period_ms - row[m.FRACTION_S] * 1e3
        at_bits_ms = bit_ms * round((at_period_0_ms + bits_ms) / bit_ms)
        timed[number] = replace(arc, tow_ms_at_period_0=(at_bits_ms - bits_ms) % WEEK_MS)
    return timed


def collect_navigation(arcs: Mapping[int, Arc], week_near: int, source: str) -> NavigationData:
    """Collect the ephemerides, ionosphere and UTC parameters that the signals themselves sent."""
    ephemerides: dict[tuple[str, int, int], Ephemeris] = {}
    ionosphere, utc = None, None
    for arc in arcs.values():
        sub = arc.subframes
        if {1, 2, 3} <= sub.keys():
            ephemeris = ephemeris_from_subframes(sub[1], sub[2], sub[3], arc.signal.sat, week_near)
            if ephemeris is not None:
                ephemerides.setdefault((ephemeris.sat, ephemeris.week, int(ephemeris.toe)), ephemeris)
        if 4 in sub:
            decoded = ionosphere_and_utc(sub[4], week_near)
            if decoded is not None:
                ionosphere, utc = decoded
    ordered = tuple(ephemerides[key] for key in sorted(ephemerides))
    return NavigationData(ephemerides=ordered, ionosphere=ionosphere, utc=utc, source=source)


def list_weeks(arcs: Mapping[int, Arc]) -> set[int]:
    """List the weeks modulo 1024 that subframes 1 state; empty without one."""
    firsts = (arc.subframes.get(1) for arc in arcs.values())
    return {int(first.fields["week_mod_1024"]) for first in firsts if first is not None}
