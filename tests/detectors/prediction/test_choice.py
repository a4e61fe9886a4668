"""Which of two skies is true by prediction: as rarely wrong as stated, and nothing chosen where nothing is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from skyproof.detectors.prediction.choice import (
    Prediction,
    PredictionSettings,
    collect_overlapping_fixes,
    list_compared_skies,
)
from skyproof.fusion.fuse import fuse
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.navigation.predictor import Standing, place_surveyed
from skyproof.records import OverlappingSkies, Records
from skyproof.simulator.clocks import make_clock

HOME = np.array([3.8e6, 7.9e5, 5.0e6])
OLD = ("G05a", "G07a", "G10a", "G13a", "G15a")
NEW = ("G05b", "G07b", "G10b", "G13b", "G15b")
EAST, CLOCK = np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0])
WINDOWS = 14


def make_standing(oscillator=None, *, stands=True):
    stability = None if oscillator is None else OSCILLATORS[oscillator]
    return Standing(stands=stands, oscillator=stability, by=("standing",), assumes=("receiver_stands",))


class Taken:
    """A receiver that stands is taken over.

    Its channels follow the false sky from `onset_s` on; the true one is found again once they differ by `found_m`.
    """

    def __init__(self, invented, rng, *, onset_s, away, found_m, sigma_m=1.5, clock_m=None, hidden=True):
        self.invented, self.rng, self.sigma_m = invented, rng, sigma_m
        self.clock_m = clock_m or (lambda at_s: 0.0 * at_s)
        self.lasting_m = sigma_m * rng.standard_normal((2, 4)) / np.sqrt(2.0)
        speed = np.linalg.norm(away)
        self.found_s = onset_s + found_m / speed
        self.onset_s, self.away = onset_s, away
        self.sets = [s for window in range(WINDOWS) for s in self.list_sets(window)]
        doubled = {w for w in range(WINDOWS) if sum(s.gpst == invented.at(10.0 * w + 5.0) for s in self.sets) > 1}
        self.first = min(doubled, default=None)
        self.evidence = [
            invented.evidence(
                w, "attack" if w in doubled else "clean", *OLD, *(NEW if w in doubled else ()), p_value=0.5
            )
            for w in range(WINDOWS)
        ]
        first = int(self.found_s)
        o = invented.observations(
            (*OLD, *NEW),
            duration_s=10 * WINDOWS,
            there=dict.fromkeys(NEW, (first, 10 * WINDOWS - 1)),
            found=dict.fromkeys(NEW, (self.found_s - 0.5, self.found_s)),
        )
        if not hidden:
            o = replace(o, pseudorange_m=o.pseudorange_m + np.where(np.arange(10) < 5, 0.0, 1e3))
        self.observations = o

    def list_sets(self, window):
        at_s = 10.0 * window + 5.0
        led = max(at_s - self.onset_s, 0.0) * self.away
        yield self.set_of(window, OLD, led)
        if 10.0 * window >= self.found_s:
            yield self.set_of(window, NEW, np.zeros(4))

    def set_of(self, window, names, off):
        at_s = 10.0 * window + 5.0
        white = self.sigma_m * self.rng.standard_normal(4) / np.sqrt(2.0)
        state = off + white + self.lasting_m[int(names is NEW)] + float(self.clock_m(np.array(at_s))) * CLOCK
        return replace(
            self.invented.sky(window, *names),
            position_ecef_m=HOME + state[:3],
            clock_bias_s=state[3] / SPEED_OF_LIGHT_M_S,
            covariance_m2=self.sigma_m**2 * np.eye(4),
        )

    def choose(self, predictor, **rules):
        return walk(self, self.evidence, self.sets, predictor, **rules)[0]

    def decide(self, predictor, **rules):
        return fuse([*self.evidence, *self.choose(predictor, **rules)], [self.observations], self.sets)


def walk(taken, evidence, sets, predictor, others=(), **settings):
    """Hand the windows to the detector in order; return its findings after review, and its state."""
    detector, state, found = Prediction(PredictionSettings(**settings)), None, []
    for window in range(WINDOWS):
        start, end = taken.invented.at(10.0 * window), taken.invented.at(10.0 * (window + 1))
        records = Records(
            start_gpst=start,
            end_gpst=end,
            observations=tuple(o.read(10 * window, 10 * window + 10) for o in (taken.observations, *others)),
            sets=tuple(s for s in sets if start <= s.gpst < end),
            findings=tuple(e for e in evidence if e.start_gpst == start),
            expected={"rx1": predictor},
        )
        findings, state = detector.examine(records, state)
        found += findings
    return sorted(detector.review(found), key=lambda e: e.start_gpst), state


def list_names_after(taken, found, says):
    """List by window the names of findings of this kind, once there are two skies."""
    return {
        int((e.start_gpst - taken.invented.at(0)) / np.timedelta64(10, "s")): {
            s.signal.sat + s.signal.copy for s in e.signals
        }
        for e in found
        if e.says == says and e.start_gpst >= taken.invented.at(10.0 * taken.first)
    }


@pytest.fixture
def takeover(invented):
    def make(**options):
        options = {"onset_s": 40.0, "away": 8.0 * EAST, "found_m": 400.0} | options
        return Taken(invented, np.random.default_rng(1), **options)

    return make


def test_a_standing_receiver_chooses_the_sky_at_its_old_place(takeover):
    taken = takeover()
    found = taken.choose(make_standing())
    assert set(map(frozenset, list_names_after(taken, found, "authentic").values())) == {frozenset(NEW)}
    assert set(map(frozenset, list_names_after(taken, found, "spoofed").values())) == {frozenset(OLD)}
    decision = taken.decide(make_standing())
    assert decision.verdict == "spoofed"
    assert (decision.open, decision.skies) == (None, ())
    assert [source.one_antenna for source in decision.sources] == [False]
    (until,) = {e.data["clean_until"] for e in found if "assumes" in e.data}
    assert until == "10:00:30"
    (first,) = [e for e in found if e.code == "chosen_first"]
    assert first.data["wrong"] == 1e-12


def test_fixes_while_an_attack_may_hide_are_not_learned(takeover):
    labels = takeover().decide(make_standing()).labels
    old = [(s.label, s.first_epoch, s.last_epoch) for s in labels if s.ref.signal.copy == "a"][:3]
    assert old == [("authentic", 0, 29), ("unknown", 30, 89), ("spoofed", 90, 139)]


def test_an_attack_in_a_window_without_sets_counts(takeover):
    taken = takeover()
    last = taken.invented.at(10.0 * taken.first)
    evidence = [e for e in taken.evidence if e.start_gpst <= last]
    sets = [s for s in taken.sets if s.gpst < last]
    found, _ = walk(taken, evidence, sets, make_standing())
    assert [e.code for e in found if e.says == "authentic"] == ["only_sky"] * 3


def test_a_doubtful_start_nearby_makes_this_start_doubtful(takeover):
    taken = takeover()
    nearby = replace(taken.observations, receiver="rx2")
    subject = tuple(replace(ref, receiver="rx2") for ref in taken.evidence[0].signals)
    for window, believed in ((0, False), (3, True)):
        doubted = taken.invented.restate(taken.evidence[window], subject=subject, says="attack")
        evidence = sorted([*taken.evidence, doubted], key=lambda e: e.start_gpst)
        found, _ = walk(taken, evidence, taken.sets, make_standing(), [nearby])
        assert any(e.says == "authentic" for e in found) is believed


def test_a_sky_that_came_from_afar_was_not_there_before(takeover):
    taken = takeover(onset_s=60.0, away=1e4 * EAST, hidden=False)
    found = taken.choose(make_standing())
    trusted = [e for e in found if e.says == "authentic" and e.end_gpst <= taken.invented.at(60.0)]
    assert [e.data["clean_until"] for e in trusted] == ["10:00:30"] * 3
    first = next(e for e in found if e.code == "chosen_first")
    assert first.data["assumes"][:2] == ("no_concert", "clean_start")
    assert first.data["clean_until"] == "10:00:50"


def test_a_discontinuous_window_ends_the_trusted_time(takeover):
    # Channels taken over, by a pull that is over before the true sky is found, from afar.
    taken = takeover(onset_s=40.0, away=30.0 * EAST, found_m=2000.0, hidden=False)
    found = taken.choose(make_standing())
    assert {e.data["clean_until"] for e in found if "assumes" in e.data} == {"10:00:30"}
    assert set(map(frozenset, list_names_after(taken, found, "authentic").values())) == {frozenset(NEW)}


@pytest.mark.parametrize("speed_m_s", [0.2, 0.5, 2.0])
def test_a_fixed_place_is_not_dragged_while_a_decoy_waits(takeover, speed_m_s):
    # The only sky is drawn off from 40 s on, and at 105 s another false one appears far away: none is chosen that is
    # farther off than a fix is.
    taken = takeover(onset_s=40.0, away=speed_m_s * EAST, found_m=65.0 * speed_m_s, hidden=False)
    far = {"a": np.zeros(3), "b": 3e4 * EAST[:3]}
    taken.sets = [replace(s, position_ecef_m=s.position_ecef_m + far[s.signals[0].copy]) for s in taken.sets]
    trusted = [e for e in taken.choose(make_standing()) if e.says == "authentic"]
    off_m = [
        np.linalg.norm(s.position_ecef_m - HOME)
        for e in trusted
        for s in taken.sets
        if s.signals[0].copy == "a" and e.start_gpst <= s.gpst < e.end_gpst
    ]
    assert len(trusted) > 2
    assert max(off_m) < 6.0 * 1.5 * np.sqrt(3.0)


@pytest.mark.parametrize(
    ("options", "rules"),
    [({"onset_s": -100.0}, {}), ({}, {"clean_start_s": 0.0}), ({"onset_s": -1.0, "away": 30.0 * EAST}, {})],
    ids=["both there from the first moment", "nothing taken for true", "led away from the first moment"],
)
def test_where_nothing_was_clean_nothing_is_chosen(takeover, options, rules):
    taken = takeover(**options)
    assert taken.choose(make_standing(), **rules) == []
    decision = taken.decide(make_standing(), **rules)
    assert len(decision.skies) == 2
    assert decision.open is not None


def test_a_surveyed_place_chooses_from_the_first_moment_on(takeover):
    taken = takeover(onset_s=-100.0)
    found = taken.choose(place_surveyed(make_standing(), HOME, 0.01 * np.eye(3)))
    assert set(map(frozenset, list_names_after(taken, found, "authentic").values())) == {frozenset(NEW)}


def test_a_push_of_the_clock_is_not_recognized_by_a_place(takeover):
    taken = takeover(away=8.0 * CLOCK)
    found = taken.choose(make_standing())
    assert not list_names_after(taken, found, "authentic")
    assert (found[-1].code, found[-1].data["by"]) == ("too_uncertain", ("standing",))
    decision = taken.decide(make_standing())
    assert decision.open is not None
    assert decision.open.finding.code == "too_uncertain"
    assert decision.open.receivers == ("rx1",)
    assert {s.label for s in decision.labels if s.last_epoch > 40} == {"unknown"}


def test_a_clock_push_is_recognized_moving_or_standing(takeover):
    taken = takeover(away=8.0 * CLOCK)
    for stands in (True, False):
        found = taken.choose(make_standing("ocxo", stands=stands))
        assert set(map(frozenset, list_names_after(taken, found, "authentic").values())) == {frozenset(NEW)}


def test_without_an_alarm_two_skies_are_left_alone(takeover):
    taken = takeover()
    taken.evidence = [taken.invented.restate(e, says="clean") for e in taken.evidence]
    assert not list_names_after(taken, taken.choose(make_standing()), "spoofed")


def test_before_skies_part_only_the_first_windows_are_true(takeover):
    taken = takeover(away=1.0 * EAST)
    assert taken.first is None
    taken.evidence = [
        taken.invented.restate(e, says="attack") if e.start_gpst >= taken.invented.at(80.0) else e
        for e in taken.evidence
    ]
    decision = taken.decide(make_standing())
    assert [(s.label, s.first_epoch, s.last_epoch) for s in decision.labels[:2]] == [
        ("authentic", 0, 29),
        ("unknown", 30, 139),
    ]
    assert decision.verdict == "spoofed"
    assert decision.open is not None


def test_where_others_say_what_is_true_nothing_is_chosen(takeover):
    taken = takeover()
    taken.evidence.append(taken.invented.evidence(taken.first, "authentic", *NEW))
    assert taken.choose(make_standing()) == []


def test_a_late_copy_is_no_rival(takeover):
    taken = takeover()
    taken.evidence += [taken.invented.evidence(w, "multipath", *OLD) for w in range(taken.first, WINDOWS)]
    assert not list_names_after(taken, taken.choose(make_standing()), "spoofed")


def test_whole_milliseconds_of_a_clock_do_not_matter(takeover):
    taken = takeover(away=8.0 * CLOCK, clock_m=lambda at_s: np.where(at_s > 95.0, 1e-3 * SPEED_OF_LIGHT_M_S, 0.0))
    found = taken.choose(make_standing("ocxo"))
    assert set(map(frozenset, list_names_after(taken, found, "authentic").values())) == {frozenset(NEW)}


def test_the_chosen_sky_alone_stays_chosen_and_no_other(takeover):
    last = takeover().invented.at(10.0 * (WINDOWS - 2))
    for remaining, expected in ((NEW, set(NEW)), (OLD, set())):
        taken = takeover()
        taken.sets = [s for s in taken.sets if s.gpst < last or s.signals[0].copy == remaining[0][-1]]
        found = taken.choose(make_standing())
        assert list_names_after(taken, found, "authentic").get(WINDOWS - 1, set()) == expected


def test_a_false_signal_in_the_true_sky_a_while_is_still_false(takeover):
    taken = takeover()
    first = taken.invented.at(10.0 * taken.first)
    late = taken.invented.ref("G05a").signal, taken.invented.ref("G05b").signal
    taken.sets = [
        replace(s, signals=tuple(late[1 - late.index(x)] if x in late else x for x in s.signals))
        if first <= s.gpst < first + np.timedelta64(10, "s")
        else s
        for s in taken.sets
    ]
    found = taken.choose(make_standing())
    assert list_names_after(taken, found, "authentic")[taken.first] == set(NEW[1:])
    assert list_names_after(taken, found, "spoofed")[taken.first] == set(OLD[1:])
    assert list_names_after(taken, found, "spoofed")[taken.first + 1] == set(OLD)


def draw_outcomes(invented, draws, kind):
    """Draw takeovers; return predicted and counted wrong choices, those that chose, and the worst chosen fix."""
    rng = np.random.default_rng(7)
    predicted, wrong, chose, worst_m = 0.0, 0, 0, 0.0
    for seed in range(draws):
        name = str(rng.choice(["tcxo", "tcxo-good", "ocxo", "rubidium"]))
        drawn = make_clock(name, seed=seed, duration_s=10.0 * WINDOWS)
        part = {"position": EAST, "clock": CLOCK, "both": EAST + CLOCK}[kind]
        taken = Taken(
            invented,
            rng,
            onset_s=rng.uniform(30.0, 60.0),
            away=rng.uniform(1.0, 10.0) * rng.choice([-1.0, 1.0]) * part,
            found_m=rng.uniform(10.0, 400.0),
            sigma_m=rng.uniform(1.0, 8.0),
            clock_m=lambda at_s, drawn=drawn: SPEED_OF_LIGHT_M_S * drawn.offset_s(at_s),
        )
        if taken.first is None:
            continue
        found = taken.choose(make_standing(name, stands=True))
        first = next((e for e in found if e.code == "chosen_first"), None)
        if first is None:
            continue
        chose += 1
        predicted += 1.0 / (1.0 + np.exp(first.log_likelihood_ratio))
        if {s.signal.copy for s in first.signals} == {"a"}:
            wrong += 1
            worst_m = max(worst_m, float(np.abs(taken.away).max()) * (taken.found_s - taken.onset_s + 10.0))
    print(f"{kind}: {chose} of {draws} chose, predicted wrong {predicted:.3f}, wrong {wrong}, of {worst_m:.0f} m")
    return predicted, wrong, chose


def test_no_more_choices_are_wrong_than_the_limit(invented):
    _, wrong, chose = draw_outcomes(invented, 15, "both")
    assert chose > 10
    assert wrong == 0


@pytest.mark.long
@pytest.mark.parametrize("kind", ["position", "clock", "both"])
def test_of_many_choices_no_more_are_wrong_than_the_limit(invented, kind):
    _, wrong, chose = draw_outcomes(invented, 2000, kind)
    assert chose > 600
    assert stats.binom.sf(wrong - 1, chose, PredictionSettings().wrong_choice_probability) > 1e-3


@pytest.mark.parametrize(
    ("pushed", "expected"), [(EAST, make_standing("ocxo", stands=False)), (CLOCK, make_standing())]
)
def test_a_false_sky_true_in_all_expected_loses_to_no_mixture(takeover, pushed, expected):
    # A push of the position leaves the clock; some true and some false signals fit a place and a time by chance.
    taken = takeover(away=8.0 * pushed)
    mixed = 300.0 * (EAST + CLOCK)
    taken.sets = [
        replace(s, position_ecef_m=s.position_ecef_m + mixed[:3], clock_bias_s=s.clock_bias_s + 1e-6)
        if set(signal.sat + signal.copy for signal in s.signals) == set(NEW)
        else s
        for s in taken.sets
    ]
    found = taken.choose(expected)
    assert not list_names_after(taken, found, "authentic")
    assert found[-1].code == "both_may_be_false"


# Skies that overlap: fixes that a detector took out of signals of which the receiver follows the sum


def make_overlap(taken, apart_m, doubt=3.2e-4, reflected=(1e-6, 1.0), sigma_m=3.0):
    """Make two skies at the middle of every window from the seventh on, the true one at home."""
    rng, evidence = np.random.default_rng(7), []
    for window, item in enumerate(taken.evidence):
        fixes = []
        for away in (np.zeros(4), apart_m * EAST):
            off = (away + sigma_m * rng.standard_normal(4))[:3]
            s = replace(
                taken.invented.sky(window, *OLD),
                position_ecef_m=HOME + off,
                clock_bias_s=0.0,
                covariance_m2=sigma_m**2 * np.eye(4),
            )
            fixes.append(s)
        order = int(rng.choice([-1, 1]))
        skies = (OverlappingSkies(sets=tuple(fixes[::order]), doubt=doubt, reflected=reflected[::order]),)
        says = "attack" if window == 6 else "clean"
        evidence.append(taken.invented.restate(item, says=says, overlapping=skies if window >= 6 else ()))
    return evidence


def find_chosen(taken, evidence, predictor):
    """Find what is chosen where the signals of the receiver's only set are taken over."""
    sets = [s for s in taken.sets if s.signals[0].copy == "a"]
    found, state = walk(taken, evidence, sets, predictor)
    return found, collect_overlapping_fixes(found, state).get("rx1", ()), list_compared_skies(state)


def test_of_overlapping_skies_home_is_chosen_and_none_named(takeover):
    taken = takeover()
    evidence = make_overlap(taken, 100.0)
    found, fixes, compared = find_chosen(taken, evidence, make_standing())
    assert len(fixes) == WINDOWS - 6
    off_m = np.stack([fix.mean[:3] - HOME for fix in fixes])
    assert np.abs(off_m).max() < 5.0 * 3.0
    later = [e for e in found if e.start_gpst >= taken.invented.at(60.0)]
    assert {(e.says, e.code) for e in later} == {("undecided", "chosen_overlapping")}
    assert later[0].data["wrong"] == pytest.approx(3.2e-4, rel=0.2)
    assert "one_of_overlapping" in later[0].data["assumes"]
    result = fuse([*evidence, *found], [taken.observations], taken.sets)
    assert not [s for s in result.labels if s.label == "spoofed"]
    assert len(compared) == 1


@pytest.mark.parametrize(
    ("apart_m", "doubt", "reflected"),
    [(8.0, 3.2e-4, (1e-6, 1.0)), (100.0, 1e-3, (1e-6, 1.0)), (100.0, 3.2e-4, (1e-2, 1e-6))],
)
def test_undivided_or_doubtful_skies_are_not_chosen(takeover, apart_m, doubt, reflected):
    # The third may be one at home and its reflections.
    taken = takeover()
    found, fixes, _ = find_chosen(taken, make_overlap(taken, apart_m, doubt, reflected), make_standing())
    assert fixes == ()
    later = [e for e in found if e.start_gpst >= taken.invented.at(60.0)]
    assert {e.says for e in later} == {"undecided"}
    assert {e.code for e in later} <= {"maybe_one_sky", "no_difference", "too_uncertain"}


def test_overlapping_skies_without_an_attack_are_not_compared(takeover):
    taken = takeover()
    calm = [taken.invented.restate(e, says="clean") for e in make_overlap(taken, 100.0)]
    assert find_chosen(taken, calm, make_standing())[:2] == ([], ())
