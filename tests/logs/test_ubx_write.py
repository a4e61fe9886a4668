"""A UBX log that is written says what was measured, by our reader and by pyubx2."""

import io
from dataclasses import replace

import numpy as np
import pytest
from pyubx2 import UBXReader
from tests.logs.frames import make_ubx_frame as frame_by_hand
from tests.logs.test_ubx import RAWX, list_fields

from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.orbits import compute_satellite_state
from skyproof.gnss.time import gpst
from skyproof.logs.orbits import OrbitCollector
from skyproof.logs.stream import read_log
from skyproof.logs.ubx_write import ubx_frame, ubx_log
from skyproof.records import CellStatus, Observations, ReceiverFixes, SignalId
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.measurements import simulate_observations
from skyproof.simulator.ordinary import follow_strongest
from skyproof.simulator.scenes import read_ready_made
from skyproof.simulator.standalone import override

SIGNALS = (
    SignalId("C30", "B1", "2I"),
    SignalId("E11", "E1", "C"),
    SignalId("E11", "E5b", "Q"),
    SignalId("G05"),
    SignalId("G05", "L2", "L"),
    SignalId("J02"),
    SignalId("R07", "G1", "CA"),
    SignalId("S31"),
)


@pytest.fixture(scope="module")
def scene():
    made = override(read_ready_made("clean"), seed=None, duration_s=50.0)
    navigation = make_navigation(made)
    observations, _ = simulate_observations(made, navigation, rng=np.random.default_rng(1))
    return observations[0], navigation


def draw_signals(n_epochs: int = 6) -> Observations:
    """Return numbers drawn for signals of every system, with gaps and slips."""
    rng = np.random.default_rng(4)
    shape = n_epochs, len(SIGNALS)
    code_m = rng.uniform(2e7, 4e7, shape)
    code_m[rng.random(shape) < 0.2] = np.nan
    cycles = rng.uniform(-1e8, 1e8, shape)
    cycles[rng.random(shape) < 0.2] = np.nan
    carrier_hz = np.array([1.5e9] * len(SIGNALS))
    carrier_hz[6] = 1602e6 - 4 * 562.5e3
    slipped = rng.random(shape) < 0.2
    return Observations(
        receiver="rx",
        signals=SIGNALS,
        gpst=gpst(np.full(n_epochs, 2300), 604_798.0 + np.arange(n_epochs)),
        elapsed_s=np.arange(float(n_epochs)),
        pseudorange_m=code_m,
        carrier_cyc=cycles,
        doppler_hz=rng.uniform(-5e3, 5e3, shape),
        cn0_dbhz=rng.integers(20, 50, shape).astype(float),
        pseudorange_sigma_m=0.01 * 2.0 ** rng.integers(1, 12, shape),
        carrier_sigma_cyc=0.004 * rng.integers(1, 14, shape),
        doppler_sigma_hz=0.002 * 2.0 ** rng.integers(1, 12, shape),
        status=np.where(slipped, CellStatus.SLIP, CellStatus.OK).astype(np.uint8),
        half_cycle_open=rng.random(shape) < 0.3,
        found_elapsed_s=np.zeros(len(SIGNALS)),
        missed_elapsed_s=np.full(len(SIGNALS), np.nan),
        carrier_hz=carrier_hz,
    )


def test_what_is_written_is_read() -> None:
    o = draw_signals()
    (piece,) = read_log([b"".join(ubx_log(o))], "rx")
    read = piece.observations
    assert read.signals == SIGNALS
    present = np.isfinite(o.pseudorange_m) | np.isfinite(o.carrier_cyc)
    np.testing.assert_array_equal(read.gpst, o.gpst)
    for name in ("pseudorange_m", "carrier_cyc"):
        np.testing.assert_array_equal(getattr(read, name), getattr(o, name))
    for name in ("doppler_hz", "cn0_dbhz"):
        np.testing.assert_allclose(getattr(read, name)[present], getattr(o, name)[present], rtol=1e-6)
    known = np.isfinite(o.pseudorange_m)
    np.testing.assert_allclose(read.pseudorange_sigma_m[known], o.pseudorange_sigma_m[known])
    carrier = np.isfinite(o.carrier_cyc)
    np.testing.assert_allclose(read.carrier_sigma_cyc[carrier], o.carrier_sigma_cyc[carrier], atol=0.0041)
    np.testing.assert_array_equal(read.half_cycle_open, carrier & o.half_cycle_open)
    usable = carrier[1:] & carrier[:-1]
    assert read.slipped[1:][usable & o.slipped[1:]].all()
    assert read.carrier_hz[6] == o.carrier_hz[6]


def test_pyubx2_reads_the_same() -> None:
    o = draw_signals(2)
    parsed = [message for _, message in UBXReader(io.BytesIO(b"".join(ubx_log(o))))]
    assert [message.identity for message in parsed] == ["RXM-RAWX"] * 2
    present = np.isfinite(o.pseudorange_m[0]) | np.isfinite(o.carrier_cyc[0])
    assert list_fields(parsed[0], "prMes") == np.nan_to_num(o.pseudorange_m[0][present]).tolist()
    assert list_fields(parsed[0], "cpMes") == np.nan_to_num(o.carrier_cyc[0][present]).tolist()
    assert (parsed[0].week, parsed[0].rcvTow, parsed[0].leapS) == (2300, 604_798.0, 18)


def test_frames_are_those_made_by_hand() -> None:
    for payload in (b"", bytes(range(256)), bytes(8192)):
        assert ubx_frame(0x02, 0x15, payload) == frame_by_hand(0x02, 0x15, payload)
    assert len(RAWX) == 15


def test_messages_give_the_orbits(scene) -> None:
    o, navigation = scene
    (piece,) = read_log([b"".join(ubx_log(o, navigation))], "rx")
    collector = OrbitCollector()
    collector.take(piece.frames, {})
    found = collector.navigation("log").ephemerides
    assert {e.sat for e in found} == {s.sat for s in o.signals}
    for e in found:
        places = [
            compute_satellite_state(item, o.gpst[-1]).position_ecef_m
            for item in (e, navigation.best(e.sat, o.gpst[-1]))
        ]
        assert np.linalg.norm(places[0] - places[1]) < 0.5
    # Each subframe comes once, in the second after it has arrived.
    (frames,) = piece.frames
    assert len(set(zip(frames.sat.tolist(), frames.gpst.tolist(), strict=True))) == frames.sat.size
    seconds = (frames.gpst - np.datetime64("1980-01-06", "ns")).astype(np.int64) // 10**9
    assert set((seconds % 6).tolist()) == {1}


def test_fixes_stand_beside_their_epoch(scene) -> None:
    o, _ = scene
    lat, lon = np.radians([57.7] * 3), np.radians([11.9] * 3)
    speed_m_s = np.tile([3.0, -4.0, 1.5], (3, 1))
    fixes = ReceiverFixes.from_geodetic(
        o.gpst[[1, 2, 4]], lat, lon, np.array([50.0, 51.0, np.nan]), velocity_enu_m_s=speed_m_s,
        horizontal_sigma_m=np.full(3, 2.5), vertical_sigma_m=np.full(3, 4.0), satellites=np.array([9, 8, 7]),
    )  # fmt: skip
    (piece,) = read_log([b"".join(ubx_log(o, fixes=fixes))], "rx")
    assert piece.fixes.gpst.tolist() == o.gpst[[1, 2]].tolist()
    away_m = np.linalg.norm(
        piece.fixes.position_ecef_m - ecef_from_geodetic(lat[:2], lon[:2], np.array([50, 51])), axis=1
    )
    assert away_m.max() < 0.02
    np.testing.assert_allclose(piece.fixes.velocity_ecef_m_s, fixes.velocity_ecef_m_s[:2], atol=2e-3)
    assert piece.fixes.horizontal_sigma_m.tolist() == [2.5, 2.5]
    assert piece.fixes.satellites.tolist() == [9, 8]


def test_two_signals_of_a_transmission_are_refused(scene) -> None:
    o, _ = scene
    twice = replace(o, signals=(SignalId(o.signals[0].sat, copy="b"), o.signals[0], *o.signals[2:]))
    with pytest.raises(ValueError, match="two signals"):
        next(ubx_log(twice))
    strange = replace(o, signals=(SignalId(o.signals[0].sat, "L1", "W"), *o.signals[1:]))
    with pytest.raises(ValueError, match="number in UBX"):
        next(ubx_log(strange))


def test_the_strongest_copy_is_followed() -> None:
    o = draw_signals(4)
    copies = (SignalId("G05"), SignalId("G05", copy="b"), SignalId("G07"))
    levels = np.array([[40.0, 30.0, 45.0], [40.0, np.nan, 45.0], [40.0, 44.0, 45.0], [41.0, 39.0, 45.0]])
    code_m = np.where(np.isfinite(levels), 2e7 + np.arange(12.0).reshape(4, 3), np.nan)
    picked = {
        name: getattr(o, name)[:, :3] for name in ("carrier_cyc", "doppler_hz", "half_cycle_open", "quadrature_m")
    }
    picked |= {f"{name}_sigma_{unit}": np.ones((4, 3)) for name, unit in
               (("pseudorange", "m"), ("carrier", "cyc"), ("doppler", "hz"))}  # fmt: skip
    two = replace(
        o, signals=copies, pseudorange_m=code_m, cn0_dbhz=levels, status=np.zeros((4, 3), np.uint8) + CellStatus.OK,
        found_elapsed_s=np.array([0.0, 2.0, 0.0]), missed_elapsed_s=np.array([np.nan, 1.0, np.nan]),
        carrier_hz=np.full(3, 1.57542e9), **picked,
    )  # fmt: skip
    single = follow_strongest(two)
    assert single.signals == (SignalId("G05"), SignalId("G07"))
    assert single.pseudorange_m[:, 0].tolist() == [code_m[0, 0], code_m[1, 0], code_m[2, 1], code_m[3, 0]]
    assert single.slipped[:, 0].tolist() == [False, False, True, True]
    assert not single.slipped[:, 1].any()
    assert single.found_elapsed_s.tolist() == [0.0, 0.0]
