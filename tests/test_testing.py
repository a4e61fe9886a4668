"""The contract catches detectors that break it, one broken promise each."""

from dataclasses import dataclass, replace
from itertools import count
from typing import Any, ClassVar

import numpy as np
import pytest

from skyproof.detectors.base import missing, signals_of, undecided
from skyproof.navigation.fix import fix
from skyproof.records import Evidence, Need, Taps
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors, check_detector

CLEAN = MeasuredScene(epochs=4, max_satellites=6)


@dataclass(frozen=True)
class Settings:
    false_alarm_probability: float = 0.05


class Honest:
    """Alarms at its rate on records whose first pseudorange has a standard normal error: by its last digits."""

    name = "honest"
    needs: ClassVar[tuple[Need, ...]] = (Need.OBSERVATIONS,)
    usual: ClassVar[Any] = Settings()

    def __init__(self, settings=None):
        self.settings = settings or self.usual

    def chance(self, records):
        """Uniform and the same for the same records, whatever the order of the channels."""
        micrometres = np.rint(records.observations[0].pseudorange_m * 1e6).astype(np.int64)
        return float(micrometres.sum() % 1_000_003) / 1_000_003

    def examine(self, records, state=None):
        lacking = missing(self, records)
        if lacking:
            return lacking, state
        if not np.isfinite(records.observations[0].pseudorange_m).any():
            return [undecided(self, records, (), because="nothing tracked", would_need="signals")], state
        return [self.said(records, self.chance(records))], state

    def said(self, records, chance, **changes):
        evidence = Evidence(
            detector=self.name,
            start_gpst=records.start_gpst,
            end_gpst=records.end_gpst,
            subject=signals_of(records.observations),
            because="digits",
            statistic=round(chance, 4),
            says="attack" if chance < self.settings.false_alarm_probability else "clean",
            false_alarm_probability=self.settings.false_alarm_probability,
        )
        return replace(evidence, **changes)


class Nameless(Honest):
    name = "no name"


class Loose(Honest):
    @dataclass
    class Melting:
        false_alarm_probability: float = 0.05

    usual = Melting()


class Silent(Honest):
    def examine(self, records, state=None):
        return ([], state) if missing(self, records) else super().examine(records, state)


class Bold(Honest):
    def examine(self, records, state=None):
        lacking = missing(self, records)
        return ([replace(lacking[0], says="clean")], state) if lacking else super().examine(records, state)


class Blind(Honest):
    def examine(self, records, state=None):
        lacking = missing(self, records)
        return (lacking or [self.said(records, 0.5)]), state


class Meddler(Honest):
    def chance(self, records):
        array = records.observations[0].cn0_dbhz
        while array.base is not None:
            array = array.base
        array += 1.0
        return super().chance(records)


class Moody(Honest):
    calls = count()

    def chance(self, records):
        return super().chance(records) / (1.0 + next(self.calls))


class Ordered(Honest):
    def examine(self, records, state=None):
        evidence, state = super().examine(records, state)
        if evidence[0].says != "undecided":
            evidence = [replace(evidence[0], statistic=float(records.observations[0].pseudorange_m[0, 0]))]
        return evidence, state


class OfTaps(Honest):
    """Examines taps and takes their signal from their names."""

    needs = (Need.OBSERVATIONS, Need.TAPS)

    def chance(self, records):
        (taps,) = records.taps
        prompt = {signal: float(taps.value[0, k, 0, 0].real) for k, signal in enumerate(taps.signals)}
        return sum(prompt[signal] * (k + 1) for k, signal in enumerate(sorted(prompt))) * 1e4 % 1.0

    def examine(self, records, state=None):
        evidence, state = super().examine(records, state)
        if evidence[0].says != "undecided" and not np.isfinite(records.taps[0].value).any():
            evidence = [undecided(self, records, (), because="nothing tracked", would_need="signals")]
        return evidence, state


class OfTapsInOrder(OfTaps):
    """Takes the first taps for those of the first observations."""

    def chance(self, records):
        return float(records.taps[0].value[0, 0, 0, 0].real) * 1e4 % 1.0


class OfSilentTaps(OfTaps):
    """Silent where there are no taps."""

    def examine(self, records, state=None):
        return ([], state) if records.taps == () else super().examine(records, state)


class OfDarkTaps(OfTaps):
    """Says what it likes of taps that hold nothing."""

    def examine(self, records, state=None):
        lacking = missing(self, records)
        return (lacking or [self.said(records, 0.5)]), state


class Forgetful(Honest):
    """Remembers in itself, not in its state."""

    def __init__(self, settings=None):
        super().__init__(settings)
        self.windows = set()

    def examine(self, records, state=None):
        evidence, state = super().examine(records, state)
        self.windows.add(id(records))
        return [replace(evidence[0], group=len(self.windows))], state


class Nervous(Honest):
    def chance(self, records):
        return super().chance(records) / 2


class Sleepy(Honest):
    def chance(self, records):
        return super().chance(records) * 2


def test_an_honest_detector_passes():
    check_detector(Honest, CLEAN.records, np.random.default_rng(0), windows=1000)


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        (Nameless, "identifier"),
        (Loose, "not frozen"),
        (Silent, "says nothing"),
        (Bold, "it needs"),
        (Blind, "anything measured"),
        (Meddler, "changed"),
        (Moody, "different evidence"),
        (Ordered, "order"),
        (Forgetful, ": pieces"),
        (Nervous, "false alarms"),
        (Sleepy, "false alarms"),
    ],
)
def test_a_broken_promise_is_caught(broken, words):
    with pytest.raises(AssertionError, match=words):
        check_detector(broken, CLEAN.records, np.random.default_rng(0), windows=1000)


def add_taps(rng):
    """Add taps of the same channels to the scene's records, in a scene's order."""
    records = CLEAN.records(rng)
    (first, _) = records.observations
    value = rng.standard_normal((4, len(first.signals), 1, 3)).astype(np.complex64)
    taps = Taps(
        receiver=first.receiver,
        signals=first.signals,
        elapsed_s=first.elapsed_s,
        delays_chips=np.array([0.5, 0.0, -0.5]),
        dopplers_hz=np.zeros(1),
        value=value,
    )
    return replace(records, taps=(taps,))


def test_a_detector_of_other_records_passes():
    check_detector(OfTaps, add_taps, np.random.default_rng(0), windows=1000)


@pytest.mark.parametrize(
    ("broken", "words"),
    [(OfTapsInOrder, "order"), (OfSilentTaps, "nothing without"), (OfDarkTaps, "anything measured")],
)
def test_a_broken_promise_is_caught_in_other_records(broken, words):
    with pytest.raises(AssertionError, match=words):
        check_detector(broken, add_taps, np.random.default_rng(0), windows=1000)


def test_records_without_a_detectors_needs_are_no_test():
    with pytest.raises(AssertionError, match="lack taps"):
        check_detector(OfTaps, CLEAN.records, np.random.default_rng(0), windows=10)


def test_too_few_false_alarms_pass_with_a_reason():
    check_detector(Sleepy, CLEAN.records, np.random.default_rng(0), windows=1000, conservative="it sleeps")


@pytest.mark.parametrize("attacked", [False, True])
def test_the_measured_scene_shows_the_places_it_was_given(attacked):
    quiet = TrackErrors(sigma_m=0.001)
    scene = MeasuredScene(epochs=4, errors=quiet, false=(FalseSky(),) if attacked else (), sky=() if attacked else None)
    records = scene.records(np.random.default_rng(1))
    for observations, truth in zip(records.observations, records.sets, strict=True):
        found = fix(observations, records.navigation)
        assert np.linalg.norm(found.position_ecef_m - truth.position_ecef_m, axis=1).max() < 0.1
        assert np.abs(found.clock_bias_s - truth.clock_bias_s).max() < 1e-9


def test_track_errors_have_the_moments_asked_for():
    scene = MeasuredScene(
        antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=400, errors=TrackErrors(2.0, 0.8, 3.0), max_satellites=8
    )
    exact = MeasuredScene(
        antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=400, errors=TrackErrors(0.0), max_satellites=8
    ).records(np.random.default_rng(2))
    errors = [
        scene.records(np.random.default_rng(k)).observations[0].pseudorange_m - exact.observations[0].pseudorange_m
        for k in range(40)
    ]
    errors = np.array(errors)
    moving = errors - errors.mean(axis=1, keepdims=True)
    assert errors.mean(axis=1).std() == pytest.approx(3.0, rel=0.15)
    assert moving.std() == pytest.approx(2.0, rel=0.05)
    assert np.mean(moving[:, 1:] * moving[:, :-1]) / np.mean(moving**2) == pytest.approx(0.8, abs=0.03)
