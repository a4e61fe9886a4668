"""Wrong authentications under noise that is not white: the group decision beside a rule that takes it for white.

Two receivers 20 m apart hear eight true satellites and the copies of them that one antenna sends; windows of 30 s. The
paper's rule (detector 1b at 1 %, k = 4) is given the matched tracks, as the group decision is given the sets.
"""

from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyproof.detectors.multi_receiver.detector import MultiReceiver
from skyproof.detectors.multi_receiver.settings import MultiReceiverSettings
from skyproof.records import Records
from skyproof.studies.double_difference import counting_rule, pair_tests
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

WINDOWS, ALONG = 60, 200
SHARE = 0.001 * 10.0 / 3600.0 / (4 * 2)
"""Of the false alarms of an hour: a window's of 10 s, one of four detectors', one of two receivers'."""
SATELLITES = 8
WINDOW: dict[str, Any] = {
    "epochs": 50,
    "step_s": 0.2,
    "max_satellites": 10,
    "errors": TrackErrors(sigma_m=2.0, constant_m=0.5),
}
NOISES = {
    "white, 1 m": TrackErrors(sigma_m=1.0),
    "AR(1) 0.9 from second to second, 1 m": TrackErrors(sigma_m=1.0, correlation=0.9),
    "white 1 m and constant 1 m": TrackErrors(sigma_m=1.0, constant_m=1.0),
}


def report() -> Iterator[str]:
    """Rows of the table."""
    yield f"signals a window, {WINDOWS} windows, {SATELLITES} true and {SATELLITES} false ones in each of 2 receivers"
    for name, errors in NOISES.items():
        scene = MeasuredScene(false=(FalseSky(),), epochs=30, max_satellites=SATELLITES, errors=errors)
        rng = np.random.default_rng(1)
        ours, paper = [], []
        for _ in range(WINDOWS):
            records = scene.records(rng)
            ours.append(_group_decision(records))
            paper.append(_paper_rule(records))
        yield f"  {name}"
        yield _row("group decision", np.array(ours))
        yield _row("paper's rule", np.array(paper))
    yield from _distances()


def _distances() -> Iterator[str]:
    """What is said of windows of 10 s at the error rate that a detector gets in a run, by the antennas' distance."""
    yield (
        f"{ALONG} windows of 10 s with 10 satellites, 2 m of noise at each epoch of 0.2 s, false alarms of {SHARE:g}, "
        "as a test gets in a run of two receivers"
    )
    for distance_m in (5.0, 7.0, 8.0, 10.0, 15.0, 20.0):
        antennas = {"rx1": (0.0, 0.0, 0.0), "rx2": (distance_m, 0.0, 0.0)}
        clean = MeasuredScene(antennas_enu_m=antennas, **WINDOW)
        captured = MeasuredScene(antennas_enu_m=antennas, sky=(), false=(FalseSky(),), **WINDOW)
        for words, known in {
            "at least so far": {"antenna_separation_m": distance_m},
            "distance": {"antenna_distance_m": distance_m},
            "positions": {"antennas_enu_m": antennas},
        }.items():
            given = MultiReceiverSettings(false_alarm_probability=SHARE, **known)  # type: ignore[arg-type]
            yield (
                f"  antennas {distance_m:2g} m apart, given {words:<16} clean sky {_says(clean, given)}; "
                f"nothing but false signals {_says(captured, given)}"
            )


def _says(scene: MeasuredScene, settings: MultiReceiverSettings) -> str:
    rng = np.random.default_rng(1)
    words = Counter(MultiReceiver(settings).examine(scene.records(rng))[0][0].says for _ in range(ALONG))
    return ", ".join(f"{word} {count}" for word, count in words.most_common())


def _row(name: str, counts: NDArray[np.int64]) -> str:
    false, true = counts.mean(axis=0)
    share, of = np.mean(counts[:, 0] > 0), 2 * SATELLITES
    words = f"false taken for true {false:5.2f} of {of} (in {100 * share:3.0f} % of the windows)"
    return f"    {name:<16} {words}, true recognised {true:5.2f} of {of}"


def _group_decision(records: Records) -> tuple[int, int]:
    """False and true signals called authentic; copy a is the true one here."""
    evidence, _ = MultiReceiver().examine(records)
    kept = {ref for e in evidence if e.says == "authentic" for ref in e.signals}
    return sum(ref.signal.copy != "a" for ref in kept), sum(ref.signal.copy == "a" for ref in kept)


def _paper_rule(records: Records) -> tuple[int, int]:
    """Kept, that is not removed, by the rule that counts with how many satellites each signal agrees."""
    sats = sorted({signal.sat for signal in records.observations[0].signals})
    rows = [
        (k, (i, j), _single_difference_m(records, sat, "ab"[i], "ab"[j]))
        for k, sat in enumerate(sats)
        for i in range(2)
        for j in range(2)
    ]
    differences_m = np.array([difference_m for _, _, difference_m in rows])[..., None]
    rejected = pair_tests(differences_m).p_value < 0.01
    rule = counting_rule(rejected, np.array([k for k, _, _ in rows]), np.array([tracks for _, tracks, _ in rows]))
    return int(np.sum(~rule.removed[:, :, 1])), int(np.sum(~rule.removed[:, :, 0]))


def _single_difference_m(records: Records, sat: str, of_one: str, of_other: str) -> NDArray[np.float64]:
    """Second receiver minus first, brought to the first one's instants; their clocks' differences are taken off."""
    ranges_m = []
    for observations, copy in zip(records.observations, (of_one, of_other), strict=True):
        channel = next(i for i, s in enumerate(observations.signals) if (s.sat, s.copy) == (sat, copy))
        true = next(s for s in records.sets if s.receiver == observations.receiver and s.signals[0].copy == "a")
        late = (observations.gpst - records.start_gpst) / np.timedelta64(1, "s") - true.clock_bias_s
        rate_m_s = -observations.doppler_hz[:, channel] * 299_792_458.0 / observations.carrier_hz[channel]
        ranges_m.append((late, observations.pseudorange_m[:, channel], rate_m_s))
    (at_one_s, one_m, _), (at_other_s, other_m, rate_m_s) = ranges_m
    return np.asarray(other_m + rate_m_s * (at_one_s - at_other_s) - one_m)
