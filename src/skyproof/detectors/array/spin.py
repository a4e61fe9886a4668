"""Find signals on a spinning arm that come from one direction, and those that come from their satellites.

Level direction cosines by the phases of a window (`arm_phases`), and what they show: the detector.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.detectors.array.arm_phases import (
    estimate_rate,
    find_bent_signals,
    fit_whole_series,
    repair_slips,
    subtract_mean,
)
from skyproof.detectors.array.array_common import compare_directions, select_commonest_carrier
from skyproof.detectors.array.ins_array import (
    InsArray,
    InsArraySettings,
    block_from_view,
    build_level_states,
    list_places,
    select_likeliest,
)
from skyproof.detectors.array.over_time import Block, Waiting, alpha_alone, pattern_share
from skyproof.detectors.array.policy import POLICY
from skyproof.detectors.base import NotTested, Reporter, leave_open, signals_of
from skyproof.errors import require_probability
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import timedelta_from_s
from skyproof.records import (
    ArrayPhases,
    Cause,
    Datum,
    Finding,
    Hypothesis,
    Need,
    Observations,
    Records,
    SignalRef,
    SpinArm,
)

__all__ = ["Levels", "Spin", "SpinSettings", "estimate_levels"]


# A window's measurements ----------------------------------------------------------------------------------------------


class Levels(NamedTuple):
    """Of those signals of a receiver whose phase is unbroken. channels : (n,) of the observations. level : (n, 2) level
    direction cosines from the arm at the window's elapsed time 0, less what all share; covariance : (2, 2) of each.
    bent : (m,) channels among them whose phases are not those of one direction: two signals within a chip, slips."""

    channels: Indices
    level: Reals
    covariance: Reals
    bent: Indices


def estimate_levels(
    observations: Observations,
    arm: SpinArm,
    *,
    degree: int | None = None,
    min_share: float = 0.9,
    lasting_sigma_cyc: float = 0.01,
    accept_probability: float = 1e-3,
) -> Levels | None:
    """Estimate level direction cosines from carrier phases on an arm, after slips are repaired.

    The arm's rate is estimated if it is not known exactly. Returns None with fewer than two signals or too few epochs
    for the polynomial.

    Other parameters are as in `SpinSettings`.
    """
    channels = select_commonest_carrier(observations.carrier_hz)
    told = np.isfinite(observations.pseudorange_m[:, channels]).any(axis=0)
    if told.any():  # a jammer's carrier can be followed, too, and comes from one direction
        channels = channels[told]
    measured = np.isfinite(observations.carrier_cyc[:, channels])
    channels = channels[measured.mean(axis=0) >= min_share] if measured.size else channels[:0]
    epochs = np.all(np.isfinite(observations.carrier_cyc[:, channels]), axis=-1)
    time_s = observations.elapsed_s[epochs]
    if degree is None:
        degree = 2 if time_s.size == 0 or time_s[-1] - time_s[0] <= POLICY.quadratic_lasts_s else 3
    if channels.size < 2 or time_s.size < degree + 5:
        return None
    radius_cyc = arm.radius_m * observations.carrier_hz[channels[0]] / SPEED_OF_LIGHT_M_S
    sigma_cyc = float(np.median(observations.carrier_sigma_cyc[np.ix_(epochs, channels)]))
    phase_cyc = -observations.carrier_cyc[np.ix_(epochs, channels)].T
    rate_rad_s = arm.rate_rad_s
    angle_rad = rate_rad_s * time_s
    phase_cyc = repair_slips(phase_cyc, angle_rad, sigma_cyc=sigma_cyc, degree=degree, time=time_s).phase_cyc
    if arm.rate_sigma_rad_s > 0.0:
        rate_rad_s = float(
            estimate_rate(
                phase_cyc,
                arm.rate_rad_s,
                radius_cyc=radius_cyc,
                sigma_cyc=sigma_cyc,
                degree=degree,
                time=time_s,
                rate_sigma_rad=arm.rate_sigma_rad_s,
                within=5.0 * arm.rate_sigma_rad_s / abs(arm.rate_rad_s),
            ).rate_rad
        )
        angle_rad = rate_rad_s * time_s
    fit = fit_whole_series(
        subtract_mean(phase_cyc), angle_rad, radius_cyc=radius_cyc, sigma_cyc=sigma_cyc, degree=degree, time=time_s
    )
    sigmas_cyc = np.hypot(
        np.median(observations.carrier_sigma_cyc[np.ix_(epochs, channels)], axis=0),
        _add_pattern(lasting_sigma_cyc, arm, float(observations.carrier_hz[channels[0]])),
    )
    bent = find_bent_signals(
        phase_cyc, angle_rad, sigmas_cyc, degree=degree, time=time_s, accept_probability=accept_probability
    )
    return Levels(channels, fit.level, np.asarray(np.linalg.inv(fit.information), np.float64), channels[bent])


def _add_pattern(lasting_sigma_cyc: float, arm: SpinArm, carrier_hz: float) -> float:
    """Return what lasts in a phase in step with the arm, with what is stated of the antenna's pattern."""
    return float(np.hypot(lasting_sigma_cyc, (arm.pattern_sigma_m or 0.0) * carrier_hz / SPEED_OF_LIGHT_M_S))


# The detector ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SpinSettings:
    """Settings of `Spin`.

    false_alarm_probability : of each receiver and window: that signals of one antenna are divided, and, at most, that a
        true sky is said to have a cluster.
    degree : of the polynomial for clocks and motion; None for 2 up to 15 s and 3 beyond.
    min_share : of the window's epochs in which a signal has to be there.
    tilt_sigma_deg : of the circle's plane against the horizon, about each axis. radius_sigma_m : of the arm.
    lasting_sigma_cyc : of what reflections and other satellites' codes write into a phase in step with the arm.
    accept_probability : that a window's phases of one direction each, with noise and that, are not believed to be.
    """

    false_alarm_probability: float = 1e-3
    degree: int | None = None
    min_share: float = 0.9
    tilt_sigma_deg: float = 2.0
    radius_sigma_m: float = 0.002
    lasting_sigma_cyc: float = 0.01
    accept_probability: float = 1e-3

    def __post_init__(self) -> None:
        for name in ("false_alarm_probability", "accept_probability"):
            require_probability("spin", name, getattr(self, name))


class SpinPast(NamedTuple):
    """What is kept of each receiver. bent_at : when several of its signals were bent last. waiting : its blocks of
    windows."""

    bent_at: dict[str, np.datetime64]
    waiting: dict[str, Waiting]


class Spin:
    """The detector: which signals of a receiver on an arm come from one direction.

    From its observations and `spin_arms`, a tuple of `SpinArm`. The arm must turn by most of a turn within the
    window; with less nothing is decided. With orbits and a surveyed place or a consistent set, directions are held
    against the satellites', up to the angle from which the arm starts, as `ins_array` does; without, with each other.
    """

    name = "spin"
    needs = (Need.OBSERVATIONS, Need.SPIN_ARMS)

    def __init__(self, settings: SpinSettings | None = None) -> None:
        self.settings = settings or SpinSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        alone = Spin(replace(self.settings, false_alarm_probability=alpha_alone(self.settings.false_alarm_probability)))
        report = Reporter(alone, records, Hypothesis.SKY_DIRECTIONS)
        lacking = report.name_missing()
        if lacking:
            return lacking, state
        arms = {arm.receiver: arm for arm in records.spin_arms}
        turning = [o for o in records.observations if o.receiver in arms]
        if not turning:
            return [report.pass_over(signals_of(records.observations), NotTested("no_arm"))], state
        past = state or SpinPast({}, {})
        past = SpinPast(dict(past.bent_at), dict(past.waiting))
        return [f for o in turning for f in self._test_receiver(report, o, arms[o.receiver], past)], past

    def _test_receiver(
        self, report: Reporter, observations: Observations, arm: SpinArm, past: "SpinPast"
    ) -> list[Finding]:
        """Return what directions show of one receiver's signals. past : brought up to date."""
        asked = self.settings
        seen = estimate_levels(
            observations,
            arm,
            degree=asked.degree,
            min_share=asked.min_share,
            lasting_sigma_cyc=asked.lasting_sigma_cyc,
            accept_probability=asked.accept_probability,
        )
        receiver = observations.receiver
        if seen is None:
            why = _explain_no_levels(observations, asked.min_share)
            return [report.pass_over(signals_of((observations,)), why)]
        found = self._test_against_orbits(report, observations, arm, seen, past.waiting)
        if all(finding.says == "undecided" for finding in found):
            refs = [SignalRef(receiver, observations.signals[k]) for k in seen.channels]
            covariances = np.broadcast_to(seen.covariance, (len(refs), 2, 2))
            alike = compare_directions(report, refs, seen.level, covariances, np.eye(3)[:2], wrapped=False)
            # Directions that differ, but are not those of the satellites, are no sky's.
            found = alike if not found or alike[0].says == "spoofed" else found
        bent = [SignalRef(receiver, observations.signals[k]) for k in seen.bent]
        if len(bent) > 1:
            past.bent_at[receiver] = report.records.end_gpst
        doubt = _state_doubt(report.records, len(bent), seen.channels.size, past.bent_at.get(receiver))
        return [_leave_out_bent(report, f, bent, doubt) if f.says == "authentic" else f for f in found]

    def _test_against_orbits(
        self,
        report: Reporter,
        observations: Observations,
        arm: SpinArm,
        levels: Levels,
        waiting: dict[str, Waiting],
    ) -> list[Finding]:
        """Test level directions against those of the satellites; empty if that shows nothing.

            waiting : blocks of windows of each receiver; brought up to date.

            If most signals come from elsewhere, the cause stays open: two equal signals within a chip show a direction
        between them.

            Level direction cosines are what a small flat array measures: its heading is the arm's start, which is not
            known nor needed, and what all share is not known either.
        """
        records = report.records
        places = list_places(records, observations.receiver)
        if records.navigation is None or not places:
            return []
        channels = levels.channels
        middle = [observations.gpst.size // 2]
        seen = (
            POLICY.level_scale_cyc * levels.level * [1.0, -1.0]
        )  # the arm turns clockwise: forward is its start, then right
        shape = (1, channels.size, 3)
        carrier_hz = observations.carrier_hz[channels]
        wavelength_m = SPEED_OF_LIGHT_M_S / carrier_hz[0]
        lasting_cyc = _add_pattern(self.settings.lasting_sigma_cyc, arm, float(carrier_hz[0]))
        lasting = lasting_cyc * wavelength_m / arm.radius_m
        sigma = POLICY.level_scale_cyc * np.sqrt(np.linalg.eigvalsh(levels.covariance).max() + lasting**2)
        phases = ArrayPhases(
            receiver=observations.receiver,
            signals=tuple(observations.signals[k] for k in channels),
            gpst=observations.gpst[middle],
            elapsed_s=observations.elapsed_s[middle],
            elements_m=POLICY.level_scale_cyc
            * wavelength_m
            * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
            phase_cyc=np.concatenate([np.zeros((channels.size, 1)), seen], axis=1)[None],
            # Both are a part of one phase: where they are taken against, nothing has an error.
            sigma_cyc=np.broadcast_to([1e-6, sigma, sigma], shape),
            carrier_hz=carrier_hz,
            calibrated=False,
            elements_sigma_m=0.0,
            pattern_sigma_m=0.0,  # in step with the arm, it is a part of what lasts
        )
        scale_sigma = self.settings.radius_sigma_m / arm.radius_m
        judge = _ByArm(
            InsArraySettings(false_alarm_probability=self.settings.false_alarm_probability, scale_sigma=scale_sigma)
        )
        alone = judge.spending(alpha_alone(judge.settings.false_alarm_probability))
        bodies = build_level_states(records, places, float(np.radians(self.settings.tilt_sigma_deg)))
        views = [view for body in bodies if (view := alone.view_from(phases, body, records.navigation)) is not None]
        if not views:
            return []
        view = select_likeliest(views)
        alone_report = Reporter(alone, records, report.hypothesis)
        found = alone.judge(alone_report, view, records.navigation)
        block = _to_north(block_from_view(view, POLICY.level_scale_cyc * lasting * np.array([0.0, 1.0, 1.0]), records))
        share = pattern_share(lasting_cyc, float(carrier_hz[0]), arm.pattern_sigma_m)
        waiting[observations.receiver], found = judge.judge_with_blocks(
            alone_report, found, waiting.get(observations.receiver, Waiting()), block, view, records.navigation, share
        )
        if any(finding.says in ("spoofed", "authentic") for finding in found):
            return found
        if all(finding.says == "clean" for finding in found):
            return []
        data: dict[str, Datum] = {"off": len(view.refs) - int(view.agreed.members.size)}
        p = {Cause.CLEAN: view.agreed.p_value, **leave_open((Cause.REFLECTIONS, Cause.STATEMENT))}
        return [report.find(view.refs, "not_from_satellites", p, data=data)]


def _to_north(block: Block) -> Block:
    """Return an arm's block in the axes north and east: where the arm starts is another angle in each window."""
    turn = block.frame.turn
    bias_cyc = block.frame.bias_cyc @ turn[:2, :2]
    return replace(
        block,
        residual_cyc=block.residual_cyc @ turn[:2, :2],
        towards=block.towards @ turn,
        frame=replace(block.frame, turn=np.eye(3), bias_cyc=bias_cyc),
        body=np.eye(3),
    )


def _leave_out_bent(
    report: Reporter, authentic: Finding, bent: Sequence[SignalRef], doubt: dict[str, Datum] | None
) -> Finding:
    """Return a finding of true signals without those of no one direction; that none could be tested where in doubt."""
    kept = tuple(ref for ref in authentic.signals if ref not in bent)
    if kept and doubt is None:
        return replace(authentic, signals=kept)
    return report.pass_over(authentic.signals, NotTested("phases_bent", doubt or {}))


def _explain_no_levels(observations: Observations, min_share: float) -> NotTested:
    """Return whether signals, or epochs of them, are what is missing."""
    share = np.isfinite(observations.carrier_cyc).mean(axis=0) if observations.gpst.size else np.zeros(0)
    n = int((share >= min_share).sum())
    data: dict[str, Datum] = {"receiver": observations.receiver, "signals": n, "epochs": observations.gpst.size}
    return NotTested("few_signals", data) if n < 2 else NotTested("few_epochs", data)


def _state_doubt(records: Records, bent: int, signals: int, bent_at: np.datetime64 | None) -> dict[str, Datum] | None:
    """Return why none of a receiver's signals is authentic; None if nothing speaks against it.

    One signal alone may slip, be reflected or imitated. Where there are several, what makes them so may be in all
    others as well, too weak or too fast to be seen in each: two skies within a chip. `bent_at` is when it was so last.
    """
    if bent > 1:
        return {"bent": bent, "of": signals}
    if bent_at is not None and (since := records.start_gpst - bent_at) < timedelta_from_s(POLICY.bent_for_s):
        return {"ago_s": float(since / np.timedelta64(1, "s"))}
    return None


class _ByArm(InsArray):
    """Directions of an arm, judged as those of an array."""

    name = "spin"
