"""Positions in stretches are those of the whole run."""

from dataclasses import fields, replace

import numpy as np
import pytest

from skyproof.app.common.settings import Settings
from skyproof.app.protect import positions
from skyproof.app.protect.positions import positions_of
from skyproof.formats.pieces import Workspace
from skyproof.formats.spool import ObservationSpool
from skyproof.fusion.fuse import Decision
from skyproof.fusion.labels import FalseSource, LabelledSignal
from skyproof.records import Fix, SignalRef
from skyproof.testing import FalseSky, MeasuredScene

SCENE = MeasuredScene(
    antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=90, step_s=1.0, max_satellites=8, false=(FalseSky(),)
)
RECORDS = SCENE.records(np.random.default_rng(5))
(WHOLE,) = RECORDS.observations


def decision():
    """The first copies are true until epoch 60, the second ones false from 30 on."""
    labels = tuple(
        LabelledSignal(ref=SignalRef("rx1", signal), label=label, first_epoch=first, last_epoch=last, because=())
        for signal in WHOLE.signals
        for label, first, last in [("authentic", 0, 59) if signal.copy == "a" else ("spoofed", 30, 89)]
    )
    false = FalseSource(name="S1", signals=tuple(s.ref for s in labels if s.label == "spoofed"))
    return Decision(verdict="spoofed", labels=labels, sources=(false,), skies=(), onset=None, until=None, open=None)


def positions_in(log, smoothing_s=20.0):
    return positions_of(log, decision(), RECORDS.navigation, Settings(smoothing_s=smoothing_s))


@pytest.fixture
def spooled():
    log = ObservationSpool(Workspace(), "rx1")
    for first in range(0, 90, 25):
        log.append(WHOLE.read(first, first + 25))
    return log


@pytest.mark.parametrize("epochs", [7, 31, 89])
@pytest.mark.parametrize("kind", ["trusted", "false", "unprotected", "S1"])
def test_stretches_of_any_length_give_what_the_whole_gives(monkeypatch, spooled, epochs, kind):
    expected = positions_in(WHOLE).whole(kind)
    monkeypatch.setattr(positions, "STRETCH_EPOCHS", epochs)
    found = positions_in(spooled).whole(kind)
    good = expected.status == 0
    assert good.sum() > 25
    for f in fields(Fix):
        a, b = getattr(expected, f.name), getattr(found, f.name)
        if isinstance(a, np.ndarray) and a.dtype.kind == "f":
            np.testing.assert_allclose(b[good], a[good], rtol=1e-9, atol=1e-6, err_msg=f.name)
    assert np.array_equal(found.status == 0, good)
    assert np.array_equal(found.gpst[good], expected.gpst[good])


def test_a_track_is_what_of_the_fixes_stays_at_hand(monkeypatch):
    whole = positions_in(WHOLE).whole("trusted")
    monkeypatch.setattr(positions, "STRETCH_EPOCHS", 16)
    track = positions_in(WHOLE).track("trusted")
    assert np.array_equal(track.fixed, whole.status == 0)
    np.testing.assert_allclose(track.position_ecef_m[:60], whole.position_ecef_m[:60], atol=1e-6)
    assert np.isnan(track.clock_bias_s[60:]).all()
    assert track.last.gpst.tolist() == whole.gpst[59:60].tolist()
    np.testing.assert_allclose(track.last.covariance_m2[0], whole.covariance_m2[59], rtol=1e-9)


def test_trusted_fixes_alone_have_a_protection_level_and_a_smaller_risk_a_larger_one():
    def levels_of(kind, risk):
        settings = Settings(smoothing_s=20.0, integrity_risk=risk)
        found = positions_of(WHOLE, decision(), RECORDS.navigation, settings).whole(kind)
        return found.protection_m[found.status == 0]

    often, seldom = levels_of("trusted", 1e-2), levels_of("trusted", 1e-7)
    assert (seldom > often).all()
    assert np.isnan(levels_of("false", 1e-2)).all()
    assert np.isnan(levels_of("unprotected", 1e-2)).all()


def test_what_there_is_no_fix_of_is_none():
    false = tuple(s for s in decision().labels if s.label == "spoofed")
    found = positions_of(WHOLE, replace(decision(), labels=false), RECORDS.navigation, Settings())
    assert found.track("trusted") is None
    assert found.whole("trusted") is None
    assert found.track("false") is not None
