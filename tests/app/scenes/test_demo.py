"""The demonstration shows what it is for: an ordinary receiver is led away, a protected one is not."""

import json
from pathlib import Path

import numpy as np
import pytest

from skyproof.app.scenes.demo import demo
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.report.positions import radius_95_m
from skyproof.simulator import scenes
from skyproof.verdict import Position


def convert_ecef_m(place: Position) -> np.ndarray:
    return ecef_from_geodetic(np.radians(place.lat_deg), np.radians(place.lon_deg), place.height_m)


@pytest.mark.long
def test_an_ordinary_receiver_is_dragged_off_a_protected_one_not(tmp_path: Path) -> None:
    verdict = demo(tmp_path).verdict
    assert verdict.verdict == "spoofed"
    for receiver, site in zip(verdict.receivers, scenes.make_demo().receivers, strict=True):
        true_m = ecef_from_geodetic(*site.geodetic_rad)
        assert receiver.trusted_fix is not None
        assert receiver.unprotected_fix is not None
        trusted = receiver.trusted_fix
        assert np.linalg.norm(convert_ecef_m(trusted) - true_m) < radius_95_m(
            trusted.sigma_east_m, trusted.sigma_north_m
        )
        assert np.linalg.norm(convert_ecef_m(receiver.unprotected_fix) - true_m) > 500.0
    labels = {
        (row["receiver"], row["sat"], row["label"])
        for row in json.loads((tmp_path / "verdict.json").read_text())["signals"]
    }
    assert all((receiver, sat, "spoofed") in labels for receiver, sat, label in labels if label == "authentic")
