"""The verdict: never stronger than the evidence, and with what would show more."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.fusion.fuse import fuse
from skyproof.records import OBSERVABLES

SKY = ("G05a", "G07a", "G10a", "G13a", "G15a")
FALSE = ("G05b", "G07b", "G10b", "G13b", "G15b")
BOTH = ("rx1", "rx2")


@pytest.fixture
def pair(invented):
    return [invented.observations(receiver=receiver) for receiver in BOTH]


def take_epochs(o, rows):
    """Take the epochs with these numbers."""
    cells = ("gpst", "elapsed_s", "status", "half_cycle_open", "quadrature_m", *OBSERVABLES)
    return replace(o, **{name: getattr(o, name)[rows] for name in cells})


def make_attacked_pair(invented):
    """Make a pair in which every satellite appears twice from 12 s on."""
    return [
        invented.observations(
            (*SKY, *FALSE),
            receiver=receiver,
            there=dict.fromkeys(FALSE, (13, 39)),
            found=dict.fromkeys(FALSE, (11.5, 12.0)),
        )
        for receiver in BOTH
    ]


def test_evidence_for_all_at_all_times_makes_it_authentic(invented, pair):
    decision = fuse([invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in range(4)], pair, [])
    assert decision.verdict == "authentic"
    assert decision.open is None
    assert (decision.onset, decision.until, decision.sources, decision.skies) == (None, None, (), ())


def test_no_evidence_is_no_attack_seen(pair):
    decision = fuse([], pair, [])
    assert decision.verdict == "no_attack_seen"
    assert decision.open.receivers == BOTH


def test_no_receiver_is_never_authentic():
    decision = fuse([], [], [])
    assert (decision.verdict, decision.open.receivers) == ("no_attack_seen", ())


def test_clean_alone_is_not_authentic(invented, pair):
    decision = fuse([invented.evidence(w, "clean", *SKY, receivers=BOTH) for w in range(4)], pair, [])
    assert decision.verdict == "no_attack_seen"
    assert {s.label for s in decision.labels} == {"unknown"}


def test_one_receiver_without_evidence_is_not_authentic(invented, pair):
    decision = fuse([invented.evidence(w, "authentic", *SKY) for w in range(4)], pair, [])
    assert decision.verdict == "no_attack_seen"
    assert decision.open.receivers == ("rx2",)


@pytest.mark.parametrize("windows", [(0,), (0, 1), (1, 2, 3), (0, 3)])
def test_authentic_for_a_part_of_the_time_is_not_authentic(invented, pair, windows):
    decision = fuse([invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in windows], pair, [])
    assert decision.verdict == "no_attack_seen"
    assert "authentic" in {s.label for s in decision.labels}


def test_authentic_for_the_common_time_is_authentic(invented):
    observed = [invented.observations(), invented.observations(receiver="rx2", begin_s=20)]
    evidence = [invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in (2, 3)]
    decision = fuse(evidence, observed, [])
    assert decision.verdict == "authentic"
    assert {(s.ref.receiver, s.label, s.first_epoch, s.last_epoch) for s in decision.labels} == {
        ("rx1", "unknown", 0, 19),
        ("rx1", "authentic", 20, 39),
        ("rx2", "authentic", 0, 19),
        ("rx2", "unknown", 20, 39),
    }
    assert decision.alone_s == (("rx1", 20.0), ("rx2", 20.0))


@pytest.mark.parametrize(("alone_s", "verdict"), [(5, "authentic"), (30, "authentic"), (40, "no_attack_seen")])
def test_a_receiver_recorded_alone_for_long_leaves_it_open(invented, alone_s, verdict):
    # One antenna cannot vouch for itself: false signals could have come in that time.
    observed = [invented.observations(duration_s=20 + alone_s), invented.observations(receiver="rx2", duration_s=20)]
    evidence = [invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in (0, 1)]
    decision = fuse(evidence, observed, [])
    assert decision.verdict == verdict
    assert decision.alone_s == ((("rx1", alone_s),) if verdict == "authentic" and alone_s > 5 else ())


def test_a_few_signals_are_too_few_for_authentic(invented, pair):
    decision = fuse([invented.evidence(w, "authentic", *SKY[:3], receivers=BOTH) for w in range(4)], pair, [])
    assert decision.verdict == "no_attack_seen"


def test_a_receiver_that_never_had_a_fix_is_not_authentic(invented):
    # Two signals from different directions for some seconds say nothing of a recording in which nobody had a fix.
    observed = [invented.observations(SKY[:3])]
    evidence = [invented.evidence(w, "authentic", *SKY[:3]) for w in range(4)]
    assert fuse(evidence, observed, []).verdict == "no_attack_seen"


def test_four_signals_are_enough_to_be_misled(invented):
    observed = [invented.observations(SKY[:4])]
    assert fuse([invented.evidence(0, "authentic", *SKY[:4])], observed, []).verdict == "no_attack_seen"
    assert fuse([invented.evidence(w, "authentic", *SKY[:4]) for w in range(4)], observed, []).verdict == "authentic"


def test_time_without_any_fix_is_stated_beside_authentic(invented):
    observed = [invented.observations(there=dict.fromkeys(SKY[2:], (0, 24)))]
    decision = fuse([invented.evidence(w, "authentic", *SKY) for w in (0, 1, 2)], observed, [])
    assert decision.verdict == "authentic"
    assert decision.without_fix_s == (("rx1", 15.0),)


@pytest.mark.parametrize(("word", "verdict"), [("clean", "no_attack_seen"), ("attack", "spoofed")])
def test_time_without_signals_is_stated_whatever_the_verdict(invented, word, verdict):
    lost = invented.observations(SKY, there=dict.fromkeys(SKY[1:], (8, 39)))
    for observed in (lost, take_epochs(lost, np.r_[0, 8:40])):
        decision = fuse([invented.evidence(3, word, *SKY)], [observed], [])
        assert decision.verdict == verdict
        assert decision.without_fix_s == (("rx1", 8.0),)
    moment = invented.observations(SKY, there=dict.fromkeys(SKY, (4, 39)))
    assert fuse([invented.evidence(3, word, *SKY)], [moment], []).without_fix_s == ()


def test_signals_that_are_lost_for_a_moment_do_no_harm(invented):
    observed = [invented.observations(receiver=r, slips=dict.fromkeys(SKY, (17,))) for r in BOTH]  # 3 s of window 1
    evidence = [invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in range(4)]
    assert fuse(evidence, observed, []).verdict == "authentic"


def test_time_without_any_epoch_is_time_without_signals(invented):
    kept = np.r_[0:20, 29:60]
    observed = [
        replace(
            o,
            **{
                name: getattr(o, name)[kept]
                for name in ("gpst", "elapsed_s", "status", "half_cycle_open", "quadrature_m", *OBSERVABLES)
            },
        )
        for o in (invented.observations(duration_s=60, receiver=r) for r in BOTH)
    ]
    evidence = [invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in (0, 1, 3, 4, 5)]
    assert fuse(evidence, observed, []).verdict == "authentic"


def test_a_failed_test_that_overrules_is_the_first_reason(invented, pair):
    evidence = [invented.evidence(window, "authentic", *SKY, receivers=BOTH) for window in range(4)]
    evidence += [invented.evidence(window, "undecided", *SKY, p_value=None, code="often") for window in range(4)]
    assert fuse(evidence, pair, []).verdict == "authentic"
    broken = invented.evidence(1, "undecided", "G05a", code="jumps", overrules=True)
    decision = fuse([*evidence, broken], pair, [])
    assert decision.verdict == "suspect"
    assert decision.open.receivers == decision.suspicion.receivers == ("rx1",)
    assert decision.suspicion.finding.code == "jumps"


def test_only_the_reason_of_most_windows_is_given(invented, pair):
    findings = [invented.evidence(w, "undecided", *SKY, p_value=0.5, code="near", null="one antenna") for w in range(3)]
    findings.append(invented.evidence(3, "undecided", *SKY, p_value=0.5, code="few", null="one antenna"))
    assert fuse(findings, pair, []).open.finding is findings[2]


def test_a_missing_test_is_no_reason_beside_one_that_ran(invented, pair):
    could_not = [invented.evidence(w, "undecided", *SKY, code="few", p_value=None) for w in range(3)]
    ran = invented.evidence(3, "undecided", *SKY, p_value=0.5, code="near", null="one antenna")
    assert fuse([*could_not, ran], pair, []).open.finding is ran
    assert fuse(could_not, pair, []).open.finding is None


# --- what is suspected


def test_a_test_that_fails_in_one_window_makes_the_run_suspect(invented, pair):
    findings = [invented.evidence(w, "clean", *SKY, receivers=BOTH, p_value=0.4) for w in range(4)]
    assert fuse(findings, pair, []).verdict == "no_attack_seen"
    failed = invented.evidence(2, "undecided", *SKY, detector="two", may_also_be=("oscillator",))
    decision = fuse([*findings, failed], pair, [])
    assert decision.verdict == "suspect"
    found = decision.suspicion
    assert (found.receivers, found.finding) == (("rx1",), failed)
    assert found.may_also_be == ("oscillator",)
    assert (decision.onset.seen, decision.onset.earliest) == (failed.end_gpst, None)


@pytest.mark.parametrize(
    "changes", [{"p_value": 1e-5}, {"null": "one antenna"}, {"says": "clean"}], ids=["passed", "other null", "clean"]
)
def test_only_a_rejected_sky_is_a_suspicion(invented, pair, changes):
    failed = invented.evidence(2, "undecided", *SKY)
    assert fuse([failed], pair, []).verdict == "suspect"
    assert fuse([invented.restate(failed, **changes)], pair, []).verdict == "no_attack_seen"


def test_a_suspicion_is_dated_by_the_test_that_dates_it(invented, pair):
    late = invented.evidence(1, "undecided", *SKY, detector="two")
    dated = invented.evidence(2, "undecided", *SKY, p_value=1e-20, dated_gpst=invented.at(14.0))
    decision = fuse([late, dated], pair, [])
    assert (decision.onset.gpst, decision.onset.sigma_s) == (invented.at(14.0), None)


def test_a_suspicion_names_the_causes_that_all_windows_allow(invented, pair):
    def fail(window, p_value, detector, *causes):
        return invented.evidence(window, "undecided", *SKY, p_value=p_value, detector=detector, may_also_be=causes)

    findings = [fail(w, p, "two", "shade", "gain") for w, p in enumerate((1e-7, 1e-30, 1e-9))]
    findings.append(fail(3, 1e-60, "three", "fault", "shade"))
    found = fuse(findings, pair, []).suspicion
    assert (found.finding, found.may_also_be) == (findings[1], ("shade",))
    findings[3] = fail(3, 1e-60, "three", "fault")
    assert fuse(findings, pair, []).suspicion.may_also_be == ("shade", "gain", "fault")


def test_a_rival_signal_is_suspect_since_it_was_found(invented):
    evidence = [invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in range(4)]
    signals = {"there": {"G05b": (20, 39)}, "found": {"G05b": (19.0, 19.5)}}
    o = invented.observations((*SKY, "G05b"), **signals)
    cn0_dbhz = np.full_like(o.cn0_dbhz, 45.0)
    cn0_dbhz[:, -1] += 3.0
    later_m = np.where(np.arange(6) == 5, 900.0, 0.0)
    rival = replace(o, cn0_dbhz=cn0_dbhz, pseudorange_m=o.pseudorange_m + later_m)
    decision = fuse(evidence, [rival, invented.observations(receiver="rx2")], [])
    assert (decision.verdict, decision.suspicion.finding) == ("suspect", None)
    assert decision.suspicion.may_also_be == ("fault",)
    assert (decision.onset.earliest, decision.onset.seen) == (invented.at(19.0), invented.at(19.52))


def test_an_attack_is_dated_by_a_test_that_failed_in_its_window(invented, pair):
    attack = invented.evidence(1, "attack", *SKY)
    failed = invented.evidence(1, "undecided", *SKY, detector="two", dated_gpst=invented.at(10.5))
    assert fuse([attack], pair, []).onset.seen == attack.end_gpst
    assert fuse([attack, failed], pair, []).onset.seen == invented.at(10.5)
    before = replace(failed, dated_gpst=invented.at(3.0))
    assert fuse([attack, before], pair, []).onset.seen == attack.end_gpst


def test_an_attack_is_dated_by_what_overruled_just_before(invented, pair):
    attack = invented.evidence(2, "attack", *SKY)
    failed = invented.evidence(1, "undecided", *SKY, detector="two", dated_gpst=invented.at(16.5))
    assert fuse([failed, attack], pair, []).onset.seen == invented.at(30.0)
    overruled = invented.restate(failed, overrules=True)
    assert fuse([overruled, attack], pair, []).onset.seen == invented.at(16.5)
    long_ago = replace(overruled, dated_gpst=invented.at(4.0))
    assert fuse([long_ago, attack], pair, []).onset.seen == invented.at(30.0)


def test_an_attack_is_dated_by_the_test_that_shows_it(invented, pair):
    attack = invented.evidence(2, "attack", *SKY, dated_gpst=invented.at(4.0))
    assert fuse([attack], pair, []).onset.seen == invented.at(4.0)


# --- what stays unexplained


def make_doubled_pair(invented, *, late_m: float, over_db: float):
    """Make a pair whose first receiver has a second signal of G05 all the time."""
    o = invented.observations((*SKY, "G05b"))
    pseudorange_m, cn0_dbhz = o.pseudorange_m.copy(), np.full_like(o.cn0_dbhz, 45.0)
    pseudorange_m[:, -1] += late_m
    cn0_dbhz[:, -1] += over_db
    return [replace(o, pseudorange_m=pseudorange_m, cn0_dbhz=cn0_dbhz), invented.observations(receiver="rx2")]


@pytest.mark.parametrize(
    ("late_m", "over_db", "kind", "verdict"),
    [(500.0, -6.0, "echo", "authentic"), (500.0, 3.0, "rival", "suspect"), (-500.0, -6.0, "rival", "suspect")],
)
def test_a_second_signal_that_is_no_echo_leaves_all_open(invented, late_m, over_db, kind, verdict):
    evidence = [invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in range(4)]
    decision = fuse(evidence, make_doubled_pair(invented, late_m=late_m, over_db=over_db), [])
    assert [(str(u.ref.signal), u.kind, u.cn0_dbhz, u.over_db) for u in decision.unexplained] == [
        ("G05 L1 CA b", kind, 45.0 + over_db, over_db)
    ]
    assert decision.verdict == verdict


@pytest.mark.parametrize(
    ("late_m", "over_db", "kind", "verdict"),
    [
        (500.0, -6.0, "echo", "authentic"),
        (-500.0, 6.0, "echo", "authentic"),
        (500.0, 3.0, "rival", "suspect"),
        (-500.0, -6.0, "rival", "suspect"),
    ],
)
@pytest.mark.parametrize("epoch_s", [1.0, 0.001])
def test_two_unknown_signals_of_a_satellite_leave_all_open(invented, late_m, over_db, kind, verdict, epoch_s):
    # Also in a recording of tens of milliseconds.
    evidence = [invented.evidence(w, "authentic", *SKY[1:], receivers=BOTH) for w in range(4)]
    observed = [
        replace(o, elapsed_s=epoch_s * o.elapsed_s) for o in make_doubled_pair(invented, late_m=late_m, over_db=over_db)
    ]
    decision = fuse(evidence, observed, [])
    found = {str(u.ref.signal): u.kind for u in decision.unexplained if u.ref.receiver == "rx1"}
    assert found == {"G05 L1 CA a": "untested", "G05 L1 CA b": kind}
    assert decision.verdict == verdict


def test_satellites_received_twice_are_counted_while_open(invented):
    (o, _) = make_doubled_pair(invented, late_m=500.0, over_db=8.0)
    decision = fuse([], [o], [])
    assert [(str(u.ref.signal), u.kind, u.over_db) for u in decision.unexplained] == [("G05 L1 CA b", "double", 8.0)]


def test_a_satellite_that_fits_nothing_leaves_the_whole_open(invented):
    names = (*SKY, "G20a")
    observed = [invented.observations(names), invented.observations(names, receiver="rx2")]
    evidence = [invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in range(4)]
    assert [u.kind for u in fuse(evidence, observed, []).unexplained] == ["untested", "untested"]
    assert fuse(evidence, observed, []).verdict == "authentic"
    evidence += [invented.evidence(w, "undecided", *names, receivers=("rx1",), detector="two") for w in range(4)]
    decision = fuse(evidence, observed, [])
    assert sorted(u.kind for u in decision.unexplained) == ["misfit", "untested"]
    assert decision.verdict == "suspect"
    assert decision.suspicion.may_also_be == ("fault", "reflections")


def test_signals_that_are_received_for_a_moment_are_not_counted(invented):
    names = (*SKY, "G20a")
    observed = [invented.observations(names, there={"G20a": (12, 15)}), invented.observations(receiver="rx2")]
    evidence = [invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in range(4)]
    assert fuse(evidence, observed, []).unexplained == ()


# --- under attack


def decide_windows(invented, windows=range(1, 4)):
    return [
        invented.evidence(w, says, *names, receivers=BOTH)
        for w in windows
        for says, names in (("authentic", SKY), ("spoofed", FALSE))
    ]


def test_a_decided_attack_has_source_onset_and_no_open_question(invented):
    clean = [invented.evidence(0, "authentic", *SKY, receivers=BOTH)]
    sets = [invented.sky(w, *names) for w in (1, 2, 3) for names in (SKY, FALSE)]
    decision = fuse([*clean, *decide_windows(invented)], make_attacked_pair(invented), sets)
    assert decision.verdict == "spoofed"
    assert decision.open is None
    assert decision.skies == ()
    assert len(decision.sources) == 1
    assert len(decision.sources[0].signals) == 10
    assert decision.onset.seen == invented.at(12.02)
    assert decision.until is None
    assert {s.ref.signal.copy for s in decision.labels if s.label == "authentic"} == {"a"}
    assert {s.ref.signal.copy for s in decision.labels if s.label == "spoofed"} == {"b"}


def test_one_spoofed_window_outweighs_many_authentic_ones(invented):
    evidence = [invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in range(4)]
    evidence.append(invented.evidence(2, "spoofed", *FALSE, receivers=BOTH))
    assert fuse(evidence, make_attacked_pair(invented), []).verdict == "spoofed"


def test_an_attack_with_a_receiver_left_open_says_which(invented):
    evidence = [invented.evidence(w, "spoofed", *FALSE, receivers=BOTH) for w in range(1, 4)]
    evidence += [invented.evidence(w, "authentic", *SKY, receivers=("rx1",)) for w in range(4)]
    decision = fuse(evidence, make_attacked_pair(invented), [])
    assert decision.verdict == "spoofed"
    assert decision.open.receivers == ("rx2",)


def test_a_signal_that_was_captured_begins_the_attack(invented, pair):
    # No new signal was found: the channels went over from the true ones to the false ones.
    says = ["authentic", "authentic", "spoofed", "spoofed"]
    decision = fuse([invented.evidence(w, s, *SKY, receivers=BOTH) for w, s in enumerate(says)], pair, [])
    assert decision.verdict == "spoofed"
    assert (decision.onset.seen, decision.onset.earliest) == (invented.at(20), None)  # it may have been hidden before


def test_an_attack_from_the_first_moment_has_no_sigma(invented, pair):
    decision = fuse([invented.evidence(w, "spoofed", *SKY, receivers=BOTH) for w in range(4)], pair, [])
    assert (decision.onset.gpst, decision.onset.sigma_s) == (invented.at(0), None)


def test_an_unnamed_attack_was_present_when_its_window_ended(invented, pair):
    says = ["clean", "attack", "clean", "attack"]
    evidence = [invented.evidence(w, s, *SKY, receivers=BOTH) for w, s in enumerate(says)]
    decision = fuse(evidence, pair, [])
    assert (decision.onset.seen, decision.onset.earliest) == (evidence[1].end_gpst, None)


def test_an_attack_that_ends_is_reported(invented):
    observed = [
        invented.observations(
            (*SKY, *FALSE), receiver=r, there=dict.fromkeys(FALSE, (13, 28)), found=dict.fromkeys(FALSE, (11.5, 12.0))
        )
        for r in BOTH
    ]
    evidence = decide_windows(invented, windows=(1, 2)) + [
        invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in (0, 3)
    ]
    assert fuse(evidence, observed, []).until == invented.at(28)


# --- one receiver alone


def test_two_skies_are_shown_while_it_is_open_which_is_true(invented):
    (observed, _) = make_attacked_pair(invented)
    sets = [invented.sky(0, *SKY)] + [invented.sky(w, *names) for w in (1, 2, 3) for names in (SKY, FALSE)]
    evidence = [invented.evidence(w, "attack", *SKY, *FALSE) for w in (1, 2, 3)]
    decision = fuse(evidence, [observed], sets)
    assert decision.verdict == "spoofed"
    assert decision.open.finding is evidence[-1]
    assert {s.label for s in decision.labels} == {"unknown"}
    assert decision.sources == ()
    assert [{r.signal.copy for r in sky.signals} for sky in decision.skies] == [{"a"}, {"b"}]
    assert decision.onset.seen == invented.at(12.02)  # when the second sky came


def test_skies_that_swap_signals_for_a_window_do_not_become_one(invented):
    # A set that takes one signal of the other sky in one window must not tie both skies together.
    (observed, _) = make_attacked_pair(invented)
    mixed = ("G05a", "G07a", "G10a", "G13a", "G15b"), ("G05b", "G07b", "G10b", "G13b", "G15a")
    sets = [invented.sky(w, *names) for w in (1, 3) for names in (SKY, FALSE)] + [invented.sky(2, *m) for m in mixed]
    evidence = [invented.evidence(w, "attack", *SKY, *FALSE) for w in (1, 2, 3)]
    decision = fuse(evidence, [observed], sets)
    assert len(decision.skies) == 2
    assert all(len({r.signal.sat for r in sky.signals}) == len(sky.signals) for sky in decision.skies)


def test_words_reach_from_the_first_epoch_to_the_last(invented, pair):
    decision = fuse([invented.evidence(w, "authentic", *SKY, receivers=BOTH) for w in range(4)], pair, [])
    assert [(word.receiver, word.word) for word in decision.windows] == [("rx1", "authentic"), ("rx2", "authentic")]
    assert {(word.start_gpst, word.end_gpst) for word in decision.windows} == {(pair[0].gpst[0], pair[0].gpst[-1])}


def test_a_suspect_run_without_epochs_has_no_words(invented):
    assert fuse([invented.evidence(0, "undecided", *SKY, p_value=1e-9)], [], []).windows == ()
