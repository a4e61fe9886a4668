"""Takeovers of one receiver at the level of measurements, with capture as loops do it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from tests.app.kit import PLACES, START, TRANSMIT

from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings
from skyproof.app.protect import judge
from skyproof.app.protect.coasting import usable_fixes
from skyproof.app.protect.document import document
from skyproof.app.protect.outcome import Outcome
from skyproof.app.protect.predictors import InertialUnit, build_predictors
from skyproof.detectors.adapter import finding_from_evidence
from skyproof.detectors.prediction.choice_findings import CHOSEN
from skyproof.gnss.frames import heading_pitch_roll_rad
from skyproof.gnss.imu_grades import GRADES
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.navigation.ins import InsSettings
from skyproof.records import Attitude, Evidence, Finding, FixStatus, Records, SignalId, SignalRef
from skyproof.simulator.received import Scene
from skyproof.simulator.scenario import FrontEnd, Scenario, SceneReceiver, Sky, Takeover
from skyproof.simulator.sky import make_scene
from skyproof.simulator.truth import simulate_imus
from skyproof.studies.receiver_model import ChannelNoise, model_receptions
from skyproof.verdict import Verdict

NAVIGATION = make_nominal_constellation(START)
WAVE_M_S = 299_792_458.0


def make_takeover(
    *,
    onset_s: float = 35.0,
    duration_s: float = 110.0,
    speed_m_s: float = 12.0,
    clock_m_s: float = 0.0,
    power_db: float = 3.0,
    oscillator: str = "ocxo",
    heading_deg: float = 90.0,
    seed: int = 1,
    zenith_cn0_dbhz: float = 50.0,
    carrier: str = "follows",
    **receiver: object,
) -> Scene:
    """Make a receiver whose signals are taken over at the onset, aligned, and dragged off 3 s later."""
    antenna = PLACES[0].model_dump(exclude_unset=True) | {"lo_ppm": 0.4, "oscillator": oscillator} | receiver
    begin_s, long_s = onset_s + 3.0, duration_s - onset_s - 3.0
    far_m, late_s = speed_m_s * long_s, clock_m_s / WAVE_M_S * long_s
    east, north = np.sin(np.radians(heading_deg)), np.cos(np.radians(heading_deg))
    attack = Takeover(
        target="bow",
        transmit=TRANSMIT,
        power_db=power_db,
        onset_s=onset_s,
        carrier=carrier,
        away_points_enu_m=((begin_s, 0.0, 0.0, 0.0), (duration_s, far_m * east, far_m * north, 0.0)),
        clock_points_s=((begin_s, 0.0), (duration_s, late_s)),
    )
    scenario = Scenario(
        seed=seed,
        start_gpst=START,
        duration_s=duration_s,
        receivers=(SceneReceiver(**antenna),),
        attacks=(attack,),
        front_end=FrontEnd(),
        sky=Sky(zenith_cn0_dbhz=zenith_cn0_dbhz, horizon_cn0_dbhz=zenith_cn0_dbhz - 8.0),
    )
    return make_scene(scenario, NAVIGATION)


def find_nothing(windows: Sequence[Records], signals: Sequence[SignalId]) -> list[Finding]:
    """Return findings that call every window clean, of no detector in particular."""
    return [
        finding_from_evidence(
            Evidence(
                detector="none",
                start_gpst=w.start_gpst,
                end_gpst=w.end_gpst,
                subject=tuple(SignalRef("bow", signal) for signal in signals),
                says="clean",
                because="",
            )
        )
        for w in windows
    ]


@dataclass(frozen=True, eq=False)
class Judged:
    """off_m, sigma_m, level_m, hidden_m (n,) of all fixes that may be used, in space; kind, at_s (n,) of each.
    wrong : whether a signal was called what it is not for a second and more. wrong_sky : whether most signals of the
    sky that was chosen first were false; None where nothing was chosen."""

    outcome: Outcome
    verdict: Verdict
    off_m: np.ndarray
    sigma_m: np.ndarray
    level_m: np.ndarray
    hidden_m: np.ndarray
    kind: np.ndarray
    at_s: np.ndarray
    wrong: bool
    wrong_sky: bool | None


def judge_scene(scene: Scene, settings: Settings, *, seed: int = 1, code_m: float = 0.5, **judging: object) -> Judged:
    noise = ChannelNoise(code_m=code_m)
    (heard,) = model_receptions(scene, noise, rng=np.random.default_rng(seed))
    outcome, _ = judge([heard.reception], scene.navigation, settings, Silent(), **judging)
    off_m, sigma_m, level_m, hidden_m, kind, at_s = [], [], [], [], [], []
    positions = outcome.receivers[0].positions
    for name, fix in usable_fixes(positions) if positions is not None else ():
        good = fix.status == FixStatus.OK
        true_s = (fix.gpst[good] - START) / np.timedelta64(1, "s")
        rows = np.clip(np.searchsorted(heard.true_s, true_s - 0.25), 0, heard.true_s.size - 1)
        off_m.append(np.linalg.norm(fix.position_ecef_m[good] - heard.position_ecef_m[rows], axis=1))
        sigma_m.append(np.sqrt(np.trace(fix.covariance_m2[good, :3, :3], axis1=1, axis2=2)))
        level_m.append(np.linalg.norm(fix.protection_m[good], axis=1))
        hidden_m.append(fix.hidden_m[good])
        kind.append(np.repeat(name, good.sum()))
        at_s.append(true_s)
    o = heard.reception.observations
    faults = False
    for s in outcome.decision.labels:
        share = heard.false_share[s.first_epoch : s.last_epoch + 1, o.signals.index(s.ref.signal)]
        wrong = share > 0.6 if s.label == "authentic" else share < 0.4
        faults |= s.label in ("authentic", "spoofed") and wrong.sum() >= 2
    empty = [np.empty(0)]
    return Judged(
        outcome,
        document(outcome, [], settings),
        np.concatenate(off_m or empty),
        np.concatenate(sigma_m or empty),
        np.concatenate(level_m or empty),
        np.concatenate(hidden_m or empty),
        np.concatenate(kind or empty),
        np.concatenate(at_s or empty),
        bool(faults),
        _has_wrong_sky(heard, outcome),
    )


def make_inertia(scene: Scene, settings: Settings, grade: str, *, attitude_deg: float | None = 1.0, seed: int = 1):
    """Make the inertial prediction of the scene's unit, whose first attitude is stated with this error."""
    unit = simulate_imus(scene)["bow"]
    readings = unit.read(0, unit.n_samples)
    true = scene.trajectories["bow"].at(np.zeros(1))
    rng, initial = np.random.default_rng(seed), None
    if attitude_deg is not None:
        angles = np.stack(heading_pitch_roll_rad(true.position_ecef_m[0], true.attitude[0]))
        sigma_rad = float(np.radians(attitude_deg))
        initial = Attitude(
            gpst=readings.gpst[:1],
            angles_rad=(angles + sigma_rad * rng.standard_normal(3))[None],
            sigma_rad=sigma_rad,
        )
    ins = InsSettings(grade=GRADES[grade], oscillator=OSCILLATORS["tcxo"])
    own = InertialUnit(readings=readings, settings=ins, levers_m={"bow": np.zeros(3)}, initial=initial)
    return build_predictors(["bow"], settings, unit=own)


def _has_wrong_sky(heard, outcome: Outcome) -> bool | None:
    first = next((e for e in outcome.evidence if e.detector == "prediction" and e.code in CHOSEN), None)
    if first is None:
        return None
    o = heard.reception.observations
    rows = slice(*np.searchsorted(o.gpst, np.array([first.start_gpst, first.end_gpst])))
    shares = heard.false_share[rows][:, [o.signals.index(ref.signal) for ref in first.signals]]
    return bool(np.nanmean(shares > 0.5) > 0.5)


def find_choice(found: Judged):
    """Return the finding that chose first, None where none did."""
    return next((e for e in found.outcome.evidence if e.detector == "prediction" and e.code in CHOSEN), None)
