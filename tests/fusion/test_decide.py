"""Words from window to window: the table of transitions, and causes that compete for what failed."""

from itertools import combinations

import numpy as np
import pytest
from scipy.stats import chi2

from skyproof.fusion.decide import Deciding, decide, decide_all, find_worst_word, weigh
from skyproof.records import Cause, Finding, Hypothesis, SignalId, SignalRef

T0 = np.datetime64("2024-05-14T10:00:00", "ns")
SATS = tuple(f"G{n:02d}" for n in range(1, 11))
ALPHA = 1e-6


def make_refs(receiver="rx1", sats=SATS):
    return tuple(SignalRef(receiver, SignalId(sat, "L1", "CA", "a")) for sat in sats)


def make_finding(p, hypothesis=Hypothesis.ONE_POSITION, *, window=0, alpha=ALPHA, receiver="rx1"):
    start = T0 + np.timedelta64(10 * window, "s")
    return Finding(
        detector=f"test_of_{hypothesis.value}",
        start_gpst=start,
        end_gpst=start + np.timedelta64(10, "s"),
        signals=make_refs(receiver),
        hypothesis=hypothesis,
        code="x",
        p=p,
        alpha=alpha,
    )


PASSED = {Cause.CLEAN: 0.5}
OPEN = {Cause.CLEAN: 1e-9, Cause.REFLECTIONS: 0.3}
ATTACK = {Cause.CLEAN: 1e-9, Cause.REFLECTIONS: 1e-9}
SHOWN = {
    "attack": make_finding(ATTACK),
    "stopped": make_finding(OPEN, Hypothesis.CONTINUOUS),
    "failed": make_finding(OPEN),
    "true": make_finding({Cause.FALSE_SKY: 1e-9}, Hypothesis.FALSE_SKY),
    "nothing": make_finding(PASSED),
}
TABLE = {
    ("true",): "spoofed suspect suspect authentic no_attack_seen",
    ("nothing",): "spoofed suspect suspect authentic no_attack_seen",
    ("failed",): "spoofed suspect suspect authentic no_attack_seen",
    ("stopped",): "spoofed suspect suspect authentic suspect",
    ("stopped", "failed"): "spoofed suspect suspect authentic suspect",
    ("attack",): "spoofed spoofed spoofed authentic spoofed",
    ("attack", "true"): "spoofed suspect suspect authentic no_attack_seen",
}


def run(shown, receivers=("rx1",)):
    state = Deciding()
    for number, name in enumerate(shown):
        start = T0 + np.timedelta64(10 * number, "s")
        state, _ = decide(state, [SHOWN[name]], receivers, start, start + np.timedelta64(10, "s"))
    return state


@pytest.mark.parametrize("before", TABLE)
def test_words_follow_the_table_of_transitions(before):
    assert [run((*before, observed)).words[-1].word for observed in SHOWN] == TABLE[before].split()


def test_a_run_has_the_worst_of_its_words():
    assert run(("true", "failed", "true")).word == "suspect"
    assert find_worst_word([]) is None


def test_state_grows_with_changes_of_word_alone():
    state = run(["true"] * 50 + ["failed"] * 50)
    assert [word.word for word in state.words] == ["authentic", "suspect"]
    assert state.words[0].end_gpst == state.words[1].start_gpst == T0 + np.timedelta64(500, "s")


def test_another_receivers_findings_change_no_word():
    state, _ = decide(Deciding(), [SHOWN["attack"]], ("rx1", "rx2"), T0, T0 + np.timedelta64(10, "s"))
    assert [word.word for word in state.words] == ["spoofed", "no_attack_seen"]


def test_one_cause_that_explains_all_leaves_it_open():
    findings = [make_finding(OPEN), make_finding({Cause.CLEAN: 1e-9, Cause.REFLECTIONS: 0.2, Cause.FAULT: 0.4})]
    assert weigh(findings, "rx1") is None
    state, _ = decide(Deciding(), findings, ("rx1",), T0, T0 + np.timedelta64(10, "s"))
    assert state.words[-1].causes == (Cause.REFLECTIONS,)


def test_two_causes_together_leave_it_open():
    findings = [
        make_finding(OPEN | {Cause.OSCILLATOR: 1e-9}),
        make_finding({Cause.CLEAN: 1e-9, Cause.OSCILLATOR: 1.0, Cause.REFLECTIONS: 1e-9}),
    ]
    assert weigh(findings, "rx1") is None
    state, _ = decide(Deciding(), findings, ("rx1",), T0, T0 + np.timedelta64(10, "s"))
    assert set(state.words[-1].causes) == {Cause.REFLECTIONS, Cause.OSCILLATOR}


THREE = (Cause.OSCILLATOR, Cause.FAULT, Cause.REFLECTIONS)


def test_a_cause_that_a_test_does_not_list_stays_open():
    assert weigh([make_finding({Cause.CLEAN: 1e-30, cause: 1.0}) for cause in THREE], "rx1") is None


def test_what_no_two_causes_explain_is_an_attack():
    three = [make_finding(dict.fromkeys((Cause.CLEAN, *THREE), 1e-30) | {cause: 1.0}) for cause in THREE]
    found = weigh(three, "rx1")
    assert found.says == "attack"
    assert found.alpha == pytest.approx(3 * ALPHA)
    assert max(found.p.values()) == pytest.approx(3e-30)
    state, together = decide(Deciding(), three, ("rx1",), T0, T0 + np.timedelta64(10, "s"))
    assert state.word == "spoofed"
    assert len(together) == 1


def test_findings_of_different_windows_are_not_weighed_together(invented):
    every = dict.fromkeys((Cause.CLEAN, *THREE), 1e-30)
    apart = [make_finding(every | {cause: 1.0}, window=n) for n, cause in enumerate(THREE)]
    state = decide_all(apart, [invented.observations()])
    assert state.word == "suspect"


# --- the table of the guide to decisions: ten satellites, a place that is known, one and two satellites spoilt


def draw_p_values(errors_m, shown_off_m, rng, n):
    """Draw p-values (n,) of both tests by cause, for ranges of 1 m and a place that is known to 1 m."""
    unit = rng.normal(size=(10, 3))
    unit[:, 2] = np.abs(unit[:, 2])
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    design = np.column_stack([-unit, np.ones(10)])
    ranges_m = rng.normal(size=(n, 10)) + errors_m + design[:, :3] @ shown_off_m
    known_m = rng.normal(size=(n, 3))

    def select_tests(kept):
        gain = np.linalg.pinv(design[kept])
        solved = ranges_m[:, kept] @ gain.T
        residual = ranges_m[:, kept] - solved @ design[kept].T
        fit = chi2.sf((residual**2).sum(axis=1), len(kept) - 4)
        cov = (gain @ gain.T)[:3, :3] + np.eye(3)
        off = solved[:, :3] - known_m
        return fit, chi2.sf(np.einsum("ni,ij,nj->n", off, np.linalg.inv(cov), off), 3)

    ways = {cause: [set(range(10)) - set(out) for out in combinations(range(10), k)] for cause, k in SPOILT.items()}
    found = {cause: [select_tests(sorted(kept)) for kept in each] for cause, each in ways.items()}
    return {cause: np.max(np.array(each), axis=0) for cause, each in found.items()}


SPOILT = {Cause.CLEAN: 0, Cause.FAULT: 1, Cause.REFLECTIONS: 2}


@pytest.mark.parametrize(
    ("errors_m", "off_m", "suspect", "spoofed"),
    [
        pytest.param([0.0] * 10, 0.0, (0.0, 0.02), (0.0, 0.004), id="clean"),
        pytest.param([30.0] + [0.0] * 9, 0.0, (1.0, 1.0), (0.0, 0.004), id="one satellite"),
        pytest.param([25.0, 60.0] + [0.0] * 8, 0.0, (1.0, 1.0), (0.0, 0.02), id="two satellites"),
        pytest.param([0.0] * 10, 15.0, (0.98, 1.0), (0.8, 1.0), id="a sky 15 m off"),
    ],
)
def test_words_have_their_rates_under_each_cause(errors_m, off_m, suspect, spoofed):
    rng, n = np.random.default_rng(7), 1000
    p = draw_p_values(np.array(errors_m), np.array([off_m, 0.0, 0.0]), rng, n)
    nulls = (Hypothesis.ONE_POSITION, Hypothesis.AS_STATED)
    words = []
    for draw in range(n):
        window = [
            make_finding({cause: float(value[test, draw]) for cause, value in p.items()}, null, alpha=0.005)
            for test, null in enumerate(nulls)
        ]
        state, _ = decide(Deciding(), window, ("rx1",), T0, T0 + np.timedelta64(10, "s"))
        words.append(state.word)
    shares = [np.mean([word != "no_attack_seen" for word in words]), words.count("spoofed") / n]
    assert suspect[0] <= shares[0] <= suspect[1]
    assert spoofed[0] <= shares[1] <= spoofed[1]
