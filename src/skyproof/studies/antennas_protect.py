"""The scenes of both papers on antennas through `protect`: how often it names each false signal.

Directions, antennas, noise and errors are those of the papers, the other satellites those of the ready-made scenes of
the same names. They go in as measurements, and the rate of false alarms is that of usual settings: some 1e-6 a window,
where the papers allow each test 1e-2.
"""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from skyproof.app.common.body import Body
from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings
from skyproof.app.protect import judge
from skyproof.gnss.constants import L1_HZ
from skyproof.receiver.observables import build_array_phases
from skyproof.records import (
    AntennaArray,
    ArrayPhases,
    Attitude,
    NavigationData,
    Observations,
    SignalRef,
    SpinArm,
)
from skyproof.simulator import scenes
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.measurements import NoiseModel, simulate_observations
from skyproof.simulator.scenario import Scenario
from skyproof.studies.multi_receiver_protect import build_reception

__all__ = ["count_named_by_arm", "count_named_by_array"]

_PHASE_SIGMA_CYC: Final = 0.01
_ELEMENT_SIGMA_M: Final = 0.003
_ATTITUDE_SIGMA_RAD: Final = float(np.radians(0.05))
_ARRAY_S, _ARRAY_STEP_S = 60.0, 0.2
_ARM_STEP_S: Final = 0.1


def count_named_by_array(scene: str, runs: int, rng: np.random.Generator) -> dict[str, float]:
    """Count in which share of runs of 60 s the false signal of each satellite is called *spoofed*.

    In the result, "true" is the share of runs in which a true signal is called so.
    """
    scenario = _read_scene(scene, _ARRAY_S)
    navigation = make_navigation(scenario)
    exact_m = np.array([antenna.body_m for antenna in scenario.receivers[0].antennas])

    def judge_one() -> dict[str, bool]:
        of_antennas, truth = _observe(scenario, navigation, rng, _ARRAY_STEP_S)
        observed = of_antennas[0]
        phase_cyc = -np.stack([each.carrier_cyc for each in of_antennas], axis=-1)
        phases = build_array_phases(
            observed.receiver,
            observed.signals,
            observed.gpst,
            observed.elapsed_s,
            phase_cyc - np.floor(phase_cyc),
            np.full(phase_cyc.shape, _PHASE_SIGMA_CYC),
            array=AntennaArray(
                elements_m=exact_m + _ELEMENT_SIGMA_M * rng.standard_normal(exact_m.shape),
                sigma_m=_ELEMENT_SIGMA_M,
                pattern_sigma_m=0.0,
                line_bias_cyc=np.zeros(len(exact_m)),
            ),
            carrier_hz=L1_HZ,
        )
        stated = Attitude(
            gpst=observed.gpst[:1],
            angles_rad=_ATTITUDE_SIGMA_RAD * rng.standard_normal((1, 3)),
            sigma_rad=_ATTITUDE_SIGMA_RAD,
        )
        return _judge(observed, truth, navigation, array_phases=phases, body=Body(stated=stated))

    return _count([judge_one() for _ in range(runs)])


def count_named_by_arm(scene: str, n: int, runs: int, rng: np.random.Generator) -> dict[str, float]:
    """Count the same over runs of one window of `n` samples, ten a second, of a turning antenna."""
    scenario = _read_scene(scene, n * _ARM_STEP_S)
    navigation = make_navigation(scenario)
    (receiver,) = scenario.receivers
    spin = receiver.antennas[0].spin
    assert spin is not None
    arm = SpinArm(receiver=receiver.name, radius_m=spin.radius_m, rate_rad_s=2.0 * np.pi * spin.rate_hz)

    def judge_one() -> dict[str, bool]:
        (observed,), truth = _observe(scenario, navigation, rng, _ARM_STEP_S)
        return _judge(observed, truth, navigation, spin_arms=(arm,), window_s=n * _ARM_STEP_S)

    return _count([judge_one() for _ in range(runs)])


def _read_scene(name: str, duration_s: float) -> Scenario:
    return scenes.read_ready_made(name).model_copy(update={"duration_s": duration_s + 1.0})


def _observe(
    scenario: Scenario, navigation: NavigationData, rng: np.random.Generator, step_s: float
) -> tuple[Sequence[Observations], dict[SignalRef, str]]:
    """Draw what each antenna of the receiver measures, and what each signal is."""
    errors = NoiseModel(carrier_sigma_cyc=_PHASE_SIGMA_CYC)
    return simulate_observations(scenario, navigation, rng=rng, interval_s=step_s, noise=errors)


def _judge(
    observed: Observations,
    truth: Mapping[SignalRef, str],
    navigation: NavigationData,
    *,
    window_s: float = 10.0,
    array_phases: ArrayPhases | None = None,
    body: Body | None = None,
    spin_arms: Sequence[SpinArm] = (),
) -> dict[str, bool]:
    """Judge one run; return of each false signal, and of the true ones together, whether it is called spoofed."""
    settings = Settings(window_s=window_s)
    outcome, _ = judge(
        [build_reception(observed, array_phases)], navigation, settings, Silent(), spin_arms=spin_arms, body=body
    )
    said = {item.ref for item in outcome.decision.labels if item.label == "spoofed"}
    named = {
        ref.signal.sat: ref in said
        for ref, label in truth.items()
        if label == "spoofed" and ref.receiver == observed.receiver
    }
    return {**named, "true": any(label == "authentic" and ref in said for ref, label in truth.items())}


def _count(runs: Sequence[Mapping[str, bool]]) -> dict[str, float]:
    return {name: float(np.mean([run[name] for run in runs])) for name in runs[0]}
