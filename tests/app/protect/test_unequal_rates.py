"""Two logs of unequal rates, clocks free and epochs not aligned: the answer is that of equal rates."""

import numpy as np
import pytest

from skyproof.app.protect.run import protect
from skyproof.logs.ubx_write import ubx_log
from skyproof.records import Observations, ReceiverFixes
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

APART_M = 20.0


def take_every(o: Observations, number: int) -> Observations:
    """Return every n-th epoch."""
    return o.select(np.arange(0, o.gpst.size, number))


def write_log(o: Observations, scene: MeasuredScene, path) -> None:
    at = np.full(o.gpst.size, np.radians(59.0)), np.full(o.gpst.size, np.radians(17.0)), np.full(o.gpst.size, 100.0)
    path.write_bytes(b"".join(ubx_log(o, scene.navigation, ReceiverFixes.from_geodetic(o.gpst, *at))))


@pytest.mark.parametrize(
    ("step_s", "numbers", "seconds"),
    [(1.0, (1, 1), 60), (0.2, (5, 1), 60), (0.04, (25, 1), 24)],
    ids=["1 and 1 Hz", "1 and 5 Hz", "1 and 25 Hz"],
)
@pytest.mark.parametrize(("false", "word"), [((), "authentic"), ((FalseSky(),), "spoofed")], ids=["clean", "attacked"])
def test_rates_change_no_answer(tmp_path, step_s, numbers, seconds, false, word) -> None:
    scene = MeasuredScene(
        antennas_enu_m={"rx1": (0.0, 0.0, 0.0), "rx2": (APART_M, 0.0, 0.0)},
        sky=None if not false else (),
        epochs=round(seconds / step_s),
        step_s=step_s,
        errors=TrackErrors(sigma_m=0.5),
        false=false,
    )
    for o, number in zip(scene.records(np.random.default_rng(1)).observations, numbers, strict=True):
        write_log(take_every(o, number), scene, tmp_path / f"{o.receiver}.ubx")
    logs = [tmp_path / "rx1.ubx", tmp_path / "rx2.ubx"]
    assert protect(logs, antenna_distance_m=APART_M).verdict.verdict == word
