"""Judge every further signal of receivers whose true sky is known: false, or possibly an echo.

A satellite is received once from the sky. Each signal beside those shown to be true is tested against two explanations:

- an echo of the true signal, by how late, strong and fast it is (`second_signals.echoes`). The delay counts from the
  range that the true signals predict, so that an early signal shows as such;
- a false signal: one of a second consistent set, which unrelated echoes make by chance with a known probability
  (`second_signals.second_sky`), or one of several satellites' that echoes make so rarely that they are not.

Echoes are other ones in another receiver, where no reflector serves both: signals of receivers a kilometre apart are
also held against echoes together.

Two rates are kept. The first is that of an alarm under echoes only (`alarm`), over all satellites of a receiver. The
second is the share of echoes among the signals that a window with an alarm names one by one (`mistaken`). With n
satellites, k of them at p or below, that share is at most n p / k in the mean (Y. Benjamini, Y. Hochberg, JRSS B 57,
1995).

What is named in two receivers is parted by the antennas that it comes from: a false signal's range differs between two
receivers by the same, whichever satellite it imitates. The number of antennas is too large with a stated probability
(`statistics.clusters`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.detectors.multi_receiver.pairing import Pairing
from skyproof.detectors.multi_receiver.policy import POLICY
from skyproof.detectors.second_signals.detector import SecondSignals, SecondSignalsSettings, elevation_rad
from skyproof.detectors.second_signals.echoes import EchoModel, Second, echo_p_value, false_over_echo
from skyproof.detectors.second_signals.policy import POLICY as SECOND_SIGNALS
from skyproof.detectors.second_signals.second_sky import second_sky_p_value
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.navigation.search import WindowRanges, compute_innovation
from skyproof.navigation.sets import measure_window
from skyproof.navigation.skies import group_by_kind
from skyproof.records import ConsistentSet, Kind, Observations, Records, SignalId, SignalRef
from skyproof.statistics.clusters import divide_line
from skyproof.statistics.many_small import many_small
from skyproof.statistics.medians import medians

__all__ = ["Named", "Rates", "find_further_signals"]

ECHOES: Final = EchoModel(early_share=POLICY.early_echo_share)
"""A true signal fits the others of its receiver and, with the baseline, those of another one: an echo in its place does
so by chance in 3 % of cases each, where delays spread over 300 m."""

_Place = tuple[str, str]


@dataclass(frozen=True, kw_only=True)
class Rates:
    """alarm : of a false alarm in the window. mistaken : share of echoes among signals that are named one by one, and
    probability of more antennas than there are. multipath_sigma_m, unrelated_spread_m : as of `MultiReceiverSettings`.
    """

    alarm: float
    mistaken: float
    multipath_sigma_m: float
    unrelated_spread_m: float
    echoes: EchoModel = ECHOES


@dataclass(frozen=True)
class Named:
    """False signals. code : of what they are. p_value : of true signals and their echoes alone. together : whether they
    come from one antenna."""

    subject: tuple[SignalRef, ...]
    code: str
    p_value: float
    together: bool = False


@dataclass(frozen=True, eq=False)
class _Beside:
    """A signal beside a receiver's true ones: how late it is against their prediction, what it is beside its
    satellite's own, and that one; None where it has none."""

    ref: SignalRef
    late_m: float
    sigma_m: float
    second: Second
    direct: SignalId | None


@dataclass(frozen=True, eq=False)
class _Measured:
    """One receiver's signals over a window, those of them that have an orbit (rows, by kind), how strong all are."""

    observations: Observations
    signals: tuple[SignalId, ...]
    ranges: WindowRanges
    usable: Mapping[Kind, Indices]
    level_dbhz: Mapping[SignalId, float]


def find_further_signals(
    records: Records,
    skies: Sequence[Pairing],
    sets: Mapping[str, Sequence[ConsistentSet]],
    named: Mapping[SignalRef, float],
    rates: Rates,
) -> list[Named]:
    """Find false signals among those that are neither `named` nor in one of the true `skies`, a pairing each.

    sets : of each receiver, those that are no late copies of another one. named : false signals, with the p-value of
    what named them. Under an attack more signals are named than without: these have the p-value of the attack.
    """
    true = {(s.receiver, kind): s for sky in reversed(skies) for s in sky.sets for kind in sky.kinds}
    apart = [(sky, kind) for sky in skies for kind in _kinds_far_apart(sky)]
    tests = 3.0 if apart else 2.0  # a second sky, echoes, echoes together
    tests *= max(len(true), 1)
    each = replace(rates, alarm=rates.alarm / tests)
    observed = {o.receiver: o for o in records.observations}
    found: list[Named] = []
    for (receiver, _), chosen in true.items():
        known = set(named).union(*(tested_kind.subject for tested_kind in found))
        found += _find_second_skies(observed[receiver], chosen, sets.get(receiver, ()), known, each)
    known_p = {**named, **{ref: tested_kind.p_value for tested_kind in found for ref in tested_kind.subject}}
    known = set(known_p)
    measured = {name: _measure(records, observed[name], each) for name in {name for name, _ in true}}
    by_place, kinds = {}, dict[int, dict[Kind, list[SignalId]]]()
    for (receiver, kind), chosen in true.items():
        if id(chosen) not in kinds:
            rows = group_by_kind(chosen.signals, np.arange(len(chosen.signals)))
            kinds[id(chosen)] = {own_kind: [chosen.signals[k] for k in of] for own_kind, of in rows.items()}
        beside = _select_beside(records, measured[receiver], chosen, kind, kinds[id(chosen)], each)
        places = {(receiver, signal.sat) for signal in kinds[id(chosen)].get(kind, ())}
        by_place[receiver, kind] = [b for b in beside if b.ref not in known], places
    places_m = np.array([chosen.position_ecef_m for chosen in true.values()])
    apart_m = float(np.linalg.norm(places_m[:, None] - places_m, axis=-1).max(initial=0.0))
    matched = {sat for _, sat in _join_places(by_place)}
    wrong = _find_wrong_orbits([b for beside, _ in by_place.values() for b in beside], matched, apart_m, each.alarm)
    by_place = {
        of: ([b for b in beside if b.ref.signal.sat not in wrong], places) for of, (beside, places) in by_place.items()
    }
    together = [_merge([by_place[name, kind] for name in sky.receivers]) for sky, kind in apart]
    tested = [_Tested(beside, places, each) for beside, places in [*by_place.values(), *together]]
    p_attack = tests * min((tested_kind.p_value for tested_kind in tested), default=1.0)
    if p_attack >= rates.alarm:
        p_attack = _find_alarm(records, {name for name, _ in true}, known_p, rates)
    alone = {b.ref: b for tested_kind in tested for b in tested_kind.told if p_attack < rates.alarm}
    return [*found, *_group_by_antenna(alone, skies, p_attack, each)]


def _find_alarm(records: Records, receivers: set[str], named: Mapping[SignalRef, float], rates: Rates) -> float:
    """Return the p-value of the alarm that another test raises; 1 if none does.

    One that `second_signals` raises is not paid for a second time: it takes the same signals at the same rate.
    """
    rules = SecondSignalsSettings(false_alarm_probability=rates.alarm, multipath_sigma_m=rates.multipath_sigma_m)
    alone = SecondSignals(rules)
    raised = min(
        (alone.echoes_p_value(records, o) for o in records.observations if o.receiver in receivers), default=1.0
    )
    return raised if raised < rates.alarm else max(named.values(), default=1.0)


def _join_places(own: Mapping[tuple[str, Kind], tuple[list[_Beside], set[_Place]]]) -> set[_Place]:
    return set[_Place]().union(*(places for _, places in own.values()))


def _find_wrong_orbits(beside: Sequence[_Beside], true: set[str], apart_m: float, alarm: float) -> set[str]:
    """Find satellites without a true signal whose other signals are as late as a wrong orbit or clock makes them.

    A clock makes them equally late in every receiver. An orbit may move the satellite to elsewhere in the sky. Then the
    delays differ by the distance of the receivers along the change of direction, at most twice that distance. Such an
    orbit leaves a range nearly right by chance only: a displacement in any direction changes the range by no more than
    a share of it with that share as probability. Orbits are to blame unless all of them together are improbable.

    true : satellites that have a true signal. apart_m : distance of the receivers. alarm : probability from which on
    wrong orbits explain all of them.
    """
    late: dict[tuple[str, Kind], list[_Beside]] = {}
    for b in beside:
        if b.ref.signal.sat not in true:
            late.setdefault((b.ref.signal.sat, b.ref.signal.kind), []).append(b)
    chance: dict[str, float] = {}
    for (sat, _), some in late.items():
        least, most = min(some, key=lambda b: b.late_m), max(some, key=lambda b: b.late_m)
        apart = most.late_m - least.late_m - POLICY.same_delay_sigmas * float(np.hypot(least.sigma_m, most.sigma_m))
        turned = 0.0 if apart <= 0.0 else apart / apart_m if apart_m > 0.0 else np.inf
        moved_m = turned * POLICY.least_range_m
        largest_m = max(abs(least.late_m), abs(most.late_m))
        probability = 1.0 if moved_m <= largest_m else largest_m / moved_m if turned <= 2.0 else 0.0
        if len({b.ref.receiver for b in some}) < len(some) and apart > 0.0:  # signals of one receiver are late alike
            probability = 0.0
        chance[sat] = min(chance.get(sat, 1.0), probability)
    alike = {sat for sat, probability in chance.items() if probability == 1.0}
    turned_sats = {sat for sat, probability in chance.items() if 0.0 < probability < 1.0}
    together = float(np.prod([chance[sat] for sat in turned_sats]))
    return alike | (turned_sats if together >= alarm else set())


def _find_second_skies(
    o: Observations, chosen: ConsistentSet, sets: Sequence[ConsistentSet], named: set[SignalRef], rates: Rates
) -> list[Named]:
    """Find sets of a receiver beside its true one that chance does not make."""
    found = []
    for rival in sets:
        if rival is chosen:
            continue
        subject = tuple(ref for s in rival.signals if (ref := SignalRef(o.receiver, s)) not in named)
        shared = {s.transmission for s in rival.signals} & {s.transmission for s in chosen.signals}
        if not subject or not shared:
            continue
        p_value = second_sky_p_value(
            o,
            (chosen, rival) if len(rival.signals) <= len(chosen.signals) else (rival, chosen),
            unrelated_spread_m=rates.unrelated_spread_m,
            multipath_sigma_m=max(rates.multipath_sigma_m, 1.0),
        )
        if p_value < rates.alarm:
            found.append(Named(subject, "second_sky", p_value))
    return found


def _measure(records: Records, o: Observations, rates: Rates) -> _Measured | None:
    """Measure the signals of one receiver over the window; None without orbits."""
    if records.navigation is None:
        return None
    mean, measurements, usable = measure_window(
        o, records.navigation, multipath_sigma_m=rates.multipath_sigma_m, ionosphere_share=0.25
    )
    level_dbhz = dict(zip(o.signals, medians(o.cn0_dbhz).tolist(), strict=True))
    return _Measured(o, mean.signals, measurements, group_by_kind(mean.signals, np.flatnonzero(usable)), level_dbhz)


def _select_beside(
    records: Records,
    measured: _Measured | None,
    chosen: ConsistentSet,
    kind: Kind,
    kinds: Mapping[Kind, Sequence[SignalId]],
    rates: Rates,
) -> list[_Beside]:
    """Select credible signals of a kind outside the true set, and clearly apart from what it predicts.

    `kinds` are the signals of the true set.
    """
    if measured is None or records.navigation is None:
        return []
    o, level_dbhz, signals = measured.observations, measured.level_dbhz, measured.signals
    true_signals = {signal.transmission: signal for signal in kinds.get(kind, ())}
    inside = set(true_signals.values())
    rows: Indices = np.array([k for k in measured.usable.get(kind, ()) if signals[k] not in inside], np.intp)
    if not rows.size:
        return []
    state_m = np.append(chosen.position_ecef_m, SPEED_OF_LIGHT_M_S * chosen.clock_of_s(kind))
    late_m, variance_m2 = compute_innovation(
        measured.ranges, rows, np.tile(state_m, (rows.size, 1)), np.tile(chosen.covariance_m2, (rows.size, 1, 1))
    )
    best_dbhz = max((level_dbhz[s] for s in true_signals.values() if np.isfinite(level_dbhz[s])), default=np.nan)
    found = []
    for row, late, variance in zip(rows, late_m, variance_m2, strict=True):
        signal = signals[row]
        direct = true_signals.get(signal.transmission)
        beside_dbhz = best_dbhz - POLICY.blocked_db if direct is None else level_dbhz[direct]
        over_db = level_dbhz[signal] - beside_dbhz
        if not (
            abs(late) > rates.echoes.least_delay_chips * signal.plan.chip_m
            and over_db >= -rates.echoes.most_weaker_db
            and level_dbhz[signal] >= POLICY.credible_cn0_dbhz
            and _is_steady(o, signal)
        ):
            continue
        apart_hz = 0.0 if direct is None else _apart_hz(o, signal, direct)
        elevation = elevation_rad(records.navigation, (chosen,), signal.sat)
        below_db, chip_m = float(best_dbhz - beside_dbhz), signal.plan.chip_m
        second = Second(float(late), float(over_db), apart_hz, below_db, chip_m, elevation)
        found.append(_Beside(SignalRef(o.receiver, signal), float(late), float(np.sqrt(variance)), second, direct))
    return found


def _is_steady(o: Observations, signal: SignalId) -> bool:
    """Tell if code and carrier run smoothly through the window, as those of any transmitter do."""
    column = o.signals.index(signal)
    sigma_m = float(np.nanmedian(o.pseudorange_sigma_m[:, column])) if o.gpst.size else np.nan
    limit_m = POLICY.unsteady_m + POLICY.same_delay_sigmas * (sigma_m if np.isfinite(sigma_m) else 0.0)
    wave_m = SPEED_OF_LIGHT_M_S / o.carrier_hz[column]
    courses_m = (o.pseudorange_m[:, column], wave_m * o.carrier_cyc[:, column])
    return all(_scatter_m(o.elapsed_s, course_m) <= limit_m for course_m in courses_m)


def _scatter_m(elapsed_s: Reals, range_m: Reals) -> float:
    """Return the standard deviation about a smooth course; 0 if too few measurements define one."""
    rows = np.flatnonzero(np.isfinite(range_m))
    if rows.size <= POLICY.course_coefficients:
        return 0.0
    design = np.vander(elapsed_s[rows] - elapsed_s[rows].mean(), POLICY.course_coefficients)
    return float(np.std(range_m[rows] - design @ np.linalg.lstsq(design, range_m[rows], rcond=None)[0]))


def _kinds_far_apart(sky: Pairing) -> list[Kind]:
    """Return the kind of a true sky whose antennas all stand so far apart that they share no reflector."""
    if not sky.baselines or len(sky.kinds) != 1:
        return []
    places_m = np.vstack([np.zeros(3), sky.baselines[0].enu_m])
    apart_m = np.linalg.norm(places_m[:, None] - places_m, axis=-1)[np.triu_indices(len(places_m), 1)]
    return list(sky.kinds) if apart_m.min() >= POLICY.independent_echoes_m else []


def _merge(receivers: Sequence[tuple[list[_Beside], set[_Place]]]) -> tuple[list[_Beside], set[_Place]]:
    """Join several receivers' signals."""
    return [b for beside, _ in receivers for b in beside], set[_Place]().union(*(places for _, places in receivers))


class _Tested:
    """Signals of a kind tested against echoes. p_value : of all of them. told : those that stand out.

    places : the satellites that are received, in which receiver.
    """

    def __init__(self, beside: Sequence[_Beside], places: set[_Place], rates: Rates) -> None:
        model = rates.echoes
        by_satellite: dict[_Place, list[tuple[float, _Beside]]] = {}
        for b in beside:
            ratio = false_over_echo(model, b.second)
            p_value = echo_p_value(model, ratio, b.second)
            by_satellite.setdefault((b.ref.receiver, b.ref.signal.sat), []).append((p_value, b))
        least = sorted(min(p for p, _ in signals) for signals in by_satellite.values())
        n = len(places | set(by_satellite))
        self.p_value = many_small(
            [*least, *[1.0] * (n - len(least))],
            least=SECOND_SIGNALS.attack_satellites,
            most=SECOND_SIGNALS.telling_p_value,
        ).p_value
        limit = max((p for k, p in enumerate(least, 1) if n * p <= rates.mistaken * k), default=0.0)
        self.told = [b for signals in by_satellite.values() for p, b in signals if p <= limit]


def _group_by_antenna(
    alone: Mapping[SignalRef, _Beside], skies: Sequence[Pairing], p_value: float, rates: Rates
) -> list[Named]:
    """Group the named signals by the antenna that they come from.

    Signals of one receiver only, or without a true signal beside them, form one group.
    """
    remaining = dict(alone)
    found = []
    for sky in skies:
        first, other, *_ = sky.receivers
        pairs = _pair_signals(remaining, sky, first, other)
        if len(pairs) < SECOND_SIGNALS.attack_satellites or sky.unit_enu is None:
            continue
        row = {sat: k for k, sat in enumerate(sky.ranges.sats)}
        away_m = np.array(
            [
                b.late_m - a.late_m - float(sky.unit_enu[row[a.ref.signal.sat]] @ sky.baselines[0].enu_m[0])
                for a, b in pairs
            ]
        )
        sigma_m = np.array([np.hypot(a.sigma_m, b.sigma_m) for a, b in pairs])
        for cluster in _cluster(away_m, sigma_m, rates.mistaken):
            sats = {a.ref.signal.sat for a, _ in (pairs[k] for k in cluster)}
            elsewhere = [
                r
                for r in remaining
                if r.signal.sat in sats and r.signal.kind in sky.kinds and r.receiver not in (first, other)
            ]
            refs = tuple(sorted([*(b.ref for k in cluster for b in pairs[k]), *elsewhere]))
            together = len(cluster) >= SECOND_SIGNALS.attack_satellites
            code = "unlike_echoes_of_one_antenna" if together else "unlike_echoes"
            found.append(Named(refs, code, p_value, together))
            for ref in refs:
                del remaining[ref]
    for receiver in sorted({ref.receiver for ref in remaining}):
        refs = tuple(sorted(r for r in remaining if r.receiver == receiver))
        found.append(Named(refs, "unlike_echoes", p_value))
    return found


def _pair_signals(
    named: Mapping[SignalRef, _Beside], sky: Pairing, first: str, other: str
) -> list[tuple[_Beside, _Beside]]:
    """Match the named signals of each satellite that has one in each of two receivers."""
    by_sat: dict[tuple[str, str], list[_Beside]] = {}
    for ref, b in named.items():
        if ref.signal.sat in sky.ranges.sats and ref.signal.kind in sky.kinds:
            by_sat.setdefault((ref.receiver, ref.signal.sat), []).append(b)
    sats = sorted({sat for receiver, sat in by_sat if receiver == first})
    candidates = [(by_sat[first, sat], by_sat.get((other, sat), [])) for sat in sats]
    return [
        (in_first[0], in_other[0]) for in_first, in_other in candidates if len(in_first) == 1 and len(in_other) == 1
    ]


def _cluster(away_m: Reals, sigma_m: Reals, probability: float) -> list[Indices]:
    clusters = divide_line(away_m, sigma_m, probability)
    return [np.flatnonzero(clusters.label == number) for number in range(int(clusters.number))]


def _apart_hz(o: Observations, one: SignalId, other: SignalId) -> float:
    a, b = (o.doppler_hz[:, o.signals.index(signal)] for signal in (one, other))
    apart = float(medians(a - b))
    return apart if np.isfinite(apart) else 0.0
