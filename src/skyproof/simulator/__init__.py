"""Turn scenes into samples and measurements, with the truth.

Knows no receiver and no detector: none hides its faults.
"""

from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.correlators import CorrelatorOutputs, correlate
from skyproof.simulator.files import write
from skyproof.simulator.measurement_errors import FieldErrors
from skyproof.simulator.measurements import NoiseModel, draw, make_ideal_measurements, simulate_observations
from skyproof.simulator.samples import render_samples
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
from skyproof.simulator.scenes import ReadyMade, load_ready_made, make_clean, make_demo, make_meaconed, read_ready_made
from skyproof.simulator.sky import make_scene
from skyproof.simulator.tracked import align_channels
from skyproof.simulator.truth import compute_signal_truth, compute_trajectory_truth, simulate_imus
from skyproof.simulator.truth_document import build_truth

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
    "align_channels",
    "build_truth",
    "compute_signal_truth",
    "compute_trajectory_truth",
    "correlate",
    "draw",
    "load_ready_made",
    "make_clean",
    "make_demo",
    "make_ideal_measurements",
    "make_meaconed",
    "make_navigation",
    "make_scene",
    "parse_scenario",
    "read_ready_made",
    "read_scenario",
    "render_samples",
    "simulate_imus",
    "simulate_observations",
    "write",
]
