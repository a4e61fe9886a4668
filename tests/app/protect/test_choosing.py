"""One receiver is taken over and dragged off: what is trusted stays true, the choice is right or not made."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy import stats
from tests.app.kit import START
from tests.app.protect.choosing import find_choice, judge_scene, make_inertia, make_takeover

from skyproof.app.common.settings import Settings
from skyproof.app.protect.takeover_pictures import compare_skies, list_origins

STANDS = Settings(speed_max_m_s=0.0)


@pytest.fixture(scope="module")
def push_scene():
    return judge_scene(make_takeover(), STANDS)


def test_the_old_place_chooses_and_the_trusted_position_stays(push_scene):
    assert push_scene.verdict.verdict == "spoofed"
    assert [source.one_antenna for source in push_scene.outcome.decision.sources] == [False]
    taken = find_choice(push_scene).data
    assert taken["wrong"] == 1e-12
    assert {"receiver_stands", "clean_start"} <= set(taken["assumes"])
    assert taken["clean_until"].startswith("10:00:28")
    assert not push_scene.wrong
    assert push_scene.off_m.max() < 6.0
    assert (push_scene.off_m < 4.0 * push_scene.sigma_m).all()


def test_fixes_are_trusted_then_held_then_trusted(push_scene):
    order = np.argsort(push_scene.at_s)
    kind = push_scene.kind[order]
    changes = np.flatnonzero(kind[1:] != kind[:-1])
    assert [str(word) for word in (*kind[changes], kind[-1])] == ["trusted", "held", "trusted"]
    assert np.diff(push_scene.at_s[order]).max() < 0.6


def test_the_report_draws_expectation_skies_and_sources(push_scene):
    zero = push_scene.outcome.receivers[0].reception.observations.gpst[0]
    (compared,) = compare_skies(push_scene.outcome, zero)
    away_m = {track.kind: float(np.hypot(track.east_m[0], track.north_m[0])) for track in compared.tracks}
    assert away_m["expected"] == 0.0
    assert away_m["trusted"] < 5.0 < away_m["false"]
    assert compared.chosen
    assert compared.wrong <= 1e-3
    (came,) = list_origins(push_scene.outcome, zero)
    assert [item.origin for item in came.usable] == ["trusted", "held", "trusted"]
    held = push_scene.at_s[push_scene.kind == "held"]
    assert came.usable[1].from_s == pytest.approx(held.min(), abs=0.6)
    assert came.usable[1].to_s == pytest.approx(held.max(), abs=0.6)
    assert np.nanmax(came.away_m) > 100.0


def test_without_knowledge_of_a_receiver_no_sky_is_chosen():
    found = judge_scene(make_takeover(), Settings())
    assert found.verdict.verdict == "spoofed"
    assert len(found.outcome.decision.skies) >= 2
    assert (found.verdict.assumed, find_choice(found)) == (None, None)


def test_positions_stay_consistent_until_a_test_fails():
    # With nothing known of the receiver nothing carries them on.
    found = judge_scene(make_takeover(), Settings())
    assert set(found.kind) == {"consistent"}
    assert 25.0 < found.at_s.max() < 35.0  # the onset
    assert (found.off_m < 4.0 * found.sigma_m).all()


def test_only_an_oscillator_recognizes_a_push_of_the_clock():
    scene = make_takeover(speed_m_s=0.0, clock_m_s=12.0)
    found = judge_scene(scene, Settings(speed_max_m_s=0.0, oscillator="ocxo"))
    assert "oscillator_ocxo" in find_choice(found).data["assumes"]
    assert not found.wrong
    assert found.off_m.max() < 6.0
    alone = judge_scene(scene, STANDS)
    assert find_choice(alone) is None
    assert alone.outcome.decision.open.finding.detector == "prediction"
    assert [set(alone.kind[alone.at_s > at_s]) for at_s in (31.0, 41.0)] == [{"consistent", "held"}, {"held"}]
    assert alone.off_m.max() < 6.0


DRIVE = {
    "kind": "way-points",
    "points_enu_m": [[0, 0, 0], [200, 100, 0], [300, 400, 0], [0, 600, 0], [-300, 300, 0], [0, 0, 0], [900, 0, 0]],
    "speed_m_s": 12.0,
}
ZIGZAG = {
    "kind": "way-points",
    "points_enu_m": [[250 * k, 150 * (k % 2), 0] for k in range(12)],
    "speed_m_s": 12.0,
}
WALK = {
    "kind": "way-points",
    "points_enu_m": [
        [0, 0, 0],
        [9, 4, 0],
        [12, 20, 0],
        [0, 30, 0],
        [-14, 22, 0],
        [-20, -20, 0],
        [60, -30, 0],
        [400, 0, 0],
    ],
    "speed_m_s": 1.4,
}


def make_moving(path, grade, seed=1, **options):
    """Make a moving scene and the prediction of its inertial unit."""
    scene = make_takeover(path=path, imu={"grade": grade, "rate_hz": 50.0}, seed=seed, **options)
    settings = Settings(oscillator=options.get("oscillator", "ocxo"))
    return judge_scene(scene, settings, seed=seed, predictors=make_inertia(scene, settings, grade, seed=seed))


def test_a_car_with_an_inertial_unit_chooses_and_coasts():
    found = make_moving(DRIVE, "tactical", onset_s=35.0, duration_s=110.0)
    assert found.wrong_sky is False
    assert not found.wrong
    assert (find_choice(found).start_gpst - START) / np.timedelta64(1, "s") >= 60.0
    assert "inertial_as_stated" in find_choice(found).data["assumes"]
    kind = found.kind[np.argsort(found.at_s)]
    changes = np.flatnonzero(kind[1:] != kind[:-1])
    assert [str(word) for word in (*kind[changes], kind[-1])] == ["trusted", "consistent", "inertial", "trusted"]
    assert (found.off_m < 4.0 * found.sigma_m).all()
    free = found.kind == "inertial"
    assert (found.off_m < found.level_m).all()
    assert np.ptp(found.sigma_m[free]) > 5.0  # grows as long as nothing corrects it
    assert found.off_m[~free].max() < 10.0


def test_inertia_is_corrected_until_a_test_fails():
    # Of a pull after minutes the navigator knows more than that of a clean start of 30 s, which is 250 m off.
    onset_s = 157.0
    scene = make_takeover(
        path=ZIGZAG, imu={"grade": "tactical", "rate_hz": 50.0}, onset_s=onset_s, duration_s=200.0, speed_m_s=5.0
    )
    settings = Settings(oscillator="ocxo")
    found = judge_scene(scene, settings, predictors=make_inertia(scene, settings, "tactical"))
    assert found.verdict.verdict == "spoofed"
    assert found.at_s[found.kind != "inertial"].max() > onset_s - 10.0
    assert (found.off_m < found.level_m).all()
    assert found.off_m.max() < 25.0
    assert (found.off_m < 4.0 * found.sigma_m).all()


@dataclass
class Count:
    """Of drawn takeovers."""

    draws: int = 0
    spoofed: int = 0
    chose: int = 0
    wrong: int = 0
    predicted: float = 0.0
    labels: int = 0
    off_m: list = field(default_factory=list)
    by_inertia_m: list = field(default_factory=list)
    over: float = 0.0
    over_level: int = 0

    def add(self, found):
        self.draws += 1
        first = find_choice(found)
        if first is not None:
            self.chose += 1
            self.predicted += 1.0 / (1.0 + np.exp(first.log_likelihood_ratio))
            self.wrong += bool(found.wrong_sky)
        self.spoofed += found.verdict.verdict == "spoofed"
        self.labels += found.wrong
        self.off_m += list(found.off_m)
        self.by_inertia_m += list(found.off_m[found.kind == "inertial"])
        seen_m = found.off_m - np.nan_to_num(found.hidden_m)
        self.over = max(self.over, float((seen_m / found.sigma_m).max(initial=0.0)))
        self.over_level += int((seen_m > found.level_m).sum())

    def check(self, words):
        free = self.by_inertia_m or [np.nan]
        print(
            f"{words}: spoofed {self.spoofed} of {self.draws}, chosen {self.chose}, wrong {self.wrong}, predicted "
            f"{self.predicted:.2g}, runs with a wrong label {self.labels}; trusted fixes: 95 % within "
            f"{np.quantile(self.off_m, 0.95):.1f} m, all within {max(self.off_m):.1f} m and {self.over:.1f} sigma in "
            f"space; by inertia 95 % within {np.quantile(free, 0.95):.1f} m, all within {max(free):.1f} m"
        )
        assert stats.binom.sf(self.wrong - 1, self.chose, Settings().wrong_choice_probability) > 1e-3
        assert self.labels <= 0.02 * self.draws
        assert self.over < 5.0
        assert self.over_level == 0


def draw_pull(rng, kind):
    """Draw a takeover."""
    return {
        "onset_s": float(rng.uniform(33.0, 50.0)),
        "duration_s": 150.0,
        "speed_m_s": 0.0 if kind == "clock" else float(rng.uniform(3.0, 15.0)),
        "clock_m_s": 0.0 if kind == "position" else float(rng.uniform(3.0, 15.0)),
        "power_db": float(rng.uniform(-1.0, 10.0)),
        "oscillator": str(rng.choice(["tcxo", "ocxo", "rubidium"])),
        "heading_deg": float(rng.uniform(0.0, 360.0)),
        "zenith_cn0_dbhz": float(rng.uniform(46.0, 52.0)),
    }


TOLD_FROM_GUESSES = 14
"""Choices, no two of them wrong: of so many guesses fewer than two are wrong once in a thousand times."""


@pytest.mark.long
@pytest.mark.parametrize("kind", ["position", "clock", "both"])
def test_drawn_takeovers_give_no_wrong_choice_and_no_false_trust(kind):
    rng, count = np.random.default_rng(11), Count()
    for seed in range(70):
        drawn = draw_pull(rng, kind)
        settings = Settings(speed_max_m_s=0.0, oscillator=drawn["oscillator"])
        count.add(
            judge_scene(make_takeover(seed=seed, **drawn), settings, seed=seed, code_m=float(rng.uniform(0.3, 1.5)))
        )
    count.check(f"standing, {kind}")
    assert count.chose >= TOLD_FROM_GUESSES
    assert np.quantile(count.off_m, 0.95) < 15.0


@pytest.mark.long
@pytest.mark.parametrize("grade", ["tactical", "navigation"])
def test_of_drawn_takeovers_of_what_moves_no_choice_is_wrong(grade):
    chose = 0
    for kind in ("position", "clock", "both"):
        rng, count = np.random.default_rng(12), Count()
        for seed in range(36):
            count.add(make_moving((DRIVE, WALK)[seed % 2], grade, seed, **draw_pull(rng, kind)))
        count.check(f"moving, {grade}, {kind}")
        chose += count.chose
    assert chose >= TOLD_FROM_GUESSES
