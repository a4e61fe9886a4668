"""Positions in stretches are those of the whole run."""

from dataclasses import fields, replace

import numpy as np
import pytest

from skyproof.app.common.settings import Settings
from skyproof.app.protect import positions
from skyproof.app.protect.coasting import usable_fixes
from skyproof.app.protect.hidden import HiddenDrag
from skyproof.app.protect.positions import set_up_positions
from skyproof.formats.pieces import Workspace
from skyproof.formats.spool import ObservationSpool
from skyproof.fusion.decide import WindowWord
from skyproof.fusion.fuse import Decision
from skyproof.fusion.labels import FalseSource, LabelledSignal
from skyproof.fusion.timeline import Onset
from skyproof.records import Fix, FixStatus, SignalRef
from skyproof.testing import FalseSky, MeasuredScene

SCENE = MeasuredScene(
    antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=90, step_s=1.0, max_satellites=8, false=(FalseSky(),)
)
RECORDS = SCENE.records(np.random.default_rng(5))
(WHOLE,) = RECORDS.observations
CLEAN = WHOLE.select_channels([k for k, signal in enumerate(WHOLE.signals) if signal.copy == "a"])


def make_decision():
    """Make a decision: the first copies are true until epoch 60, the second ones false from 30 on."""
    labels = tuple(
        LabelledSignal(ref=SignalRef("rx1", signal), label=label, first_epoch=first, last_epoch=last, because=())
        for signal in WHOLE.signals
        for label, first, last in [("authentic", 0, 59) if signal.copy == "a" else ("spoofed", 30, 89)]
    )
    false = FalseSource(name="S1", signals=tuple(s.ref for s in labels if s.label == "spoofed"))
    return Decision(
        verdict="spoofed",
        labels=labels,
        sources=(false,),
        skies=(),
        onset=Onset(seen=WHOLE.gpst[30], earliest=None),
        until=None,
        open=None,
    )


def read_positions(log, smoothing_s=20.0):
    settings = Settings(smoothing_s=smoothing_s)
    return set_up_positions(log, make_decision(), RECORDS.navigation, settings)


@pytest.fixture
def log():
    log = ObservationSpool(Workspace(), "rx1")
    for first in range(0, 90, 25):
        log.append(WHOLE.read(first, first + 25))
    return log


@pytest.mark.parametrize("epochs", [7, 31, 89])
@pytest.mark.parametrize("kind", ["trusted", "false", "unprotected", "S1"])
def test_stretches_of_any_length_give_what_the_whole_gives(monkeypatch, log, epochs, kind):
    expected = read_positions(WHOLE).whole(kind)
    monkeypatch.setattr(positions, "STRETCH_EPOCHS", epochs)
    found = read_positions(log).whole(kind)
    good = expected.status == 0
    assert good.sum() > 25
    for f in fields(Fix):
        a, b = getattr(expected, f.name), getattr(found, f.name)
        if isinstance(a, np.ndarray) and a.dtype.kind == "f":
            np.testing.assert_allclose(b[good], a[good], rtol=1e-9, atol=1e-6, err_msg=f.name)
    assert np.array_equal(found.status == 0, good)
    assert np.array_equal(found.gpst[good], expected.gpst[good])


def test_a_track_is_what_of_the_fixes_stays_at_hand(monkeypatch):
    whole = read_positions(WHOLE).whole("trusted")
    monkeypatch.setattr(positions, "STRETCH_EPOCHS", 16)
    track = read_positions(WHOLE).track("trusted")
    assert np.array_equal(track.fixed, whole.status == 0)
    np.testing.assert_allclose(track.position_ecef_m[:60], whole.position_ecef_m[:60], atol=1e-6)
    assert np.isnan(track.clock_bias_s[60:]).all()
    assert track.last.gpst.tolist() == whole.gpst[59:60].tolist()
    np.testing.assert_allclose(track.last.covariance_m2[0], whole.covariance_m2[59], rtol=1e-9)


def test_only_trusted_fixes_have_a_level_larger_for_less_risk():
    def levels_of(kind, risk):
        settings = Settings(smoothing_s=20.0, integrity_risk=risk)
        found = set_up_positions(WHOLE, make_decision(), RECORDS.navigation, settings).whole(kind)
        return found.protection_m[found.status == 0]

    often, seldom = levels_of("trusted", 1e-2), levels_of("trusted", 1e-7)
    assert (seldom > often).all()
    assert np.isnan(levels_of("false", 1e-2)).all()
    assert np.isnan(levels_of("unprotected", 1e-2)).all()


@pytest.mark.parametrize(("satellites", "fixes"), [(4, 0), (5, 90)])
def test_what_no_satellite_checks_is_no_fix_to_use(satellites, fixes):
    # One range that is wrong by a kilometre shows in no residual of four.
    log = CLEAN.select_channels(range(satellites))
    labels = [label for label in make_decision().labels if label.ref.signal in log.signals]
    all_day = tuple(replace(label, last_epoch=89) for label in labels if label.label == "authentic")
    result = set_up_positions(log, replace(make_decision(), labels=all_day), RECORDS.navigation, Settings())
    found = sum(int((fix.status == FixStatus.OK).sum()) for _, fix in result.stretches("trusted"))
    assert found == fixes
    ordinary = next(iter(result.stretches("unprotected")))[1]
    assert (ordinary.status == FixStatus.OK).all()


def test_what_there_is_no_fix_of_is_none():
    false = tuple(s for s in make_decision().labels if s.label == "spoofed")
    found = set_up_positions(WHOLE, replace(make_decision(), labels=false), RECORDS.navigation, Settings())
    assert found.track("trusted") is None
    assert found.whole("trusted") is None
    assert found.track("false") is not None


def clean_positions(labels=(), *, suspect_from=None, hidden=None, **settings):
    windows = () if suspect_from is None else (make_word("suspect", suspect_from, CLEAN.gpst[-1]),)
    decided = replace(make_decision(), verdict="no_attack_seen", labels=tuple(labels), sources=(), windows=windows)
    return set_up_positions(CLEAN, decided, RECORDS.navigation, Settings(smoothing_s=20.0, **settings), hidden=hidden)


def make_word(name, start, end):
    return WindowWord(receiver="rx1", start_gpst=start, end_gpst=end, word=name)


def make_clean_labels(label, first, last):
    return [
        LabelledSignal(ref=SignalRef("rx1", signal), label=label, first_epoch=first, last_epoch=last, because=())
        for signal in CLEAN.signals
    ]


def list_kinds(found):
    """List the kinds of each epoch that has a fix, by its row of the log."""
    kinds = [[] for _ in range(CLEAN.gpst.size)]
    for kind, fix in usable_fixes(found):
        for at in fix.gpst[fix.status == 0]:
            kinds[int(np.argmin(np.abs(CLEAN.gpst - at)))].append(kind)
    return kinds


def test_while_no_test_fails_every_epoch_has_a_consistent_fix():
    fix = clean_positions().whole("consistent")
    assert (fix.status == 0).all()
    assert np.isfinite(fix.protection_m).all()
    assert np.isnan(fix.hidden_m).all()  # no test says what it would have missed


def test_no_epoch_has_two_fixes_and_the_trusted_one_is_first():
    found = clean_positions(make_clean_labels("authentic", 20, 49), suspect_from=CLEAN.gpst[70], speed_max_m_s=0.0)
    kinds = list_kinds(found)
    assert kinds == [["consistent"]] * 20 + [["trusted"]] * 30 + [["consistent"]] * 20 + [["held"]] * 20


@pytest.mark.parametrize("epochs", [7, 31, 89])
def test_stretches_of_any_length_give_the_same_consistent_fixes(monkeypatch, epochs):
    labels = make_clean_labels("authentic", 20, 49)
    expected = clean_positions(labels).whole("consistent")
    monkeypatch.setattr(positions, "STRETCH_EPOCHS", epochs)
    found = clean_positions(labels).whole("consistent")
    good = expected.status == 0
    assert np.array_equal(found.status == 0, good)
    np.testing.assert_allclose(found.position_ecef_m[good], expected.position_ecef_m[good], atol=1e-6)
    assert list_kinds(clean_positions(labels)) == [["trusted"] if 20 <= k < 50 else ["consistent"] for k in range(90)]


@pytest.mark.parametrize("label", ["spoofed", "multipath"])
def test_false_signals_and_reflections_make_no_consistent_fix(label):
    found = clean_positions(make_clean_labels(label, 30, 59)).whole("consistent")
    assert np.array_equal(np.flatnonzero(found.status != 0), np.arange(30, 60))


def test_what_may_be_hidden_grows_from_the_last_evidence_on():
    drag = HiddenDrag(
        zero=CLEAN.gpst[0],
        edges_s=np.array([0.0, 50.0, 90.0]),
        rate_m_s=np.array([1.0, 0.5]),
        jump_m=np.full(2, 7.0),
        far_m=np.full(2, np.inf),
    )
    hidden_m = np.full(90, np.nan)
    for kind, fix in usable_fixes(clean_positions(make_clean_labels("authentic", 20, 29), hidden=drag)):
        good = np.flatnonzero(fix.status == 0)
        hidden_m[good] = fix.hidden_m[good]
        assert (kind == "trusted") == (fix.hidden_m[good] == 0.0)[-1]
    # Smoothed over 10 s to either side.
    assert hidden_m[[0, 10, 19, 25]] == pytest.approx([12.0, 17.0, 26.0, 0.0])
    assert hidden_m[[30, 50, 80]] == pytest.approx([12.5, 28.0, 43.0])


def test_reflections_that_discriminators_show_widen_a_trusted_fix_alone():
    def sigma_m(off_m, kind):
        shown = replace(WHOLE, quadrature_m=np.full(WHOLE.pseudorange_m.shape, off_m))
        found = read_positions(shown).whole(kind)
        return np.sqrt(np.nanmedian(np.trace(found.covariance_m2[:, :3, :3], axis1=1, axis2=2)))

    without = read_positions(WHOLE).whole("trusted")
    plain_m = np.sqrt(np.nanmedian(np.trace(without.covariance_m2[:, :3, :3], axis1=1, axis2=2)))
    assert sigma_m(0.0, "trusted") == pytest.approx(plain_m, rel=1e-9)
    assert sigma_m(6.0, "trusted") > 3.0 * plain_m
    assert sigma_m(6.0, "unprotected") == pytest.approx(sigma_m(0.0, "unprotected"), rel=1e-9)
