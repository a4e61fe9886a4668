"""Satellites with more than one credible signal: an attack that does not hide the true signals shows beside them.

Signals of one transmission are compared (satellite, band, code): what a satellite sends on two bands are no two signals
of it. A satellite counts once, whichever of its transmissions has a second signal: one reflector makes all of them.

A second signal must be clearly apart in delay or Doppler, which near echoes are not, and not much weaker, which the
side lobes of a strong satellite's code are. Far echoes do happen, to one satellite here and there. So the statistic is
the number of satellites with a second signal, binomial if echoes come to each satellite independently.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.base import missing, signals_of, undecided
from skyproof.detectors.second_signals.late_copies import MOST_LATE_M, WEAKER_DB
from skyproof.errors import require_probability
from skyproof.gnss.constants import CA_CHIP_RATE_HZ, SPEED_OF_LIGHT_M_S
from skyproof.records import Evidence, Need, Observations, Records, SignalId, SignalRef
from skyproof.statistics.distributions import binomial_survival, binomial_threshold

__all__ = ["FoundSecondSignals", "SecondSignals", "SecondSignalsSettings", "find_second_signals"]

_Transmission = tuple[str, str, str]
LATE_HZ = 10.0
"""By which the carrier of a late copy differs at most: it is not sent anew."""
SAME_DELAY = 4.0
"""Sigmas: second signals whose delays differ from the satellites' median by less are one late copy of the sky."""


@dataclass(frozen=True)
class SecondSignalsSettings:
    """Settings of `SecondSignals`.

    false_alarm_probability : at most, per receiver and window; counts are whole, so the attained rate is lower, and
        is reported.
    long_echo_probability : that a satellite has a credible second signal without an attack.
    min_separation_chips : second signals nearer than this in delay and `min_separation_hz` in Doppler do not count.
    max_weaker_db : nor those weaker than the satellite's strongest by more.
    min_cn0_dbhz : nor any signal below.
    min_epochs : in which a signal must be there.
    multipath_sigma_m : error of a track that stays over the window, one sigma.
    """

    false_alarm_probability: float = 1e-3
    long_echo_probability: float = 0.01
    min_separation_chips: float = 1.5
    min_separation_hz: float = 50.0
    max_weaker_db: float = 12.0
    min_cn0_dbhz: float = 30.0
    min_epochs: int = 2
    multipath_sigma_m: float = 1.0

    def __post_init__(self) -> None:
        for name in ("false_alarm_probability", "long_echo_probability"):
            require_probability("second_signals", name, getattr(self, name))


@dataclass(frozen=True)
class FoundSecondSignals:
    """Satellites of one receiver and window: all with a credible signal, those with a second one, and those of which it
    is not known, because the time of week, and with it the delay, is not known yet.

    repeated : signals later and weaker than the strongest of their transmission, by a delay that several satellites
        share; so these do not make a satellite count as doubled.
    """

    sats: tuple[str, ...]
    doubled: tuple[str, ...]
    unknown: tuple[str, ...]
    repeated: tuple[SignalId, ...]


def find_second_signals(observations: Observations, settings: SecondSignalsSettings) -> FoundSecondSignals:
    """Look for second signals in one receiver's window."""
    cn0_dbhz = observations.cn0_dbhz
    there = np.isfinite(cn0_dbhz).sum(axis=0) >= settings.min_epochs
    level_dbhz = np.full(len(observations.signals), -np.inf)
    level_dbhz[there] = np.nanmedian(cn0_dbhz[:, there], axis=0)
    sent: dict[_Transmission, list[int]] = {}
    for channel in np.flatnonzero(level_dbhz >= settings.min_cn0_dbhz):
        sent.setdefault(observations.signals[channel].transmission, []).append(int(channel))
    verdicts = {name: _apart(observations, channels, level_dbhz, settings) for name, channels in sent.items()}
    twice = sorted(name for name, apart in verdicts.items() if apart is True)
    repeated = _repeated(observations, {name: sent[name] for name in twice}, level_dbhz, settings)
    doubled = {sat for sat, *_ in set(twice) - {signal.transmission for signal in repeated}}
    return FoundSecondSignals(
        sats=tuple(sorted({sat for sat, *_ in sent})),
        doubled=tuple(sorted(doubled)),
        unknown=tuple(sorted({sat for (sat, *_), apart in verdicts.items() if apart is None} - doubled)),
        repeated=repeated,
    )


def _repeated(
    observations: Observations,
    doubled: Mapping[_Transmission, list[int]],
    level_dbhz: Reals,
    settings: SecondSignalsSettings,
) -> tuple[SignalId, ...]:
    """Second signals of transmissions with two, later and weaker, whose delays agree: a late copy of the whole sky."""
    late: dict[int, tuple[float, float]] = {}
    for channels in doubled.values():
        strong, other = sorted(channels, key=lambda c: -level_dbhz[c])[:2]
        if len(channels) > 2 or level_dbhz[strong] - level_dbhz[other] < WEAKER_DB:
            continue
        difference_m = observations.pseudorange_m[:, other] - observations.pseudorange_m[:, strong]
        known = np.isfinite(difference_m)
        apart_hz = _median_difference(observations.doppler_hz, strong, other, settings.min_epochs)
        enough = known.sum() >= settings.min_epochs and not apart_hz > LATE_HZ
        if enough and 0.0 < np.median(difference_m[known]) <= MOST_LATE_M:
            thermal_m = observations.pseudorange_sigma_m[known][:, [strong, other]]
            variance = np.sum(thermal_m**2) / known.sum() ** 2 + 2.0 * settings.multipath_sigma_m**2
            late[other] = float(np.mean(difference_m[known])), float(np.sqrt(variance))
    if len({observations.signals[c].sat for c in late}) < 2:
        return ()
    common_m = float(np.median([delay_m for delay_m, _ in late.values()]))
    agreeing = [c for c, (delay_m, sigma_m) in late.items() if abs(delay_m - common_m) < SAME_DELAY * sigma_m]
    several = len({observations.signals[c].sat for c in agreeing}) > 1
    return tuple(observations.signals[c] for c in agreeing) if several else ()


def _apart(
    observations: Observations, channels: list[int], level_dbhz: Reals, settings: SecondSignalsSettings
) -> bool | None:
    """Whether two of a transmission's channels are apart; None if that is not known."""
    strong = [c for c in channels if level_dbhz[c] >= level_dbhz[channels].max() - settings.max_weaker_db]
    chip_m = SPEED_OF_LIGHT_M_S / CA_CHIP_RATE_HZ
    known = True
    for one, other in combinations(strong, 2):
        delay_m = _median_difference(observations.pseudorange_m, one, other, settings.min_epochs)
        doppler_hz = _median_difference(observations.doppler_hz, one, other, settings.min_epochs)
        if delay_m > settings.min_separation_chips * chip_m or doppler_hz > settings.min_separation_hz:
            return True
        known &= bool(np.isfinite(delay_m))
    return False if known else None


def _median_difference(values: Reals, one: int, other: int, min_epochs: int) -> float:
    """Within one receiver both have the same clock, so it does not matter."""
    difference = values[:, one] - values[:, other]
    known = difference[np.isfinite(difference)]
    return float(np.abs(np.median(known))) if known.size >= min_epochs else np.nan


class SecondSignals:
    """The detector: one Evidence per receiver and window."""

    name = "second_signals"
    needs = (Need.OBSERVATIONS,)

    def __init__(self, settings: SecondSignalsSettings | None = None) -> None:
        self.settings = settings or SecondSignalsSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Evidence], Any]:
        """Evidence of one window; never raises for what the data lack."""
        lacking = missing(self, records)
        return lacking or [e for o in records.observations for e in self._receiver(records, o)], state

    def _receiver(self, records: Records, observations: Observations) -> list[Evidence]:
        found = find_second_signals(observations, self.settings)
        late = [self._late(records, observations, found)] if found.repeated else []
        return [self._count(records, observations, found), *late]

    def _late(self, records: Records, observations: Observations, found: FoundSecondSignals) -> Evidence:
        return Evidence(
            detector=self.name,
            start_gpst=records.start_gpst,
            end_gpst=records.end_gpst,
            says="multipath",
            subject=tuple(SignalRef(observations.receiver, signal) for signal in found.repeated),
            because=f"{len(found.repeated)} satellites in {observations.receiver} have a second signal, weaker and "
            "later by the same delay: a repeater or a reflector, which shows no other place",
            false_alarm_probability=self.settings.false_alarm_probability,
        )

    def _count(self, records: Records, observations: Observations, found: FoundSecondSignals) -> Evidence:
        if not np.isfinite(observations.cn0_dbhz).any():
            return undecided(
                self,
                records,
                signals_of((observations,)),
                would_need="C/N0 of the signals: of an observation file the types that begin with S",
                because=f"{observations.receiver} gives no C/N0, without which no signal is known to be credible",
            )
        n, k = len(found.sats), len(found.doubled)
        count, attained = binomial_threshold(
            self.settings.false_alarm_probability, n, self.settings.long_echo_probability
        )
        if count > n:
            return undecided(
                self,
                records,
                signals_of((observations,)),
                would_need="more satellites in view",
                because=f"{n} satellites with a signal of {self.settings.min_cn0_dbhz:g} dB-Hz or more are too few",
            )
        if k < count <= k + len(found.unknown):
            return undecided(
                self,
                records,
                _signals(observations, found.sats),
                because=f"of {len(found.unknown)} satellites with two signals the delay between them is not known yet",
                would_need="6 s more of signal to decode the time of week, or a navigation file",
            )
        attack = k >= count
        return Evidence(
            detector=self.name,
            start_gpst=records.start_gpst,
            end_gpst=records.end_gpst,
            subject=_signals(observations, found.doubled if attack else found.sats),
            says="attack" if attack else "clean",
            because=f"{k} of {n} satellites in {observations.receiver} have a second credible signal; far echoes make "
            f"{count} or more of them once in {float(f'{1.0 / attained:.2g}'):.0f} windows",
            statistic=float(k),
            threshold=float(count),
            false_alarm_probability=attained,
            p_value=float(binomial_survival(k, n, self.settings.long_echo_probability)),
        )


def _signals(observations: Observations, sats: tuple[str, ...]) -> tuple[SignalRef, ...]:
    return tuple(SignalRef(observations.receiver, signal) for signal in observations.signals if signal.sat in sats)
