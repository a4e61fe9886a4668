"""Compile and cache every kernel, so that no user waits for it: `python -m skyproof.app.warm`, run by `make setup`."""

import tempfile
from pathlib import Path

from skyproof.app.receive import receive
from skyproof.gnss.nominal import nominal_constellation
from skyproof.simulate import scenes
from skyproof.simulate.files import write


def warm() -> None:
    """A fraction of a second through simulator and receiver."""
    scenario = scenes.demo(duration_s=0.3, onset_s=0.1)
    with tempfile.TemporaryDirectory() as folder:
        recordings = write(scenario, nominal_constellation(scenario.start_gpst), Path(folder))
        receive(recordings)


if __name__ == "__main__":
    warm()
