"""What each detector asks, in words."""

import pytest

from skyproof.detectors.registry import is_ours, load_detectors
from skyproof.report.methods import about, title


@pytest.mark.parametrize("name", sorted(name for name, kind in load_detectors().items() if is_ours(kind())))
def test_every_detector_has_a_heading_and_a_question(name):
    assert title(name) != name.replace("_", " ")
    assert about(name).endswith("?")
