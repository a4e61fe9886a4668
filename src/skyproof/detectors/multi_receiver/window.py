"""One window: the receivers' sets, their pairings, and what tests of them have in common, words included."""

import itertools
from collections.abc import Collection, Sequence
from dataclasses import replace

from skyproof.detectors.base import Detector, undecided
from skyproof.detectors.multi_receiver.carriers import CarrierTest
from skyproof.detectors.multi_receiver.known_geometry import AntennaGeometry, LearntDistance, agreement
from skyproof.detectors.multi_receiver.learnt import LearntDistances
from skyproof.detectors.multi_receiver.one_antenna import RatioTest
from skyproof.detectors.multi_receiver.pairing import Pairing, groups_in, pair_up, sky_by_carriers
from skyproof.detectors.multi_receiver.settings import MultiReceiverSettings
from skyproof.detectors.second_signals.late_copies import without_late_copies
from skyproof.detectors.second_signals.second_sky import echoes_p_value
from skyproof.records import Baseline, CauseName, ConsistentSet, Evidence, Null, Records, Says, SignalRef, StatementTest

__all__ = ["ONE_FALSE_SKY", "ONE_TRANSMITTER", "SEPARATION", "Window", "far", "names"]

ONE_FALSE_SKY = "one transmitter sends one false sky"
ONE_TRANSMITTER = "no two transmitters act in concert"
SEPARATION = "antenna_separation_m"


class Window:
    """One window's pairings. skies : those that were called authentic; groups : numbers of what is decided together."""

    def __init__(
        self, detector: Detector, settings: MultiReceiverSettings, records: Records, learnt: LearntDistances
    ) -> None:
        self.detector, self.settings, self.records, self.learnt = detector, settings, records, learnt
        self.sets = _sets_to_decide(records)
        choices = list(itertools.product(*self.sets.values())) if len(self.sets) >= 2 else []
        self.one_choice = len(choices) <= 1
        least = self.settings.min_satellites
        groups = [(sets, kind) for sets in choices for kind in groups_in(sets, least)]
        self.tests = max(len(groups), 1)
        noise = self.settings.noise(self.tests)
        every = [pair_up(records, sets, noise, min_satellites=least, kind=kind) for sets, kind in groups]
        self.pairings = [pairing for pairing in every if self.enough(pairing)]
        self.groups = itertools.count(1)
        self.skies: list[Pairing] = []
        self._of_sky: dict[tuple[int, ...], CarrierTest | None] = {}
        self._fitting: dict[tuple[int, ...], tuple[str, ...] | None] = {}

    def geometry(self, pairing: Pairing) -> AntennaGeometry | None:
        """What is given of where antennas stand; of one set in each receiver also what earlier windows showed."""
        given = self.settings.geometry(pairing.receivers)
        return self.learnt.of(pairing.receivers) if given is None and self.one_choice else given

    def statement(self, pairing: Pairing, geometry: AntennaGeometry | None, *, agrees: bool) -> StatementTest | None:
        """What a pairing says of what the user stated of the antennas; None where nothing was, or it is not tested."""
        key = next((key for key in (getattr(geometry, "key", None),) if key), None)
        if geometry is None and self.settings.antenna_separation_m > 0.0:
            key = SEPARATION
        if key is None or isinstance(geometry, LearntDistance):
            return None
        return StatementTest(
            key=key,
            receivers=pairing.receivers,
            agrees=agrees,
            one_place=not agrees and self._in_one_place(pairing),
            shown=next(iter(pairing.baselines), None),
        )

    def open_statement(
        self, pairing: Pairing, geometry: AntennaGeometry | None, p_value: float
    ) -> StatementTest | None:
        """What a pairing says of it that may be of the sky or of one antenna; p_value : of the statement, by code."""
        test = self.statement(pairing, geometry, agrees=False)
        if test is None:
            return None
        key = tuple(map(id, pairing.sets))
        if key not in self._fitting:  # alike for all kinds of signals
            self._fitting[key] = self._slips_by_carriers(pairing)
        return replace(test, p_value=p_value, fitting=self._fitting[key])

    def _slips_by_carriers(self, pairing: Pairing) -> tuple[str, ...] | None:
        """Codes of the slips that the carriers of two receivers fit; none if these fit what is stated, None if they do
        not tell.

        With so many slips that are tried each must fit by chance the more rarely.
        """
        geometry, accept = self.settings.geometry(pairing.receivers), self.settings.accept_probability
        same = [p for p in self.pairings if p.sets == pairing.sets and p.fractions]
        stated = self._sky_by_carriers(same)
        if geometry is None or len(pairing.sets) != 2 or stated is None:
            return None
        if stated.p_value >= accept:
            return ()
        slips = list(geometry.slips(pairing.receivers))
        tests = [(slip.code, sky_by_carriers(same, slip.fit)) for slip in slips]
        return tuple(
            code
            for code, test in tests
            if test is not None and test._replace(by_chance=len(slips) * test.by_chance).fits(accept)
        )

    def _in_one_place(self, pairing: Pairing) -> bool:
        """Whether carriers show no distance at all between the antennas, which two antennas cannot have."""
        one, accept = pairing.one_antenna_carriers, self.settings.accept_probability
        return one is not None and one.p_value >= accept and one.by_chance < accept

    def enough(self, pairing: Pairing) -> bool:
        """Whether it has as many satellites and epochs in common as are asked for."""
        ranges, settings = pairing.ranges, self.settings
        n_kinds = int(ranges.kinds.max(initial=0)) + 1
        enough = len(ranges.signals) - n_kinds >= settings.min_satellites - 1
        return enough and len(ranges.range_m) >= settings.min_epochs

    def agrees(self, pairing: Pairing, geometry: AntennaGeometry) -> bool:
        """Whether the baselines are as known."""
        baselines = self.believed(pairing)
        return bool(baselines) and agreement(geometry, baselines) >= self.settings.accept_probability

    def p_sky(self, pairing: Pairing, geometry: AntennaGeometry) -> float:
        """Of "the sky over these antennas", by two tests: the baseline of the window, and those of its parts, or, where
        the noise goes beyond the bound of any track's error, that it does.
        """
        p_parts = agreement(geometry, pairing.baselines) if pairing.baselines else 1.0
        if pairing.noise_m > self.settings.error_bound_m:
            p_parts = pairing.swing_p_value
        return min(1.0, 2.0 * min(pairing.survival(geometry), p_parts))

    def believed(self, pairing: Pairing) -> tuple[Baseline, ...]:
        """Its baselines; none where the noise goes beyond the bound of any track's error."""
        return pairing.baselines if pairing.noise_m <= self.settings.error_bound_m else ()

    def p_one(self, pairing: Pairing) -> float:
        """Of "one antenna", for all tests of the window together."""
        return min(1.0, self.tests * self._with_carriers(pairing, float(pairing.one_antenna.p_value)))

    def p_each(self, pairing: Pairing) -> float:
        """The same, of any of its kinds."""
        return min(1.0, self.tests * self._with_carriers(pairing, pairing.one_antenna_each_p_value))

    def _with_carriers(self, pairing: Pairing, p_code: float) -> float:
        """Of "one antenna" by code, and by carriers where they fit the sky: the smaller one, for two tests."""
        carriers = self.not_one_by_carriers(pairing)
        return p_code if carriers is None else min(1.0, 2.0 * min(p_code, carriers.p_value))

    def not_one_by_carriers(self, pairing: Pairing) -> CarrierTest | None:
        """Test of "one antenna" by carriers, where they fit the sky over antennas that stand as known; else None.

        Carriers that fit neither are not what is assumed of them, so they are no evidence. To fit the sky is asked of
        all kinds of signals of the same sets together, or, if some do not, of this one alone.
        """
        same = [p for p in self.pairings if p.sets == pairing.sets and p.fractions]
        for together in (same, [pairing]):
            sky = self._sky_by_carriers(together)
            if sky is not None and sky.fits(self.settings.accept_probability):
                return pairing.one_antenna_carriers
        return None

    def _sky_by_carriers(self, pairings: Sequence[Pairing]) -> CarrierTest | None:
        """Test of "the sky over antennas that stand as known" by carriers; None where these do not tell."""
        key = tuple(id(pairing) for pairing in pairings)
        if key not in self._of_sky:
            geometry = self.settings.geometry(pairings[0].receivers) if pairings else None
            self._of_sky[key] = None if geometry is None else sky_by_carriers(pairings, geometry)
        return self._of_sky[key]

    def of_carriers(self, pairing: Pairing) -> str:
        """What their carriers would need to tell, to follow "or"; nothing where it is not known how antennas stand."""
        phases = pairing.ranges.phases
        single = pairing.ranges.kinds.max(initial=0) == 0 and (phases is None or phases.whole_cycles.all())
        if self.settings.geometry(pairing.receivers) is None or not single:
            return ""
        if not pairing.fractions:
            return ", or carrier phases of 5 satellites in each receiver, steady over a window, at known instants"
        sky = self._sky_by_carriers([pairing])
        if sky is None or sky.p_value >= self.settings.accept_probability:
            return ", or to know more closely where the antennas stand (antennas_enu_m), which carriers would tell"
        return ", or better carriers: they fit neither one antenna nor what is known of the antennas"

    def p_possible(self, pairing: Pairing) -> float:
        """Of "antennas no farther apart than they may be"."""
        return pairing.at_most_p_value(self.settings.max_separation_m)

    def is_apart(self, pairing: Pairing) -> bool:
        """Whether the signals show the antennas as far apart as they are stated to be at least."""
        limit_m, alpha = self.settings.antenna_separation_m, self.settings.false_alarm_probability
        return limit_m > 0.0 and pairing.at_most_p_value(limit_m) < alpha

    def p_of_echoes(self, receivers: Collection[str], pairing: Pairing) -> float:
        """That echoes in place of blocked signals make such a set at a wrong place, in any of these receivers."""
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

    def p_not_sky(self, pairing: Pairing, geometry: AntennaGeometry | None) -> tuple[float, str]:
        """p-value of "the sky over these antennas", and what to say if it is rejected."""
        because = f"{names(pairing)} come from one antenna"
        if geometry is not None:
            return self._not_sky(pairing, geometry), f"{because}: they do not show {geometry.words}"
        limit_m = self.settings.antenna_separation_m
        if limit_m <= 0.0:
            return 1.0, ""
        because = f"{because}, if the receivers' antennas are {limit_m:g} m or more apart"
        return pairing.at_least_p_value(limit_m), because

    def _not_sky(self, pairing: Pairing, geometry: AntennaGeometry) -> float:
        """Of "the sky" by code, and by carriers where they fit one antenna: the smaller one, for two tests."""
        p_code, one, sky = pairing.survival(geometry), pairing.one_antenna_carriers, self._sky_by_carriers([pairing])
        if one is None or sky is None or one.p_value < self.settings.accept_probability:
            return p_code
        return min(1.0, 2.0 * min(p_code, sky.p_value))

    def authentic(
        self,
        pairing: Pairing,
        p_value: float,
        assumes: tuple[str, ...],
        *,
        because: str,
        baselines: tuple[Baseline, ...] = (),
        statement: StatementTest | None = None,
    ) -> Evidence:
        self.skies.append(pairing)
        share = self.settings.false_alarm_probability / self.tests
        statistic, threshold = float(pairing.one_antenna.statistic), pairing.threshold(share)
        shown = f"range differences between the receivers vary by {pairing.scatter_m:.1f} m between satellites"
        if statistic <= threshold and (carriers := self.not_one_by_carriers(pairing)) is not None:
            statistic, threshold = carriers.statistic, carriers.threshold(0.5 * share)
            shown = "the carriers' differences between the receivers are no whole cycles from satellite to satellite"
        return self.say(
            "authentic",
            pairing.subject,
            p_value=p_value,
            group=next(self.groups),
            baselines=baselines,
            statistic=statistic,
            threshold=threshold,
            because=f"{names(pairing)} do not come from one antenna: {shown}{because}",
            assumes=(ONE_TRANSMITTER, *assumes),
            statement=statement,
        )

    def toofar(self, pairing: Pairing) -> str:
        far_m, limit_m = max(pairing.distances_m or (0.0,)), self.settings.max_separation_m
        return (
            f"{names(pairing)} put the antennas {far_m:.0f} m apart, more than the {limit_m:g} m that they may be: "
            "one receiver may follow a false sky and another the true one"
        )

    def toonear(self, pairing: Pairing) -> str:
        far_m, limit_m = max(pairing.distances_m or (0.0,)), self.settings.antenna_separation_m
        return (
            f"{names(pairing)} put the antennas {far_m:.0f} m apart, less than the {limit_m:g} m that were stated: "
            "one receiver may follow a false sky and another the true one"
        )

    def where(self) -> str:
        """What of the antennas would have to be known."""
        return "the distance between the antennas (antenna_distance_m), or where they stand (antennas_enu_m)"

    def signals(self) -> tuple[SignalRef, ...]:
        return tuple(SignalRef(s.receiver, signal) for sets in self.sets.values() for s in sets for signal in s.signals)

    def undecided(self, subject: tuple[SignalRef, ...], *, code: str, because: str, would_need: str) -> Evidence:
        return undecided(self.detector, self.records, subject, code=code, because=because, would_need=would_need)

    def say(
        self,
        says: Says,
        subject: tuple[SignalRef, ...],
        *,
        because: str,
        p_value: float,
        ratio: RatioTest | None = None,
        statistic: float | None = None,
        threshold: float | None = None,
        group: int | None = None,
        would_need: str | None = None,
        assumes: tuple[str, ...] = (),
        baselines: tuple[Baseline, ...] = (),
        null: Null = "sky",
        may_also_be: tuple[CauseName, ...] = (),
        statement: StatementTest | None = None,
    ) -> Evidence:
        if ratio is not None:
            statistic, threshold = float(ratio.statistic), ratio.threshold(self.settings.false_alarm_probability)
        return Evidence(
            detector=self.detector.name,
            start_gpst=self.records.start_gpst,
            end_gpst=self.records.end_gpst,
            subject=subject,
            says=says,
            because=because,
            statistic=statistic,
            threshold=threshold,
            false_alarm_probability=self.settings.false_alarm_probability,
            p_value=p_value,
            log_likelihood_ratio=None if ratio is None else float(ratio.log_likelihood_ratio),
            would_need=would_need,
            group=group,
            assumes=assumes,
            baselines=baselines,
            null=null,
            may_also_be=may_also_be,
            statement=statement,
        )


def _sets_to_decide(records: Records) -> dict[str, list[ConsistentSet]]:
    """Sets by receiver, receivers in the order of the observations.

    Where two receivers or more show several skies, those that show one only are left out: with which of the skies it
    belongs is not theirs to decide, and they would hide that the others' pairings are complete.
    """
    by_receiver = {
        o.receiver: without_late_copies(o, [s for s in records.sets if s.receiver == o.receiver])
        for o in records.observations
    }
    by_receiver = {receiver: sets for receiver, sets in by_receiver.items() if sets}
    several = {receiver: sets for receiver, sets in by_receiver.items() if len(sets) >= 2}
    return several if len(several) >= 2 else by_receiver


def far(pairing: Pairing) -> str:
    """How far apart the signals put the antennas."""
    first, *others = pairing.receivers
    far = [f"{d:.1f} ± {s:.1f} m" for whole in pairing.baselines[:1] for d, s in whole.distances_m]
    places = [f"the antenna of {name} {d} from that of {first}" for name, d in zip(others, far, strict=False)]
    return "they put " + ", ".join(places) if places else ""


def names(pairing: Pairing) -> str:
    *others, last = [chosen.receiver for chosen in pairing.sets]
    kinds = sorted(pairing.kinds)
    which = "" if kinds == [("G", "L1", "CA")] else f" {' and '.join(' '.join(kind) for kind in kinds)}"
    return f"the {len(set(pairing.ranges.sats))} satellites'{which} signals in {', '.join(others)} and {last}"
