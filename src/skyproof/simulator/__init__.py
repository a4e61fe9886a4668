"""Scenes to samples and measurements, with the truth. Knows no receiver and no detector: none hides its faults."""

from skyproof.simulator.constellation import navigation_of
from skyproof.simulator.correlators import CorrelatorOutputs, correlate
from skyproof.simulator.files import write
from skyproof.simulator.measurement_errors import FieldErrors
from skyproof.simulator.measurements import NoiseModel, draw, ideal_measurements_of, observations_of
from skyproof.simulator.samples import samples_of
from skyproof.simulator.scenario import (
    Antenna,
    FrontEnd,
    Interference,
    Meaconer,
    Multipath,
    Scenario,
    SceneImu,
    ScenePlace,
    SceneReceiver,
    SceneSpin,
    Site,
    Sky,
    Spoofer,
    Takeover,
    parse_scenario,
    read_scenario,
)
from skyproof.simulator.scenes import ReadyMade, clean, demo, meaconed, ready, ready_made
from skyproof.simulator.sky import scene_of
from skyproof.simulator.tracked import aligned
from skyproof.simulator.truth import imus_of, signal_truth, trajectory_truth
from skyproof.simulator.truth_document import truth_of

__all__ = [
    "Antenna",
    "CorrelatorOutputs",
    "FieldErrors",
    "FrontEnd",
    "Interference",
    "Meaconer",
    "Multipath",
    "NoiseModel",
    "ReadyMade",
    "Scenario",
    "SceneImu",
    "ScenePlace",
    "SceneReceiver",
    "SceneSpin",
    "Site",
    "Sky",
    "Spoofer",
    "Takeover",
    "aligned",
    "clean",
    "correlate",
    "demo",
    "draw",
    "ideal_measurements_of",
    "imus_of",
    "meaconed",
    "navigation_of",
    "observations_of",
    "parse_scenario",
    "read_scenario",
    "ready",
    "ready_made",
    "samples_of",
    "scene_of",
    "signal_truth",
    "trajectory_truth",
    "truth_of",
    "write",
]
