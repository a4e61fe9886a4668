"""Compile and cache every kernel, so that no user waits for it: `python -m skyproof.app.warm`, run by `make setup`."""

import tempfile
from pathlib import Path

from skyproof.app.reception import open_inputs, track
from skyproof.app.settings import Settings
from skyproof.gnss.nominal import nominal_constellation
from skyproof.simulate import scenes
from skyproof.simulate.files import write


def warm() -> None:
    """A fraction of a second through simulator and receiver: too short to hear anything, long enough to compile."""
    scenario = scenes.demo(duration_s=0.3, onset_s=0.1)
    with tempfile.TemporaryDirectory() as folder:
        recordings = write(scenario, nominal_constellation(scenario.start_gpst), Path(folder))
        track(open_inputs(recordings, Settings()), Settings())


if __name__ == "__main__":
    warm()
