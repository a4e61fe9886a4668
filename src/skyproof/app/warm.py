"""Compile and cache every kernel, so that no user waits for it: `python -m skyproof.app.warm`, run by `make setup`."""

import tempfile
from pathlib import Path

from skyproof.app.reception import open_inputs, track
from skyproof.app.settings import Settings
from skyproof.gnss.nominal import nominal_constellation
from skyproof.simulate import scenes
from skyproof.simulate.files import write
from skyproof.simulate.scenario import FrontEnd


def warm() -> None:
    """Seconds under a meaconer through simulator and receiver, until two signals of a satellite are told apart, then a
    moment of each kind of whole bytes behind a filter: all that is compiled.
    """
    scenario = scenes.demo(duration_s=2.2, onset_s=-1.0)
    with tempfile.TemporaryDirectory() as folder:
        recordings = write(scenario, nominal_constellation(scenario.start_gpst), Path(folder) / "bits")
        track(open_inputs(recordings, Settings()), Settings())
        for bits in (8, 16):
            front_end = FrontEnd(encoding="int", bits=bits, bandwidth_hz=2e6)
            short = scenario.model_copy(update={"duration_s": 0.1, "front_end": front_end})
            recordings = write(short, nominal_constellation(scenario.start_gpst), Path(folder) / f"int{bits}")
            track(open_inputs(recordings, Settings()), Settings())


if __name__ == "__main__":
    warm()
