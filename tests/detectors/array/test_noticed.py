"""What an array says that it would have noticed, it notices."""

import numpy as np
import pytest
from tests.detectors.array.test_array_common import SKY
from tests.detectors.nulls import ELEMENTS_M, SIGNALS, TRUE, draw_array_phases, draw_array_records, make_window

from skyproof.detectors.array.array_common import ArrayCommon, ArrayCommonSettings
from skyproof.detectors.array.ins_array import InsArray, InsArraySettings


def read_noticed(detector, records):
    found, _ = detector.examine(records)
    return {attack.kind: attack.size for finding in found for attack in finding.noticed}


def test_the_stated_number_of_imitated_satellites_is_found():
    detector = ArrayCommon(ArrayCommonSettings(false_alarm_probability=1e-4))
    count = int(
        read_noticed(detector, make_window(draw_array_phases(np.random.default_rng(1), SKY)))["one_transmitter"]
    )
    assert 3 <= count < len(SKY)
    for seed in range(10):
        rng = np.random.default_rng([2, seed])
        towards = SKY.copy()
        towards[:count] = SKY[rng.integers(count)]
        found, _ = detector.examine(make_window(draw_array_phases(rng, towards)))
        assert any(finding.says == "spoofed" for finding in found)


@pytest.mark.parametrize("signal", [0, 3, 6])
def test_a_false_signal_from_as_far_as_is_said_is_noticed(monkeypatch, signal):
    # Nearly always: 24 of 24. Half a wavelength leaves no whole cycles open.
    monkeypatch.setattr("tests.detectors.nulls.ELEMENTS_M", 0.5 * ELEMENTS_M)
    detector = InsArray(InsArraySettings(false_alarm_probability=1e-3, pattern_sigma_m=0.0))
    angle_rad = read_noticed(detector, draw_array_records(np.random.default_rng(3)))["elsewhere"]
    assert np.radians(2.0) < angle_rad < np.radians(60.0)
    rng = np.random.default_rng([4, signal])
    tried = 0
    while tried < 24:
        towards = TRUE.copy()
        true = towards[0, signal]
        across = np.cross(true, rng.normal(size=3))
        moved = np.cos(angle_rad) * true + np.sin(angle_rad) * across / np.linalg.norm(across)
        if moved[2] > 0.0:  # down is positive in the body
            continue
        tried += 1
        towards[:, signal] = moved
        found, _ = detector.examine(draw_array_records(rng, towards))
        assert all(finding.code != "all_from_satellites" for finding in found)
        assert SIGNALS[signal] not in {ref.signal for f in found if f.says == "authentic" for ref in f.signals}
