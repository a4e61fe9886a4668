"""What is said of a recording in which signals are few or short."""

import pytest

from skyproof.app.receive.diagnosis import Diagnosis


@pytest.mark.parametrize(("mirrored", "n_sats", "misread"), [(False, 10, False), (False, 2, True), (True, 10, True)])
def test_a_recording_of_enough_satellites_keeps_its_layout(mirrored, n_sats, misread):
    # Though its signals are lost often, as under reflections or a jammer.
    assert Diagnosis(mirrored=mirrored, cure="check rate_hz", n_sats=n_sats).is_misread is misread
