"""What a verdict comes to in one row, and the table of all rows."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from skyproof.app.fleet.catalogue import CatalogueItem
from skyproof.formats.tables import Column, open_growing_tables
from skyproof.formats.verdict import read_verdict
from skyproof.records import LABELS
from skyproof.verdict import Verdict

__all__ = ["FleetRow", "make_row", "write_rows"]


@dataclass(frozen=True, kw_only=True)
class FleetRow:
    """One item and how it ended. Without how long it took: the same items give the same table, whatever did them.

    state : done, failed or not run. may_also_be : with ";" between several. interference_... : onset of the first
        spell, and the largest fall of C/N0. share_... : of its signals by label.
        position_... : the last fix that may be used of the first receiver that has one, with its kind. What is not
        there is None.
    """

    name: str
    inputs: str
    nav: str | None
    imu: str | None
    platform: str | None
    state: str
    error: str | None = None
    verdict: str | None = None
    summary: str | None = None
    reason: str | None = None
    may_also_be: str | None = None
    remedy: str | None = None
    since_gpst: str | None = None
    since_sigma_s: float | None = None
    until_gpst: str | None = None
    interference: str | None = None
    interference_since_gpst: str | None = None
    interference_fall_db: float | None = None
    signals: int = 0
    share_authentic: float | None = None
    share_spoofed: float | None = None
    share_multipath: float | None = None
    share_unknown: float | None = None
    position_receiver: str | None = None
    position_kind: str | None = None
    position_gpst: str | None = None
    position_lat_deg: float | None = None
    position_lon_deg: float | None = None
    position_height_m: float | None = None
    position_sigma_east_m: float | None = None
    position_sigma_north_m: float | None = None
    position_sigma_up_m: float | None = None
    position_horizontal_protection_m: float | None = None
    position_vertical_protection_m: float | None = None
    position_hidden_m: float | None = None


def make_row(item: CatalogueItem, results: Path, error: str | None) -> FleetRow:
    """Summarize an item's verdict, or why it has none, in a row.

    results : the item's folder. error : why it failed; None if it is done or was not run.

    Raises
    ------
    InputError : the verdict there cannot be read.
    """
    named: dict[str, Any] = {key: getattr(item, key) for key in ("name", "nav", "imu", "platform")}
    named["inputs"] = ";".join(item.inputs)
    if error is not None:
        return FleetRow(**named, state="failed", error=error)
    if not (results / "verdict.json").exists():
        return FleetRow(**named, state="not run")
    return FleetRow(**named, state="done", **_of_verdict(read_verdict(results / "verdict.json")))


def _of_verdict(verdict: Verdict) -> dict[str, Any]:
    keys = ("verdict", "summary", "reason", "remedy", "since_gpst", "since_sigma_s", "until_gpst")
    found: dict[str, Any] = {key: getattr(verdict, key) for key in keys}
    found["may_also_be"] = ";".join(verdict.may_also_be) or None
    found["interference"] = verdict.interference.state
    if spells := verdict.interference.spells:
        found["interference_since_gpst"] = spells[0].since_gpst
        found["interference_fall_db"] = max(spell.fall_db for spell in spells)
    labels = [signal.label for signal in verdict.signals]
    found["signals"] = len(labels)
    if labels:
        found |= {f"share_{label}": labels.count(label) / len(labels) for label in LABELS}
    for receiver in verdict.receivers:
        if receiver.usable is not None:
            kind, fix = receiver.usable
            found |= {"position_receiver": receiver.name, "position_kind": kind}
            return found | {f"position_{key}": value for key, value in fix.model_dump().items()}
    return found


def write_rows(rows: Sequence[FleetRow], path: Path) -> None:
    """Raises OutputError as `open_growing_tables` does."""
    with open_growing_tables([path]) as take:
        take(
            {field.name: _column(field.name, [getattr(row, field.name) for row in rows]) for field in fields(FleetRow)}
        )


def _column(name: str, values: list[Any]) -> Column:
    kind = FleetRow.__annotations__[name]
    if name.endswith("_gpst"):
        return np.array([np.datetime64(value or "NaT", "ns") for value in values])
    if kind is int:
        return np.array(values, np.int64)
    if kind == float | None:
        return np.array([np.nan if value is None else value for value in values], float)
    return np.array(values, object)
