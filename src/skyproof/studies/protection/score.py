"""What `protect` said of a simulated scene, held against the truth."""

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from skyproof.app.protect.coasting import usable_fixes
from skyproof.app.protect.outcome import Outcome, ReceiverOutcome
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import seconds_between
from skyproof.records import Observations
from skyproof.simulator.received import ReceiverSky, Scene
from skyproof.studies.protection.errors import STANFORD, FixErrors, fix_errors, protection_columns, stanford_rows
from skyproof.verdict import Verdict

__all__ = ["NEAR_M", "WRONG_BOUNDS", "false_labels", "onset_s", "score", "true_labels"]

NEAR_M: Final = 100.0
"""A signal whose delay is no nearer than this to any that is there is none of them."""
WRONG_BOUNDS: Final = 3.0
"""A fix that is off by so many of its 95 % bounds is a false position that was given out."""
_WRONGLY_S: Final = 1.0


def score(scene: Scene, verdict: Verdict, outcome: Outcome) -> dict[str, Any]:
    """Compute the columns of a cell that need the truth.

    delay_s : from the onset, or the first sample if the attack was there before, to the end of the first window in
        which a test does; None if none does. onset_error_s : of the onset that the verdict states.
    false_alarms : windows that end before the onset, or any without one, in which a test does.
    wrong_labels : signals called authentic or spoofed that are not, for a second or more.
    trusted_* : errors in space of fixes that may be used, but for consistent ones; trusted_share : of all epochs of all
        receivers; consistent_share : that of consistent ones. wrong_fixes : how many of all these are off, level, by
        more than `WRONG_BOUNDS` bounds and what an attack may have moved them by unnoticed.
    protection_*, beyond_* : of their protection levels, as `protection_columns` has them; the bins of a Stanford
        diagram, `stanford_rows`, stand under `STANFORD`.
    """
    began_s = onset_s(scene)
    trusted, consistent, epochs, ordinary = list[FixErrors](), list[FixErrors](), 0, 0.0
    for sky, receiver in _pairs(scene, outcome):
        log = receiver.reception.observations
        if log is None or receiver.positions is None:
            continue
        epochs += log.gpst.size
        for kind, fix in usable_fixes(receiver.positions):
            (consistent if kind == "consistent" else trusted).append(fix_errors(scene, sky, fix))
        if (plain := receiver.positions.whole("unprotected")) is not None:
            ordinary = max(ordinary, float(fix_errors(scene, sky, plain).space_m.max(initial=0.0)))
    trusted_m = np.concatenate([errors.space_m for errors in trusted]) if trusted else np.empty(0)
    p50, p95, worst = np.quantile(trusted_m, [0.5, 0.95, 1.0]) if trusted_m.size else [None] * 3
    return {
        "delay_s": _delay_s(scene, outcome, began_s),
        "onset_error_s": _onset_error_s(scene, verdict, began_s),
        "false_alarms": _false_alarms(scene, outcome, began_s),
        "wrong_labels": len(list(false_labels(scene, outcome))),
        "wrong_fixes": sum(int(np.sum(errors.beyond(WRONG_BOUNDS))) for errors in (*trusted, *consistent)),
        "trusted_p50_m": p50,
        "trusted_p95_m": p95,
        "trusted_worst_m": worst,
        "unprotected_worst_m": ordinary or None,
        "trusted_share": round(trusted_m.size / epochs, 3) if epochs else 0.0,
        "consistent_share": round(sum(errors.space_m.size for errors in consistent) / epochs, 3) if epochs else 0.0,
        **protection_columns(trusted),
        STANFORD: stanford_rows(trusted),
    }


def onset_s(scene: Scene) -> float | None:
    """Return when the first false wave is there at any antenna, of the scene's time; None without any.

    Of what was there before it is the first sample.
    """
    found = []
    for sky in scene.skies:
        first_s = [received.from_s for received in sky.signals if received.label != "authentic"]
        if first_s:
            found.append(max(min(first_s), sky.receiver.start_offset_s))
    return min(found, default=None)


def _pairs(scene: Scene, outcome: Outcome) -> Iterator[tuple[ReceiverSky, ReceiverOutcome]]:
    """Pair each receiver's outcome with what its first antenna received."""
    for receiver in outcome.receivers:
        name = receiver.reception.source.name
        yield next(sky for sky in scene.skies if sky.receiver.name == name), receiver


def _delay_s(scene: Scene, outcome: Outcome, began_s: float | None) -> float | None:
    later_s = [end_s - began_s for _, end_s in _alarms_s(scene, outcome) if began_s is not None and end_s > began_s]
    return round(min(later_s), 1) if later_s else None


def _false_alarms(scene: Scene, outcome: Outcome, began_s: float | None) -> int:
    return sum(began_s is None or end_s <= began_s for _, end_s in _alarms_s(scene, outcome))


def _alarms_s(scene: Scene, outcome: Outcome) -> set[tuple[float, float]]:
    """Collect from when to when the windows are whose tests report an attack, of the scene's time."""
    start = scene.scenario.start_gpst
    return {
        (float(seconds_between(e.start_gpst, start)), float(seconds_between(e.end_gpst, start)))
        for e in outcome.evidence
        if e.says in ("spoofed", "attack")
    }


def _onset_error_s(scene: Scene, verdict: Verdict, began_s: float | None) -> float | None:
    if began_s is None or verdict.since_gpst is None:
        return None
    stated_s = float(seconds_between(np.datetime64(verdict.since_gpst, "ns"), scene.scenario.start_gpst))
    return round(stated_s - began_s, 2)


# --- labels


def false_labels(scene: Scene, outcome: Outcome) -> Iterator[str]:
    """Describe every stretch of a second or more that is called authentic and is spoofed, or the reverse."""
    for sky, receiver in _pairs(scene, outcome):
        log = receiver.reception.observations
        if log is None:
            continue
        o = log.read(0, log.gpst.size)
        true = true_labels(o, sky, scene)
        for s in outcome.decision.labels:
            if s.ref.receiver == o.receiver and s.label in ("authentic", "spoofed"):
                column = true[s.first_epoch : s.last_epoch + 1, o.signals.index(s.ref.signal)]
                wrong = (column != "") & (column != s.label)
                if np.sum(wrong) * np.median(np.diff(o.elapsed_s)) >= _WRONGLY_S:
                    share = f"{wrong.sum()} of {wrong.size} epochs"
                    yield f"{s.ref} is called {s.label}, but is {set(column[wrong])} in {share}"


def true_labels(o: Observations, sky: ReceiverSky, scene: Scene) -> NDArray[np.str_]:
    """Label each measured signal by the nearest delay of its satellite, (n_epochs, n_channels).

    "" where none is near, where two of different labels are, or where nothing was measured.
    """
    true_s = o.elapsed_s + sky.true_minus_elapsed_s(o.elapsed_s)
    clock_s = seconds_between(o.gpst, scene.scenario.start_gpst) - true_s
    there_m = o.pseudorange_m - SPEED_OF_LIGHT_M_S * clock_s[:, None]  # what is left is delay alone
    delay_m = SPEED_OF_LIGHT_M_S * sky.code_delay_s(true_s)
    for column, received in enumerate(sky.signals):
        delay_m[(true_s < received.from_s) | (true_s >= received.until_s), column] = np.nan
    labels = np.full(o.pseudorange_m.shape, "", dtype="U9")
    for channel, signal in enumerate(o.signals):
        candidates = [column for column, received in enumerate(sky.signals) if received.id.sat == signal.sat]
        kinds = np.array([sky.signals[column].label for column in candidates])
        near = np.abs(there_m[:, channel, None] - delay_m[:, candidates]) < NEAR_M
        for kind in sorted(set(kinds)):
            alone = near[:, kinds == kind].any(axis=1) & ~near[:, kinds != kind].any(axis=1)
            labels[alone, channel] = kind
    return labels
