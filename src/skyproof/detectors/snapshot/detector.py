"""Test if the signals of a recording of some milliseconds stay constant throughout.

The receiver holds the parts of each signal against each other as it sums them up (`receiver.snapshot_changes`): one
that begins, ends or turns to another direction is a change, which noise makes with a stated probability. A true sky
does not change in so short a time. Something that shades the antenna may do it, and samples that are missing.
"""

from dataclasses import dataclass
from typing import Any

from skyproof.detectors.base import Reporter, leave_open
from skyproof.errors import require_probability
from skyproof.records import Cause, Finding, Hypothesis, Need, Records, SnapshotChanges, list_refs

__all__ = ["Snapshots", "SnapshotsSettings"]


@dataclass(frozen=True)
class SnapshotsSettings:
    """Settings of `Snapshots`. false_alarm_probability : of each receiver; the receiver's own test asks for less."""

    false_alarm_probability: float = 1e-3

    def __post_init__(self) -> None:
        require_probability("snapshot", "false_alarm_probability", self.false_alarm_probability)


class Snapshots:
    """The detector: see the module's text. It remembers nothing."""

    name = "snapshot"
    share = 0.0  # it never speaks of an attack
    needs = (Need.CHANGES,)

    def __init__(self, settings: SnapshotsSettings | None = None) -> None:
        self.settings = settings or SnapshotsSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return a finding for each receiver whose recording is a snapshot."""
        report = Reporter(self, records, Hypothesis.CONTINUOUS)
        if lacking := report.name_missing():
            return lacking, state
        return [_find(report, name, changes) for name, changes in records.changes.items()], state


def _find(report: Reporter, receiver: str, found: SnapshotChanges) -> Finding:
    signals, alpha = list_refs(receiver, found.signals), len(found.signals) * found.chance
    if not found.changes:
        return report.find(signals, "unchanged", {}, alpha=alpha)
    p_value = min(1.0, len(signals) * min(change.p_value for change in found.changes))
    return report.find(
        signals,
        "changes",
        {Cause.CLEAN: p_value, **leave_open((Cause.SHADE, Cause.MISSING_SAMPLES))},
        alpha=alpha,
        data={
            "changed": tuple(f"{change.signal.sat} {change.signal.copy}" for change in found.changes),
            "kinds": tuple(change.kind for change in found.changes),
            "after_s": tuple(change.after_s for change in found.changes),
        },
        dated_gpst=min(change.gpst for change in found.changes),
    )
