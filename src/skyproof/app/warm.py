"""Compile and cache every kernel, so that no user waits for it: `python -m skyproof.app.warm`, run by `make setup`."""

import tempfile
from pathlib import Path

import numpy as np

from skyproof.app.common.settings import Settings
from skyproof.app.receive.inputs import only_recordings, open_inputs
from skyproof.app.receive.tracker import track
from skyproof.app.scenes.simulate import simulate
from skyproof.decomposition.fit import (
    blocks_dictionary,
    decompose,
    delay_bound,
    delay_dictionary,
    simulate_taps,
)
from skyproof.detectors.dccaf.inverse_raim import passing_sets
from skyproof.detectors.dccaf.swarm import SwarmSettings, swarm_decompose
from skyproof.gnss.nominal import nominal_constellation
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.navigation.strapdown import strapdown_paths
from skyproof.receiver import kernels as k
from skyproof.receiver.joining import JointReceiver
from skyproof.receiver.joint import bound, predict
from skyproof.simulator import scenes
from skyproof.simulator.files import write
from skyproof.simulator.scenario import FrontEnd
from skyproof.statistics.directions import hemisphere


def warm() -> None:
    """All that is compiled, once."""
    with tempfile.TemporaryDirectory() as folder:
        _receiver(Path(folder))
        simulate("takeover", out=Path(folder) / "measured", depth="measurements")
    _joint_channels()
    _methods()


def _receiver(folder: Path) -> None:
    """Seconds under a meaconer through simulator and receiver, until two signals of a satellite are distinguished, then
    a moment of each kind of whole bytes behind a filter.
    """
    scenario = scenes.meaconed(duration_s=2.2, onset_s=-1.0)
    recordings = write(scenario, nominal_constellation(scenario.start_gpst), folder / "bits")
    track(only_recordings(open_inputs(recordings, Settings())), Settings())
    for bits in (8, 16):
        front_end = FrontEnd(encoding="int", bits=bits, bandwidth_hz=2e6)
        short = scenario.model_copy(update={"duration_s": 0.1, "front_end": front_end})
        recordings = write(short, nominal_constellation(scenario.start_gpst), folder / f"int{bits}")
        track(only_recordings(open_inputs(recordings, Settings())), Settings())


def _joint_channels() -> None:
    """One over a row of noise, and what it needs where a further signal is born."""
    rate_hz = 2.6e6
    loop = np.zeros(k.N_STATE)
    loop[[k.CODE_RATE, k.CN0_DBHZ]] = GPS_L1_CA.chip_rate_hz, 45.0
    receiver = JointReceiver(GPS_L1_CA, rate_hz)
    followed = receiver.begin([], [(0, "G07")], loop[None], np.ones(1, np.bool_), 2.0, 0.0)
    planes = np.random.default_rng(1).standard_normal((2, round(0.23 * rate_hz)), dtype=np.float32)
    receiver.step(followed, planes, 0, {})
    model, joint = receiver.tracker("G07").model, followed[0].state.channel.joint
    bound(predict(joint, model.bit_s).mean, model.row_times_s, model.look_s, model.dictionary)


def _methods() -> None:
    rng = np.random.default_rng(1)
    delays, variance = delay_dictionary(5e6), 1e-3
    taps = simulate_taps(np.zeros((2, 1)), np.ones((2, 1)), variance, delays, rng)
    decompose(taps, delays, noise_variance=variance)
    blocks = blocks_dictionary(0.02, 2, within_hz=60.0)
    decompose(np.repeat(taps[:, None, :], 2, axis=1), delays, blocks, noise_variance=variance)
    delay_bound(np.array([[0.0, 0.25]]), np.ones((1, 2)), variance, delays)
    swarm = SwarmSettings(particles=4, iterations=2, within_hz=0.0)
    swarm_decompose(
        taps[:, None, :], delays.points, settings=swarm, bins_hz=np.zeros(1), coherent_s=0.02, band_hz=5e6, rng=rng
    )
    for exhaustive in (True, False):
        passing_sets(hemisphere(9)[:6], rng.standard_normal((6, 2)), 1.0, exhaustive=exhaustive)
    strapdown_paths(np.array([6.4e6, 0.0, 0.0]), np.zeros(3), np.eye(3), np.ones((2, 3)), np.zeros((2, 3)), 0.01)


if __name__ == "__main__":
    warm()
