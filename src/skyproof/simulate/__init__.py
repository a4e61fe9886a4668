"""Scenes to samples and measurements, with the truth. Knows no receiver and no detector: none hides its faults."""

from skyproof.simulate.constellation import navigation_of
from skyproof.simulate.document import truth_of
from skyproof.simulate.files import write
from skyproof.simulate.measurements import NoiseModel, draw, geometry_of, observations_of
from skyproof.simulate.samples import samples_of
from skyproof.simulate.scenario import (
    FrontEnd,
    Meaconer,
    Place,
    Receiver,
    Scenario,
    Sky,
    Spoofer,
    parse_scenario,
    read_scenario,
)
from skyproof.simulate.scenes import ReadyMade, clean, demo, ready, ready_made
from skyproof.simulate.sky import scene_of
from skyproof.simulate.truth import imus_of, signal_truth, trajectory_truth

__all__ = [
    "FrontEnd", "Meaconer", "NoiseModel", "Place", "ReadyMade", "Receiver", "Scenario", "Sky", "Spoofer", "clean",
    "demo", "draw", "geometry_of", "imus_of", "navigation_of", "observations_of", "parse_scenario", "read_scenario",
    "ready", "ready_made", "samples_of", "scene_of", "signal_truth", "trajectory_truth", "truth_of", "write",
]  # fmt: skip
