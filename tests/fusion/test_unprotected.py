"""Which signals a receiver without protection follows."""

from dataclasses import replace

import numpy as np

from skyproof.fusion import unprotected


def set_cn0(o, **dbhz):
    """Set the C/N0 of each signal: G05a=45."""
    names = [f"{signal.sat}{signal.copy}" for signal in o.signals]
    cn0_dbhz = np.where(np.isfinite(o.pseudorange_m), [dbhz[name] for name in names], np.nan)
    return replace(o, cn0_dbhz=cn0_dbhz)


def list_followed(o):
    """List the column followed at each epoch; -1 for none, and never two."""
    columns = unprotected.followed(o)
    assert columns.sum(axis=1).max() <= 1
    return np.where(columns.any(axis=1), columns.argmax(axis=1), -1)


def test_a_signal_is_followed_whatever_stronger_one_comes(invented):
    o = invented.observations(("G05a", "G05b"), there={"G05b": (10, 39)})
    assert (list_followed(set_cn0(o, G05a=40.0, G05b=55.0)) == 0).all()


def test_after_jamming_the_strongest_signal_is_taken(invented):
    # Even where the one that it followed before is received again.
    o = invented.observations(("G05a", "G05b"), there={"G05b": (20, 39)})
    jammed = np.arange(40)[:, None] // 5 == 3
    o = replace(o, pseudorange_m=np.where(jammed, np.nan, o.pseudorange_m))
    assert list_followed(set_cn0(o, G05a=40.0, G05b=48.0)).tolist() == [0] * 15 + [-1] * 5 + [1] * 20
    assert list_followed(set_cn0(o, G05a=48.0, G05b=40.0)).tolist() == [0] * 15 + [-1] * 5 + [0] * 20


def test_the_strongest_is_taken_of_what_comes_while_it_searches(invented):
    # True signals that loops coasted for are back at once, false ones have to be found first.
    o = invented.observations(("G05a", "G05b"), there={"G05b": (22, 39)})
    jammed = np.arange(40)[:, None] // 5 == 3
    o = replace(o, pseudorange_m=np.where(jammed, np.nan, o.pseudorange_m))
    assert list_followed(set_cn0(o, G05a=40.0, G05b=48.0)).tolist() == [0] * 15 + [-1] * 7 + [1] * 18
    late = replace(o, elapsed_s=2.0 * o.elapsed_s)
    assert list_followed(set_cn0(late, G05a=40.0, G05b=48.0)).tolist() == [0] * 15 + [-1] * 5 + [0] * 20


def test_a_single_missing_epoch_hands_nothing_over(invented):
    o = invented.observations(("G05a", "G05b"))
    o = replace(
        o,
        elapsed_s=0.2 * o.elapsed_s,
        pseudorange_m=np.where((np.arange(40) == 20)[:, None] & [True, False], np.nan, o.pseudorange_m),
    )
    assert list_followed(set_cn0(o, G05a=50.0, G05b=49.0)).tolist() == [0] * 20 + [-1] + [0] * 19


def test_each_satellite_has_its_own(invented):
    o = invented.observations(("G05a", "G05b", "G07a"))
    columns = unprotected.followed(set_cn0(o, G05a=40.0, G05b=45.0, G07a=30.0))
    assert columns.all(axis=0).tolist() == [False, True, True]
