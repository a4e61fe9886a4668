"""What windows show of interference becomes spells of a receiver."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.adapter import finding_from_evidence
from skyproof.fusion.interference import join_spells
from skyproof.records import Evidence, Finding, NoiseRise
from skyproof.testing import MeasuredScene

(RX,) = MeasuredScene(antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=60).records(np.random.default_rng(0)).observations
SECOND = np.timedelta64(1, "s")


def window(number: int, *rises: NoiseRise) -> Finding:
    return finding_from_evidence(
        Evidence(
            detector="levels",
            start_gpst=RX.gpst[10 * number],
            end_gpst=RX.gpst[10 * number] + 10 * SECOND,
            subject=(),
            says="clean",
            because="",
            interference=rises,
        )
    )


def make_rise(first: int, last: int, fall_db: float, carrier: str = "L1", **more) -> NoiseRise:
    values = {"level_db": None, "lost": 0, "signs": ("cn0",), "may_be_shade": True}
    return NoiseRise(
        receiver="rx1",
        carrier=carrier,
        from_gpst=RX.gpst[first],
        to_gpst=RX.gpst[last],
        fall_db=fall_db,
        sigma_db=1.0,
        **values | more,
    )


def test_windows_in_a_row_are_one_spell_of_the_strongest() -> None:
    lost = make_rise(20, 29, 14.0, lost=6, signs=("cn0", "lost"))
    level = make_rise(20, 29, 9.0, "L5", level_db=8.0, may_be_shade=False)
    (spell,) = join_spells(
        [window(1, make_rise(13, 19, 7.0)), window(2, lost, level), window(3, make_rise(30, 34, 12.0))], [RX]
    )
    assert (spell.since_gpst, spell.until_gpst) == (RX.gpst[13], RX.gpst[34])
    assert spell.carriers == ("L1", "L5")
    assert (spell.fall_db, spell.lost, spell.level_db) == (14.0, 6, 8.0)
    assert spell.signs == ("cn0", "lost")
    assert not spell.may_be_shade


def test_a_window_without_it_parts_spells() -> None:
    spells = join_spells([window(1, make_rise(13, 19, 7.0)), window(2), window(3, make_rise(30, 39, 5.0))], [RX])
    assert [(s.since_gpst, s.fall_db) for s in spells] == [(RX.gpst[13], 7.0), (RX.gpst[30], 5.0)]


def test_a_spell_at_the_end_lasts() -> None:
    (spell,) = join_spells([window(5, make_rise(52, 59, 7.0))], [RX])
    assert spell.until_gpst is None


def test_nothing_looked_for_is_not_nothing() -> None:
    assert join_spells([window(0)], [RX]) == ()
    assert join_spells([replace(window(0), estimates={})], [RX]) is None


@pytest.mark.parametrize(
    ("fall_db", "more", "jammer_db", "bounded"),
    [
        (10.0, {}, 9.54, True),
        (14.0, {"lost": 6, "signs": ("cn0", "lost")}, 13.82, False),
        (14.0, {"lost": 6, "signs": ("cn0", "lost"), "level_db": 30.0, "level_sigma_db": 1.0}, 30.0, True),
        (10.0, {"level_db": 12.0, "level_sigma_db": 1.0}, 10.6, True),
    ],
)
def test_a_spell_has_the_power_of_its_jammer(fall_db, more, jammer_db, bounded) -> None:
    (spell,) = join_spells([window(1, make_rise(13, 19, fall_db, **more))], [RX])
    assert spell.jammer.db == pytest.approx(jammer_db, abs=0.05)
    assert (spell.jammer.high_db is not None) == bounded
