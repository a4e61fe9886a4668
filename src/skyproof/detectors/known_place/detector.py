"""Test if the codes of the few remaining satellites fit the place where the receiver stands.

A position takes four satellites and more. A receiver that stands, or was surveyed, needs none: two satellites of one
time scale differ by what the place says, whatever the clock shows. In windows in which no position is found, the codes
of each epoch are held against the place (`laws`): the surveyed one, or that of the first window of a receiver that is
stated not to move. The epoch that fits worst counts, with the number of epochs shared out, and whichever one satellite
is left out: a single fault or reflection does not fail it.

A failure leaves the cause open: two reflections, a statement that is not true, or false signals.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.base import NotTested, Reporter, leave_open
from skyproof.detectors.code_motion.detector import select_primary_signals
from skyproof.detectors.known_place.laws import chance_at_place
from skyproof.detectors.known_place.policy import POLICY
from skyproof.errors import require_probability
from skyproof.navigation.search import compute_misfits
from skyproof.navigation.sets import measure_window
from skyproof.records import Cause, Finding, Hypothesis, NavigationData, Need, Observations, Records, list_refs

__all__ = ["CodesAtPlace", "CodesAtPlaceSettings"]


@dataclass(frozen=True)
class CodesAtPlaceSettings:
    """Settings of `CodesAtPlace`.

    false_alarm_probability : of each receiver and report. multipath_sigma_m : of one pseudorange, one sigma.
    ionosphere_share : of the ionosphere's delay, one sigma of what the model leaves. speed_max_m_s : 0 if the receivers
    stand. positions_ecef_m : (3,) of each surveyed receiver.
    """

    false_alarm_probability: float = 1e-3
    multipath_sigma_m: float = 1.0
    ionosphere_share: float = 0.25
    speed_max_m_s: float | None = None
    positions_ecef_m: Mapping[str, Reals] | None = None

    def __post_init__(self) -> None:
        require_probability("known_place", "false_alarm_probability", self.false_alarm_probability)


class _Place(NamedTuple):
    """Where a receiver stands, (3,), and the covariance, (3, 3)."""

    position_ecef_m: Reals
    covariance_m2: Reals


class CodesAtPlace:
    """The detector: see the module's text. It remembers where each receiver stood at first."""

    name = "known_place"
    share = 0.0  # it never speaks of an attack
    needs = (Need.OBSERVATIONS, Need.NAVIGATION)

    def __init__(self, settings: CodesAtPlaceSettings | None = None) -> None:
        self.settings = settings or CodesAtPlaceSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.AS_STATED)
        lacking = report.name_missing()
        if lacking or records.navigation is None:
            return lacking, state
        places: dict[str, _Place] = dict(state or {})
        found = []
        for o in records.observations:
            sets = [s for s in records.sets if s.receiver == o.receiver]
            surveyed = (self.settings.positions_ecef_m or {}).get(o.receiver)
            if surveyed is not None:
                places[o.receiver] = _Place(np.asarray(surveyed), POLICY.survey_sigma_m**2 * np.eye(3))
            elif self.settings.speed_max_m_s == 0.0 and len(sets) == 1 and o.receiver not in places:
                places[o.receiver] = _Place(sets[0].position_ecef_m, sets[0].covariance_m2[:3, :3])
            found.append(self._test_receiver(report, records.navigation, o, bool(sets), places.get(o.receiver)))
        return found, places

    def _test_receiver(
        self, report: Reporter, navigation: NavigationData, o: Observations, fixed: bool, place: _Place | None
    ) -> Finding:
        signals = list_refs(o.receiver, o.signals)
        primary = select_primary_signals(o)
        if place is None:
            return report.pass_over(signals, NotTested("no_place"))
        if fixed:
            return report.pass_over(signals, NotTested("fixed"))
        if not primary:
            return report.pass_over(signals, NotTested("received_twice"))
        epochs = self._list_epochs(o, navigation, set(primary), place)
        if not epochs:
            return report.pass_over(signals, NotTested("few_satellites", {"least": POLICY.least_satellites}))
        sats = sorted({sat for epoch in epochs for sat in epoch.sats})
        chances = [_least_chance([epoch.chance(out) for epoch in epochs]) for out in ("", *sats)]
        p_value, alpha = max(chances), self.settings.false_alarm_probability
        failed = p_value < alpha
        return report.find(
            tuple(ref for ref in signals if ref.signal.sat in set(sats)),
            "does_not_fit" if failed else "fits",
            {Cause.CLEAN: p_value, **leave_open((Cause.REFLECTIONS, Cause.STATEMENT, Cause.FAULT))},
            dated_gpst=self._date_misfit(o, epochs, alpha) if failed else None,
        )

    def _list_epochs(
        self, o: Observations, navigation: NavigationData, among: set[Any], place: _Place
    ) -> "list[_EpochAtPlace]":
        """Return the epochs with enough satellites, each at the place."""
        rows = np.unique(np.linspace(0, o.gpst.size - 1, min(o.gpst.size, POLICY.most_epochs)).round().astype(np.intp))
        found = []
        for row in rows.tolist():
            mean, measurements, usable = measure_window(
                o.read(row, row + 1),
                navigation,
                multipath_sigma_m=self.settings.multipath_sigma_m,
                ionosphere_share=self.settings.ionosphere_share,
            )
            kept = np.array([k for k in np.flatnonzero(usable) if mean.signals[k] in among], np.intp)
            if kept.size < POLICY.least_satellites:
                continue
            misfit_m, sigma_m, unit = compute_misfits(measurements, kept, np.append(place.position_ecef_m, 0.0))
            chosen = [mean.signals[k] for k in kept]
            scales = sorted({signal.kind for signal in chosen})
            clocks = np.array([[signal.kind == kind for kind in scales] for signal in chosen], np.float64)
            sats = tuple(signal.sat for signal in chosen)
            found.append(_EpochAtPlace(row, sats, misfit_m, sigma_m, unit, clocks, place.covariance_m2))
        return found

    def _date_misfit(self, o: Observations, epochs: "Sequence[_EpochAtPlace]", alpha: float) -> np.datetime64:
        """Return the first epoch that alone does not fit, else the one that fits worst."""
        chances = [epoch.chance("") for epoch in epochs]
        first = next((k for k, chance in enumerate(chances) if len(epochs) * chance < alpha), int(np.argmin(chances)))
        at: np.datetime64 = o.gpst[epochs[first].row]
        return at


class _EpochAtPlace(NamedTuple):
    """The codes of one epoch at the known place, as `chance_at_place` takes them."""

    row: int
    sats: tuple[str, ...]
    misfit_m: Reals
    sigma_m: Reals
    unit: Reals
    clocks: Reals
    place_m2: Reals

    def chance(self, out: str) -> float:
        """Return the chance of this epoch with a satellite left out."""
        kept = np.array([sat != out for sat in self.sats])
        return chance_at_place(self.misfit_m, self.sigma_m, self.unit, self.clocks, self.place_m2, kept)


def _least_chance(chances: Sequence[float]) -> float:
    """Return the chance of the least of several, by the union bound."""
    return min(1.0, len(chances) * min(chances))
