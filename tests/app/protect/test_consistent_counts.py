"""Consistent fixes of one receiver in drawn scenes, clean and with attacks of about the size that tests notice."""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import stats

from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings
from skyproof.app.protect import judge
from skyproof.app.protect.coasting import usable_fixes
from skyproof.detectors.continuity.series import Limits, build_series
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.records import CellStatus
from skyproof.studies.protection.errors import compare_with_truth
from skyproof.studies.random_scenes import build_scene, draw_scene
from skyproof.studies.receiver_model import ChannelNoise, model_receptions

KINDS = {"code_drag": (0.2, 3.0), "motion": (0.2, 3.0), "position_jump": (0.1, 3.0)}
"""Attacks, with the smallest and the largest share of the size that is noticed in the window that sees least."""


@dataclass(frozen=True, eq=False)
class Found:
    """Of the consistent fixes of a run: how far each is off, level, and its bound, what is hidden and its level."""

    word: str
    sizes: dict
    off_m: np.ndarray
    bound_m: np.ndarray
    hidden_m: np.ndarray
    level_m: np.ndarray


def list_found(heard, made):
    stands = made.drawn.motion == "still"
    outcome, _ = judge([heard.reception], made.navigation, Settings(speed_max_m_s=0.0 if stands else None), Silent())
    positions = outcome.receivers[0].positions
    parts = [np.empty((4, 0))]
    for kind, fix in usable_fixes(positions):
        good = np.flatnonzero(fix.status == 0)
        if kind == "consistent" and good.size:
            errors = compare_with_truth(fix, good, heard.position_ecef_m[good])
            parts.append(np.stack([errors.horizontal_m, errors.bound_m, errors.hidden_m, errors.protection_m[:, 0]]))
    noticed = [attack for e in outcome.evidence for attack in e.noticed]
    sizes = {kind: max((item.size for item in noticed if item.kind == kind), default=np.nan) for kind in KINDS}
    return Found(outcome.decision.verdict, sizes, *np.concatenate(parts, axis=1))


def list_heard(made):
    drawn = made.drawn
    noise = ChannelNoise(code_m=drawn.code_sigma_m, ar1=drawn.ar1, constant_m=drawn.constant_m, field=drawn.field)
    return model_receptions(made.scene, noise, rng=np.random.default_rng(drawn.seed))[0]


def attack(heard, made, rng, kind, size):
    """Drag codes off, with or without their carriers, or let codes jump while all carriers break."""
    o = heard.reception.observations
    direction = rng.normal(size=3)
    direction *= size / np.linalg.norm(direction)
    unit = build_series(o, made.navigation, heard.position_ecef_m[0], Limits()).unit
    onset_s, status = rng.uniform(5.0, 0.8 * o.elapsed_s[-1]), o.status.copy()
    moved = np.maximum(o.elapsed_s - onset_s, 0.0)
    if kind == "position_jump":
        row = int(np.argmax(o.elapsed_s >= onset_s))
        status[row][status[row] == CellStatus.OK] = CellStatus.SLIP
        moved = 1.0 * (o.elapsed_s >= onset_s)
    change_m = -(unit @ direction) * moved[:, None]
    carrier_cyc = o.carrier_cyc
    if kind == "motion":
        carrier_cyc = (
            carrier_cyc + change_m * np.array([signal.plan.carrier_hz for signal in o.signals]) / SPEED_OF_LIGHT_M_S
        )
    o = replace(o, pseudorange_m=o.pseudorange_m + change_m, carrier_cyc=carrier_cyc, status=status)
    return replace(heard, reception=replace(heard.reception, observations=o))


@pytest.mark.parametrize("draws", [8, pytest.param(120, marks=pytest.mark.long)])
def test_fixes_stay_in_their_bound_and_attacks_in_the_hidden_one(draws):
    rng, count, number = np.random.default_rng(11), Counter(), -1
    while count["attacked"] < draws:  # of receivers that are stated to stand
        number += 1
        made = build_scene(draw_scene(f"clean-{number}", most_receivers=2))
        if made is None:
            continue
        heard = list_heard(made)
        clean = list_found(heard, made)
        if not clean.off_m.size:
            assert clean.word != "no_attack_seen"
            continue
        count["clean"] += 1
        count["over bound"] += int(clean.off_m[-1] > clean.bound_m[-1])
        count["over level"] += int((clean.off_m > clean.level_m).any())
        kind = str(rng.choice(list(KINDS)))
        share = float(np.exp(rng.uniform(*np.log(KINDS[kind]))))
        if made.drawn.motion != "still":
            assert np.isnan(clean.hidden_m).all()  # carriers may drag it as it may move
            continue
        found = list_found(attack(heard, made, rng, kind, share * clean.sizes[kind]), made)
        count["attacked"] += 1
        count["moved"] += int((found.off_m > found.bound_m).any())
        count["over hidden"] += int((found.off_m > found.bound_m + found.hidden_m).any())
    assert stats.binomtest(count["over bound"], count["clean"], 0.05, alternative="greater").pvalue > 1e-3
    assert count["over level"] == 0
    assert count["moved"] > 0  # else nothing was hidden
    assert stats.binomtest(count["over hidden"], draws, 0.01, alternative="greater").pvalue > 1e-3
