"""Hold one window: the receivers' sets, their pairings, and what their tests have in common."""

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

from skyproof.detectors.base import Reporter, leave_open
from skyproof.detectors.multi_receiver.carriers import CarrierTest, evaluate_one_antenna_carriers
from skyproof.detectors.multi_receiver.known_geometry import (
    AntennaGeometry,
    AntennaPlaces,
    Fit,
    LearntDistance,
    consistency_p_value,
)
from skyproof.detectors.multi_receiver.learnt import LearntDistances, keep_shown
from skyproof.detectors.multi_receiver.pairing import (
    Comparison,
    Pairing,
    compare_pairings,
    evaluate_sky_by_carriers,
    list_groups,
    pair_up,
)
from skyproof.detectors.multi_receiver.settings import MultiReceiverSettings
from skyproof.detectors.second_signals.late_copies import remove_late_copies
from skyproof.detectors.second_signals.second_sky import echoes_p_value
from skyproof.records import (
    Baseline,
    Cause,
    ConsistentSet,
    Datum,
    Finding,
    Hypothesis,
    Records,
    SignalRef,
    StatementTest,
)

__all__ = ["SEPARATION", "Window", "collect_estimates", "describe_distances", "describe_pairing"]

SEPARATION = "antenna_separation_m"


class Window:
    """One window's pairings.

    skies : those that were called authentic. groups : numbers of what is decided together. shown : what receivers
    showed of their antennas when these first may have stood as stated.
    """

    def __init__(
        self,
        report: Reporter,
        settings: MultiReceiverSettings,
        learnt: LearntDistances,
        shown: Mapping[tuple[str, ...], Fit],
    ) -> None:
        self.report, self.records, self.settings = report, report.records, settings
        self.learnt, self.shown = learnt, shown
        self.sets = _select_sets(self.records)
        choices = list(itertools.product(*self.sets.values())) if len(self.sets) >= 2 else []
        self.one_choice = len(choices) <= 1
        least = self.settings.min_satellites
        groups = [(sets, kind) for sets in choices for kind in list_groups(sets, least)]
        self.tests = max(len(groups), 1)
        noise = self.settings.noise(self.tests)
        every = [pair_up(self.records, sets, noise, min_satellites=least, kind=kind) for sets, kind in groups]
        self.pairings = [pairing for pairing in every if self.enough(pairing)]
        self.groups = itertools.count(1)
        self.skies: list[Pairing] = []
        self._of_sky: dict[tuple[int, ...], CarrierTest | None] = {}
        self._fitting: dict[tuple[int, ...], tuple[str, ...] | None] = {}

    def geometry(self, pairing: Pairing) -> AntennaGeometry | None:
        """Return the stated antenna geometry; of one set in each receiver also what earlier windows showed."""
        stated = self.settings.geometry(pairing.receivers)
        return self.learnt.of(pairing.receivers) if stated is None and self.one_choice else stated

    def compare(self, larger: Pairing, smaller: Pairing) -> Comparison:
        """Test "it is `larger`, not `smaller`, that comes from one antenna"; where places are stated, towards them."""
        geometry = self.settings.geometry(larger.receivers)
        stated_m = geometry.baselines_m(larger.receivers) if isinstance(geometry, AntennaPlaces) else None
        return compare_pairings(larger, smaller, stated_m)

    def build_statement(
        self, pairing: Pairing, geometry: AntennaGeometry | None, *, agrees: bool
    ) -> StatementTest | None:
        """Return how a pairing tests the user's statement of the antennas; None without one, or if it is not tested."""
        key = next((key for key in (getattr(geometry, "key", None),) if key), None)
        if geometry is None and self.settings.antenna_separation_m > 0.0:
            key = SEPARATION
        if key is None or isinstance(geometry, LearntDistance):
            return None
        return StatementTest(
            key=key,
            receivers=pairing.receivers,
            agrees=agrees,
            one_place=not agrees and self._are_in_one_place(pairing),
            shown=next(iter(pairing.baselines), None),
            p_elsewhere=1.0 if agrees else self._p_elsewhere(pairing),
        )

    def _p_elsewhere(self, pairing: Pairing) -> float:
        """Return the p-value of "the antennas stand elsewhere than stated, and did so before"."""
        if (before := self.shown.get(pairing.receivers)) is None:
            return 1.0
        return min(1.0, self.tests * pairing.survival(before) + self.p_of_echoes(pairing.receivers, pairing))

    def keep_shown(self) -> dict[tuple[str, ...], Fit]:
        """Return what receivers showed of their antennas, with those that may stand as stated for the first time."""
        found = dict(self.shown)
        for pairing in self.pairings if self.one_choice else ():
            geometry = self.settings.geometry(pairing.receivers)
            if geometry is None or pairing.receivers in found or not self.agrees(pairing, geometry):
                continue
            places = isinstance(geometry, AntennaPlaces) and self.settings.antennas_body_m is None
            if (now := keep_shown(pairing, places=places)) is not None:
                found[pairing.receivers] = now
        return found

    def weigh_open_statement(
        self, pairing: Pairing, geometry: AntennaGeometry | None, p_value: float
    ) -> StatementTest | None:
        """Test the statement by a pairing that may come from the sky or from one antenna.

        p_value : of the statement, by code.
        """
        test = self.build_statement(pairing, geometry, agrees=False)
        if test is None:
            return None
        key = tuple(map(id, pairing.sets))
        if key not in self._fitting:  # alike for all kinds of signals
            self._fitting[key] = self._slips_by_carriers(pairing)
        return replace(test, p_value=p_value, fitting=self._fitting[key])

    def _slips_by_carriers(self, pairing: Pairing) -> tuple[str, ...] | None:
        """Return the codes of the slips that the carriers of two receivers fit.

        Empty if they fit the statement, None if they cannot tell.

        The more slips are tried, the more rarely each may fit by chance.
        """
        geometry, accept = self.settings.geometry(pairing.receivers), self.settings.accept_probability
        same = [p for p in self.pairings if p.sets == pairing.sets and p.fractions]
        stated = self._sky_by_carriers(same)
        if geometry is None or len(pairing.sets) != 2 or stated is None:
            return None
        if stated.p_value >= accept:
            return ()
        slips = list(geometry.slips(pairing.receivers))
        tests = [(slip.code, evaluate_sky_by_carriers(same, slip.fit)) for slip in slips]
        return tuple(
            code
            for code, test in tests
            if test is not None and test._replace(by_chance=len(slips) * test.by_chance).fits(accept)
        )

    def _are_in_one_place(self, pairing: Pairing) -> bool:
        """Tell if carriers show no distance at all between the antennas, which two antennas cannot have."""
        carriers, accept = pairing.one_antenna_carriers, self.settings.accept_probability
        return carriers is not None and carriers.p_value >= accept and carriers.by_chance < accept

    def enough(self, pairing: Pairing) -> bool:
        """Tell if a pairing has as many satellites and epochs in common as the settings require."""
        ranges, settings = pairing.ranges, self.settings
        n_kinds = int(ranges.kinds.max(initial=0)) + 1
        enough = len(ranges.signals) - n_kinds >= settings.min_satellites - 1
        return enough and len(ranges.range_m) >= settings.min_epochs

    def agrees(self, pairing: Pairing, geometry: AntennaGeometry) -> bool:
        """Tell if the baselines are as known."""
        baselines = self.select_believed(pairing)
        return bool(baselines) and consistency_p_value(geometry, baselines) >= self.settings.accept_probability

    def p_sky(self, pairing: Pairing, geometry: AntennaGeometry) -> float:
        """Return the p-value of "the sky over these antennas", by baselines of the window and of its parts.

        If the noise exceeds the bound of any track's error, that excess replaces the second test.
        """
        p_parts = consistency_p_value(geometry, pairing.baselines) if pairing.baselines else 1.0
        if pairing.noise_m > pairing.noise.bound_m:
            p_parts = pairing.swing_p_value
        return min(1.0, 2.0 * min(pairing.survival(geometry), p_parts))

    def select_believed(self, pairing: Pairing) -> tuple[Baseline, ...]:
        """Return the pairing's baselines; none if the noise exceeds the bound of any track's error."""
        return pairing.baselines if pairing.noise_m <= pairing.noise.bound_m else ()

    def p_one(self, pairing: Pairing) -> float:
        """Return the p-value of "one antenna", for all tests of the window together."""
        return min(1.0, self.tests * self._with_carriers(pairing, float(pairing.one_antenna.p_value)))

    def p_each(self, pairing: Pairing) -> float:
        """Return the p-value of "one antenna" of any of its kinds, for all tests of the window together."""
        return min(1.0, self.tests * self._with_carriers(pairing, pairing.one_antenna_each_p_value))

    def _with_carriers(self, pairing: Pairing, p_code: float) -> float:
        """Return the p-value of "one antenna" by code, and by carriers if they fit the sky: the smaller of two."""
        carriers = self.not_one_by_carriers(pairing)
        return p_code if carriers is None else min(1.0, 2.0 * min(p_code, carriers.p_value))

    def not_one_by_carriers(self, pairing: Pairing) -> CarrierTest | None:
        """Test "one antenna" by carriers if they fit the sky over antennas that stand as known; else None.

        Carriers that fit neither break the model's assumptions, so they are no evidence. All kinds of signals of the
        same sets must fit the sky together, or, if some do not, this one alone.
        """
        same = [p for p in self.pairings if p.sets == pairing.sets and p.fractions]
        for together in (same, [pairing]):
            sky = self._sky_by_carriers(together)
            if sky is not None and sky.fits(self.settings.accept_probability):
                return pairing.one_antenna_carriers
        return None

    def _sky_by_carriers(self, pairings: Sequence[Pairing]) -> CarrierTest | None:
        """Test "the sky over antennas that stand as known" by carriers; None if these cannot tell."""
        key = tuple(id(pairing) for pairing in pairings)
        if key not in self._of_sky:
            geometry = self.settings.geometry(pairings[0].receivers) if pairings else None
            self._of_sky[key] = None if geometry is None else evaluate_sky_by_carriers(pairings, geometry)
        return self._of_sky[key]

    def judge_carriers(self, pairing: Pairing) -> str:
        """Return why the carriers of a pairing cannot tell: "missing", "coarse" or "misfit".

        It is "unused" if the antenna geometry is unknown."""
        phases = pairing.ranges.phases
        single = pairing.ranges.kinds.max(initial=0) == 0 and (phases is None or phases.whole_cycles.all())
        if self.settings.geometry(pairing.receivers) is None or not single:
            return "unused"
        if not pairing.fractions:
            return "missing"
        sky = self._sky_by_carriers([pairing])
        return "coarse" if sky is None or sky.p_value >= self.settings.accept_probability else "misfit"

    def p_possible(self, pairing: Pairing) -> float:
        """Return the p-value of "antennas no farther apart than they may be"."""
        return pairing.at_most_p_value(self.settings.max_separation_m)

    def is_apart(self, pairing: Pairing) -> bool:
        """Tell if the signals show the antennas at least as far apart as stated."""
        limit_m, alpha = self.settings.antenna_separation_m, self.settings.false_alarm_probability
        return limit_m > 0.0 and pairing.at_most_p_value(limit_m) < alpha

    def p_of_echoes(self, receivers: Collection[str], pairing: Pairing) -> float:
        """Return the probability that echoes in place of blocked signals make such a set, in any of these receivers."""
        settings = self.settings
        observed = {o.receiver: o for o in self.records.observations}
        return sum(
            echoes_p_value(
                observed[chosen.receiver],
                chosen,
                unrelated_spread_m=settings.unrelated_spread_m,
                multipath_sigma_m=max(settings.multipath_sigma_m, 1.0),
            )
            for chosen in pairing.sets
            if chosen.receiver in receivers
        )

    def p_not_sky(self, pairing: Pairing, geometry: AntennaGeometry | None) -> float:
        """Return the p-value of "the sky over these antennas"; 1 if nothing is known of them."""
        if geometry is not None:
            return self._not_sky(pairing, geometry)
        limit_m = self.settings.antenna_separation_m
        return pairing.at_least_p_value(limit_m) if limit_m > 0.0 else 1.0

    def p_of_one_place(self, pairing: Pairing) -> float:
        """Return the p-value of antennas that differ, by the receivers' noise, being in one place by their carriers.

        It is 1 unless all antennas differ, and all carriers fit one place.
        """
        apart_from, accept = self.records.apart_from, self.settings.accept_probability
        differ = all(b in apart_from.get(a, ()) for a, b in itertools.combinations(pairing.receivers, 2))
        tests = [evaluate_one_antenna_carriers(fractions) for fractions in pairing.fractions] if differ else []
        if not tests or any(test.p_value < accept for test in tests):
            return 1.0
        return min(1.0, self.tests * max(test.p_unrelated for test in tests))

    def describe_known(self, geometry: AntennaGeometry | None) -> Mapping[str, Datum]:
        """Return what is known of the antennas, or how far apart they are stated to stand at least."""
        return {"limit_m": self.settings.antenna_separation_m} if geometry is None else geometry.data

    def _not_sky(self, pairing: Pairing, geometry: AntennaGeometry) -> float:
        """Return the p-value of "the sky" by code, and by carriers if they fit one antenna: the smaller of two."""
        p_code, carriers, sky = (
            pairing.survival(geometry),
            pairing.one_antenna_carriers,
            self._sky_by_carriers([pairing]),
        )
        if carriers is None or sky is None or carriers.p_value < self.settings.accept_probability:
            return p_code
        return min(1.0, 2.0 * min(p_code, sky.p_value))

    def find_authentic(
        self,
        pairing: Pairing,
        code: str,
        p_value: float,
        assumes: tuple[str, ...],
        *,
        data: Mapping[str, Datum] | None = None,
        baselines: tuple[Baseline, ...] = (),
        statement: StatementTest | None = None,
    ) -> Finding:
        """Return that a pairing comes from the sky, and keep it. p_value : of "one antenna". assumes : codes."""
        self.skies.append(pairing)
        share = self.settings.false_alarm_probability / self.tests
        by, statistic, threshold = "code", float(pairing.one_antenna.statistic), pairing.threshold(share)
        if statistic <= threshold and (carriers := self.not_one_by_carriers(pairing)) is not None:
            by, statistic, threshold = "carriers", float(carriers.statistic), carriers.threshold(0.5 * share)
        state_data: dict[str, Datum] = {
            "by": by,
            "scatter_m": float(pairing.scatter_m),
            "statistic": statistic,
            "threshold": float(threshold),
            "group": next(self.groups),
            "assumes": ("no_concert", *assumes),
        }
        return self.report.find(
            pairing.subject,
            code,
            {Cause.FALSE_SKY: p_value},
            hypothesis=Hypothesis.ONE_ANTENNA,
            data={**describe_pairing(pairing), **state_data, **(data or {})},
            estimates=collect_estimates(baselines, statement),
        )

    def find_open(
        self,
        signals: tuple[SignalRef, ...],
        code: str,
        p_clean: float,
        causes: Mapping[Cause, float],
        *,
        data: Mapping[str, Datum],
        statement: StatementTest | None = None,
    ) -> Finding:
        """Return signals that are neither shown to be true nor false: a clean sky is rejected and `causes` are not, or
        no more than a false sky is, which nothing that was measured speaks against."""
        failed = p_clean < self.settings.false_alarm_probability
        p = {Cause.CLEAN: p_clean, **(causes if failed else leave_open((Cause.FALSE_SKY,)))}
        return self.report.find(
            signals,
            code,
            p,
            hypothesis=None if failed else Hypothesis.FALSE_SKY,
            data=data,
            estimates=collect_estimates((), statement),
        )

    def signals(self) -> tuple[SignalRef, ...]:
        return tuple(SignalRef(s.receiver, signal) for sets in self.sets.values() for s in sets for signal in s.signals)


def _select_sets(records: Records) -> dict[str, list[ConsistentSet]]:
    """Select the sets by receiver, receivers in the order of the observations.

    If two receivers or more show several skies, those that show one only are left out. They cannot decide which of the
    skies theirs is, and they would hide that the others' pairings are complete.
    """
    by_receiver = {
        o.receiver: remove_late_copies(o, [s for s in records.sets if s.receiver == o.receiver])
        for o in records.observations
    }
    by_receiver = {receiver: sets for receiver, sets in by_receiver.items() if sets}
    several = {receiver: sets for receiver, sets in by_receiver.items() if len(sets) >= 2}
    return several if len(several) >= 2 else by_receiver


def collect_estimates(baselines: tuple[Baseline, ...], statement: StatementTest | None) -> Mapping[str, Any]:
    """Return the estimates of a finding that are there."""
    found: Mapping[str, Any] = {"baselines": baselines, "statement": statement}
    return {name: value for name, value in found.items() if value}


def describe_pairing(pairing: Pairing) -> dict[str, Datum]:
    """Return a pairing's number of satellites, its kinds of signals and its receivers."""
    return {
        "satellites": len(set(pairing.ranges.sats)),
        "kinds": tuple(" ".join(kind) for kind in sorted(pairing.kinds)),
        "receivers": pairing.receivers,
    }


def describe_distances(pairing: Pairing) -> dict[str, Datum]:
    """Return how far from the first one the signals put the other antennas, and the sigmas; empty without orbits."""
    apart = [pair for whole in pairing.baselines[:1] for pair in whole.distances_m]
    return {"apart_m": tuple(d for d, _ in apart), "apart_sigma_m": tuple(sigma for _, sigma in apart)}
