"""Find codes that no orbit explains, of more satellites than fail at once, or satellites that change places.

A receiver that true and false signals pull about writes fragments: a code whole milliseconds off, negative ranges,
ranges of another satellite, for an epoch or two, of other satellites each time. A position filter leaves them out one
by one. Here they are counted together. So are satellites that take each other's place from epoch to epoch, whatever
their codes are (`exchange`). The smaller of the two p-values, doubled, is the test's.

Model. The last good fix of the others, with the receiver's clock at that time, predicts each code. A code that is off
by more than a reflection explains is a stray; so is one that no receiver measures. A satellite or its channel has
strays in a window with the probability of a fault, independently of others. The number of satellites with strays is
binomial; the chance of so many is the p-value. The distance that the antenna and the clock may have gone since the last
good fix is subtracted: no farther than the largest speed leads, nor than the largest acceleration leads from where the
last velocity does.
"""

from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np

from skyproof.arrays import Booleans, Reals
from skyproof.detectors.base import NotTested, Reporter, leave_open
from skyproof.detectors.code_motion.detector import select_primary_signals
from skyproof.detectors.torn.exchange import Exchange, ExchangePast, examine_exchange
from skyproof.detectors.torn.policy import POLICY
from skyproof.errors import require_probability
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.navigation.fix import fix_and_geometry
from skyproof.navigation.least_squares import compute_line_of_sight
from skyproof.navigation.ranges import correct_ranges
from skyproof.records import (
    Cause,
    CellStatus,
    Datum,
    Finding,
    FixStatus,
    Hypothesis,
    NavigationData,
    Need,
    Observations,
    Records,
    SignalId,
    list_refs,
)
from skyproof.statistics.distributions import binomial_survival

__all__ = ["Torn", "TornSettings"]

_OPEN_M_S: Final = 1e9  # faster than anything


@dataclass(frozen=True)
class TornSettings:
    """Settings of `Torn`.

    false_alarm_probability : of each receiver and window.
    fault_probability : of one satellite or its channel, to give a stray code within a window.
    speed_max_m_s : no platform is faster; 1000 where it is not known. acceleration_max_m_s2 : none exceeds it.
    clock_jump, clock_pace_s : what an oscillator's rate may step by, and change by in a second.
    multipath_sigma_m : of one pseudorange, one sigma. elevation_mask_deg : satellites lower are not used for fixes.
    """

    false_alarm_probability: float = 1e-3
    fault_probability: float = 1e-3
    speed_max_m_s: float | None = None
    acceleration_max_m_s2: float = 50.0
    clock_jump: float = 1e-8
    clock_pace_s: float = 1e-8
    multipath_sigma_m: float = 1.0
    elevation_mask_deg: float = 5.0

    def __post_init__(self) -> None:
        require_probability("torn", "false_alarm_probability", self.false_alarm_probability)
        require_probability("torn", "fault_probability", self.fault_probability)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Anchor:
    """The last good fix of a receiver: when, where, and c times the clock bias, by time scale.

    motion_m_s : (4,) velocity and c times the clock's drift then; zero where not known. motion_sigma_m_s : of each of
    them at most, `_OPEN_M_S` where not known.
    """

    elapsed_s: float
    position_ecef_m: Reals
    variance_m2: float
    clock_m: dict[str, float]
    motion_m_s: Reals
    motion_sigma_m_s: float


class _Strays(NamedTuple):
    """Satellites with stray codes, of how many, the chance of so many, and since when."""

    signals: tuple[SignalId, ...]
    of: int
    p_value: float
    since: np.datetime64


@dataclass(frozen=True, eq=False, kw_only=True)
class _Past:
    """What is remembered of a receiver: its last good fix, and which satellites it tracked."""

    end_s: float
    anchor: _Anchor | None
    exchange: ExchangePast


class Torn:
    """The detector: see the module's text. It remembers the last good fix and the satellites of each receiver."""

    name = "torn"
    share = 0.0  # it never speaks of an attack
    needs = (Need.OBSERVATIONS, Need.NAVIGATION)

    def __init__(self, settings: TornSettings | None = None) -> None:
        self.settings = settings or TornSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.WHOLE_TRACKING)
        lacking = report.name_missing()
        if lacking or records.navigation is None:
            return lacking, state
        pasts: dict[str, _Past] = dict(state or {})
        found = []
        for o in records.observations:
            before = pasts.get(o.receiver)
            if before is None or before.end_s >= o.elapsed_s[0]:  # the first window, or another recording
                before = _Past(end_s=-np.inf, anchor=None, exchange=ExchangePast())
            finding, pasts[o.receiver] = self._test_receiver(report, records.navigation, o, before)
            found.append(finding)
        return found, pasts

    def _test_receiver(
        self, report: Reporter, navigation: NavigationData, o: Observations, before: _Past
    ) -> tuple[Finding, _Past]:
        """Test strays and exchanged satellites of a receiver; return what is remembered of it."""
        exchange, after = examine_exchange(o, before.exchange)
        signals = select_primary_signals(o)
        strays, anchor = (None, before.anchor)
        if signals is not None:
            strays, anchor = self._find_stray_satellites(o, navigation, signals, before.anchor)
        past = _Past(end_s=float(o.elapsed_s[-1]), anchor=anchor, exchange=after)
        tests = [test.p_value for test in (strays, exchange) if test is not None]
        p_value = min(1.0, len(tests) * min(tests)) if tests else 1.0
        if strays is not None or p_value < self.settings.false_alarm_probability:
            return self._report_tests(report, o, strays, exchange, p_value), past
        why = NotTested("received_twice") if signals is None else NotTested("no_good_fix")
        return report.pass_over(list_refs(o.receiver, o.signals), why), past

    def _find_stray_satellites(
        self, o: Observations, navigation: NavigationData, signals: tuple[SignalId, ...], before: _Anchor | None
    ) -> tuple[_Strays | None, _Anchor | None]:
        """Return the satellites with stray codes, None without a fix, and the last good fix."""
        anchors = self._find_anchors(o, navigation, signals, before)
        columns = [o.column_of[signal] for signal in signals]
        impossible = np.asarray(o.status[:, columns] == CellStatus.IMPOSSIBLE)
        stray = impossible.copy()
        if any(anchor is not None for anchor in anchors):
            stray |= self._find_strays(o, navigation, signals, anchors)
        elif not stray.any():
            return None, before
        n = int((o.measured[:, columns] | impossible).any(axis=0).sum())
        torn = tuple(signal for k, signal in enumerate(signals) if stray[:, k].any())
        p_value = float(binomial_survival(len(torn), max(n, 1), self.settings.fault_probability))
        since = o.gpst[int(stray.any(axis=1).argmax())]
        return _Strays(torn, n, p_value, since), anchors[-1] or before

    def _find_anchors(
        self, o: Observations, navigation: NavigationData, signals: tuple[SignalId, ...], before: _Anchor | None
    ) -> list[_Anchor | None]:
        """Return for each epoch the last good fix up to it, or where there is none the first one after it."""
        anchors: list[_Anchor | None] = [before] * o.gpst.size
        if not signals:
            return anchors
        fix, geometry = fix_and_geometry(
            o,
            navigation,
            signals=signals,
            multipath_sigma_m=self.settings.multipath_sigma_m,
            elevation_mask_deg=self.settings.elevation_mask_deg,
            false_alarm_probability=POLICY.fault_probability,
        )
        used = np.isfinite(geometry.sigma_m) & np.isfinite(geometry.misfit_m)
        clocks = np.any(used[..., None] & (geometry.design[..., 3:] != 0.0), axis=1).sum(axis=1)
        normalised = np.where(used, geometry.misfit_m / np.where(used, geometry.sigma_m, 1.0), 0.0)
        dof = used.sum(axis=1) - 3 - clocks
        small = (normalised**2).sum(axis=1) < 25.0 * np.maximum(dof, 1)
        good = np.flatnonzero((fix.status == FixStatus.OK) & (dof >= POLICY.least_dof) & small)
        last = before
        for row in range(o.gpst.size):
            if row in good:
                clock_m = {
                    scale: SPEED_OF_LIGHT_M_S * float(fix.clock_bias_s[row] + offset_s[row])
                    for scale, offset_s in fix.inter_system_s.items()
                    if np.isfinite(offset_s[row])
                }
                found = _Anchor(
                    elapsed_s=float(o.elapsed_s[row]),
                    position_ecef_m=fix.position_ecef_m[row],
                    variance_m2=float(np.trace(fix.covariance_m2[row])),
                    clock_m=clock_m,
                    motion_m_s=np.append(fix.velocity_ecef_m_s[row], SPEED_OF_LIGHT_M_S * fix.clock_drift[row]),
                    motion_sigma_m_s=0.0,
                )
                last = found if np.isfinite(found.motion_m_s).all() else _add_velocity(found, last, self.settings)
            anchors[row] = last
        first = next((anchor for anchor in anchors if anchor is not None), None)
        return [anchor or first for anchor in anchors]

    def _find_strays(
        self,
        o: Observations,
        navigation: NavigationData,
        signals: tuple[SignalId, ...],
        anchors: list[_Anchor | None],
    ) -> Booleans:
        """Return the cells (n_epochs, n_signals) that are off by more than anything explains."""
        known = [anchor for anchor in anchors if anchor is not None]
        codes_m = o.pseudorange_m[:, [o.column_of[signal] for signal in signals]]
        ranges = correct_ranges(signals, o.gpst, codes_m, navigation, with_unknown_delay=True)
        place = np.array([anchor.position_ecef_m for anchor in known])
        _, _, distance_m = compute_line_of_sight(ranges.satellite_ecef_m, place)
        apart_s = o.elapsed_s - np.array([anchor.elapsed_s for anchor in known])
        motion_m_s = np.array([anchor.motion_m_s for anchor in known])
        scales = [signal.kind[0] for signal in signals]
        clock_m = np.array([[anchor.clock_m.get(scale, np.nan) for scale in scales] for anchor in known])
        range_m = ranges.range_m - clock_m - (motion_m_s[:, 3] * apart_s)[:, None]
        _, _, carried_m = compute_line_of_sight(ranges.satellite_ecef_m, place + motion_m_s[:, :3] * apart_s[:, None])
        since_s = np.abs(apart_s)
        speed_m_s = 1000.0 if self.settings.speed_max_m_s is None else self.settings.speed_max_m_s
        reach_m = POLICY.stray_m + (speed_m_s + SPEED_OF_LIGHT_M_S * POLICY.most_drift) * since_s
        settings = self.settings
        pace_m_s2 = settings.acceleration_max_m_s2 + SPEED_OF_LIGHT_M_S * settings.clock_pace_s
        off_m_s = np.array([anchor.motion_sigma_m_s for anchor in known]) + SPEED_OF_LIGHT_M_S * settings.clock_jump
        carried_reach_m = POLICY.stray_m + off_m_s * since_s + 0.5 * pace_m_s2 * since_s**2
        beyond = np.abs(range_m - distance_m) > reach_m[:, None]
        return np.asarray(beyond | (np.abs(range_m - carried_m) > carried_reach_m[:, None]))

    def _report_tests(
        self, report: Reporter, o: Observations, strays: _Strays | None, exchange: Exchange | None, p_value: float
    ) -> Finding:
        """Return the finding of the test that is the less probable of the two."""
        failed = p_value < self.settings.false_alarm_probability
        data: dict[str, Datum] = {"receiver": o.receiver}
        causes: tuple[Cause, ...] = (Cause.INTERFERENCE, Cause.FAULT)
        signals, since = o.signals, None
        if strays is not None and (exchange is None or strays.p_value <= exchange.p_value):
            sats = tuple(signal.sat for signal in strays.signals)
            data |= {"by": "codes", "sats": sats, "of": strays.of, "statistic": float(len(sats))}
            since = strays.since
            signals = strays.signals if failed else signals
        elif exchange is not None:
            data |= {"by": "exchange", "sats": exchange.satellites, "statistic": float(exchange.exchanged)}
            data |= {"exchanged": exchange.exchanged, "of": exchange.tracked}
            causes, since = (Cause.SHADE, *causes), exchange.began
            signals = tuple(s for s in signals if s.sat in exchange.satellites) if failed else signals
        return report.find(
            list_refs(o.receiver, signals),
            "torn" if failed else "whole",
            {Cause.CLEAN: p_value, **leave_open(causes)},
            data=data,
            dated_gpst=since if failed else None,
        )


def _add_velocity(found: _Anchor, last: _Anchor | None, settings: TornSettings) -> _Anchor:
    """Return a fix without a velocity with that since the last one."""
    apart_s = found.elapsed_s - last.elapsed_s if last is not None else 0.0
    scales = found.clock_m.keys() & last.clock_m.keys() if last is not None else set[str]()
    if last is None or apart_s <= 0.0 or not scales:
        return replace(found, motion_m_s=np.zeros(4), motion_sigma_m_s=_OPEN_M_S)
    drift_m = float(np.median([found.clock_m[scale] - last.clock_m[scale] for scale in scales]))
    motion_m_s = np.append(found.position_ecef_m - last.position_ecef_m, drift_m) / apart_s
    # It is that of half an interval ago.
    sigma_m_s = POLICY.velocity_off_sigmas * np.sqrt(found.variance_m2 + last.variance_m2) / apart_s
    sigma_m_s += 0.5 * settings.acceleration_max_m_s2 * apart_s
    return replace(found, motion_m_s=motion_m_s, motion_sigma_m_s=float(sigma_m_s))
