"""Grids as the record that detectors see: references are pseudoranges on the receiver's clock, however it is set."""

from dataclasses import replace

import numpy as np
from tests.detectors.nulls import OVERLAPPED_CCAF, draw_ccaf

from skyproof.detectors.dccaf.detector import Dccaf
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.gnss.time import gpst, week_and_tow
from skyproof.receiver.channels import Arc
from skyproof.receiver.grids import GridCorrelator, Grids
from skyproof.receiver.observables import ReceiverTimeTag, assemble_grids
from skyproof.records import CcafAsked


def test_grids_become_a_record_in_which_an_attack_shows():
    rng = np.random.default_rng(2)
    records = draw_ccaf(OVERLAPPED_CCAF.records(rng), rng)
    (o,), (grid_record,) = records.observations, records.ccaf
    # The clock showed 3 ms more before it was moved.
    week, tow_s = week_and_tow(o.gpst[0])
    label = ReceiverTimeTag(week=int(week), tow_ms=round((float(tow_s) - float(o.elapsed_s[0])) * 1e3) + 3)
    observations = replace(o, gpst=gpst(label.week, label.tow_ms * 1e-3 + o.elapsed_s) - np.timedelta64(3, "ms"))
    sent_s = label.tow_ms * 1e-3 + grid_record.elapsed_s[:, None] - 3e-3 - grid_record.reference_m / SPEED_OF_LIGHT_M_S
    started_ms = np.floor(sent_s[0] * 1e3).astype(np.int64) - 500
    arcs = {
        number: Arc(
            signal=signal,
            found_s=0.0,
            missed_s=float("nan"),
            began="found",
            tow_ms_at_period_0=None if number == 0 else int(started_ms[number]),
            bit_synchronised=True,
            bits_period=0,
            subframes={},
        )
        for number, signal in enumerate(grid_record.signals)
    }
    n, intervals = len(grid_record.signals), grid_record.elapsed_s.size
    since_s = sent_s - started_ms * 1e-3
    periods = np.floor(since_s * 1e3).astype(np.int64)
    grids = Grids(
        elapsed_s=np.repeat(grid_record.elapsed_s, n),
        arc=np.tile(np.arange(n), intervals),
        periods=periods.ravel(),
        fraction_s=(since_s - periods * 1e-3).ravel(),
        doppler_hz=grid_record.reference_hz.ravel(),
        noise_variance=grid_record.noise_variance.ravel(),
        value=np.asarray(grid_record.value, np.complex64).reshape(-1, *grid_record.value.shape[2:]),
    )
    asked = CcafAsked(reach_chips=1.5, every_s=1.0, soon_s=0.2)
    taken = GridCorrelator(asked, grid_record.band_hz / 0.6, 0.0, GPS_L1_CA, 32)
    taken.delays_chips = grid_record.delays_chips
    found = assemble_grids("rx1", grids, taken, arcs, label, observations)
    assert np.isnan(found.reference_m[:, found.signals.index(grid_record.signals[0])]).all()  # its time is not known
    columns = [found.signals.index(signal) for signal in grid_record.signals[1:]]
    np.testing.assert_allclose(found.reference_m[:, columns], grid_record.reference_m[:, 1:], atol=1e-3)
    np.testing.assert_array_equal(found.value[:, columns], grid_record.value[:, 1:].astype(np.complex64))
    seen = replace(records, observations=(observations,), ccaf=(found,))
    assert Dccaf().examine(seen)[0][0].says == "attack"
    nothing = assemble_grids("rx1", Grids.nothing(1, grid_record.delays_chips.size), taken, arcs, label, observations)
    assert nothing.gpst.size == 0
    assert Dccaf().examine(replace(seen, ccaf=(nothing,)))[0][0].says == "undecided"
