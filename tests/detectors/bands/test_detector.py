"""Codes of two bands of one satellite: the ionosphere parts them, false signals on one band part them further."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from skyproof.detectors.bands.detector import Bands, BandsSettings
from skyproof.detectors.bands.laws import evaluate_common_change
from skyproof.records import Cause, Observations, Records, SignalId
from skyproof.testing import MeasuredScene, TrackErrors

RATE = 1e-6
SCENE = MeasuredScene(
    antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=10, errors=TrackErrors(sigma_m=1.0, constant_m=1.0)
)
L5_HZ = 1176.45e6


def make_two_bands(
    rng: np.random.Generator, shift_m=None, ionosphere_m: float = 15.0, scene: MeasuredScene = SCENE
) -> Records:
    """Return a clean sky on L1 and L5: each satellite with an ionosphere and a group delay, `shift_m` added to L1."""
    records = scene.records(rng)
    (o,) = records.observations
    n = len(o.signals)
    slant_m = rng.uniform(0.3, 1.0, n) * ionosphere_m
    gamma = (1575.42e6 / L5_HZ) ** 2
    second_m = o.pseudorange_m + (gamma - 1.0) * slant_m + 40.0 + rng.normal(0.0, 2.0, n)
    second_m += rng.normal(0.0, 1.0, second_m.shape)
    first_m = o.pseudorange_m + (0.0 if shift_m is None else np.asarray(shift_m))
    signals = tuple(SignalId(s.sat, "L5", "Q") for s in o.signals)
    other = replace(o, signals=signals, pseudorange_m=second_m, carrier_hz=np.full(n, L5_HZ))
    first = replace(o, pseudorange_m=first_m)
    return replace(records, observations=(_join_signals(first, other),))


def _join_signals(a: Observations, b: Observations) -> Observations:
    """Return one record with the signals of both at the same epochs."""
    cells = {
        name: np.hstack([getattr(a, name), getattr(b, name)])
        for name in (
            *("pseudorange_m", "carrier_cyc", "doppler_hz", "cn0_dbhz", "pseudorange_sigma_m", "carrier_sigma_cyc"),
            *(
                "doppler_sigma_hz",
                "status",
                "half_cycle_open",
                "quadrature_m",
                "found_elapsed_s",
                "missed_elapsed_s",
                "carrier_hz",
            ),
        )
    }
    return replace(a, signals=(*a.signals, *b.signals), **cells)


def examine(records: Records):
    (evidence,) = Bands(BandsSettings(false_alarm_probability=RATE)).examine(records)[0]
    return evidence


@pytest.mark.parametrize("ionosphere_m", [2.0, 15.0, 120.0])
def test_the_ionosphere_is_no_attack(ionosphere_m) -> None:
    for seed in range(5):
        found = examine(make_two_bands(np.random.default_rng(seed), ionosphere_m=ionosphere_m))
        assert (found.says, found.code, found.failed) == ("clean", "together", False)


def test_one_code_far_off_is_named() -> None:
    shift_m = np.zeros(len(SCENE._exact[0].signals))
    shift_m[2] = -400.0
    found = examine(make_two_bands(np.random.default_rng(1), shift_m))
    sat = SCENE._exact[0].signals[2].sat
    assert (found.code, found.says, found.overrules) == ("parted", "undecided", True)
    assert found.may_also_be == (Cause.REFLECTIONS, Cause.FAULT)
    assert {ref.signal.sat for ref in found.signals} == {sat}
    assert found.data["parted"] == (f"{sat} L1/L5",)
    assert found.data["late_m"] == pytest.approx(-400.0, abs=60.0)


def test_a_false_place_on_one_band_shows() -> None:
    shift_m = np.linspace(-700.0, 700.0, len(SCENE._exact[0].signals))
    evidence = examine(make_two_bands(np.random.default_rng(1), shift_m))
    assert evidence.failed
    assert len({ref.signal.sat for ref in evidence.signals}) >= 3


def test_a_delay_that_all_share_is_the_receivers() -> None:
    assert examine(make_two_bands(np.random.default_rng(1), 5000.0)).says == "clean"


def test_one_band_alone_cannot_be_tested() -> None:
    found = examine(SCENE.records(np.random.default_rng(0)))
    assert (found.says, found.code, found.p_value) == ("undecided", "one_band", None)


def make_windows(records: Records, epochs: int = 10) -> list[Records]:
    (o,) = records.observations
    cuts = range(0, o.gpst.size, epochs)
    return [replace(records, observations=(o.read(first, first + epochs),)) for first in cuts]


def make_long_sky(seed: int, change_m=None) -> Records:
    """Return two bands over eight windows, `change_m` (n_epochs,) added to all codes of the first."""
    rng = np.random.default_rng(seed)
    shift_m = None if change_m is None else change_m[:, None]
    return make_two_bands(rng, shift_m, scene=replace(SCENE, epochs=80))


def follow(records: Records, **settings):
    """Return the findings of what all satellites do together, window by window."""
    detector, state = Bands(BandsSettings(**{"false_alarm_probability": RATE, **settings})), None
    found = []
    for window in make_windows(records):
        findings, state = detector.examine(window, state)
        found += [e for e in findings if e.code.endswith("together") and e.code != "together"]
    return found


def test_bands_of_a_clean_sky_stay_apart_as_they_were() -> None:
    found = [e for seed in range(4) for e in follow(make_long_sky(seed))]
    assert len(found) == 4 * 7  # the first window has none before
    assert {e.code for e in found} == {"go_on_together"}


@pytest.mark.parametrize("step_m", [-12.0, 40.0])
def test_a_clock_step_of_one_band_is_found_at_its_epoch(step_m) -> None:
    # The place that the band shows stays where it was: only the time of its signals moves.
    first = next(e for e in follow(make_long_sky(1, np.where(np.arange(80) >= 33, step_m, 0.0))) if e.failed)
    (o,) = make_long_sky(1).observations
    assert (first.code, first.says, first.may_also_be) == ("part_together", "undecided", (Cause.FAULT,))
    assert first.dated_gpst == o.gpst[33]
    assert len({ref.signal.sat for ref in first.signals}) == first.data["satellites"]


def test_a_clock_push_of_one_band_is_no_oscillators() -> None:
    push_m = 0.36 * np.maximum(np.arange(80) - 15.0, 0.0)
    codes = [e.code for e in follow(make_long_sky(2, push_m))]
    assert codes[-1] == "part_together"
    assert codes[0] == "go_on_together"


def test_one_satellite_that_steps_is_not_all() -> None:
    change_m = np.zeros((80, len(SCENE._exact[0].signals)))
    change_m[33:, 2] = 60.0
    records = make_two_bands(np.random.default_rng(1), change_m, scene=replace(SCENE, epochs=80))
    assert {e.code for e in follow(records)} == {"go_on_together"}


@pytest.mark.parametrize("scatter_m", [1.0, 6.0])
def test_the_chance_of_a_common_change_is_uniform(scatter_m) -> None:
    rng = np.random.default_rng(5)
    chances = [evaluate_common_change(rng.normal(0.0, scatter_m, 8), np.ones(8), 0.0)[1] for _ in range(1500)]
    assert stats.kstest(chances, "uniform").pvalue > 1e-3
