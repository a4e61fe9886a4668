"""Attacks put into measurements: every observable continues as if the receiver had followed the false signals."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.navigation.fix import fix
from skyproof.records import CellStatus, Observations, Records
from skyproof.studies.log_attacks import (
    TORN,
    FalseShift,
    Jamming,
    Tearing,
    drop_carriers,
    put_attack,
    put_jamming,
    put_tearing,
    select_signals,
    true_place_ecef_m,
)
from skyproof.testing import MeasuredScene

ONSET = 8
SCENE = MeasuredScene(antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=20)


def make_records() -> Records:
    """Return a clean window in which all observables stand."""
    drawn = SCENE.records(np.random.default_rng(3))
    (o,) = drawn.observations
    wavelength_m = SPEED_OF_LIGHT_M_S / o.carrier_hz
    carrier_cyc = o.pseudorange_m / wavelength_m
    doppler_hz = -np.gradient(o.pseudorange_m, o.elapsed_s, axis=0) / wavelength_m
    o = replace(o, carrier_cyc=carrier_cyc, doppler_hz=doppler_hz, cn0_dbhz=np.full(o.status.shape, 40.0))
    return replace(drawn, observations=(o,))


def attack(shift: FalseShift, signals=None) -> tuple[Observations, Observations, np.ndarray]:
    """Return measurements before and after, and how far the fix of codes moved, east north up and clock, (n, 4)."""
    drawn = make_records()
    (o,) = drawn.observations
    place_m = true_place_ecef_m(o, drawn.navigation)
    chosen = np.ones(len(o.signals), np.bool_) if signals is None else signals
    false = put_attack(o, drawn.navigation, shift, signals=chosen, place_ecef_m=place_m)
    fixes = [fix(each, drawn.navigation) for each in (o, false)]
    lat_rad, lon_rad, _ = geodetic_from_ecef(place_m[0])
    moved_m = (fixes[1].position_ecef_m - fixes[0].position_ecef_m) @ rot_enu_ecef(lat_rad, lon_rad).T
    clock_m = SPEED_OF_LIGHT_M_S * (fixes[1].clock_bias_s - fixes[0].clock_bias_s)
    return o, false, np.column_stack([moved_m, clock_m])


def find_onset_s() -> float:
    return float(make_records().observations[0].elapsed_s[ONSET])


@pytest.mark.parametrize("jump_enu_m", [(300.0, -200.0, 50.0), (40_000.0, 20_000.0, -100.0)])
def test_codes_show_the_false_place_and_time(jump_enu_m) -> None:
    clock_s = 3e-6
    _, _, moved = attack(FalseShift(onset_s=find_onset_s(), jump_enu_m=jump_enu_m, clock_s=clock_s))
    assert np.abs(moved[:ONSET]).max() < 1e-3
    # Models of the atmosphere see the satellites a little higher or lower from the false place.
    tolerance_m = 1e-4 * np.linalg.norm(jump_enu_m) + 0.01
    expected = [*jump_enu_m, clock_s * SPEED_OF_LIGHT_M_S]
    assert np.abs(moved[ONSET:] - expected).max() < 3.0 * tolerance_m


def test_residuals_are_those_of_the_true_sky() -> None:
    drawn = make_records()
    (o,) = drawn.observations
    _, false, _ = attack(FalseShift(onset_s=find_onset_s(), jump_enu_m=(500.0, 0.0, 0.0)))
    residuals_m = [fix(each, drawn.navigation).residual_m for each in (o, false)]
    assert np.nanmax(np.abs(residuals_m[1] - residuals_m[0])) < 0.05


def test_carriers_and_dopplers_go_with_the_codes() -> None:
    shift = FalseShift(onset_s=find_onset_s(), velocity_enu_m_s=(5.0, 3.0, 0.0), clock_drift=1e-8, breaks=False)
    o, false, _ = attack(shift)
    wavelength_m = SPEED_OF_LIGHT_M_S / o.carrier_hz
    longer_m = false.pseudorange_m - o.pseudorange_m
    assert np.abs(longer_m[-1]).max() > 10.0
    np.testing.assert_allclose((false.carrier_cyc - o.carrier_cyc) * wavelength_m, longer_m, atol=1e-5)
    rate_m_s = np.gradient(longer_m[ONSET:], o.elapsed_s[ONSET:], axis=0)
    np.testing.assert_allclose(-(false.doppler_hz - o.doppler_hz)[ONSET:] * wavelength_m, rate_m_s, atol=1e-4)
    assert np.array_equal(false.status, o.status)


def test_a_drag_reaches_its_speed_at_its_acceleration() -> None:
    shift = FalseShift(onset_s=2.0, velocity_enu_m_s=(4.0, 0.0, 0.0), acceleration_m_s2=2.0)
    offset_m = shift.offset_enu_m(np.array([0.0, 2.0, 3.0, 4.0, 6.0]))
    np.testing.assert_allclose(offset_m[:, 0], [0.0, 0.0, 1.0, 4.0, 12.0])


def test_other_signals_stay_as_they_are() -> None:
    (o,) = make_records().observations
    chosen = select_signals(o, "satellite", satellite=o.signals[2].sat)
    before, false, _ = attack(FalseShift(onset_s=find_onset_s(), jump_enu_m=(900.0, 0.0, 0.0)), chosen)
    changed = (false.pseudorange_m != before.pseudorange_m).any(axis=0)
    assert np.array_equal(changed, chosen)
    assert chosen.sum() == 1


def test_carriers_break_at_the_onset_of_a_jump() -> None:
    _, false, _ = attack(FalseShift(onset_s=find_onset_s(), jump_enu_m=(900.0, 0.0, 0.0)))
    assert (false.status[ONSET] == CellStatus.SLIP).all()
    assert (np.delete(false.status, ONSET, axis=0) == CellStatus.OK).all()


def test_jamming_weakens_and_loses_what_is_too_weak() -> None:
    (o,) = make_records().observations
    levels_dbhz = np.broadcast_to(np.linspace(30.0, 48.0, len(o.signals)), o.status.shape)
    o = replace(o, cn0_dbhz=levels_dbhz)
    jamming = Jamming(begin_s=float(o.elapsed_s[5]), end_s=float(o.elapsed_s[10]), loss_db=12.0)
    jammed = put_jamming(o, jamming, np.random.default_rng(0))
    lost = np.isnan(jammed.pseudorange_m)
    assert np.array_equal(lost[5:10], levels_dbhz[5:10] < 34.0)
    assert not lost[:5].any()
    assert not lost[10:].any()
    np.testing.assert_allclose(jammed.cn0_dbhz[5:10][~lost[5:10]], (levels_dbhz[5:10] - 12.0)[~lost[5:10]])


@pytest.mark.parametrize("how", TORN)
def test_a_torn_receiver_writes_what_the_kind_says(how) -> None:
    o, false, _ = attack(FalseShift(onset_s=find_onset_s(), jump_enu_m=(900.0, 0.0, 0.0), clock_s=1e-5))
    torn = put_tearing(o, false, Tearing(onset_s=find_onset_s(), how=how, share=0.5), np.random.default_rng(1))
    after = torn.pseudorange_m[ONSET:]
    assert np.array_equal(torn.pseudorange_m[:ONSET], o.pseudorange_m[:ONSET])
    present = np.isfinite(after)
    if how == "few":
        assert present.sum(axis=1).max() <= 6
    if how == "alternate":
        true = after == o.pseudorange_m[ONSET:]
        assert (true[1:] != true[:-1]).all()
    if how == "no_ranges":
        assert (torn.status[ONSET:] == CellStatus.IMPOSSIBLE).any()
    if how == "milliseconds":
        late_ms = np.abs(after - false.pseudorange_m[ONSET:]) / (1e-3 * SPEED_OF_LIGHT_M_S)
        assert (late_ms > 0.9).any()


def test_codes_alone_have_neither_carriers_nor_dopplers() -> None:
    (o,) = make_records().observations
    alone = drop_carriers(o)
    assert not np.isfinite(alone.carrier_cyc).any()
    assert not np.isfinite(alone.doppler_hz).any()
    assert np.array_equal(alone.pseudorange_m, o.pseudorange_m)
