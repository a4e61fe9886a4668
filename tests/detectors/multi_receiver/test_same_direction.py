"""A true sky's signals that the antenna of false ones could have sent as well are vouched for by nothing."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.multi_receiver.pairing import pair_up
from skyproof.detectors.multi_receiver.same_direction import withhold_doubtful
from skyproof.detectors.multi_receiver.settings import MultiReceiverSettings
from skyproof.records import Cause, Finding, Hypothesis, SignalRef
from skyproof.testing import FalseSky, MeasuredScene

FAR_M = 50_000.0


def make_scene(azimuth_rad):
    antenna = (FAR_M * np.sin(azimuth_rad), FAR_M * np.cos(azimuth_rad), 0.0)
    return MeasuredScene(false=(FalseSky(antenna_enu_m=antenna, shows_enu_m=(300.0, 0.0, 0.0)),))


def pair_true_sets(records):
    """Return the pairing of the true sets."""
    true = tuple(next(s for s in records.sets if s.receiver == r) for r in ("rx1", "rx2"))
    return pair_up(records, true, MultiReceiverSettings().noise(1), min_satellites=5)


@pytest.fixture(scope="module")
def behind():
    """Make records in which one satellite's range differs between receivers as the false antenna's does."""
    plain = pair_true_sets(make_scene(0.0).records(np.random.default_rng(1)))
    east = plain.unit_enu[:, 0]
    k = int(np.argmin(np.abs(east - 0.3)))
    records = make_scene(np.arcsin(east[k])).records(np.random.default_rng(2))
    return records, pair_true_sets(records), plain.ranges.sats[k]


def examine_all(records, sky, imitated, **data):
    false = [SignalRef(r, s) for r in sky.receivers for s in records.sets[1].signals if s.sat in imitated]
    window = {"detector": "multi_receiver", "start_gpst": records.start_gpst, "end_gpst": records.end_gpst}
    window |= {"hypothesis": Hypothesis.ONE_ANTENNA, "alpha": 1e-3, "singled_out": True}
    true = Finding(**window, signals=sky.subject, code="beside_false_sky", p={Cause.FALSE_SKY: 1e-9}, data={"group": 1})
    imitated = Finding(**window, signals=tuple(false), code="least_contrast", p={Cause.CLEAN: 1e-9}, data=data)
    return [true, imitated]


def test_a_satellite_behind_the_antenna_needs_a_known_false_one(behind):
    records, sky, sat = behind
    other_sats = [s for s in sky.ranges.sats if s != sat]
    kept, spoofed = withhold_doubtful(records, [sky], examine_all(records, sky, other_sats))
    assert {ref.signal.sat for ref in sky.subject} - {ref.signal.sat for ref in kept.signals} == {sat}
    assert (kept.says, kept.data["doubtful"]) == ("authentic", 1)
    assert set(kept.withheld) == set(sky.subject) - set(kept.signals)
    assert spoofed.says == "spoofed"
    whole = examine_all(records, sky, sky.ranges.sats)
    assert withhold_doubtful(records, [sky], whole) == whole


def test_signals_of_unknown_antennas_make_none_doubtful(behind):
    records, sky, sat = behind
    kept = examine_all(records, sky, [s for s in sky.ranges.sats if s != sat], whole_sky=True)
    assert withhold_doubtful(records, [sky], kept) == kept


def test_three_satellites_that_are_left_are_not_authentic(behind):
    records, sky, sat = behind
    other_sats = [s for s in sky.ranges.sats if s != sat]
    true, false = examine_all(records, sky, other_sats)
    few = replace(true, signals=tuple(ref for ref in true.signals if ref.signal.sat in (sat, *other_sats[:3])))
    kept, _ = withhold_doubtful(records, [sky], [few, false])
    assert (kept.says, kept.code, kept.group) == ("undecided", "few_without_doubtful", None)
    assert kept.data["found"] == "beside_false_sky"


def test_a_false_signal_is_doubtful_with_the_stated_chance():
    rng, kept, drawn = np.random.default_rng(3), 0, 40
    for _ in range(drawn):
        records = make_scene(rng.uniform(0.0, 2.0 * np.pi)).records(rng)
        sky = pair_true_sets(records)
        sat = sky.ranges.sats[0]
        # The sky has the false signal of a satellite in place of its own.
        mixed = tuple(
            replace(s, signals=tuple(sorted([f for f in other.signals if f.sat == sat] + list(s.signals[1:]))))
            for s, other in zip(sky.sets, [s for s in records.sets if s not in sky.sets], strict=True)
        )
        wrong = pair_up(records, mixed, sky.noise, min_satellites=5)
        (true, _) = withhold_doubtful(
            records, [wrong], examine_all(records, wrong, [s for s in sky.ranges.sats if s != sat])
        )
        kept += sat in {ref.signal.sat for ref in true.signals}
    assert kept == 0
