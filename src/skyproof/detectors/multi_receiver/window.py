"""One window: the receivers' sets, their pairings, and what tests of them have in common, words included."""

import itertools

from skyproof.detectors.base import Detector, undecided
from skyproof.detectors.multi_receiver.known_geometry import AntennaGeometry, agreement
from skyproof.detectors.multi_receiver.one_antenna import RatioTest
from skyproof.detectors.multi_receiver.pairing import Pairing, groups_in, pair_up
from skyproof.detectors.multi_receiver.settings import MultiReceiverSettings
from skyproof.detectors.second_signals.late_copies import without_late_copies
from skyproof.records import Baseline, ConsistentSet, Evidence, Records, Says, SignalRef

__all__ = ["ONE_FALSE_SKY", "ONE_TRANSMITTER", "Window", "far", "names"]

ONE_FALSE_SKY = "one transmitter sends one false sky"
ONE_TRANSMITTER = "no two transmitters act in concert"


class Window:
    """One window's pairings. skies : those that were called authentic; groups : numbers of what is decided together."""

    def __init__(self, detector: Detector, settings: MultiReceiverSettings, records: Records) -> None:
        self.detector, self.settings, self.records = detector, settings, records
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

    def believed(self, pairing: Pairing) -> tuple[Baseline, ...]:
        """Its baselines; none where the noise goes beyond the bound of any track's error."""
        return pairing.baselines if pairing.noise_m <= self.settings.error_bound_m else ()

    def p_one(self, pairing: Pairing) -> float:
        """Of "one antenna", for all tests of the window together."""
        return min(1.0, self.tests * float(pairing.one_antenna.p_value))

    def p_each(self, pairing: Pairing) -> float:
        """The same, of any of its kinds."""
        return min(1.0, self.tests * pairing.one_antenna_each_p_value)

    def p_possible(self, pairing: Pairing) -> float:
        """Of "antennas no farther apart than they may be"."""
        return pairing.at_most_p_value(self.settings.max_separation_m)

    def p_not_sky(self, pairing: Pairing, geometry: AntennaGeometry | None) -> tuple[float, str]:
        """p-value of "the sky over these antennas", and what to say if it is rejected."""
        because = f"{names(pairing)} come from one antenna"
        if geometry is not None:
            return pairing.survival(geometry), f"{because}: they do not show {geometry.words}"
        limit_m = self.settings.antenna_separation_m
        if limit_m <= 0.0:
            return 1.0, ""
        because = f"{because}, if the receivers' antennas are {limit_m:g} m or more apart"
        return pairing.at_least_p_value(limit_m), because

    def authentic(
        self,
        pairing: Pairing,
        p_value: float,
        assumes: tuple[str, ...],
        *,
        because: str,
        baselines: tuple[Baseline, ...] = (),
    ) -> Evidence:
        self.skies.append(pairing)
        return self.say(
            "authentic",
            pairing.subject,
            p_value=p_value,
            group=next(self.groups),
            baselines=baselines,
            statistic=float(pairing.one_antenna.statistic),
            threshold=pairing.threshold(self.settings.false_alarm_probability / self.tests),
            because=f"{names(pairing)} do not come from one antenna: range differences between the receivers vary by "
            f"{pairing.scatter_m:.1f} m between satellites{because}",
            assumes=(ONE_TRANSMITTER, *assumes),
        )

    def toofar(self, pairing: Pairing) -> str:
        far_m, limit_m = max(pairing.distances_m or (0.0,)), self.settings.max_separation_m
        return (
            f"{names(pairing)} put the antennas {far_m:.0f} m apart, more than the {limit_m:g} m that they may be: "
            "one receiver may follow a false sky and another the true one"
        )

    def where(self) -> str:
        """What of the antennas would have to be known."""
        return "the distance between the antennas (antenna_distance_m), or where they stand (antennas_enu_m)"

    def signals(self) -> tuple[SignalRef, ...]:
        return tuple(SignalRef(s.receiver, signal) for sets in self.sets.values() for s in sets for signal in s.signals)

    def undecided(self, subject: tuple[SignalRef, ...], *, because: str, would_need: str) -> Evidence:
        return undecided(self.detector, self.records, subject, because=because, would_need=would_need)

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
