"""What overlapping signals do to each other's measurements is what loops on the correlators would find."""

import numpy as np
import pytest

from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import NavigationData
from skyproof.simulator.attacks import Takeover
from skyproof.simulator.correlators import correlate
from skyproof.simulator.measurements import make_ideal_measurements
from skyproof.simulator.overlap_bias import compute_pull
from skyproof.simulator.received import Scene
from skyproof.simulator.scenario import FrontEnd, Multipath, Scenario, ScenePlace, SceneReceiver, Sky
from skyproof.simulator.sky import make_scene
from skyproof.simulator.tracked import align_channels

START = np.datetime64("2023-03-04T05:06:07.25", "ns")
WIDE = FrontEnd(rate_hz=4e6, encoding="float", bits=32)


def make_scene_with(
    navigation: NavigationData, rays: tuple[Multipath, ...] = (), front_end: FrontEnd = WIDE, **attack: float
) -> Scene:
    place = {"lat_deg": 40.0, "lon_deg": -3.0, "height_m": 650.0}
    takeover = Takeover(
        target="one", transmit=ScenePlace(lat_deg=40.0003, lon_deg=-3.0002, height_m=660.0), onset_s=-1.0, **attack
    )  # type: ignore[arg-type]
    return make_scene(
        Scenario(
            seed=7,
            start_gpst=START,
            duration_s=6.0,
            front_end=front_end,
            sky=Sky(zenith_cn0_dbhz=46.0, horizon_cn0_dbhz=46.0),
            attacks=(takeover,) if attack else (),
            receivers=(SceneReceiver(name="one", **place, multipath=rays),),
        ),
        navigation,
    )


@pytest.mark.parametrize(("turn_deg", "sign"), [(0.0, 1.0), (180.0, -1.0)])
def test_a_short_reflection_pulls_as_the_envelope_says(
    navigation: NavigationData, turn_deg: float, sign: float
) -> None:
    # Sharp chips, delay below half the spacing: error a d / (1 + a), Kaplan and Hegarty, 9.5; the phase stays.
    delay_m, amplitude = 15.0, 10.0 ** (-6.0 / 20.0)
    turn_cyc = delay_m * L1_HZ / SPEED_OF_LIGHT_M_S  # what the way itself turns, taken off
    ray = Multipath(delay_m=delay_m, power_db=-6.0, phase_deg=360.0 * (turn_cyc % 1.0) + turn_deg)
    pull = compute_pull(make_scene_with(navigation, (ray,)), 0, [1.5, 2.5], averaged_s=1.0)
    expected_m = sign * amplitude * delay_m / (1.0 + sign * amplitude)
    np.testing.assert_allclose(pull.code_m, expected_m, rtol=5e-3)
    np.testing.assert_allclose(pull.carrier_cyc, 0.0, atol=1e-4)
    np.testing.assert_allclose(pull.doppler_hz, 0.0, atol=1e-4)
    assert (pull.level_db * sign > 2.5).all()


def test_loops_stand_where_early_and_late_are_equal(navigation: NavigationData) -> None:
    scene = make_scene_with(navigation, front_end=FrontEnd(bandwidth_hz=2e6), code_offset_m=120.0, power_db=1.0)
    sky = scene.skies[0]
    pull = compute_pull(scene, 0, [2.0], averaged_s=0.2)
    assert np.abs(pull.code_m).max() > 5.0
    carrier_hz = sky.signal.carrier_hz
    tracked = align_channels(scene, 0).move(code_s=pull.code_m[0] / SPEED_OF_LIGHT_M_S, carrier_hz=carrier_hz)
    outputs = correlate(scene, 0, [2.0], delays_chips=[-0.25, 0.0, 0.25], coherent_s=0.2, tracked=tracked)
    late, prompt, early = outputs.mean[0, :, 0].T
    assert np.abs(((early - late) * prompt.conj()).real / np.abs(prompt) ** 2).max() < 1e-4
    off_cyc = np.angle(prompt) / (2.0 * np.pi) + pull.carrier_cyc[0]
    assert np.abs(off_cyc - np.rint(off_cyc)).max() < 1e-4


def test_a_copy_at_another_doppler_turns_away(navigation: NavigationData) -> None:
    near = compute_pull(make_scene_with(navigation, code_offset_m=100.0, power_db=1.0), 0, [2.0], averaged_s=1.0)
    scene = make_scene_with(navigation, code_offset_m=100.0, power_db=1.0, clock_drift=31.25 / L1_HZ)
    far = compute_pull(scene, 0, [2.0], averaged_s=1.0)
    assert np.abs(near.code_m).max() > 5.0
    assert np.abs(far.code_m).max() < 0.05 * np.abs(near.code_m).max()


def test_measurements_are_pulled_only_where_signals_overlap(navigation: NavigationData) -> None:
    for overlap in (True, False):
        scene = make_scene_with(navigation, code_offset_m=100.0 if overlap else 3000.0, power_db=1.0)
        (plain,), (pulled,) = make_ideal_measurements(scene), make_ideal_measurements(scene, pulled=True)
        pull = compute_pull(scene, 0, plain.elapsed_s, averaged_s=1.0)
        np.testing.assert_allclose(pulled.pseudorange_m - plain.pseudorange_m, pull.code_m, atol=1e-6)
        np.testing.assert_allclose(pulled.doppler_hz - plain.doppler_hz, pull.doppler_hz, atol=1e-9)
        moved_cyc = pulled.carrier_cyc - plain.carrier_cyc - pull.carrier_cyc
        np.testing.assert_allclose(moved_cyc, np.rint(moved_cyc), atol=1e-6)
        np.testing.assert_allclose(pulled.cn0_dbhz - plain.cn0_dbhz, pull.level_db, atol=1e-9)
        farthest_m = float(np.abs(pull.code_m).max())
        assert farthest_m > 40.0 if overlap else farthest_m < 10.0  # side lobes of the satellite's own code remain
