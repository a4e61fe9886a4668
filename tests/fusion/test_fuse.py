"""The verdict: never stronger than the evidence, and with what would decide what is open."""

import pytest

from skyproof.fusion.fuse import fuse

SKY = ("G05a", "G07a", "G10a", "G13a", "G15a")
FALSE = ("G05b", "G07b", "G10b", "G13b", "G15b")
BOTH = ("rx1", "rx2")


@pytest.fixture
def pair(invented):
    return [invented.observations(receiver=receiver) for receiver in BOTH]


def attacked_pair(invented):
    """Every satellite twice from 12 s on."""
    return [
        invented.observations(
            (*SKY, *FALSE), receiver=receiver, there=dict.fromkeys(FALSE, (13, 39)),
            found=dict.fromkeys(FALSE, (11.5, 12.0)),
        )
        for receiver in BOTH
    ]  # fmt: skip


def test_evidence_for_all_receivers_at_all_times_makes_it_authentic(invented, pair):
    decision = fuse([invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in range(4)], pair, [])
    assert decision.verdict == "authentic"
    assert decision.undecided_because is None
    assert (decision.onset, decision.until, decision.sources, decision.skies) == (None, None, (), ())


def test_no_evidence_is_undecided(pair):
    decision = fuse([], pair, [])
    assert decision.verdict == "undecided"
    assert "rx1, rx2" in decision.undecided_because


def test_no_receiver_is_undecided():
    assert fuse([], [], []).undecided_because == "no receiver gave measurements with a time"


def test_clean_alone_is_not_authentic(invented, pair):
    decision = fuse([invented.evidence(w, "clean", *SKY, receivers=BOTH) for w in range(4)], pair, [])
    assert decision.verdict == "undecided"
    assert {s.label for s in decision.labels} == {"unknown"}


def test_one_receiver_without_evidence_leaves_it_undecided(invented, pair):
    decision = fuse([invented.evidence(w, "authentic", *SKY) for w in range(4)], pair, [])
    assert decision.verdict == "undecided"
    assert "rx2" in decision.undecided_because
    assert "rx1" not in decision.undecided_because


@pytest.mark.parametrize("windows", [(0,), (0, 1), (1, 2, 3), (0, 3)])
def test_authentic_for_a_part_of_the_time_is_undecided(invented, pair, windows):
    decision = fuse([invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in windows], pair, [])
    assert decision.verdict == "undecided"
    assert "authentic" in {s.label for s in decision.labels}


def test_authentic_for_the_common_time_is_authentic(invented):
    observed = [invented.observations(), invented.observations(receiver="rx2", begin_s=20)]
    evidence = [invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in (2, 3)]
    decision = fuse(evidence, observed, [])
    assert decision.verdict == "authentic"
    assert {(s.ref.receiver, s.label, s.first_epoch, s.last_epoch) for s in decision.labels} == {
        ("rx1", "unknown", 0, 19), ("rx1", "authentic", 20, 39),
        ("rx2", "authentic", 0, 19), ("rx2", "unknown", 20, 39),
    }  # fmt: skip


def test_a_few_signals_are_too_few_for_authentic(invented, pair):
    decision = fuse([invented.evidence(w, "authentic", *SKY[:3], receivers=BOTH) for w in range(4)], pair, [])
    assert decision.verdict == "undecided"


def test_signals_that_are_lost_for_a_moment_do_no_harm(invented):
    observed = [invented.observations(receiver=r, slips=dict.fromkeys(SKY, (17,))) for r in BOTH]  # 3 s of window 1
    evidence = [invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in range(4)]
    assert fuse(evidence, observed, []).verdict == "authentic"


def test_undecided_says_what_would_decide_each_reason_once(invented, pair):
    said = [invented.evidence(w, "undecided", *SKY, because="too near", would_need="a longer mast") for w in range(3)]
    said.append(invented.evidence(3, "undecided", *SKY, because="too few", would_need="more satellites"))
    because = fuse(said, pair, []).undecided_because
    for words in ("too near", "a longer mast", "too few", "more satellites"):
        assert because.count(words) == 1
    assert because.index("too near") < because.index("too few")  # the most frequent first


# --- under attack


def decided(invented, windows=range(1, 4)):
    return [
        invented.evidence(w, says, *names, receivers=BOTH)
        for w in windows
        for says, names in (("authentic", SKY), ("spoofed", FALSE))
    ]


def test_a_decided_attack_has_source_onset_and_no_open_question(invented):
    clean = [invented.evidence(0, "authentic", *SKY, receivers=BOTH)]
    sets = [invented.sky(w, *names) for w in (1, 2, 3) for names in (SKY, FALSE)]
    decision = fuse([*clean, *decided(invented)], attacked_pair(invented), sets)
    assert decision.verdict == "spoofed"
    assert decision.undecided_because is None
    assert decision.skies == ()
    assert len(decision.sources) == 1
    assert len(decision.sources[0].signals) == 10
    assert decision.onset.gpst == invented.at(11.75)
    assert decision.until is None
    assert {s.ref.signal.copy for s in decision.labels if s.label == "authentic"} == {"a"}
    assert {s.ref.signal.copy for s in decision.labels if s.label == "spoofed"} == {"b"}


def test_one_spoofed_window_outweighs_many_authentic_ones(invented):
    evidence = [invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in range(4)]
    evidence.append(invented.evidence(2, "spoofed", *FALSE, receivers=BOTH))
    assert fuse(evidence, attacked_pair(invented), []).verdict == "spoofed"


def test_an_attack_with_a_receiver_left_open_says_which(invented):
    evidence = [invented.evidence(w, "spoofed", *FALSE, receivers=BOTH) for w in range(1, 4)]
    evidence += [invented.evidence(w, "authentic", *SKY, receivers=("rx1",)) for w in range(4)]
    decision = fuse(evidence, attacked_pair(invented), [])
    assert decision.verdict == "spoofed"
    assert "rx2" in decision.undecided_because
    assert "rx1" not in decision.undecided_because


def test_a_signal_that_was_captured_begins_the_attack(invented, pair):
    """No new signal was found: the channels went over from the true ones to the false ones."""
    says = ["authentic", "authentic", "spoofed", "spoofed"]
    decision = fuse([invented.evidence(w, s, *SKY, receivers=BOTH) for w, s in enumerate(says)], pair, [])
    assert decision.verdict == "spoofed"
    assert decision.onset.gpst == invented.at(20)
    assert decision.onset.sigma_s == pytest.approx(10.0, abs=8.0)


def test_an_attack_from_the_first_moment_has_no_sigma(invented, pair):
    decision = fuse([invented.evidence(w, "spoofed", *SKY, receivers=BOTH) for w in range(4)], pair, [])
    assert (decision.onset.gpst, decision.onset.sigma_s) == (invented.at(0), None)


def test_an_attack_that_ends_is_told(invented):
    observed = [
        invented.observations((*SKY, *FALSE), receiver=r, there=dict.fromkeys(FALSE, (13, 28)),
                              found=dict.fromkeys(FALSE, (11.5, 12.0)))
        for r in BOTH
    ]  # fmt: skip
    evidence = decided(invented, windows=(1, 2)) + [
        invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in (0, 3)
    ]
    assert fuse(evidence, observed, []).until == invented.at(28)


# --- one receiver alone


def test_two_skies_are_shown_while_it_is_open_which_is_true(invented):
    (observed, _) = attacked_pair(invented)
    sets = [invented.sky(0, *SKY)] + [invented.sky(w, *names) for w in (1, 2, 3) for names in (SKY, FALSE)]
    evidence = [invented.evidence(w, "attack", *SKY, *FALSE, would_need="a second receiver") for w in (1, 2, 3)]
    decision = fuse(evidence, [observed], sets)
    assert decision.verdict == "spoofed"
    assert "a second receiver" in decision.undecided_because
    assert {s.label for s in decision.labels} == {"unknown"}
    assert decision.sources == ()
    assert [{r.signal.copy for r in sky.signals} for sky in decision.skies] == [{"a"}, {"b"}]
    assert decision.onset.gpst == invented.at(11.75)  # when the second sky came


def test_skies_that_swap_signals_for_a_window_do_not_become_one(invented):
    """A set that takes one signal of the other sky in one window must not tie both skies together."""
    (observed, _) = attacked_pair(invented)
    mixed = ("G05a", "G07a", "G10a", "G13a", "G15b"), ("G05b", "G07b", "G10b", "G13b", "G15a")
    sets = [invented.sky(w, *names) for w in (1, 3) for names in (SKY, FALSE)] + [invented.sky(2, *m) for m in mixed]
    evidence = [invented.evidence(w, "attack", *SKY, *FALSE) for w in (1, 2, 3)]
    decision = fuse(evidence, [observed], sets)
    assert len(decision.skies) == 2
    assert all(len({r.signal.sat for r in sky.signals}) == len(sky.signals) for sky in decision.skies)
