"""Missing samples: said at the stated rate where none are, of signals that overlap too, and seen where some are."""

import numpy as np
import pytest
from scipy import stats
from tests.receiver.conftest import PLACE, START, Rendered

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver.channels import DelayDoppler, LostSignal, continue_tow, match_lost
from skyproof.receiver.gaps import MOST_BITS_MISSING, turn_ratio
from skyproof.receiver.tracking import Receiver, ReceiverSettings, ReceiverState
from skyproof.simulator.scenario import FrontEnd, Scenario, Sky, Takeover
from skyproof.simulator.scenario import SceneReceiver as ReceiverSite

# ---------------------------------------------------------------------- carriers


@pytest.mark.parametrize("turns", ["anything", "none"])
def test_carriers_that_turn_by_chance_keep_the_stated_rate(turns):
    rng = np.random.default_rng(1)
    n, stated, n_signals = 1500, 0.05, 5
    alarms = 0
    for _ in range(n):
        turn_cyc = rng.random(n_signals) if turns == "anything" else rng.normal(size=n_signals) * 0.02
        predicted_cyc = rng.uniform(-4000.0, 4000.0, n_signals) * 0.02 * np.arange(1, MOST_BITS_MISSING + 1)[:, None]
        ratios = turn_ratio(turn_cyc - predicted_cyc, np.full(n_signals, 0.02))
        alarms += ratios.max() > MOST_BITS_MISSING / stated
    assert stats.binomtest(alarms, n, stated, alternative="greater").pvalue > 1e-3


def test_carriers_turned_by_missing_bits_are_recognized():
    rng = np.random.default_rng(2)
    predicted_cyc = rng.uniform(-4000.0, 4000.0, 7) * 0.02 * np.arange(1, MOST_BITS_MISSING + 1)[:, None]
    turn_cyc = predicted_cyc[2] + 0.21 + 0.01 * rng.normal(size=7) + 0.5 * rng.integers(0, 5, 7)
    ratios = turn_ratio(turn_cyc - predicted_cyc, np.full(7, 0.012))
    assert int(np.argmax(ratios)) == 2
    assert ratios.max() > MOST_BITS_MISSING / 1e-4


# ---------------------------------------------------------------------- signals that come back


def drop_rows(sat, delay_s, *, doppler_hz=0.0, tow_ms=None, period=0):
    place = DelayDoppler(at_s=1.0, delay_s=delay_s, doppler_hz=doppler_hz, period=period)
    return LostSignal(sat=sat, copy="a", found_s=0.0, missed_s=0.0, place=place, tow_ms=tow_ms)


def test_signals_that_return_anywhere_share_a_shift_by_chance():
    rng = np.random.default_rng(3)
    n, gaps = 80, 0
    for _ in range(n):
        sats = [f"G{prn:02d}" for prn in range(1, 9)]
        gone = [drop_rows(sat, rng.uniform(0.0, 1e-3), doppler_hz=rng.uniform(-4e3, 4e3)) for sat in sats]
        found = [
            (old.sat, DelayDoppler(at_s=3.0, delay_s=rng.uniform(0.0, 1e-3), doppler_hz=old.place.doppler_hz))
            for old in gone
        ]
        gaps += match_lost(gone, found, GPS_L1_CA)[1] is not None
    assert gaps <= 1  # of 0.08 at most; three alike of eight at any of 400 missing times would be some 2


def test_signals_that_return_to_their_place_are_no_gap():
    sats = ["G01", "G02", "G03", "G04"]
    dopplers_hz = [-3000.0, 10.0, 900.0, 4000.0]
    gone = [
        drop_rows(s, 4e-4, doppler_hz=d, tow_ms=5_000_000, period=777) for s, d in zip(sats, dopplers_hz, strict=True)
    ]
    found = []
    for old in gone:
        delay_s = old.place.delay_at_s(9.0, GPS_L1_CA) % GPS_L1_CA.period_s
        found.append((old.sat, DelayDoppler(at_s=9.0, delay_s=delay_s, doppler_hz=old.place.doppler_hz, period=40)))
    matches, gap = match_lost(gone, found, GPS_L1_CA)
    assert gap is None
    assert matches == gone
    for old, (_, place) in zip(gone, found, strict=True):
        assert continue_tow(old, place, GPS_L1_CA) == 5_000_000 + 8000 - 40


# ---------------------------------------------------------------------- through samples

RATE_HZ = 2_600_000
PULLED_S, GAP_S = 4.0, 5.53


@pytest.fixture(scope="module")
def overlapping():
    """Render false signals on the true ones from 3 s on, in phase and a little stronger, dragged off at 4 s."""
    takeover = Takeover(
        target="rx",
        transmit=place_site(PLACE),
        onset_s=3.0,
        power_db=0.9,
        phase="aligned",
        away_points_enu_m=((PULLED_S, 0.0, 0.0, 0.0), (PULLED_S + 4.0, 10.0, 8.0, 0.0)),
    )
    scenario = Scenario(
        seed=4,
        start_gpst=START,
        duration_s=8.0,
        receivers=(ReceiverSite(name="rx", **PLACE.model_dump(exclude_none=True)),),
        attacks=(takeover,),
        mask_deg=30.0,
        front_end=FrontEnd(rate_hz=RATE_HZ, bandwidth_hz=0.8 * RATE_HZ, encoding="sign-magnitude", bits=2),
        sky=Sky(zenith_cn0_dbhz=48.0, horizon_cn0_dbhz=44.0),
    )
    return Rendered(scenario)


def place_site(site):
    return site.model_copy(update={"lat_deg": site.lat_deg + 1e-3})


def receive_samples(rendered, planes):
    sats = sorted({heard.id.sat for heard in rendered.scene.skies[0].signals})
    receiver = Receiver(RATE_HZ, settings=ReceiverSettings(sats=tuple(sats)))
    output, state = receiver.step(ReceiverState(), planes)
    return output, state, sats


@pytest.mark.long
def test_a_beat_of_all_signals_is_no_gap_and_costs_no_channel(overlapping):
    output, _, sats = receive_samples(overlapping, overlapping.planes)
    assert len(sats) >= 5
    assert output.gaps == ()
    assert sorted(arc.signal.sat for arc in output.arcs.values()) == sats
    assert all(arc.tow_ms_at_period_0 is not None for arc in output.arcs.values())
    elapsed_s = output.measurements.elapsed_s
    for second in range(2, 7):
        rows = output.measurements.arc[(elapsed_s > second) & (elapsed_s <= second + 1.0)]
        assert np.unique(rows).size >= 4


@pytest.mark.long
@pytest.mark.parametrize("periods", [7, 113])
def test_samples_missing_within_the_beat_are_found(overlapping, periods):
    first = round(GAP_S * RATE_HZ)
    planes = np.delete(overlapping.planes, slice(first, first + periods * RATE_HZ // 1000), axis=1)
    output, _, sats = receive_samples(overlapping, planes)
    assert any(GAP_S - 0.2 <= gap.elapsed_s <= GAP_S + 0.7 for gap in output.gaps)
    after = {arc.signal.sat for number, arc in output.arcs.items() if arc.began == "after a gap"}
    assert after == set(sats)
