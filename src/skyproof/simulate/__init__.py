"""Scenes to samples and measurements, with the truth. Knows no receiver and no detector: none hides its faults."""

from skyproof.simulate.constellation import navigation_of
from skyproof.simulate.correlators import CorrelatorOutputs, aligned, correlate
from skyproof.simulate.document import truth_of
from skyproof.simulate.field_errors import FieldErrors
from skyproof.simulate.files import write
from skyproof.simulate.measurements import NoiseModel, draw, geometry_of, observations_of
from skyproof.simulate.samples import samples_of
from skyproof.simulate.scenario import (
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
from skyproof.simulate.scenes import ReadyMade, clean, demo, meaconed, ready, ready_made
from skyproof.simulate.sky import scene_of
from skyproof.simulate.truth import imus_of, signal_truth, trajectory_truth

__all__ = [
    "Antenna", "CorrelatorOutputs", "FieldErrors", "FrontEnd", "Imu", "Interference", "Meaconer", "Multipath",
    "NoiseModel", "Place", "ReadyMade", "Receiver", "Scenario", "Site", "Sky", "Spin", "Spoofer", "Takeover", "aligned",
    "clean", "correlate", "demo", "draw", "geometry_of", "imus_of", "meaconed", "navigation_of", "observations_of",
    "parse_scenario", "read_scenario", "ready", "ready_made", "samples_of", "scene_of", "signal_truth",
    "trajectory_truth", "truth_of", "write",
]  # fmt: skip
