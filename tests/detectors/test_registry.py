"""How detectors are found, and that a fault in one of another package stops no run."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from skyproof.detectors import base, entries, registry
from skyproof.detectors.multi_receiver.detector import MultiReceiver
from skyproof.errors import SettingsError
from skyproof.records import Cause, Evidence, Finding, Hypothesis, Need, Records
from skyproof.testing import MeasuredScene, check_evidence, check_false_alarms, check_takes_settings

START = np.datetime64("2022-01-01", "ns")
SCENE = MeasuredScene(epochs=5)


@dataclass(frozen=True)
class Rate:
    false_alarm_probability: float = 0.01


@dataclass
class Odd:
    """A detector that returns the findings it is given."""

    settings: Rate = Rate()
    name: str = "odd"
    needs: tuple[Need, ...] = (Need.OBSERVATIONS,)
    changes: dict[str, object] = field(default_factory=dict)

    def examine(self, records, state=None):
        findings = base.undecided(self, records, base.signals_of(records.observations), because="so", would_need="more")
        return [replace(findings, **self.changes)], state


def register(monkeypatch, *points):
    """Register entry points of (name, package, what is loaded or raised)."""

    def load(what):
        if isinstance(what, Exception):
            raise what
        return what

    found = [
        SimpleNamespace(
            name=name,
            value=f"{name}:Odd",
            load=lambda what=what: load(what),
            dist=SimpleNamespace(name=package, version="0.1"),
        )
        for name, package, what in points
    ]
    monkeypatch.setattr(entries, "entry_points", lambda group: found)


def test_our_detectors_are_found_by_their_entry_points():
    found = registry.load_detectors()
    pair = {"multi_receiver", "second_signals", "residual"}
    ours = pair | {"array_common", "dccaf", "ins_array", "spin", "sqm", "vector_sqm"} | {"common_change", "continuity"}
    assert ours <= set(found)
    assert list(found) == sorted(found)
    assert all(isinstance(made(), base.Detector) and made.name == name for name, made in found.items())
    assert all(registry.is_ours(found[name]()) for name in ours)
    assert ours.isdisjoint(entries.list_foreign())


@pytest.mark.parametrize(
    ("what", "said"),
    [
        (ImportError("missing"), "odd:Odd: ImportError: missing"),
        (NameError("name 'nmupy' is not defined"), r"NameError: .*'nmupy'.*\btest_registry\.py, line"),
        (lambda: SimpleNamespace(name="odd", settings=Rate()), r"\bneeds\b.*\bexamine\b"),
        (lambda: Odd(name="other"), "'other', .*'odd'"),
        (lambda: Odd(needs=Need.OBSERVATIONS), r"skyproof\.records\.Need"),
        (lambda: Odd(settings=SimpleNamespace()), r"\bdataclass\b.*false_alarm_probability"),
    ],
)
def test_a_detector_that_fails_to_load_is_named_with_its_package(monkeypatch, what, said):
    register(monkeypatch, ("odd", "odd-package", what))
    with pytest.raises(SettingsError, match=rf"'odd' of odd-package 0\.1.*{said}"):
        registry.load_detectors()


def test_no_package_takes_the_name_of_another_ones_detector(monkeypatch):
    register(monkeypatch, ("odd", "odd-package", Odd), ("odd", "other-package", Odd))
    with pytest.raises(SettingsError, match=r"odd-package 0\.1 .*other-package 0\.1"):
        registry.load_detectors()


def test_detectors_of_other_packages_are_listed(monkeypatch):
    register(monkeypatch, ("odd", "odd-package", Odd), ("spin", "skyproof", Odd))
    assert entries.list_foreign() == {"odd": "odd-package 0.1"}


def test_a_detector_has_to_take_the_settings_of_a_run():
    class Stubborn:
        settings = Rate()

        def __init__(self):
            pass

    with pytest.raises(SettingsError, match=r"\bStubborn\b.*settings=\.\.\.: TypeError"):
        registry.instantiate(Stubborn, Rate(0.1))
    check_takes_settings(Odd())
    with pytest.raises(AssertionError, match="other settings"):
        check_takes_settings(Deaf())


class Deaf(Odd):
    def __init__(self, settings=None):
        super().__init__()


FAULTS = {
    "says is 'alarm', expected one of authentic": {"says": "alarm"},
    "p_value is 1.7, expected 0 to 1": {"p_value": 1.7},
    "p_value is nan": {"p_value": float("nan")},
    "detector is 'residual', expected its own name": {"detector": "residual"},
    "because is None, expected the reason": {"because": None},
    "assumes is 'all', expected a tuple": {"assumes": "all"},
    "subject is not a tuple of SignalRef": {"subject": ("G05",)},
    "says 'attack' at p = 0.4, above": {"says": "attack", "p_value": 0.4},
}


@pytest.mark.parametrize("fault", FAULTS)
def test_unusable_evidence_fails_the_contract_not_the_run(fault):
    records = SCENE.records(np.random.default_rng(1))
    odd = Odd(changes=FAULTS[fault])
    with pytest.raises(AssertionError, match=fault.replace(".", r"\.")):
        check_evidence(lambda: odd, records)
    ((finding,), state) = registry.examine_window(odd, records, "before")
    assert (finding.says, finding.detector, state) == ("undecided", "odd", "before")
    assert fault in finding.data["error"]
    assert (finding.code, finding.data["detector"]) == ("failed", "odd")


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"signals": ("G05",)}, "SignalRef"),
        ({"code": ""}, "code is ''"),
        ({"detector": "residual"}, "'residual'"),
        ({"p": {Cause.FAULT: 1.0}}, "of fault"),
        ({"p": {Cause.CLEAN: 1.7}}, "clean is 1.7"),
        ({"p": {Cause.CLEAN: float("nan")}}, "clean is nan"),
        ({"alpha": None}, "alpha "),
    ],
)
def test_a_finding_that_cannot_be_used_fails_the_contract(changes, fault):
    records = SCENE.records(np.random.default_rng(1))
    reporter = base.Reporter(Odd(), records, Hypothesis.CONTINUOUS)

    def find(**changed: object) -> Finding:
        finding = reporter.find(base.signals_of(records.observations), "goes_on", {Cause.CLEAN: 0.5})
        return replace(finding, **changed)

    assert registry.find_result_fault(Odd(), records, ([find()], None)) is None
    assert fault in registry.find_result_fault(Odd(), records, ([find(**changes)], None))


@pytest.mark.parametrize("given", [None, [], Evidence, ([None], None)])
def test_what_is_no_evidence_is_not_taken_for_some(given):
    class Strange(Odd):
        def examine(self, records, state=None):
            return given

    ((finding,), _) = registry.examine_window(Strange(), SCENE.records(np.random.default_rng(1)), None)
    assert "gave" in finding.data["error"]


def test_foreign_errors_are_reported_and_our_own_raised(monkeypatch):
    class Raising(Odd):
        def examine(self, records, state=None):
            raise ValueError("singular matrix")

        def review(self, evidence):
            raise KeyError("none")

    records = SCENE.records(np.random.default_rng(1))
    ((finding,), _) = registry.examine_window(Raising(), records, None)
    assert finding.data["error"].startswith("ValueError: singular matrix (test_registry.py, line")
    *before, failed = registry.review_evidence(Raising(), [finding])
    assert before == [finding]
    assert failed.says == "undecided"
    assert failed.code == "review_failed"
    assert failed.data["error"].startswith("KeyError: 'none' (test_registry.py, line")
    monkeypatch.setattr(Raising, "__module__", "skyproof.detectors.raising")
    with pytest.raises(ValueError, match="singular"):
        registry.examine_window(Raising(), records, None)


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        (lambda odd_evidence, other: [odd_evidence], "1 of 2 pieces"),
        (lambda odd_evidence, other: [None, other], "NoneType among"),
        (lambda odd_evidence, other: [replace(odd_evidence, p_value=1.7), other], "p_value is 1.7"),
    ],
)
def test_an_unusable_review_is_reported_and_changes_nothing(given, fault):
    class Reviewing(Odd):
        def review(self, evidence):
            return given(*evidence)

    odd_evidence, other = _examine_odd_and_another()
    *before, failed = registry.review_evidence(Reviewing(), [odd_evidence, other])
    assert before == [odd_evidence, other]
    assert (failed.detector, failed.says, failed.start_gpst) == ("odd", "undecided", odd_evidence.start_gpst)
    assert fault in failed.data["error"]


def test_a_review_changes_its_own_evidence_and_no_others():
    class Reviewing(Odd):
        def review(self, evidence):
            return (replace(finding, because="reviewed", says="clean") for finding in evidence)

    odd_evidence, other = _examine_odd_and_another()
    changed, kept = registry.review_evidence(Reviewing(), [odd_evidence, other])
    assert (changed.code, changed.data["because"]) == ("clean", "reviewed")
    assert kept is other


def _examine_odd_and_another():
    ((odd_evidence,), _) = Odd().examine(SCENE.records(np.random.default_rng(1)))
    return odd_evidence, replace(odd_evidence, detector="residual", says="attack", because="they fit no position")


def test_too_small_p_values_under_the_null_break_the_contract():
    rng = np.random.default_rng(3)

    class Constant(Odd):
        def examine(self, records, state=None):
            findings, state = super().examine(records, state)
            alarm = rng.random() < 0.01
            return [replace(findings[0], says="attack" if alarm else "clean", p_value=0.005 if alarm else 0.3)], state

    windows = [SCENE.records(rng)] * 400
    with pytest.raises(AssertionError, match=r"\b400 p-values\b.* 0\."):
        check_false_alarms(Constant, windows)


def test_what_is_missing_is_given_in_the_words_of_the_user():
    (evidence,) = base.missing(MultiReceiver(), Records(start_gpst=START, end_gpst=START))
    assert evidence.says == "undecided"
    assert {Need.TWO_RECEIVERS, Need.SETS} <= set(evidence.lacking)
