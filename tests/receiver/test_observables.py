"""Records made of what the channels measured."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.gnss.lnav import Subframe
from skyproof.receiver import measurement as m
from skyproof.receiver.channels import Arc
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.observables import assemble_array_phases, assemble_taps, list_differing_messages
from skyproof.receiver.tracking import Receiver, ReceiverSettings, ReceiverState
from skyproof.records import AntennaArray, SignalId


def take_grids(receiver, output):
    """Take all correlators over the first three seconds."""
    return assemble_taps(
        "rx",
        output.measurements,
        output.arcs,
        0.2 * np.arange(1.0, 15.0),
        delays_chips=receiver.taps_chips,
        dopplers_hz=receiver.taps_hz,
        samples_per_period=receiver.rate_hz * 1e-3,
        averaged_s=0.2,
        look_share=receiver.settings.look_share,
    )


def test_taps_show_the_correlation_function_on_the_real_axis(clean):
    settings = ReceiverSettings(further_taps_chips=(0.5, -0.5, 1.5), further_taps_hz=(400.0,))
    receiver = Receiver(clean.samples.rate_hz, clean.samples.if_hz, settings)
    output, _ = receiver.step(ReceiverState(), clean.planes[:, : int(3.05 * clean.samples.rate_hz)])
    taps = take_grids(receiver, output)
    assert taps.value.shape == (14, len(taps.signals), 2, 6)
    late = taps.value[10:]
    prompt = late[:, :, 0, 1]
    assert np.median(np.abs(prompt.imag)) < 0.05 * np.median(prompt.real)
    shape = np.median(late[:, :, 0].real / prompt.real[..., None], axis=(0, 1))
    assert shape[3] == pytest.approx(shape[4], abs=0.03)
    assert 0.45 < shape[3] < 0.75  # half a chip off: a triangle with a round top
    assert abs(shape[5]) < 0.1
    off = np.median(late[:, :, 1, 1].real / prompt.real)
    assert off == pytest.approx(np.sinc(0.4) * np.cos(0.4 * np.pi), abs=0.1)  # 400 Hz over 1 ms, phase from its start
    missing = np.isnan(taps.value[:3])
    assert missing.all()


def test_taps_of_looks_stand_at_their_times_and_show_the_same(clean):
    # A signal's looks, by themselves, average to what all the time shows, and lie evenly over the receiver's time.
    further = {"further_taps_chips": (0.5, -0.5), "sats": ("G05", "G10")}
    planes = clean.planes[:, : int(3.05 * clean.samples.rate_hz)]
    shapes = []
    for looks in ({}, {"looks_per_frame": 5, "look_share": 0.2}):
        receiver = Receiver(clean.samples.rate_hz, clean.samples.if_hz, ReceiverSettings(**further, **looks))
        output, _ = receiver.step(ReceiverState(), planes)
        taps = take_grids(receiver, output)
        late = taps.value[taps.elapsed_s > 2.0, :, 0]
        assert np.isfinite(late).all()
        shapes.append(late.mean(axis=0) / late[:, :, 1].mean(axis=0)[:, None])
    assert taps.value.shape == (140, len(taps.signals), 1, 5)
    np.testing.assert_allclose(np.diff(taps.elapsed_s), 0.02, atol=1e-12)
    assert taps.elapsed_s[0] == pytest.approx(0.1 + 0.002)
    np.testing.assert_allclose(shapes[1], shapes[0], atol=0.1)


def make_arc(copy: str, crs: float) -> Arc:
    fields = {"iode": 17.0, "crs": crs, "toe": 7200.0}
    subframe = Subframe(id=2, tow_s=6, inverted=False, alert=False, words=(), fields=fields)
    return Arc(
        signal=SignalId("G05", copy=copy),
        found_s=0.0,
        missed_s=float("nan"),
        began="found",
        tow_ms_at_period_0=0,
        bit_synchronised=True,
        bits_period=0,
        subframes={2: subframe},
    )


def test_messages_of_one_satellite_are_compared():
    true, repeated, forged = make_arc("a", 1.5), make_arc("b", 1.5), make_arc("b", 1.53125)
    assert list_differing_messages({1: true, 2: repeated}) == []
    (words,) = list_differing_messages({1: true, 2: forged})
    assert "G05" in words
    assert "crs" in words
    later = replace(forged, subframes={2: replace(forged.subframes[2], fields={"iode": 18.0, "crs": 9.0})})
    assert list_differing_messages({1: true, 2: later}) == []  # another issue of data


def test_what_tells_no_time_or_does_not_last_has_no_direction():
    # A jammer's wave can be followed as a code, for moments, and comes from one direction like false signals.
    lasting = make_arc("a", 0.0)
    arcs = {
        0: replace(lasting, signal=SignalId("G01"), bit_synchronised=True),
        1: replace(lasting, signal=SignalId("G02"), bit_synchronised=False, tow_ms_at_period_0=None),
        2: replace(lasting, signal=SignalId("G03"), bit_synchronised=True),
        3: replace(lasting, signal=SignalId("G03"), bit_synchronised=False, tow_ms_at_period_0=6000),
    }
    epochs = np.arange(1, 51)
    number = np.concatenate([np.full(50, 0), np.full(50, 1), np.full(4, 2), np.full(46, 3)])
    antenna_rows = np.zeros((150, 2, m.N_OWN))
    measurements = replace(
        Measurements.nothing(n_antennas=2),
        elapsed_s=0.2 * np.tile(epochs, 3),
        arc=number,
        table=np.zeros((150, m.N_COLUMNS)),
        own=antenna_rows,
    )
    gpst = np.datetime64("2024-05-14T10:00:00", "ns") + epochs * np.timedelta64(200, "ms")
    phases = assemble_array_phases(
        "rx",
        measurements,
        arcs,
        0.2 * epochs,
        gpst,
        array=AntennaArray(elements_m=np.eye(3)[:2]),
        carrier_hz=1575.42e6,
        averaged_s=0.2,
    )
    assert [signal.sat for signal in phases.signals] == ["G01", "G02", "G03"]
    measured = np.isfinite(phases.phase_cyc).all(axis=-1)
    np.testing.assert_array_equal(measured.sum(axis=0), [50, 0, 46])
    assert not measured[:4, 2].any()
