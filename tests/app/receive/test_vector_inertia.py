"""Vector tracking carried by an inertial unit, behind drawn correlators: the scenes of `bench/vector_inertia.py`."""

import importlib
import sys
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def bench():
    sys.path.insert(0, str(Path(__file__).parents[3] / "bench"))
    try:
        yield importlib.import_module("vector_inertia")
    finally:
        sys.path.pop(0)


@pytest.fixture(scope="module")
def way(bench):
    return bench.scene(seconds=13.0)


def test_a_unit_carries_all_channels_through_a_blockage_at_2_g(bench, way):
    found = bench.passage(way, bench.unit_of(way), 3.0, 1)
    assert found.carried
    assert found.off_m < 1.5
    assert (found.anew, found.given_up) == (0, 0)


@pytest.mark.long
def test_without_a_unit_they_are_lost(bench, way):
    found = bench.passage(way, None, 3.0, 1)
    assert not found.carried
    assert found.off_m > 10.0


@pytest.mark.long
def test_a_wrongly_stated_unit_is_given_up_without_loss(bench, way):
    found = bench.passage(way, bench.unit_of(way, 180.0), 0.0, 1)
    assert (found.carried, found.anew) == (False, 0)
    assert found.given_up >= 1
    assert found.off_m < 20.0
