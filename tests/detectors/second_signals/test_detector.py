from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.second_signals.detector import SecondSignals, SecondSignalsSettings, find_second_signals
from skyproof.records import Observations, Records, SignalId

START = np.datetime64("2022-01-01T00:00:00", "ns")


def make_observations(
    second=(), *, sats=12, delay_m=900.0, doppler_hz=0.0, weaker_db=0.0, cn0_dbhz=45.0, tow=True, spread_m=12.0
):
    """Make one receiver; satellites numbered in `second` have a second signal, each by another delay."""
    epochs = 5
    names = [f"G{k + 1:02d}" for k in range(sats)]
    signals = [SignalId(sat) for sat in names] + [SignalId(names[k], copy="b") for k in second]
    base = np.array([2.1e7 + 1e5 * k for k in range(sats)] + [2.1e7 + 1e5 * k + delay_m + spread_m * k for k in second])
    doppler = np.array([100.0 * k for k in range(sats)] + [100.0 * k + doppler_hz for k in second])
    cn0 = np.array([cn0_dbhz] * sats + [cn0_dbhz - weaker_db] * len(second))
    ones = np.ones((epochs, len(signals)))
    return Observations(
        receiver="rx1",
        signals=tuple(signals),
        gpst=START + np.arange(epochs).astype("timedelta64[s]"),
        elapsed_s=np.arange(epochs, dtype=float),
        pseudorange_m=base * ones if tow else np.nan * ones,
        carrier_cyc=ones,
        doppler_hz=doppler * ones,
        cn0_dbhz=cn0 * ones,
        pseudorange_sigma_m=ones,
        carrier_sigma_cyc=ones,
        doppler_sigma_hz=ones,
        status=np.full(ones.shape, 0 if tow else 2, np.uint8),
        found_elapsed_s=np.zeros(len(signals)),
        missed_elapsed_s=np.full(len(signals), np.nan),
    )


def examine(*receivers):
    records = Records(start_gpst=START, end_gpst=START + np.timedelta64(5, "s"), observations=receivers)
    return SecondSignals().examine(records)[0]


def test_many_second_signals_are_an_attack_and_one_is_an_echo():
    (many,), (single,) = examine(make_observations(range(8))), examine(make_observations([3]))
    assert many.says == "attack"
    assert many.p_value < 1e-12
    assert {ref.signal.sat for ref in many.signals} == {f"G{k + 1:02d}" for k in range(8)}
    assert single.says == "clean"
    assert single.p_value == 1.0
    assert (many.code, single.code) == ("unlike_echoes", "like_echoes")
    assert (single.data["doubled"], single.data["satellites"]) == (1, 12)


def test_without_cn0_it_says_that_this_is_what_is_missing():
    (evidence,) = examine(make_observations(range(8), cn0_dbhz=np.nan))
    assert (evidence.says, evidence.code, evidence.p_value) == ("undecided", "no_cn0", None)
    (weak,) = examine(make_observations(cn0_dbhz=20.0))
    assert (weak.code, weak.data) == ("few_satellites", {"satellites": 0, "min_cn0_dbhz": 30.0})


def test_late_weak_seconds_are_echoes_where_strong_ones_are_not():
    (weak,), (strong,) = (
        examine(make_observations(range(4), weaker_db=db, delay_m=500.0, spread_m=60.0)) for db in (11.0, -9.0)
    )
    assert (weak.says, strong.says) == ("clean", "attack")
    assert strong.p_value < 1e-9 < weak.p_value


def test_two_signals_that_no_echo_is_like_are_needed():
    alone, two, three = (examine(make_observations(range(k), weaker_db=-9.0, delay_m=900.0))[0] for k in (1, 2, 3))
    assert alone.p_value == 1.0
    assert alone.says == "clean"
    assert 1e-6 < two.p_value < 1e-4
    assert three.p_value < 1e-7


def test_an_early_weak_signal_makes_the_other_a_late_strong_one():
    early, late = (
        find_second_signals(make_observations([3], delay_m=delay_m, weaker_db=db), SecondSignalsSettings())
        for delay_m, db in ((-900.0, 7.0), (900.0, -7.0))
    )
    ((first,), (second,)) = early.seconds["G04"], late.seconds["G04"]
    assert first.late_m == pytest.approx(900.0 - 36.0)
    assert second.late_m == pytest.approx(900.0 + 36.0)
    assert first.over_db == second.over_db == pytest.approx(7.0)
    assert (first.below_db, second.below_db) == (pytest.approx(7.0), pytest.approx(0.0))


@pytest.mark.parametrize(
    ("kind", "counts"),
    [
        ({"delay_m": 400.0}, False),  # 1.4 chips
        ({"delay_m": 480.0}, True),
        ({"delay_m": -480.0}, True),
        ({"delay_m": 10.0, "doppler_hz": 45.0}, False),
        ({"delay_m": 10.0, "doppler_hz": -60.0}, True),
        ({"weaker_db": 13.0}, False),
        ({"weaker_db": 11.0}, True),
        ({"weaker_db": -20.0}, False),  # the first is the weak one
        ({"cn0_dbhz": 35.0, "weaker_db": 6.0}, False),  # below what is credible
    ],
)
def test_what_counts_as_a_second_signal(kind, counts):
    found = find_second_signals(make_observations([0, 1, 2], **kind), SecondSignalsSettings())
    assert found.doubled == (("G01", "G02", "G03") if counts else ())
    assert found.unknown == ()


def test_a_late_copy_of_the_whole_sky_is_named_and_no_attack():
    copied = make_observations(range(8), weaker_db=6.0, delay_m=450.0, spread_m=0.5)
    count, late = examine(copied)
    assert (count.says, late.says, late.code) == ("clean", "multipath", "late_copy")
    assert late.p["clean"] < 1e-12
    assert {(ref.signal.sat, ref.signal.copy) for ref in late.signals} == {(f"G{k + 1:02d}", "b") for k in range(8)}


def test_coarse_delays_agree_by_chance_and_show_no_late_copy():
    copied = make_observations(range(3), weaker_db=2.5, delay_m=500.0, spread_m=0.0)
    coarse = replace(copied, pseudorange_sigma_m=np.where(np.isfinite(copied.pseudorange_sigma_m), 100.0, np.nan))
    assert len(find_second_signals(copied, SecondSignalsSettings()).repeated) == 3
    assert find_second_signals(coarse, SecondSignalsSettings()).repeated == ()


@pytest.mark.parametrize(
    "kind",
    [
        {"weaker_db": -6.0},
        {"weaker_db": 0.0},
        {"delay_m": -900.0},
        {"spread_m": 30.0},
        {"doppler_hz": 60.0},
        {"delay_m": 4000.0},
    ],
    ids=str,
)
def test_stronger_earlier_or_other_motion_is_no_late_copy(kind):
    (evidence,) = examine(make_observations(range(8), **({"weaker_db": 6.0, "spread_m": 0.5} | kind)))
    assert evidence.says == "attack"


def test_without_time_of_week_only_doppler_tells_signals_apart():
    (unknown,) = examine(make_observations(range(8), tow=False))
    assert (unknown.says, unknown.code) == ("undecided", "delay_unknown")
    (apart,) = examine(make_observations(range(8), tow=False, doppler_hz=80.0))
    assert apart.says == "attack"
    (clean,) = examine(make_observations(tow=False))
    assert clean.says == "clean"


def test_too_few_satellites_are_not_called_clean():
    (evidence,) = examine(make_observations(sats=1))
    assert (evidence.says, evidence.code) == ("undecided", "few_satellites")


def test_every_receiver_has_its_own_evidence():
    evidence = examine(make_observations(range(8)), replace(make_observations(), receiver="rx2"))
    assert [e.says for e in evidence] == ["attack", "clean"]
    assert evidence[1].signals[0].receiver == "rx2"


def test_a_channel_that_is_there_for_one_epoch_does_not_count():
    full = make_observations([0, 1, 2])
    cn0_dbhz = full.cn0_dbhz.copy()
    cn0_dbhz[1:, 12:] = np.nan
    assert find_second_signals(replace(full, cn0_dbhz=cn0_dbhz), SecondSignalsSettings()).doubled == ()
