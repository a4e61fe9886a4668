"""Which signals come from one transmit antenna, and which from the sky: several receivers decide as groups.

In each receiver the signals that fit one position and clock form a set (`navigation.sets`). A pairing takes one set
from each receiver. Signals of one antenna have the same range difference between two receivers for every satellite;
signals of the sky have the one that the baseline gives each satellite. So a pairing is

- of one antenna, if its between-satellite contrasts have zero mean (`one_antenna.one_antenna_test`);
- of the sky, if it is not, and if where it puts the antennas is possible;
- mixed, if it puts them where they cannot be.

One set in each receiver: rejecting "one antenna" proves that not all of them follow one transmitter, not that none
does. A transmitter that reaches some receivers only shows a baseline of its choice, so the signals are authentic only
if what is known of the antennas agrees (`known_geometry`): their places, their distance, or the baseline of windows in
which both skies were received. If "one antenna" cannot be rejected, rejecting "antennas so far apart" names the signals
false. Several sets in each: the pairing with the least contrast is the false one if every other is so much worse that
it cannot be the false one itself (`one_antenna.ratio_test`, which needs no noise model), and the sets left over are
authentic if both this test and the one for "one antenna" say so. What is decided is decided for whole groups.

A group is of one kind of signal (time scale, band, code; `pairing`): each kind has its own delay in each receiver, and
each may be imitated alone. Kinds that show different places are different sets.

Assumed: one transmitter of one false sky, or several that do not act in concert. What is not assumed: where it is,
which receivers it reaches, when the attack began, that receivers share a clock or their satellites, or that the noise
is white.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skyproof.detectors.base import missing, signals_of, undecided
from skyproof.detectors.multi_receiver.common_epochs import Kind
from skyproof.detectors.multi_receiver.further_signals import Rates, further_signals
from skyproof.detectors.multi_receiver.known_geometry import (
    AntennaDistance,
    AntennaGeometry,
    AntennaPlaces,
    LearntBaseline,
    agreement,
)
from skyproof.detectors.multi_receiver.one_antenna import RatioTest, TrackNoise
from skyproof.detectors.multi_receiver.pairing import Pairing, groups_in, pair_up, versus
from skyproof.detectors.second_signals.late_copies import without_late_copies
from skyproof.detectors.second_signals.second_sky import second_sky_p_value
from skyproof.errors import SettingsError, require_probability
from skyproof.records import Baseline, ConsistentSet, Evidence, Need, Records, Says, SignalRef

__all__ = ["MultiReceiver", "MultiReceiverSettings"]

SHARE = 0.05
"""To which a distance is known, of itself, in 95 of 100 cases, if nothing is said of that."""
ONE_FALSE_SKY = "one transmitter sends one false sky"
ONE_TRANSMITTER = "no two transmitters act in concert"
MAJORITY = 0.5
"""Of the windows in which both skies are received: where fewer agree on the baseline, the antennas move."""


@dataclass(frozen=True)
class MultiReceiverSettings:
    """Settings of `MultiReceiver`.

    false_alarm_probability : of each window's decision: authenticating signals of one antenna, or naming those of the
        sky false.
    accept_probability : a pairing counts as "could be one antenna", and a baseline as the known one, from this p-value
        on.
    min_satellites : common satellites of a pairing, 4 at least.
    min_epochs : common epochs of a pairing, 4 at least.
    multipath_sigma_m : error of a track that stays constant over the window, one sigma.
    correlation_max : largest AR(1) coefficient of the noise from epoch to epoch; 0 if it is known to be white.
    error_bound_m : no track's slow error has a larger sigma; infinite if that is not known.
    antenna_separation_m : the antennas stand at least this far from the first one, horizontally; 0 if they may share
        one, or nobody said.
    max_separation_m : they stand at most this far from it. It catches pairings of one receiver's true with another's
        false signals, but for false positions nearer than this.
    antenna_distance_m : the antennas of two receivers stand so far apart; None if that is not known.
    antenna_distance_sigma_m : its standard deviation; None is half of 5 %, and at least 0.5 m.
    antennas_enu_m : where each receiver's antenna is, east, north, up of any common point; for the receivers that it
        names it replaces all of the above, and decides what they cannot.
    antennas_sigma_m : standard deviation of these places, on each axis.
    unrelated_spread_m : delays of second signals that have nothing to do with each other spread over at least this.
    mistaken_probability : share of echoes among further signals that are called false one by one, under an attack.
    """

    false_alarm_probability: float = 1e-3
    accept_probability: float = 1e-3
    min_satellites: int = 5
    min_epochs: int = 4
    multipath_sigma_m: float = 1.0
    correlation_max: float = 0.98
    error_bound_m: float = 3.0
    antenna_separation_m: float = 0.0
    max_separation_m: float = 300.0
    antenna_distance_m: float | None = None
    antenna_distance_sigma_m: float | None = None
    antennas_enu_m: Mapping[str, tuple[float, float, float]] | None = None
    antennas_sigma_m: float = 0.1
    unrelated_spread_m: float = 300.0
    mistaken_probability: float = 0.01

    def __post_init__(self) -> None:
        for name in ("false_alarm_probability", "accept_probability", "mistaken_probability"):
            require_probability("multi_receiver", name, getattr(self, name))
        for name in ("min_satellites", "min_epochs"):
            if getattr(self, name) < 4:
                raise SettingsError(f"multi_receiver: {name} is {getattr(self, name)}, expected 4 or more; give more")
        if not 0.0 <= self.correlation_max < 1.0:
            raise SettingsError(f"multi_receiver: correlation_max is {self.correlation_max}, expected 0 to below 1")

    def geometry(self, receivers: Sequence[str]) -> AntennaGeometry | None:
        """What is known of where these receivers' antennas stand; None if nothing is."""
        if self.antennas_enu_m is not None and all(name in self.antennas_enu_m for name in receivers):
            return AntennaPlaces(self.antennas_enu_m, self.antennas_sigma_m)
        if self.antenna_distance_m is not None and len(receivers) == 2:
            sigma_m = self.antenna_distance_sigma_m
            given_m = self.antenna_distance_m
            return AntennaDistance(given_m, max(0.5 * SHARE * given_m, 0.5) if sigma_m is None else sigma_m)
        return None

    def noise(self, tests: int) -> TrackNoise:
        """The noise model for one of `tests` tests; a tenth of the error rate goes to the unknown correlation."""
        white = self.correlation_max == 0.0
        return TrackNoise(
            multipath_sigma_m=self.multipath_sigma_m,
            correlation_max=self.correlation_max,
            miss_probability=0.0 if white else 0.1 * self.false_alarm_probability / tests,
            bound_m=self.error_bound_m,
        )


class MultiReceiver:
    """The detector: see the module's text. Windows are independent of each other; it remembers nothing."""

    name = "multi_receiver"
    needs = (Need.TWO_RECEIVERS, Need.SETS)

    def __init__(self, settings: MultiReceiverSettings | None = None) -> None:
        self.settings = settings or MultiReceiverSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Evidence], Any]:
        """Evidence of one window; never raises for what the data lack."""
        lacking = missing(self, records)
        if lacking:
            return lacking, state
        return _Window(self, records).evidence(), state

    def review(self, evidence: Sequence[Evidence]) -> Iterator[Evidence]:
        """All windows' evidence once more, now that all of it is known; a sequence may read it from where it is kept.

        Windows in which both skies were received in every receiver give the baseline. Others that show the same one are
        authentic as well: a false sky in some of the receivers would have had to show the true place. One that shows
        another than most do is open again: true and false signals overlap when they part.
        """
        both: dict[tuple[str, ...], list[Baseline]] = {}
        for e in evidence:
            if self._is_own(e) and e.says == "authentic" and ONE_FALSE_SKY in e.assumes:
                both.setdefault(e.baselines[0].receivers, []).append(e.baselines[0])
        learnt = {receivers: self._learnt(baselines) for receivers, baselines in both.items()}
        for e in evidence:
            yield self._reviewed(e, learnt.get(e.baselines[0].receivers)) if self._is_own(e) else e

    def _is_own(self, e: Evidence) -> bool:
        return e.detector == self.name and bool(e.baselines)

    def _learnt(self, whole: Sequence[Baseline]) -> LearntBaseline | None:
        """What most of the windows agree on, of what each shows as a whole."""
        middle = LearntBaseline(
            replace(
                whole[0],
                enu_m=np.median([b.enu_m for b in whole], axis=0),
                covariance_m2=np.mean([b.covariance_m2 for b in whole], axis=0),
            )
        )
        agreeing = sum(agreement(middle, (b,)) >= self.settings.accept_probability for b in whole)
        return middle if agreeing > MAJORITY * len(whole) else None

    def _reviewed(self, e: Evidence, learnt: LearntBaseline | None) -> Evidence:
        if learnt is None:
            return e
        agrees = agreement(learnt, e.baselines) >= self.settings.accept_probability
        if e.says == "undecided" and agrees:
            return replace(
                e,
                says="authentic",
                would_need=None,
                assumes=(ONE_TRANSMITTER, ONE_FALSE_SKY, *learnt.assumes),
                because=f"{e.because.partition(';')[0]}; they agree with {learnt.words}",
            )
        if e.says == "authentic" and not agrees:
            return replace(
                e,
                says="undecided",
                would_need="a longer recording",
                because=f"{e.because.partition(';')[0]}, but they do not agree with {learnt.words}",
            )
        return e


class _Window:
    """One window's pairings and what they say."""

    def __init__(self, detector: MultiReceiver, records: Records) -> None:
        self.detector, self.records, self.settings = detector, records, detector.settings
        self.sets = _sets_to_decide(records)
        choices = list(itertools.product(*self.sets.values())) if len(self.sets) >= 2 else []
        self.one_choice = len(choices) <= 1
        least = self.settings.min_satellites
        groups = [(sets, kind) for sets in choices for kind in groups_in(sets, least)]
        self.tests = max(len(groups), 1)
        noise = self.settings.noise(self.tests)
        every = [pair_up(records, sets, noise, min_satellites=least, kind=kind) for sets, kind in groups]
        self.pairings = [pairing for pairing in every if self._enough(pairing)]
        self.groups = itertools.count(1)
        self.skies: list[Pairing] = []

    def evidence(self) -> list[Evidence]:
        said = self._of_groups()
        return [*said, *self._of_further_signals(said)] if self.skies else said

    def _of_further_signals(self, said: Sequence[Evidence]) -> list[Evidence]:
        """What is false beside the skies that are true, signal by signal."""
        rates = Rates(
            alarm=self.settings.false_alarm_probability,
            mistaken=self.settings.mistaken_probability,
            multipath_sigma_m=self.settings.multipath_sigma_m,
            unrelated_spread_m=self.settings.unrelated_spread_m,
        )
        named = {ref for e in said if e.says == "spoofed" for ref in e.subject}
        found = further_signals(self.records, self.skies, self.sets, named, rates)
        return [
            replace(
                self._say("spoofed", one.subject, p_value=one.p_value, because=one.because, group=next(self.groups)),
                whole_sky=not one.together,
            )
            for one in found
        ]

    def _of_groups(self) -> list[Evidence]:
        if len(self.sets) < 2:
            where = " and ".join(self.sets) or "no receiver"
            return [
                self._undecided(
                    signals_of(self.records.observations),
                    because=f"a consistent set of signals in {where} only",
                    would_need="5 or more satellites with pseudoranges in a second receiver",
                )
            ]
        if not self.pairings:
            return [
                self._undecided(
                    self._signals(),
                    because=f"fewer than {self.settings.min_satellites} satellites in common over "
                    f"{self.settings.min_epochs} common epochs",
                    would_need="more satellites in common, or a longer window",
                )
            ]
        if self.one_choice:
            by_size = sorted(
                self.pairings, key=lambda pairing: len(pairing.ranges.signals)
            )  # what is said last is reported
            return [e for pairing in by_size for e in self._only_pairing(pairing)]
        return self._several_sets()

    def _enough(self, pairing: Pairing) -> bool:
        ranges, settings = pairing.ranges, self.settings
        n_kinds = int(ranges.kinds.max(initial=0)) + 1
        enough = len(ranges.signals) - n_kinds >= settings.min_satellites - 1
        return enough and len(ranges.range_m) >= settings.min_epochs

    # One set in each receiver -----------------------------------------------------------------------------------------

    def _only_pairing(self, pairing: Pairing) -> list[Evidence]:
        alpha, p_one = self.settings.false_alarm_probability, self._p_one(pairing)
        geometry = self.settings.geometry(pairing.receivers)
        if (p_each := self._p_each(pairing)) < alpha:
            if geometry is None:
                return [self._open(pairing, p_each)]
            return self._by_geometry(pairing, geometry, p_each)
        p_false, because = self._p_not_sky(pairing, geometry)
        if p_one >= self.settings.accept_probability and p_false < alpha:
            return [self._say("spoofed", pairing.subject, p_value=p_false, because=because, group=next(self.groups))]
        return [
            self._say(
                "undecided",
                pairing.subject,
                p_value=p_one,
                because=f"{_names(pairing)} could come from one antenna or from the sky: range differences between the "
                f"receivers vary by {pairing.scatter_m:.1f} m between satellites, which errors may explain",
                would_need="a longer window, or antennas farther apart"
                + ("" if geometry is not None else f", or to know {self._where()}"),
            )
        ]

    def _by_geometry(self, pairing: Pairing, geometry: AntennaGeometry, p_one: float) -> list[Evidence]:
        """Not of one antenna: of the sky if the antennas stand where they are known to."""
        alpha = self.settings.false_alarm_probability
        if self._agrees(pairing, geometry):
            return [self._authentic(pairing, p_one, geometry.assumes, because=f"; they agree with {geometry.words}")]
        p_known = pairing.survival(geometry)
        steady = pairing.noise_m <= self.settings.error_bound_m
        found = self._agreeing_pairs(pairing) if len(pairing.sets) > 2 else []
        vouched = {ref for e in found for ref in e.subject}
        rest = tuple(ref for ref in pairing.subject if ref not in vouched)
        of_rest = f"{_names(pairing)} disagree with {geometry.words}" + (f": {_far(pairing)}" if _far(pairing) else "")
        if p_known < alpha and rest and steady:
            found.append(
                self._say(
                    "attack",
                    rest,
                    p_value=p_known,
                    because=f"{of_rest}; some of them are imitations, or what was given is wrong",
                    would_need="what was given of the antennas, measured again",
                )
            )
        elif rest:
            swings = f"the range differences of {_names(pairing)} swing by {pairing.noise_m:.0f} m within the window"
            found.append(
                self._say(
                    "undecided",
                    rest,
                    p_value=min(p_one, p_known),
                    because=of_rest if steady else swings,
                    would_need="a longer recording, or to know better where the antennas stand",
                )
            )
        return found

    def _agreeing_pairs(self, pairing: Pairing) -> list[Evidence]:
        """Of three receivers or more: pairs that agree with the known places among themselves.

        One transmitter cannot bring two receivers to agree, and one that holds one of them alone shows its true place.
        """
        pairs = list(itertools.combinations(pairing.sets, 2))
        settings, found = self.settings, []
        kind = next(iter(pairing.kinds)) if len(pairing.kinds) == 1 else None
        tests = len(pairs) * self.tests
        for sets in pairs:
            noise = settings.noise(tests)
            pair = pair_up(self.records, sets, noise, min_satellites=settings.min_satellites, kind=kind)
            geometry = settings.geometry(pair.receivers)
            if not self._enough(pair):
                continue
            p_one = min(1.0, tests * pair.one_antenna_each_p_value)
            if geometry is not None and p_one < settings.false_alarm_probability and self._agrees(pair, geometry):
                found.append(
                    self._authentic(pair, p_one, geometry.assumes, because=f"; they agree with {geometry.words}")
                )
        return found

    def _open(self, pairing: Pairing, p_one: float) -> Evidence:
        """Not of one antenna, and nothing says whether the baseline is the true one."""
        alpha = self.settings.false_alarm_probability
        if self._p_possible(pairing) < alpha:
            return self._say(
                "undecided",
                pairing.subject,
                p_value=p_one,
                because=self._too_far(pairing),
                would_need=f"{self._where()}; or, if they may be that far apart, a larger max_separation_m in the "
                "table [protect] of a platform file",
            )
        return self._say(
            "undecided",
            pairing.subject,
            p_value=p_one,
            baselines=self._believed(pairing),
            because=f"{_names(pairing)} do not come from one antenna, but one receiver alone may follow a false sky",
            would_need="the distance between the antennas (antenna_distance_m), or where they stand (antennas_enu_m)",
        )

    def _agrees(self, pairing: Pairing, geometry: AntennaGeometry) -> bool:
        """Whether the baselines are as known."""
        baselines = self._believed(pairing)
        return bool(baselines) and agreement(geometry, baselines) >= self.settings.accept_probability

    def _believed(self, pairing: Pairing) -> tuple[Baseline, ...]:
        """Its baselines; none where the noise goes beyond the bound of any track's error."""
        return pairing.baselines if pairing.noise_m <= self.settings.error_bound_m else ()

    # Several sets in some receiver ------------------------------------------------------------------------------------

    def _several_sets(self) -> list[Evidence]:
        alpha = self.settings.false_alarm_probability
        could_be = [p for p in self.pairings if self._p_one(p) >= max(self.settings.accept_probability, alpha)]
        could_be = [p for p in could_be if self._shows_one_place(p)]
        false = _disjoint(sorted(could_be, key=lambda p: float(p.one_antenna.statistic)))
        skies = self._left_over(false)
        said = [self._false_group(pairing, false, decided=bool(skies)) for pairing in false]
        said += [self._sky_group(sky, false) for sky in skies]
        return [e for e in said if e is not None] or [self._who()]

    def _shows_one_place(self, pairing: Pairing) -> bool:
        """Whether its baselines are zero, by the noise as it looks: one antenna puts the receivers in one place.

        False signals from several antennas, or with few satellites in common, may leave the true sky over near
        antennas as the pairing of the least contrast: all that shows it then is that its baseline is there.
        """
        if not pairing.baselines:
            return True
        nowhere = AntennaPlaces(dict.fromkeys(pairing.receivers, (0.0, 0.0, 0.0)), sigma_m=0.0)
        return agreement(nowhere, pairing.baselines[:1]) >= self.settings.accept_probability

    def _false_group(self, pairing: Pairing, false: list[Pairing], *, decided: bool) -> Evidence | None:
        """`decided`: the sets left over make one sky, so the other false groups are no rivals."""
        alpha = self.settings.false_alarm_probability
        rivals = [p for p in self.pairings if p is not pairing and not (decided and p in false)]
        tests = [versus(rival, pairing) for rival in rivals]
        worst = max(tests, key=lambda test: float(test.p_value), default=None)
        # With two skies in every receiver one of the pairings is false altogether; with fewer it may have been missed.
        complete = all(len(sets) >= 2 for sets in self.sets.values())
        if complete and worst is not None and worst.p_value < alpha:
            return self._say(
                "spoofed",
                pairing.subject,
                p_value=float(worst.p_value),
                ratio=worst,
                group=next(self.groups),
                because=f"{_names(pairing)} come from one antenna: range differences between the receivers vary by "
                f"{pairing.scatter_m:.2f} m between satellites, those of any other pairing by "
                f"{min(p.scatter_m for p in rivals):.1f} m or more",
            )
        p_false, because = self._p_not_sky(pairing, self.settings.geometry(pairing.receivers))
        p_false = min(1.0, self.tests * p_false)
        if p_false < alpha:
            return self._say("spoofed", pairing.subject, p_value=p_false, because=because, group=next(self.groups))
        return None

    def _sky_group(self, sky: Pairing, false: list[Pairing]) -> Evidence | None:
        alpha, p_one = self.settings.false_alarm_probability, self._p_each(sky)
        if p_one >= alpha:
            return None
        geometry = self.settings.geometry(sky.receivers)
        if geometry is not None:
            # As with one set in each receiver: it is told from the false ones by where the antennas stand.
            if not self._agrees(sky, geometry):
                return None
            return self._authentic(sky, p_one, geometry.assumes, because=f"; they agree with {geometry.words}")
        p_ratio = max((float(versus(sky, pairing).p_value) for pairing in false), default=0.0)
        if p_ratio >= alpha or self._p_possible(sky) < alpha:
            return None
        return self._authentic(
            sky,
            max(p_one, p_ratio),
            (ONE_FALSE_SKY,),
            baselines=self._believed(sky),
            because="; the receivers' other signals come from one antenna",
        )

    def _left_over(self, false: list[Pairing]) -> list[Pairing]:
        """The groups, one per kind, of sets that no false group takes, if it can only be those and none is of one
        antenna.

        Which of several it is, and whether anything but the false is left over when some receiver shows one set only,
        a known baseline decides: of the pairings that agree with it there must be just one of each kind.
        """
        taken = set[tuple[int, Kind]]().union(*(p.takes for p in false))
        free = [p for p in self.pairings if not taken & p.takes]
        free = [p for p in free if self._p_each(p) < self.settings.false_alarm_probability]
        known = [self.settings.geometry(p.receivers) for p in free]
        if free and all(g is not None for g in known):
            free = [p for p, g in zip(free, known, strict=True) if g is not None and self._agrees(p, g)]
            return [p for p in free if not any(p is not q and p.kinds & q.kinds for q in free)]
        whole = {id(s) for pairing in false for s in pairing.sets}
        single = all(sum(id(s) not in whole for s in sets) == 1 for sets in self.sets.values())
        free = [p for p in free if not whole & {id(s) for s in p.sets}]
        return free if false and single else []

    def _who(self) -> Evidence:
        """There are several skies, and the pairings do not tell which is false."""
        p_values = [
            second_sky_p_value(
                next(o for o in self.records.observations if o.receiver == receiver),
                tuple(sets),
                unrelated_spread_m=self.settings.unrelated_spread_m,
                multipath_sigma_m=max(self.settings.multipath_sigma_m, 1.0),
            )
            for receiver, sets in self.sets.items()
        ]
        p_value = min(1.0, len(p_values) * min(p_values))
        counts = ", ".join(f"{len(sets)} in {receiver}" for receiver, sets in self.sets.items())
        because = f"several sets of signals that each fit one position ({counts}); which is true was not decided"
        would_need = (
            "a longer window, antennas farther apart, both skies tracked in all receivers, or to know where the "
            "antennas stand (antennas_enu_m)"
        )
        if p_value >= self.settings.false_alarm_probability:
            return self._undecided(self._signals(), because=because, would_need=would_need)
        return self._say("attack", self._signals(), p_value=p_value, because=because, would_need=would_need)

    # What both have in common -----------------------------------------------------------------------------------------

    def _p_one(self, pairing: Pairing) -> float:
        """Of "one antenna", for all tests of the window together."""
        return min(1.0, self.tests * float(pairing.one_antenna.p_value))

    def _p_each(self, pairing: Pairing) -> float:
        """The same, of any of its kinds."""
        return min(1.0, self.tests * pairing.one_antenna_each_p_value)

    def _p_possible(self, pairing: Pairing) -> float:
        return pairing.at_most_p_value(self.settings.max_separation_m)

    def _p_not_sky(self, pairing: Pairing, geometry: AntennaGeometry | None) -> tuple[float, str]:
        """p-value of "the sky over these antennas", and what to say if it is rejected."""
        because = f"{_names(pairing)} come from one antenna"
        if geometry is not None:
            return pairing.survival(geometry), f"{because}: they do not show {geometry.words}"
        limit_m = self.settings.antenna_separation_m
        if limit_m <= 0.0:
            return 1.0, ""
        because = f"{because}, if the receivers' antennas are {limit_m:g} m or more apart"
        return pairing.at_least_p_value(limit_m), because

    def _authentic(
        self,
        pairing: Pairing,
        p_value: float,
        assumes: tuple[str, ...],
        *,
        because: str,
        baselines: tuple[Baseline, ...] = (),
    ) -> Evidence:
        self.skies.append(pairing)
        return self._say(
            "authentic",
            pairing.subject,
            p_value=p_value,
            group=next(self.groups),
            baselines=baselines,
            statistic=float(pairing.one_antenna.statistic),
            threshold=pairing.threshold(self.settings.false_alarm_probability / self.tests),
            because=f"{_names(pairing)} do not come from one antenna: range differences between the receivers vary by "
            f"{pairing.scatter_m:.1f} m between satellites{because}",
            assumes=(ONE_TRANSMITTER, *assumes),
        )

    def _too_far(self, pairing: Pairing) -> str:
        far_m, limit_m = max(pairing.distances_m or (0.0,)), self.settings.max_separation_m
        return (
            f"{_names(pairing)} put the antennas {far_m:.0f} m apart, more than the {limit_m:g} m that they may be: "
            "one receiver may follow a false sky and another the true one"
        )

    def _where(self) -> str:
        return "the distance between the antennas (antenna_distance_m), or where they stand (antennas_enu_m)"

    def _signals(self) -> tuple[SignalRef, ...]:
        return tuple(SignalRef(s.receiver, signal) for sets in self.sets.values() for s in sets for signal in s.signals)

    def _undecided(self, subject: tuple[SignalRef, ...], *, because: str, would_need: str) -> Evidence:
        return undecided(self.detector, self.records, subject, because=because, would_need=would_need)

    def _say(
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


def _disjoint(pairings: list[Pairing]) -> list[Pairing]:
    """The first, and of the others in order those that share no set's signals with one taken before."""
    taken: list[Pairing] = []
    for pairing in pairings:
        if not any(pairing.takes & other.takes for other in taken):
            taken.append(pairing)
    return taken


def _far(pairing: Pairing) -> str:
    """How far apart the signals put the antennas."""
    first, *others = pairing.receivers
    far = [f"{d:.1f} ± {s:.1f} m" for whole in pairing.baselines[:1] for d, s in whole.distances_m]
    places = [f"the antenna of {name} {d} from that of {first}" for name, d in zip(others, far, strict=False)]
    return "they put " + ", ".join(places) if places else ""


def _names(pairing: Pairing) -> str:
    *others, last = [chosen.receiver for chosen in pairing.sets]
    kinds = sorted(pairing.kinds)
    which = "" if kinds == [("G", "L1", "CA")] else f" {' and '.join(' '.join(kind) for kind in kinds)}"
    return f"the {len(set(pairing.ranges.sats))} satellites'{which} signals in {', '.join(others)} and {last}"
