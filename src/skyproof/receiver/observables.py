"""Epochs and arcs to `Observations`: integer code periods become time of transmission, and that pseudoranges.

Whole milliseconds are counted as integers and only fractions are floating point, so no digit of a range is lost.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from skyproof.gnss.constants import SECONDS_PER_WEEK, SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import Ephemeris, NavigationData
from skyproof.gnss.lnav import Subframe, ephemeris_from_subframes, ionosphere_and_utc
from skyproof.gnss.time import gpst
from skyproof.receiver.tracking import Arc, Epoch
from skyproof.records import Observations

TYPICAL_TRAVEL_MS = 77
WEEK_MS = SECONDS_PER_WEEK * 1000
NOT_TRACKED, NO_TIME, SLIP = 1, 2, 3


@dataclass(frozen=True, kw_only=True)
class ClockLabel:
    """What the receiver's clock shows at its first sample: whole milliseconds of a week.

    Any choice makes consistent pseudoranges; this one keeps the clock bias below some 10 ms.
    """

    week: int
    tow_ms: int


def clock_label(epochs: Sequence[Epoch], arcs: Mapping[int, Arc], week: int) -> ClockLabel | None:
    """The label that puts the middle travel time at 77 ms; None while no time of week is decoded.

    `week` is that of the first sample, or of the one nearest in time to it.
    """
    starts_ms = []
    for number, arc in arcs.items():
        if arc.tow_ms_at_period_0 is None:
            continue
        for epoch in epochs:
            if number in epoch.measurements:
                sent_ms = arc.tow_ms_at_period_0 + epoch.measurements[number].periods
                starts_ms.append(sent_ms + TYPICAL_TRAVEL_MS - round(epoch.elapsed_s * 1000))
                break
    if not starts_ms:
        return None
    # The week may turn over between satellites: count from the first one seen.
    turned = (np.array(starts_ms) - starts_ms[0] + WEEK_MS // 2) % WEEK_MS - WEEK_MS // 2
    tow_ms = int(np.median(turned)) + starts_ms[0]
    return ClockLabel(week=week + tow_ms // WEEK_MS, tow_ms=tow_ms % WEEK_MS)


def assemble(
    receiver: str, epochs: Sequence[Epoch], arcs: Mapping[int, Arc], label: ClockLabel, *, carrier_hz: float,
    averaged_s: float,
) -> Observations:  # fmt: skip
    """All epochs as one record, one column a signal; a signal lost and found again keeps its column."""
    signals = tuple(sorted({arc.signal for arc in arcs.values()}))
    column = {signal: i for i, signal in enumerate(signals)}
    shape = (len(epochs), len(signals))
    table = {
        name: np.full(shape, np.nan)
        for name in ("pseudorange_m", "carrier_cyc", "doppler_hz", "cn0_dbhz", "pseudorange_sigma_m",
                     "carrier_sigma_cyc", "doppler_sigma_hz")
    }  # fmt: skip
    status = np.full(shape, NOT_TRACKED, np.uint8)
    last_arc: dict[int, int] = {}
    for row, epoch in enumerate(epochs):
        elapsed_ms = round(epoch.elapsed_s * 1000)
        for number, m in epoch.measurements.items():
            arc = arcs[number]
            cell = row, column[arc.signal]
            if arc.tow_ms_at_period_0 is None:
                status[cell] = NO_TIME
                continue
            whole_ms = label.tow_ms + elapsed_ms - arc.tow_ms_at_period_0 - m.periods
            whole_ms = (whole_ms + WEEK_MS // 2) % WEEK_MS - WEEK_MS // 2
            status[cell] = SLIP if last_arc.get(cell[1], number) != number else 0
            last_arc[cell[1]] = number
            table["pseudorange_m"][cell] = SPEED_OF_LIGHT_M_S * (whole_ms * 1e-3 - m.fraction_s)
            table["carrier_cyc"][cell] = m.carrier_cyc
            table["doppler_hz"][cell] = m.doppler_hz
            table["cn0_dbhz"][cell] = m.cn0_dbhz
            table["pseudorange_sigma_m"][cell] = SPEED_OF_LIGHT_M_S * m.code_sigma_s
            table["carrier_sigma_cyc"][cell] = m.carrier_sigma_cyc
            table["doppler_sigma_hz"][cell] = m.doppler_sigma_hz
    found = np.full(len(signals), np.inf)
    missed = np.full(len(signals), np.nan)
    for arc in arcs.values():
        i = column[arc.signal]
        if arc.found_s < found[i]:
            found[i], missed[i] = arc.found_s, arc.missed_s
    elapsed_s = np.array([e.elapsed_s for e in epochs], dtype=np.float64)
    return Observations(
        receiver=receiver,
        signals=signals,
        gpst=gpst(label.week, label.tow_ms * 1e-3 + elapsed_s),
        elapsed_s=elapsed_s,
        status=status,
        found_elapsed_s=found,
        missed_elapsed_s=missed,
        carrier_hz=carrier_hz,
        averaged_s=averaged_s,
        **table,
    )


def timed_by_range(
    arcs: Mapping[int, Arc], epochs: Sequence[Epoch], label: ClockLabel, range_m: Callable[[str, float], float | None]
) -> dict[int, Arc]:
    """The arcs, those without a time of week given one by the range that their satellite should have.

    Bits begin at whole 20 ms, so a channel that knows where its bits begin is open by multiples of 20 ms (6000 km)
    only, and the predicted pseudorange closes that. A false signal off by more than half of it would come out wrong by
    20 ms; it then fits no position.

    Parameters
    ----------
    range_m : pseudorange expected of a satellite (name) at an epoch (elapsed_s), on the receiver's clock; None where
        that is not known.
    """
    first: dict[int, Epoch] = {}
    for epoch in epochs:
        for number in epoch.measurements:
            first.setdefault(number, epoch)
    timed = dict(arcs)
    for number, arc in arcs.items():
        if arc.tow_ms_at_period_0 is not None or not arc.bit_synchronised or number not in first:
            continue
        epoch = first[number]
        expected_m = range_m(arc.signal.sat, epoch.elapsed_s)
        if expected_m is None:
            continue
        measurement = epoch.measurements[number]
        sent_ms = label.tow_ms + epoch.elapsed_s * 1e3 - expected_m / SPEED_OF_LIGHT_M_S * 1e3
        at_period_0_ms = sent_ms - measurement.periods - measurement.fraction_s * 1e3
        at_bits_ms = 20 * round((at_period_0_ms + arc.bits_period) / 20.0)
        timed[number] = replace(arc, tow_ms_at_period_0=(at_bits_ms - arc.bits_period) % WEEK_MS)
    return timed


def navigation_of(arcs: Mapping[int, Arc], week_near: int, source: str) -> NavigationData:
    """The ephemerides, ionosphere and UTC parameters that the signals themselves told."""
    ephemerides: dict[tuple[str, int, int], Ephemeris] = {}
    ionosphere, utc = None, None
    for arc in arcs.values():
        sub = arc.subframes
        if {1, 2, 3} <= sub.keys():
            ephemeris = ephemeris_from_subframes(sub[1], sub[2], sub[3], arc.signal.sat, week_near)
            if ephemeris is not None:
                ephemerides.setdefault((ephemeris.sat, ephemeris.week, int(ephemeris.toe)), ephemeris)
        if 4 in sub:
            told = ionosphere_and_utc(sub[4], week_near)
            if told is not None:
                ionosphere, utc = told
    ordered = tuple(ephemerides[key] for key in sorted(ephemerides))
    return NavigationData(ephemerides=ordered, ionosphere=ionosphere, utc=utc, source=source)


def week_told(arcs: Mapping[int, Arc]) -> int | None:
    """The week modulo 1024 of any subframe 1, None without one."""
    for arc in arcs.values():
        first: Subframe | None = arc.subframes.get(1)
        if first is not None:
            return int(first.fields["week_mod_1024"])
    return None
