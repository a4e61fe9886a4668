"""Signals from elsewhere than their satellites: what reflections explain, by delay and strength."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.array.reflected import select_reflections
from skyproof.testing import MeasuredScene, TrackErrors

SCENE = MeasuredScene(antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, errors=TrackErrors(0.3, 0.0, 0.0))


@pytest.mark.parametrize(
    ("late_m", "stronger_db", "late"),
    [(0.0, 0.0, False), (40.0, -3.0, True), (0.0, 5.5, False), (0.0, 6.5, None), (-150.0, -3.0, None)],
    ids=["as the direct signal", "late", "sum of both", "stronger than a sum", "early"],
)
def test_a_reflection_or_its_sum_with_the_direct_signal_explains_a_signal(late_m, stronger_db, late):
    # A clean sky of an arm was spoofed: the strongest satellite's sum with a reflection was stronger than all others.
    records = SCENE.records(np.random.default_rng(3))
    (o,), (place,) = records.observations, records.sets
    other, *true = o.signals
    first = np.arange(len(o.signals)) == 0
    strongest_dbhz = float(np.nanmedian(o.cn0_dbhz[:, ~first], axis=0).max())
    o = replace(
        o,
        pseudorange_m=o.pseudorange_m + late_m * first,
        cn0_dbhz=np.where(first, strongest_dbhz + stronger_db, o.cn0_dbhz),
    )
    found = select_reflections(
        o,
        records.navigation,
        place.position_ecef_m,
        true,
        [other],
        multipath_sigma_m=1.0,
        ionosphere_share=0.0,
    )
    assert found == ({} if late is None else {other: late})
