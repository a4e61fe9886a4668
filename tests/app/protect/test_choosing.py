"""One receiver that stands is taken over and drawn off: what is trusted stays true, the choice is right or not made."""

import numpy as np
import pytest
from scipy import stats
from tests.app.protect.choosing import choice_of, judged, led_away

from skyproof.app.common.settings import Settings

STANDS = Settings(speed_max_m_s=0.0)


@pytest.fixture(scope="module")
def pushed():
    return judged(led_away(), STANDS)


def test_the_place_where_it_stood_chooses_and_the_trusted_position_never_leaves(pushed):
    assert pushed.verdict.verdict == "spoofed"
    assert "imitated by a second sky beside the true one" in pushed.verdict.summary
    assert "the probability that this is the wrong choice is 1e-12 or less" in pushed.verdict.summary
    assert "bow does not move" in pushed.verdict.assumed
    assert "were true until 10:00:28" in pushed.verdict.assumed
    assert not pushed.wrong
    assert pushed.off_m.max() < 6.0
    assert (pushed.off_m < 4.0 * pushed.sigma_m).all()


def test_fixes_come_from_satellites_then_inertia_then_satellites(pushed):
    order = np.argsort(pushed.at_s)
    source = pushed.source[order]
    changes = np.flatnonzero(source[1:] != source[:-1])
    assert [str(word) for word in (*source[changes], source[-1])] == ["satellites", "inertia", "satellites"]
    assert np.diff(pushed.at_s[order]).max() < 0.6


def test_of_a_receiver_of_which_nothing_is_known_nothing_is_chosen():
    found = judged(led_away(), Settings())
    assert found.verdict.verdict == "spoofed"
    assert "which of them is true is not decided" in found.verdict.summary
    assert (found.verdict.assumed, choice_of(found), found.off_m.size) == (None, None, 0)


def test_a_push_of_the_clock_is_recognized_by_an_oscillator_and_by_nothing_else():
    scene = led_away(speed_m_s=0.0, clock_m_s=12.0)
    found = judged(scene, Settings(speed_max_m_s=0.0, oscillator="ocxo"))
    assert choice_of(found) is not None
    assert not found.wrong
    assert "oscillator of the class ocxo" in found.verdict.assumed
    assert found.off_m.max() < 6.0
    alone = judged(scene, STANDS)
    assert choice_of(alone) is None
    assert "none is chosen" in alone.verdict.undecided_because
    assert set(alone.source[alone.at_s > 31.0]) == {"inertia"}
    assert alone.off_m.max() < 6.0


@pytest.mark.long
@pytest.mark.parametrize("kind", ["position", "clock", "both"])
def test_of_drawn_takeovers_no_choice_is_wrong_and_no_trusted_fix_is_the_attackers(kind):
    rng = np.random.default_rng(11)
    chose, wrong, predicted, off_m, over, spoofed, seconds, sure = 0, 0, 0.0, 0.0, 0.0, 0, 0, 0
    draws = 70
    for seed in range(draws):
        oscillator = str(rng.choice(["tcxo", "ocxo", "rubidium"]))
        scene = led_away(
            onset_s=float(rng.uniform(33.0, 50.0)),
            duration_s=150.0,
            speed_m_s=0.0 if kind == "clock" else float(rng.uniform(3.0, 15.0)),
            clock_m_s=0.0 if kind == "position" else float(rng.uniform(3.0, 15.0)),
            power_db=float(rng.uniform(-1.0, 10.0)),
            oscillator=oscillator,
            heading_deg=float(rng.uniform(0.0, 360.0)),
            seed=seed,
        )
        settings = Settings(speed_max_m_s=0.0, oscillator=oscillator)
        found = judged(scene, settings, seed=seed, code_m=float(rng.uniform(0.3, 1.5)))
        first = choice_of(found)
        if first is not None:
            chose += 1
            predicted += 1.0 / (1.0 + np.exp(first.log_likelihood_ratio))
            wrong += found.wrong
        spoofed += found.verdict.verdict == "spoofed"
        off_m = max(off_m, float(found.off_m.max(initial=0.0)))
        over = max(over, float((found.off_m / found.sigma_m).max(initial=0.0)))
        seconds, sure = seconds + found.off_m.size, sure + int((found.off_m < 10.0).sum())
    print(
        f"{kind}: spoofed {spoofed} of {draws}, chosen {chose}, predicted wrong {predicted:.2g}, wrong {wrong}; "
        f"trusted fixes off by {off_m:.1f} m at most, {over:.1f} sigma; {sure} of {seconds} within 10 m"
    )
    assert chose > draws / 4
    assert stats.binom.sf(wrong - 1, chose, 1e-3) > 1e-3
    assert off_m < 20.0
