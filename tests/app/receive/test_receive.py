"""`receive` on two skies at once: files, the document, and what signals of one satellite say against each other."""

import json
from dataclasses import replace

import numpy as np
import pytest
from tests.app import kit

from skyproof.app.common.settings import Settings
from skyproof.app.receive import receive, write_document_json
from skyproof.app.receive.inputs import open_inputs
from skyproof.app.receive.reception import observe
from skyproof.app.receive.tracker import track
from skyproof.formats.rinex_nav import read_nav
from skyproof.formats.rinex_obs_read import read_obs
from skyproof.simulator.scenario import Meaconer


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Record 9 s under a meaconer that was on before; the first subframe of its message is complete."""
    repeated = Meaconer(receive=kit.ELSEWHERE, transmit=kit.TRANSMIT, delay_s=4e-6, onset_s=-10.0, noise_db=-13.0)
    scenario = kit.make_scenario(receivers=1, duration_s=9.0, attacks=(repeated,))
    return kit.record(scenario, tmp_path_factory.mktemp("receive"))


@pytest.fixture(scope="module")
def tracker(recording):
    (tracker,), _ = track(open_inputs(recording.paths, Settings()), Settings())
    return tracker


def test_two_signals_of_a_satellite_stand_in_two_files(recording, tmp_path):
    result = receive(recording.paths, nav=recording.nav, out=tmp_path, start_s=0.5)
    ((orbits, *observed),) = result.files
    assert (orbits, observed) == ("bow-nav.rnx", ["bow.obs", "bow-2.obs"])
    (receiver,) = json.loads(write_document_json(result))["receivers"]
    assert receiver["files"] == [orbits, *observed]
    assert receiver["examined_s"] == pytest.approx(8.5, abs=0.01)
    assert receiver["messages_differ"] == []  # a repeater repeats
    listed = sorted((s["sat"], s["copy"]) for s in receiver["signals"] if s["n_epochs"])
    written = [sorted(signal.sat for signal in read_obs(tmp_path / name).observations.signals) for name in observed]
    assert sorted(sat for sats in written for sat in sats) == [sat for sat, _ in listed]
    assert all(len(set(sats)) == len(sats) > 5 for sats in written)
    bow = recording.scene.skies[0].point(np.array([1.0])).position_ecef_m[0]
    for name in observed:  # first copies of the sky and of the repeater, which stands 0.9 km off
        assert np.linalg.norm(read_obs(tmp_path / name).position_ecef_m - bow) < 1000.0
    for name in (orbits, *observed):
        (dated,) = [line for line in (tmp_path / name).read_text().splitlines() if "PGM / RUN BY / DATE" in line]
        assert dated[40:60] == "20240514 095941 UTC "  # of the recording, 18 leap seconds off GPS time


def test_a_forged_message_beside_the_true_one_is_reported(tracker):
    number, arc = next((number, arc) for number, arc in tracker.arcs.items() if 1 in arc.subframes)
    first = arc.subframes[1]
    fields = {**first.fields, "af0": first.fields["af0"] + 1e-6}
    forged = replace(arc, signal=replace(arc.signal, copy="z"), subframes={1: replace(first, fields=fields)})
    arcs = {number: arc, number + 1000: forged}
    reception = observe(replace(tracker, arcs=tracker.arcs | arcs), None)
    (reported,) = [words for words in reception.messages_differ if " z " in words]
    assert reported.startswith(f"{arc.signal.sat}: signals")
    assert "af0" in reported
    assert reported in reception.remarks


def test_a_repeated_message_is_not_reported_as_another(tracker):
    assert observe(tracker, None).messages_differ == ()


@pytest.mark.long
def test_a_rough_place_narrows_the_search_to_satellites_above(recording, tracker):
    navigation = read_nav(recording.nav)
    inputs = open_inputs(recording.paths, Settings(duration_s=3.0))
    here, nowhere = ({"place_deg": place} for place in ((57.0, 13.0), (-57.0, -167.0)))
    (near,), _ = track(inputs, Settings(**here), navigation=navigation)
    heard = {arc.signal.sat for arc in tracker.arcs.values()}
    sats = set(near.receiver.settings.sats)
    assert heard <= sats
    assert len(sats) < 20
    assert any(f" {len(sats)} satellites" in words for words in near.remarks)
    (far,), _ = track(inputs, Settings(**nowhere), navigation=navigation)
    assert not heard <= set(far.receiver.settings.sats)
    (unknown,), _ = track(inputs, Settings(**here))
    assert len(unknown.receiver.settings.sats) == 32
    assert any("--nav" in words for words in unknown.remarks)
