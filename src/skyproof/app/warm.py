"""Compile and cache every kernel, so that no user waits for it: `python -m skyproof.app.warm`, run by `make setup`.

With the name of a job it does that one, and prints the name of each compiled kernel.
"""

import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np

from skyproof.app.common.kernels import JOBS, make_ready
from skyproof.app.common.progress import Stage
from skyproof.app.common.rinex import write_channels
from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import asked
from skyproof.app.receive.inputs import open_inputs, require_recordings
from skyproof.app.receive.tracker import track
from skyproof.compiled import on_compiled
from skyproof.decomposition.fit import bins_dictionary, decompose, taps_dictionary
from skyproof.detectors.dccaf.bursts import Decomposed, build_shapes, fit_components, whiten_taps
from skyproof.detectors.dccaf.inverse_raim import find_passing_sets
from skyproof.detectors.dccaf.skies_fit import fit_skies
from skyproof.formats.layout import Chunk, PackedSamples, Packing
from skyproof.gnss.ephemeris import GlonassEphemeris
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.orbits import compute_satellite_positions_m, compute_satellite_state
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.fix import fix
from skyproof.navigation.sets import find_consistent_sets
from skyproof.navigation.strapdown import navigate_paths
from skyproof.simulator import scenes
from skyproof.simulator.attacks import Interference
from skyproof.simulator.files import write
from skyproof.simulator.measurements import simulate_observations
from skyproof.simulator.scenario import FrontEnd
from skyproof.statistics.directions import hemisphere


def _run_receiver() -> None:
    """Run simulator and receiver for seconds of one receiver under a meaconer.

    Until two signals of a satellite are distinguished. Then a moment of each kind of whole bytes behind a filter, one
    beside a line.
    """
    scenario = scenes.make_meaconed(duration_s=2.2, onset_s=-1.0)
    scenario = scenario.model_copy(update={"receivers": scenario.receivers[:1]})
    navigation = make_nominal_constellation(scenario.start_gpst)
    line = Interference(kind="cw", transmit=scenario.attacks[0].transmit, power_db=20.0, offset_hz=1e5)
    with tempfile.TemporaryDirectory() as folder:
        recordings = write(scenario, navigation, Path(folder) / "bits")
        track(require_recordings(open_inputs(recordings, Settings())), Settings(), asked=asked())
        for bits, lines in ((8, (line,)), (16, ())):
            front_end = FrontEnd(encoding="int", bits=bits, bandwidth_hz=2e6)
            changed = {"duration_s": 0.1, "front_end": front_end, "interference": lines, "attacks": ()}
            recordings = write(scenario.model_copy(update=changed), navigation, Path(folder) / f"int{bits}")
            track(require_recordings(open_inputs(recordings, Settings())), Settings())
    _read_packed()


def _read_packed() -> None:
    """Read numbers of 12 bits, which no front end of the simulator gives."""
    packing = Packing(kind="complex", encoding="int", bits=12)
    PackedSamples(np.zeros(3, np.uint8), packing, [Chunk(0, 1)]).read(0, 1)


def _run_overlaps() -> None:
    """Run what needs more than one signal of a satellite within a chip."""
    rng, delays = np.random.default_rng(1), taps_dictionary(tuple(np.linspace(-2.0, 2.0, 21)), 5e6, GPS_L1_CA)
    noise = rng.standard_normal((2, 2, 21)) + 1j * rng.standard_normal((2, 2, 21))
    decompose(noise[:, 0], delays)
    decompose(noise, delays, bins_dictionary(0.02, (0.0, 25.0), within_hz=60.0))
    taps, noise_variance, n = rng.normal(0.0, 50.0, (4, 9)) + 1j * rng.normal(0.0, 50.0, (4, 9)), np.ones(4), 5
    code_shapes = build_shapes(GPS_L1_CA, 7, tuple(np.linspace(-1.0, 1.0, 9)), 2e6, 1.0)
    found = fit_components(taps[None], code_shapes, noise_variance[None])
    fit_skies(
        [Decomposed(whiten_taps(taps, code_shapes, noise_variance), code_shapes, found)] * n,
        rng.standard_normal((n, 3)),
        np.zeros(n),
        np.ones(n),
        np.full(n, GPS_L1_CA.chip_m),
        window_chips=1.0,
        set_probability=1e-3,
        most_doubt=1e-3,
    )


def _run_positions() -> None:
    """Compute two skies of one receiver and write them, and integrate an orbit of GLONASS."""
    scenario = scenes.make_meaconed(duration_s=3.0, onset_s=-1.0)
    navigation = make_nominal_constellation(scenario.start_gpst)
    (observations, *_), _ = simulate_observations(scenario, navigation, rng=np.random.default_rng(1))
    sets = find_consistent_sets(observations, navigation)
    fix(observations, navigation, signals=sets[0].signals)
    week, tow_s = week_and_tow(scenario.start_gpst)
    glonass = GlonassEphemeris(
        sat="R01",
        week=int(week),
        toe=float(tow_s),
        tau_n=0.0,
        gamma_n=0.0,
        frequency_number=1,
        position_m=(2.55e7, 0.0, 0.0),
        velocity_m_s=(0.0, 3.9e3, 0.0),
        acceleration_m_s2=(0.0, 0.0, 0.0),
    )
    compute_satellite_state(glonass, scenario.start_gpst)
    compute_satellite_positions_m((glonass,), scenario.start_gpst)
    with tempfile.TemporaryDirectory() as folder:
        write_channels(Path(folder) / "bow.obs", observations, "warm", None, sets[0].signals)


def _run_methods() -> None:
    """Run what a study or an inertial unit needs."""
    rng = np.random.default_rng(1)
    for exhaustive in (True, False):
        find_passing_sets(hemisphere(9)[:6], rng.standard_normal((6, 2)), 1.0, exhaustive=exhaustive)
    navigate_paths(np.array([6.4e6, 0.0, 0.0]), np.zeros(3), np.eye(3), np.ones((2, 3)), np.zeros((2, 3)), 0.01)


_DO: Final[Mapping[str, Callable[[], None]]] = {
    "overlaps": _run_overlaps,
    "receiver": _run_receiver,
    "positions": _run_positions,
    "methods": _run_methods,
}


class _Printed:
    """Progress as lines on standard error, one every ten seconds."""

    def __init__(self) -> None:
        self._total, self._begun_s, self._said_s = 0.0, time.monotonic(), 0.0

    def advance(self, to: float) -> None:
        spent_s = time.monotonic() - self._begun_s
        if spent_s - self._said_s >= 10.0:
            self._said_s = spent_s
            self.say(f"{to:.0f} of {self._total:.0f} kernels compiled in {spent_s:.0f} s")

    def say(self, text: str) -> None:
        print(text, file=sys.stderr)

    @contextmanager
    def stage(self, name: str, total: float | None) -> Iterator[Stage]:
        self._total = total or 0.0
        self.say(f"{name}: {self._total:.0f}")
        yield self


def warm(job: str | None = None) -> None:
    """Do one job here and print the compiled kernels, or do all jobs in parallel processes."""
    if job is None:
        return make_ready(tuple(JOBS), _Printed())
    on_compiled(lambda name: print(name, flush=True))
    _DO[job]()


if __name__ == "__main__":
    warm(*sys.argv[1:2])
