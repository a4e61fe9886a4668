import importlib.metadata
from types import SimpleNamespace

import numpy as np
import pytest

from skyproof.detectors import base
from skyproof.detectors.multi_receiver.detector import MultiReceiver
from skyproof.errors import SettingsError
from skyproof.records import Records

START = np.datetime64("2022-01-01", "ns")


def test_our_detectors_are_found_by_their_entry_points():
    found = base.load_detectors()
    pair = {"multi_receiver", "second_signals", "residual"}
    ours = pair | {"array_common", "dccaf", "ins_array", "spin", "sqm", "vector_sqm"} | {"common_change", "continuity"}
    assert ours <= set(found)
    assert list(found) == sorted(found)
    assert all(isinstance(made(), base.Detector) and made.name == name for name, made in found.items())


def test_a_detector_that_cannot_be_loaded_is_named_with_its_package(monkeypatch):
    point = importlib.metadata.EntryPoint("odd", "nowhere.at.all:Odd", "skyproof.detectors")
    broken = SimpleNamespace(name="odd", value=point.value, load=point.load, dist=SimpleNamespace(name="odd-package"))
    monkeypatch.setattr(base, "entry_points", lambda group: [broken])
    with pytest.raises(SettingsError, match=r"'odd' of odd-package cannot be loaded from nowhere.at.all:Odd"):
        base.load_detectors()


def test_what_is_missing_is_given_in_the_words_of_the_user():
    (evidence,) = base.missing(MultiReceiver(), Records(start_gpst=START, end_gpst=START))
    assert evidence.says == "undecided"
    assert "second receiver nearby" in evidence.would_need
    assert "5 satellites" in evidence.would_need
