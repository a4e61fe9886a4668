"""Drawn correlators beside samples of the same scene: what the loops and grids of both receivers show."""

import numpy as np
import pytest

from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import asked
from skyproof.app.receive.tracker import build_receiver_settings
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.signals import GPS_SATS
from skyproof.receiver import measurement as m
from skyproof.receiver.grids import Grids
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.state import ReceiverState
from skyproof.receiver.tracking import Receiver
from skyproof.simulator.attacks import Takeover
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import FrontEnd, Scenario, SceneReceiver, Sky
from skyproof.simulator.sites import Site
from skyproof.simulator.sky import make_scene
from skyproof.studies.correlator_model import ModelReceiver

RATE_HZ, SECONDS, SETTLED_S = 5e6, 6.0, 2.5
START = np.datetime64("2022-03-01T06:00:00", "ns")


@pytest.fixture(scope="module")
def scene():
    """Make false signals 3 dB weaker, 90 m behind, so that code loops settle between both."""
    place = {"lat_deg": 47.0, "lon_deg": 8.0}
    attack = Takeover(
        name="false",
        transmit=Site(lat_deg=47.001, lon_deg=8.0, height_m=60.0),
        target="rx",
        power_db=-3.0,
        onset_s=-1.0,
        code_offset_m=90.0,
    )
    scenario = Scenario(
        seed=5,
        start_gpst=START,
        duration_s=SECONDS,
        mask_deg=25.0,
        receivers=(SceneReceiver(name="rx", height_m=50.0, **place),),
        front_end=FrontEnd(rate_hz=RATE_HZ, bandwidth_hz=0.8 * RATE_HZ, bits=2, encoding="sign-magnitude"),
        attacks=(attack,),
        sky=Sky(zenith_cn0_dbhz=50.0, horizon_cn0_dbhz=44.0),
    )
    return make_scene(scenario, make_nominal_constellation(START))


def receive(receiver, blocks):
    """List by satellite: mean C/N0, what codes show by epoch, and the mean size of the grids."""
    state, outputs, arcs = ReceiverState(), [], {}
    for block in blocks:
        output, state = receiver.step(state, block)
        outputs.append(output)
        arcs |= output.arcs
    found = Measurements.join([o.measurements for o in outputs])
    grids = Grids.join([o.grids for o in outputs if len(o.grids)])
    result = {}
    for number, arc in arcs.items():
        rows = (found.arc == number) & (found.elapsed_s > SETTLED_S)
        late = (grids.arc == number) & (grids.elapsed_s > SETTLED_S)
        if rows.sum() > 10 and late.any():
            value = np.abs(grids.value[late][:, 0]).mean(axis=0)
            sent_s = found.column(m.FRACTION_S)[rows] - found.elapsed_s[rows]
            codes_s = dict(zip(np.rint(10.0 * found.elapsed_s[rows]).tolist(), sent_s.tolist(), strict=True))
            result[arc.signal.sat] = float(found.column(m.CN0_DBHZ)[rows].mean()), codes_s, value / value.max()
    return result


@pytest.mark.long
def test_both_receivers_measure_the_same_where_signals_overlap(scene):
    settings = build_receiver_settings(GPS_SATS, Settings(), asked())
    count = round(0.5 * RATE_HZ)
    (samples,) = render_samples(scene.scenario, scene.navigation)
    by_samples = receive(
        Receiver(RATE_HZ, 0.0, settings), (samples.read(first, count) for first in range(0, samples.n_samples, count))
    )
    receiver = ModelReceiver(scene, 0, settings, np.random.default_rng(1))
    by_draw = receive(receiver, (np.empty((1, 0, count)) for _ in range(round(SECONDS / 0.5))))
    assert by_samples.keys() == by_draw.keys()
    assert len(by_draw) >= 5
    lost_db = []
    for sat, (dbhz, codes_s, shape) in by_samples.items():
        drawn_dbhz, drawn_s, drawn_shape = by_draw[sat]
        apart_s = np.array([codes_s[at] - drawn_s[at] for at in codes_s.keys() & drawn_s.keys()])
        apart_m = SPEED_OF_LIGHT_M_S * float(np.mean(apart_s - 1e-3 * np.rint(1e3 * apart_s)))
        print(f"{sat}: {dbhz:.2f} {drawn_dbhz:.2f} dB-Hz, {apart_m:+.2f} m, {np.abs(shape - drawn_shape).max():.3f}")
        lost_db.append(drawn_dbhz - dbhz)
        assert abs(apart_m) < 2.0
        assert np.abs(shape - drawn_shape).max() < 0.08
    # What other satellites add to one is noise in the mean over Dopplers only: a dB or so more or less here.
    assert np.abs(lost_db).max() < 2.5
    assert abs(np.mean(lost_db)) < 1.0
