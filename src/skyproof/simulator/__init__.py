"""Scenes to samples and measurements, with the truth. Knows no receiver and no detector: none hides its faults."""

from skyproof.simulator.constellation import navigation_of
from skyproof.simulator.correlators import CorrelatorOutputs, aligned, correlate
from skyproof.simulator.files import write
from skyproof.simulator.measurement_errors import FieldErrors
from skyproof.simulator.measurements import NoiseModel, draw, geometry_of, observations_of
from skyproof.simulator.samples import samples_of
from skyproof.simulator.scenario import (
    Antenna,
    FrontEnd,
    Imu,
    Interference,
    Meaconer,
    Multipath,
    Place,
    Receiver,
    Scenario,
    Site,
    Sky,
    Spin,
    Spoofer,
    Takeover,
    parse_scenario,
    read_scenario,
)
from skyproof.simulator.scenes import ReadyMade, clean, demo, meaconed, ready, ready_made
from skyproof.simulator.sky import scene_of
from skyproof.simulator.truth import imus_of, signal_truth, trajectory_truth
from skyproof.simulator.truth_document import truth_of

__all__ = [
    "Antenna",
    "CorrelatorOutputs",
    "FieldErrors",
    "FrontEnd",
    "Imu",
    "Interference",
    "Meaconer",
    "Multipath",
    "NoiseModel",
    "Place",
    "ReadyMade",
    "Receiver",
    "Scenario",
    "Site",
    "Sky",
    "Spin",
    "Spoofer",
    "Takeover",
    "aligned",
    "clean",
    "correlate",
    "demo",
    "draw",
    "geometry_of",
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
