"""Test whether the orbits given fit the signals received: their day, and their systems."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from skyproof.app.receive.observed import ObservedFile
from skyproof.app.receive.reception import Reception
from skyproof.detectors.messages.policy import POLICY as MESSAGES
from skyproof.errors import InputError
from skyproof.formats.bounds import list_names
from skyproof.gnss.ephemeris import SYSTEM_NAMES, BroadcastEphemeris
from skyproof.gnss.time import format_iso, seconds_between
from skyproof.records import MeasurementSource, NavigationData, ObservationLog, Samples

__all__ = ["add_logged_orbits", "list_missing_orbits", "require_same_day"]

_MOST_REMARKS: Final = 3  # of the file, that stand in an error


def add_logged_orbits(
    navigation: NavigationData | None, sources: Sequence[Samples | ObservedFile]
) -> NavigationData | None:
    """Add logs' own orbits to a file of the day before, which has none at a log's time.

    Positions are then by the messages in the log, and the file tells whether these continue it. A file of any other
    time stays unchanged.
    """
    if navigation is None:
        return None
    logged: list[BroadcastEphemeris] = []
    for source in sources:
        if isinstance(source, ObservedFile) and source.start_gpst is not None and source.decoded.ephemerides:
            ages_s = [abs(seconds_between(source.start_gpst, e.reference_gpst)) for e in navigation.ephemerides]
            if not _any_holds(navigation, source.start_gpst) and min(ages_s, default=np.inf) <= MESSAGES.last_day_s:
                logged += source.decoded.ephemerides
    if not logged:
        return navigation
    remark = "none of its orbits holds at the log's time: those of the log's messages are used, and held against it"
    return replace(
        navigation,
        ephemerides=tuple(dict.fromkeys((*navigation.ephemerides, *logged))),
        remarks=(*navigation.remarks, remark),
    )


def require_same_day(navigation: NavigationData, gpst: np.datetime64, source: MeasurementSource) -> None:
    """Raise InputError if no orbit of the file holds at the input's time."""
    if _any_holds(navigation, gpst):
        return
    times = [e.reference_gpst for e in navigation.ephemerides]
    # An observation file holds no messages, and its date is the receiver's own.
    otherwise = (
        ", or none to take the orbits from the signals (if the date is wrong, correct start_gpst in the sidecar)"
        if isinstance(source, Samples)
        else ""
    )
    span = f"its orbits are for {format_iso(min(times), 0)} to {format_iso(max(times), 0)}, but"
    remedy = f"give the navigation file of that day{otherwise}"
    if navigation.remarks and min(times) <= gpst <= max(times):
        span, remedy = "none of its orbits holds at its time:", "give the navigation file as it was received, unedited"
    raise InputError(
        f"{navigation.source}: {span} {source.path} was recorded at {format_iso(gpst, 0)}"
        f"{_quote_remarks(navigation)}; {remedy}"
    )


def list_missing_orbits(receptions: Sequence[Reception], navigation: NavigationData) -> tuple[str, ...]:
    """List the systems and satellites without an orbit at their time, and those unhealthy by theirs.

    Raises
    ------
    InputError : no signal of observation files has one: there is nothing that could be tested.
    """
    logs = [r.observations for r in receptions if r.observations is not None and r.observations.gpst.size]
    without: dict[str, set[str]] = {}
    served = False
    for log in logs:
        for sat in {signal.sat for signal in log.signals}:
            if _has_orbit(navigation, sat, log):
                served = True
            else:
                without.setdefault(sat[0], set()).add(sat)
    with_one = {e.sat[0] for e in navigation.ephemerides if any(_has_orbit(navigation, e.sat, log) for log in logs)}
    lacking = {system: sats for system, sats in without.items() if system not in with_one}
    if logs and not served and all(isinstance(r.source, ObservedFile) for r in receptions):
        raise InputError(
            f"{navigation.source}: no orbits for these signals: it has those of {_systems(with_one)}, the signals "
            f"belong to {_systems(without)}{_quote_remarks(navigation)}; give the navigation file of that day with "
            "these systems"
        )
    unhealthy = {e.sat for e in navigation.ephemerides if not e.healthy} & set().union(*without.values())
    words = [
        f"no orbits for the signals of {len(sats)} {SYSTEM_NAMES.get(system, system)} satellites: they are not tested"
        for system, sats in sorted(lacking.items())
    ]
    if some := sorted(set().union(*(without[system] for system in without if system in with_one)) - unhealthy):
        words.append(f"no orbits at their time for {list_names(some)}, whose signals are not tested")
    if unhealthy:
        words.append(
            f"unhealthy by their orbits, so that their signals are not tested: {list_names(sorted(unhealthy))}"
        )
    return tuple(words)


def _any_holds(navigation: NavigationData, gpst: np.datetime64) -> bool:
    return any(navigation.best(e.sat, gpst) is not None for e in navigation.ephemerides)


def _has_orbit(navigation: NavigationData, sat: str, log: ObservationLog) -> bool:
    return any(navigation.best(sat, when) is not None for when in (log.gpst[0], log.gpst[-1]))


def _systems(letters: Sequence[str] | set[str] | dict[str, set[str]]) -> str:
    return ", ".join(SYSTEM_NAMES.get(letter, letter) for letter in sorted(letters)) or "no system at that time"


def _quote_remarks(navigation: NavigationData) -> str:
    """Quote what the file's reader left out, which may be the reason."""
    remarks = navigation.remarks[:_MOST_REMARKS]
    return f" ({'; '.join(remarks)})" if remarks else ""
