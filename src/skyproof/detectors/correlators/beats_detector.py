"""Test if the power of the tracked signals beats as with one further sky, over `beats`.

Skies that overlap too much for a test of delays show within seconds once one of them moves: their carriers differ.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skyproof.arrays import Booleans, Reals
from skyproof.detectors.base import NotTested, Reporter
from skyproof.detectors.correlators.beats import (
    CommonMotion,
    Line,
    common_p_value,
    find_line,
    fit_common_motion,
    mirror_p_value,
    weaker_p_value,
)
from skyproof.detectors.correlators.policy import POLICY
from skyproof.errors import require_probability
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.navigation.directions import compute_directions
from skyproof.navigation.fix import fix
from skyproof.records import (
    Cause,
    Datum,
    Finding,
    Hypothesis,
    NavigationData,
    Need,
    Observations,
    Records,
    SignalId,
    Taps,
    list_refs,
)

__all__ = ["Beats", "BeatsSettings"]


@dataclass(frozen=True)
class BeatsSettings:
    """Settings of `Beats`.

    false_alarm_probability : of a receiver's window.
    """

    false_alarm_probability: float = 1e-3

    def __post_init__(self) -> None:
        require_probability("beats", "false_alarm_probability", self.false_alarm_probability)


class Beats:
    """Make one finding of each receiver with correlators and window; look at the window before as well.

    Lines that one motion and clock explain are of a further sky, unless they may be those of the antenna's image in a
    reflector, or of what modulates all signals at one rate. A receiver that is known to stand has no image that moves.
    """

    name = "beats"
    needs = (Need.OBSERVATIONS, Need.NAVIGATION, Need.TAPS)

    def __init__(self, settings: BeatsSettings | None = None) -> None:
        self.settings = settings or BeatsSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.ONE_COMPONENT)
        lacking = report.name_missing()
        if lacking or records.navigation is None:
            return lacking, state
        by_receiver = {o.receiver: o for o in records.observations}
        before: Mapping[str, _Powers] = state or {}
        powers, found = dict(before), []
        for taps in records.taps:
            powers[taps.receiver] = now = _read_powers(taps)
            earlier = before.get(taps.receiver)
            stretches = [now] if earlier is None or not earlier.goes_on_in(now) else [now, earlier.join(now)]
            found.append(self._test_receiver(report, taps, by_receiver.get(taps.receiver), stretches))
        return found, powers

    def _test_receiver(
        self, report: Reporter, taps: Taps, o: Observations | None, stretches: "Sequence[_Powers]"
    ) -> Finding:
        """Find what explains the lines of a receiver's signals, in the stretch that shows most."""
        navigation, refs = report.records.navigation, list_refs(taps.receiver, taps.signals)
        needed = 4 + POLICY.beats_more
        data: dict[str, Datum] = {"receiver": taps.receiver, "needed": needed}
        tested = {} if o is None or navigation is None else _compute_directions(taps, o, navigation)
        if o is None or navigation is None or len(tested) < needed:
            return report.pass_over(refs, NotTested("few_signals", data))
        every = [_fit_lines(stretch, tested) for stretch in stretches]
        lines, motion = min(every, key=lambda fitted: 1.0 if fitted[1] is None else fitted[1].p_value)
        if motion is None:
            p = dict.fromkeys((Cause.CLEAN, Cause.REFLECTIONS, Cause.INTERFERENCE, Cause.FAULT), 1.0)
            return report.find(list_refs(taps.receiver, tuple(tested)), "apart", p, data={"lines": len(lines)})
        stands = taps.receiver in report.records.standing
        velocity = (np.zeros(3), np.zeros((3, 3))) if stands else _measure_velocity(o, navigation, tuple(tested))
        chance, common = min(1.0, len(every) * motion.p_value), common_p_value(motion)
        explained = tuple(signal for signal, of in zip(lines, motion.explained, strict=True) if of)
        latest, _ = every[0]
        # An image moves so, and is weaker: what is not both is none.
        image = min(mirror_p_value(motion, *velocity), weaker_p_value([latest.get(signal) for signal in explained]))
        p = {
            Cause.CLEAN: chance,
            Cause.REFLECTIONS: min(1.0, 2.0 * image),
            Cause.INTERFERENCE: common,
            Cause.FAULT: common,
        }
        return report.find(
            list_refs(taps.receiver, explained),
            "together" if chance < self.settings.false_alarm_probability else "apart",
            p,
            data={
                "lines": len(lines),
                "motion_m_s": float(np.linalg.norm(motion.state[:3])),
                "clock_m_s": float(abs(motion.state[3])),
            },
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Powers:
    """Powers (n,) of signals at looks (n,); NaN where a signal was not tracked."""

    elapsed_s: Reals
    power: Mapping[SignalId, Reals]

    @property
    def step_s(self) -> float:
        return float(np.median(np.diff(self.elapsed_s)))

    def goes_on_in(self, later: "_Powers") -> bool:
        """Tell whether the looks of a later stretch follow without a gap."""
        gap_s = float(later.elapsed_s[0] - self.elapsed_s[-1])
        return 0.0 < gap_s < POLICY.longest_gap_s

    def join(self, later: "_Powers") -> "_Powers":
        """Join what is tracked in both."""
        both = {s: np.concatenate([self.power[s], power]) for s, power in later.power.items() if s in self.power}
        return _Powers(elapsed_s=np.concatenate([self.elapsed_s, later.elapsed_s]), power=both)


def _read_powers(taps: Taps) -> _Powers:
    """Read the power of the prompt correlators, of antennas that are summed by weights that follow it on one alone."""
    if taps.first_power is not None:
        return _Powers(
            elapsed_s=taps.elapsed_s, power=dict(zip(taps.signals, np.asarray(taps.first_power, float).T, strict=True))
        )
    prompt, carrier = int(np.argmin(np.abs(taps.delays_chips))), int(np.argmin(np.abs(taps.dopplers_hz)))
    power = np.abs(taps.value[:, :, carrier, prompt].astype(np.complex128)) ** 2
    return _Powers(elapsed_s=taps.elapsed_s, power=dict(zip(taps.signals, power.T, strict=True)))


def _fit_lines(powers: _Powers, tested: Mapping[SignalId, Reals]) -> tuple[dict[SignalId, Line], CommonMotion | None]:
    """Return the lines of a stretch's signals that have one, and what one motion and clock explain of these."""
    step_s = powers.step_s
    lines = {s: line for s in tested if s in powers.power and (line := _find_line(powers.power[s], step_s)) is not None}
    wavelength_m = SPEED_OF_LIGHT_M_S / np.array([signal.plan.carrier_hz for signal in lines])
    rows = np.array([tested[signal] for signal in lines]).reshape(-1, 4)
    return lines, fit_common_motion(tuple(lines.values()), wavelength_m, rows, step_s)


def _compute_directions(taps: Taps, o: Observations, navigation: NavigationData) -> dict[SignalId, Reals]:
    """Compute the rows of the geometry of each satellite's first signal that is the only one of its transmission."""
    directions = compute_directions(o, navigation, taps.signals)
    if directions is None:
        return {}
    tracked = [taps.signals[k] for k in np.flatnonzero(np.isfinite(taps.value).any(axis=(0, 2, 3)))]
    sent = [signal.transmission for signal in tracked]
    first: dict[str, SignalId] = {}
    for signal in tracked:
        if sent.count(signal.transmission) == 1:
            first.setdefault(signal.sat, signal)
    rows = dict(zip(taps.signals, directions.design, strict=True))
    return {signal: rows[signal] for signal in first.values() if np.isfinite(rows[signal]).all()}


def _find_line(power: Reals, step_s: float) -> Line | None:
    """Find the line in the powers (n,) of a signal that was tracked through most of a stretch."""
    there: Booleans = np.isfinite(power)
    if there.sum() < max(POLICY.least_looks, POLICY.guided_looks_share * there.size):
        return None
    looks = np.arange(there.size)
    return find_line(np.interp(looks, looks[there], power[there]), step_s)


def _measure_velocity(
    o: Observations, navigation: NavigationData, signals: tuple[SignalId, ...]
) -> tuple[Reals, Reals]:
    """Measure the velocity (3,) over a window and its covariance, which holds how it changes; huge if there is none."""
    velocity_m_s = fix(o, navigation, signals=signals).velocity_ecef_m_s
    known = velocity_m_s[np.isfinite(velocity_m_s).all(axis=1)]
    if len(known) < POLICY.least_velocities:
        return np.zeros(3), np.eye(3) * SPEED_OF_LIGHT_M_S**2
    return known.mean(axis=0), np.cov(known.T)
