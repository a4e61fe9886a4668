"""Observations that remain for a trusted fix."""

import numpy as np

from skyproof.fusion.labels import LabelledSignal
from skyproof.fusion.trusted import apply_mask, carries, fix_of, mask_signals
from skyproof.records import NavigationData


def label(invented, name, word, first, last, receiver="rx1"):
    return LabelledSignal(ref=invented.ref(name, receiver), label=word, first_epoch=first, last_epoch=last, because=())


def test_only_cells_with_the_label_are_left(invented):
    o = invented.observations(("G05a", "G05b"))
    labels = [
        label(invented, "G05a", "authentic", 0, 19),
        label(invented, "G05a", "spoofed", 20, 39),
        label(invented, "G05b", "authentic", 30, 39, "rx2"),
        label(invented, "G05b", "unknown", 0, 39),
    ]
    part = apply_mask(o, carries(o, labels, "authentic"))
    assert np.isfinite(part.pseudorange_m[:20, 0]).all()
    assert np.isnan(part.pseudorange_m[20:, 0]).all()
    assert np.isnan(part.pseudorange_m[:, 1]).all()
    assert np.array_equal(part.status == 1, np.isnan(part.pseudorange_m))  # every missing cell says why
    assert np.isfinite(o.pseudorange_m).all()  # the record given stays


def test_only_leaves_the_signals_named(invented):
    o = invented.observations(("G05a", "G05b", "G07a"))
    part = apply_mask(o, mask_signals(o, [invented.ref("G05b").signal]))
    assert np.isfinite(part.pseudorange_m).tolist() == [[False, True, False]] * 40


def test_fewer_than_four_signals_are_no_fix(invented):
    o = invented.observations(("G05a", "G07a", "G10a"))
    navigation = NavigationData(ephemerides=())
    assert fix_of(o, navigation, multipath_sigma_m=1.0, elevation_mask_deg=5.0) is None


def test_two_signals_of_one_satellite_are_neither_used(invented):
    # Both labelled authentic: it is open which is meant.
    o = invented.observations(("G05a", "G05b", "G07a", "G10a", "G13a"))
    navigation = NavigationData(ephemerides=())
    assert fix_of(o, navigation, multipath_sigma_m=1.0, elevation_mask_deg=5.0) is None
    apart = invented.observations(
        ("G05a", "G05b", "G07a", "G10a", "G13a"), there={"G05a": (0, 19), "G05b": (20, 39)}
    )  # one after the other
    fix = fix_of(apart, navigation, multipath_sigma_m=1.0, elevation_mask_deg=5.0)
    assert len(fix.signals) == 5
