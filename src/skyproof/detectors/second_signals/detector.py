"""Find satellites with second signals that echoes do not explain: an attack that does not hide the true signals.

Signals of one transmission are compared (satellite, band, code): what a satellite sends on two bands are no two signals
of it. A satellite counts once, by its most telling second signal: one reflector makes all of them.

A second signal must be clearly apart in delay or Doppler, which near echoes are not. It must not be much weaker, as the
side lobes of a strong satellite's code are. Of two signals the earlier is taken for the direct one, as an echo is
late. How rarely an echo is like the other one is the satellite's p-value (`echoes`): how late, how strong over the
direct one, how strong that is among the others, how fast. A test over all satellites, however many, finds if more of
these are small than chance explains (`statistics.many_small`). It takes two at least, for a reflector outside the model
may reach one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import comb
from typing import Any

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.base import NotTested, Reporter, leave_open, signals_of
from skyproof.detectors.second_signals.echoes import EchoModel, Second, echo_p_value, false_over_echo
from skyproof.detectors.second_signals.policy import POLICY
from skyproof.errors import SettingsError, require_probability
from skyproof.gnss.orbits import compute_satellite_state
from skyproof.gnss.sky import compute_azimuth_elevation
from skyproof.records import (
    Cause,
    ConsistentSet,
    Datum,
    Finding,
    Hypothesis,
    NavigationData,
    Need,
    Observations,
    Records,
    SignalId,
    SignalRef,
    Transmission,
    list_refs,
)
from skyproof.statistics.many_small import ManySmall, many_small

__all__ = ["FoundSecondSignals", "SecondSignals", "SecondSignalsSettings", "elevation_rad", "find_second_signals"]


@dataclass(frozen=True)
class SecondSignalsSettings:
    """Settings of `SecondSignals`.

    false_alarm_probability : at most, per receiver and window.
    echoes_per_satellite : mean number of echoes of a satellite at a time, of any delay.
    unexplained_probability : that a satellite has a credible second signal that neither an attack nor an echo makes.
    min_separation_chips : second signals nearer than this in delay and `min_separation_hz` in Doppler do not count.
    max_weaker_db : nor those weaker than the satellite's strongest by more.
    min_cn0_dbhz : nor any signal below.
    min_epochs : in which a signal must be there.
    multipath_sigma_m : error of a track that stays over the window, one sigma.
    """

    false_alarm_probability: float = 1e-3
    echoes_per_satellite: float = 1.0
    unexplained_probability: float = 1e-3
    min_separation_chips: float = 1.5
    min_separation_hz: float = 50.0
    max_weaker_db: float = 12.0
    min_cn0_dbhz: float = 30.0
    min_epochs: int = 2
    multipath_sigma_m: float = 1.0

    def __post_init__(self) -> None:
        for name in ("false_alarm_probability", "unexplained_probability"):
            require_probability("second_signals", name, getattr(self, name))
        if not 0.0 < self.echoes_per_satellite < np.inf:
            raise SettingsError(
                f"second_signals: echoes_per_satellite is {self.echoes_per_satellite:g}, expected more than 0; give "
                "the mean number of echoes of a satellite"
            )

    @property
    def echoes(self) -> EchoModel:
        """Return the model of how reflections make second signals that are tested."""
        return EchoModel(
            echoes_per_satellite=self.echoes_per_satellite,
            unexplained_probability=self.unexplained_probability,
            least_delay_chips=self.min_separation_chips,
            most_weaker_db=self.max_weaker_db,
        )


@dataclass(frozen=True)
class FoundSecondSignals:
    """Satellites of one receiver and window: all with a credible signal, those with a second one, and undecided ones.

    A satellite is undecided while its time of week, and with it the delay, is unknown.

    seconds : of each of the doubled, its second signals beside the one that is taken for the direct one.
    repeated : signals later and weaker than the strongest of their transmission, by a delay that several satellites
        share; so these do not make a satellite count as doubled. repeated_by_chance : chance that so many delays of
        echoes agree.
    """

    sats: tuple[str, ...]
    seconds: Mapping[str, tuple[Second, ...]]
    unknown: tuple[str, ...]
    repeated: tuple[SignalId, ...]
    repeated_by_chance: float = 1.0

    @property
    def doubled(self) -> tuple[str, ...]:
        """Return the satellites with a second signal."""
        return tuple(self.seconds)


def find_second_signals(observations: Observations, settings: SecondSignalsSettings) -> FoundSecondSignals:
    """Find second signals in one receiver's window."""
    cn0_dbhz = observations.cn0_dbhz
    received = np.isfinite(cn0_dbhz).sum(axis=0) >= settings.min_epochs
    level_dbhz = np.full(len(observations.signals), -np.inf)
    level_dbhz[received] = np.nanmedian(cn0_dbhz[:, received], axis=0)
    sent: dict[Transmission, list[int]] = {}
    for channel in np.flatnonzero(level_dbhz >= settings.min_cn0_dbhz):
        sent.setdefault(observations.signals[channel].transmission, []).append(int(channel))
    ordered = {name: _order_channels(observations, channels, level_dbhz, settings) for name, channels in sent.items()}
    best_dbhz = max((level_dbhz[channels[0]] for channels in ordered.values()), default=np.nan)
    beside = {
        name: _compare_channels(observations, columns, level_dbhz, best_dbhz, settings)
        for name, columns in ordered.items()
    }
    twice = sorted(name for name, (seconds, _) in beside.items() if seconds)
    repeated, by_chance = _find_repeated(observations, {name: sent[name] for name in twice}, level_dbhz, settings)
    doubled = sorted(set(twice) - {signal.transmission for signal in repeated})
    sats = sorted({sat for sat, *_ in doubled})
    return FoundSecondSignals(
        sats=tuple(sorted({sat for sat, *_ in sent})),
        seconds={sat: tuple(s for name in doubled if name[0] == sat for s in beside[name][0]) for sat in sats},
        unknown=tuple(sorted({sat for (sat, *_), (_, known) in beside.items() if not known} - set(sats))),
        repeated=repeated,
        repeated_by_chance=by_chance,
    )


def _find_repeated(
    observations: Observations,
    doubled: Mapping[Transmission, list[int]],
    level_dbhz: Reals,
    settings: SecondSignalsSettings,
) -> tuple[tuple[SignalId, ...], float]:
    """Find second signals, later and weaker, whose delays agree: a late copy of the whole sky.

    Also returned is the chance that echoes do so. Let k of n delays, anywhere up to `most_late_m`, lie within a width.
    The chance is at most C(n, k) k times the (k - 1)th power of the width's share of that range: of k places one is the
    first, and the others follow it.
    """
    late: dict[int, tuple[float, float]] = {}
    for channels in doubled.values():
        strong, other = sorted(channels, key=lambda c: -level_dbhz[c])[:2]
        if len(channels) > 2 or level_dbhz[strong] - level_dbhz[other] < POLICY.copy_weaker_db:
            continue
        difference_m = observations.pseudorange_m[:, other] - observations.pseudorange_m[:, strong]
        known = np.isfinite(difference_m)
        apart_hz = _median_difference(observations.doppler_hz, strong, other, settings.min_epochs)
        enough = known.sum() >= settings.min_epochs and not abs(apart_hz) > POLICY.late_copy_hz
        if enough and 0.0 < np.median(difference_m[known]) <= POLICY.most_late_m:
            thermal_m = observations.pseudorange_sigma_m[known][:, [strong, other]]
            variance = np.sum(thermal_m**2) / known.sum() ** 2 + 2.0 * settings.multipath_sigma_m**2
            late[other] = float(np.mean(difference_m[known])), float(np.sqrt(variance))
    if len({observations.signals[c].sat for c in late}) < 2:
        return (), 1.0
    common_m = float(np.median([delay_m for delay_m, _ in late.values()]))
    agreeing = [
        c for c, (delay_m, sigma_m) in late.items() if abs(delay_m - common_m) < POLICY.same_delay_sigmas * sigma_m
    ]
    if len({observations.signals[c].sat for c in agreeing}) < 2:
        return (), 1.0
    width = 2.0 * POLICY.same_delay_sigmas * max(late[c][1] for c in agreeing) / POLICY.most_late_m
    by_chance = comb(len(late), len(agreeing)) * len(agreeing) * width ** (len(agreeing) - 1)
    return (
        (tuple(observations.signals[c] for c in agreeing), by_chance)
        if by_chance < POLICY.delays_agree_probability
        else ((), by_chance)
    )


def _order_channels(
    observations: Observations, channels: list[int], level_dbhz: Reals, settings: SecondSignalsSettings
) -> list[int]:
    """Order a transmission's channels that are not much weaker than its strongest, the earliest first.

    If the delays are unknown, the strongest is first.
    """
    strong = sorted(
        (c for c in channels if level_dbhz[c] >= level_dbhz[channels].max() - settings.max_weaker_db),
        key=lambda c: -level_dbhz[c],
    )
    late_m = [_median_difference(observations.pseudorange_m, c, strong[0], settings.min_epochs) for c in strong]
    if not np.all(np.isfinite(late_m[1:])):
        return strong
    return [strong[k] for k in np.argsort([0.0, *late_m[1:]], kind="stable")]


def _compare_channels(
    observations: Observations,
    channels: list[int],
    level_dbhz: Reals,
    best_dbhz: float,
    settings: SecondSignalsSettings,
) -> tuple[list[Second], bool]:
    """Compare a transmission's channels with the first one; return those clearly apart, and if all delays are known."""
    direct, *other_channels = channels
    chip_m = observations.signals[direct].plan.chip_m
    found, known = [], True
    for other in other_channels:
        late_m = _median_difference(observations.pseudorange_m, other, direct, settings.min_epochs)
        apart_hz = _median_difference(observations.doppler_hz, other, direct, settings.min_epochs)
        late = abs(late_m) > settings.min_separation_chips * chip_m
        known &= bool(np.isfinite(late_m))
        if late or abs(apart_hz) > settings.min_separation_hz:
            below_db = float(best_dbhz - level_dbhz[direct])
            over_db = float(level_dbhz[other] - level_dbhz[direct])
            found.append(Second(late_m if late else np.nan, over_db, apart_hz, below_db, chip_m))
    return found, known or bool(found)


def _median_difference(values: Reals, first: int, other: int, min_epochs: int) -> float:
    """Return the median difference of two channels; they share the receiver's clock, so it cancels."""
    difference = values[:, first] - values[:, other]
    known = difference[np.isfinite(difference)]
    return float(np.median(known)) if known.size >= min_epochs else np.nan


def elevation_rad(navigation: NavigationData | None, sets: Sequence[ConsistentSet], sat: str) -> float:
    """Return a satellite's elevation at the position of the receiver's first set; NaN if that is unknown."""
    orbit = navigation.best(sat, sets[0].gpst) if navigation is not None and sets else None
    if orbit is None:
        return float("nan")
    return float(
        compute_azimuth_elevation(
            sets[0].position_ecef_m, compute_satellite_state(orbit, sets[0].gpst).position_ecef_m
        )[1]
    )


class SecondSignals:
    """The detector: one finding per receiver and window, and one more of a late copy of the sky."""

    name = "second_signals"
    needs = (Need.OBSERVATIONS,)

    def __init__(self, settings: SecondSignalsSettings | None = None) -> None:
        self.settings = settings or SecondSignalsSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.ONE_SKY)
        return report.name_missing() or [
            finding for o in records.observations for finding in self._test_receiver(report, o)
        ], state

    def _test_receiver(self, report: Reporter, o: Observations) -> list[Finding]:
        found = find_second_signals(o, self.settings)
        return [self._count(report, o, found), *([self._report_late_copy(report, o, found)] if found.repeated else [])]

    def _report_late_copy(self, report: Reporter, o: Observations, found: FoundSecondSignals) -> Finding:
        """Return a late copy of the sky: nothing but a reflector or a repeater makes echoes whose delays agree."""
        return report.find(
            list_refs(o.receiver, found.repeated),
            "late_copy",
            {Cause.CLEAN: found.repeated_by_chance, **leave_open((Cause.REFLECTIONS,))},
            alpha=POLICY.delays_agree_probability,
            singled_out=True,
        )

    def _count(self, report: Reporter, o: Observations, found: FoundSecondSignals) -> Finding:
        """Return whether more satellites have a second signal than echoes explain."""
        if not np.isfinite(o.cn0_dbhz).any():
            return report.pass_over(signals_of((o,)), NotTested("no_cn0"))
        n, alpha = len(found.sats), self.settings.false_alarm_probability
        if n < POLICY.attack_satellites:
            few: dict[str, Datum] = {"satellites": n, "min_cn0_dbhz": self.settings.min_cn0_dbhz}
            return report.pass_over(signals_of((o,)), NotTested("few_satellites", few))
        least_p = self._test_satellites(report.records, o, found)
        none = [1.0] * (n - len(least_p))
        test = _count_small([*least_p.values(), *none])
        worst = [self.settings.unexplained_probability] * len(found.unknown)
        at_worst = _count_small([*least_p.values(), *worst, *none[len(worst) :]])
        if test.p_value >= alpha > at_worst.p_value:
            return report.pass_over(
                _signals(o, found.sats), NotTested("delay_unknown", {"unknown": len(found.unknown)})
            )
        data: dict[str, Datum] = {
            "doubled": len(found.doubled),
            "satellites": n,
            "statistic": max(0.0, -float(np.log10(test.p_value))),
            "threshold": float(-np.log10(alpha)),
        }
        sats, attacked = found.sats, test.p_value < alpha
        if attacked:
            sats = tuple(sorted(least_p, key=lambda sat: least_p[sat])[: test.how_many])
            data |= {"unlike_echoes": len(sats), "of_echoes": max(least_p[sat] for sat in sats)}
        return report.find(
            _signals(o, sats),
            "unlike_echoes" if attacked else "like_echoes",
            {Cause.CLEAN: test.p_value, Cause.REFLECTIONS: test.p_value},
            data=data,
        )

    def echoes_p_value(self, records: Records, o: Observations) -> float:
        """Return the p-value of a receiver's second signals being echoes; 1 where it is not tested."""
        found = find_second_signals(o, self.settings)
        if len(found.sats) < POLICY.attack_satellites:
            return 1.0
        least_p = self._test_satellites(records, o, found)
        return _count_small([*least_p.values(), *[1.0] * (len(found.sats) - len(least_p))]).p_value

    def _test_satellites(self, records: Records, o: Observations, found: FoundSecondSignals) -> dict[str, float]:
        """Return of each satellite with second signals the p-value of the most telling, if it is an echo."""
        model, sets = self.settings.echoes, [s for s in records.sets if s.receiver == o.receiver]
        return {
            sat: min(
                _p_value(model, second._replace(elevation_rad=elevation_rad(records.navigation, sets, sat)))
                for second in seconds
            )
            for sat, seconds in found.seconds.items()
        }


def _count_small(p_values: Sequence[float]) -> ManySmall:
    """Test that no more satellites than chance explains have a telling second signal. p_values : of all of them."""
    return many_small(p_values, least=POLICY.attack_satellites, most=POLICY.telling_p_value)


def _p_value(model: EchoModel, second: Second) -> float:
    return echo_p_value(model, false_over_echo(model, second), second)


def _signals(observations: Observations, sats: tuple[str, ...]) -> tuple[SignalRef, ...]:
    return tuple(SignalRef(observations.receiver, signal) for signal in observations.signals if signal.sat in sats)
