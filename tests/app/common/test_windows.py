import numpy as np
import pytest

from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import RECEIVED, detectors_for
from skyproof.detectors.base import load_detectors
from skyproof.records import Records, SpinArm

START = np.datetime64("2022-01-01", "ns")
ARM = SpinArm(receiver="rx1", radius_m=0.1, rate_rad_s=1.0)


def share(run):
    (peaks,) = (d for d in detectors_for(Settings(), run) if d.name == "peaks")
    return peaks.settings.false_alarm_probability


def test_a_detector_without_its_equipment_gets_no_share_of_the_false_alarms():
    settings = Settings()
    of_a_window = settings.false_alarm_probability_per_hour * settings.window_s / 3600.0
    bare = Records(start_gpst=START, end_gpst=START)
    turning = Records(start_gpst=START, end_gpst=START, spin_arms=(ARM,))
    usual = [name for name, kind in load_detectors().items() if RECEIVED.issuperset(kind().needs)]
    assert {"multi_receiver", "peaks", "residual"} <= set(usual)
    assert share(bare) == pytest.approx(of_a_window / len(usual))
    assert share(turning) == pytest.approx(of_a_window / (len(usual) + 1))
