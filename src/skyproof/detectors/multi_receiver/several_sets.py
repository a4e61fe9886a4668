"""Decide on several sets of signals in a receiver: which pairing comes from one antenna, and which from the sky."""

from collections.abc import Sequence

import numpy as np

from skyproof.detectors.base import NotTested
from skyproof.detectors.multi_receiver.known_geometry import AntennaPlaces, consistency_p_value
from skyproof.detectors.multi_receiver.pairing import Pairing
from skyproof.detectors.multi_receiver.window import Window, collect_estimates, describe_pairing
from skyproof.detectors.second_signals.second_sky import second_sky_p_value
from skyproof.records import Cause, Datum, Finding, Kind

__all__ = ["BESIDE_FALSE_SKY", "decide_several_sets"]

BESIDE_FALSE_SKY = "beside_false_sky"
"""Code of signals that are true, as others of their receivers come from one antenna."""


def decide_several_sets(window: Window) -> list[Finding]:
    """Decide on the pairings of a window in which some receiver has several sets."""
    alpha = window.settings.false_alarm_probability
    could_be = [p for p in window.pairings if window.p_one(p) >= max(window.settings.accept_probability, alpha)]
    could_be = [p for p in could_be if _shows_one_place(window, p)]
    could_be = [p for p in could_be if (p_value := _p_by_others(window, p, could_be)) is None or p_value >= alpha]
    could_be.sort(key=lambda p: float(p.one_antenna.statistic))
    false = [p for p in could_be if not _is_contested(window, p, could_be)]
    skies = _select_remaining(window, false)
    found = [_test_false_group(window, pairing, false, decided=bool(skies)) for pairing in false]
    all_shown = all(finding is not None for finding in found)
    found += [_test_sky_group(window, sky, false, shown=all_shown) for sky in skies]
    return [finding for finding in found if finding is not None] or [_leave_open(window)]


def _is_contested(window: Window, pairing: Pairing, could_be: Sequence[Pairing]) -> bool:
    """Tell if some of its signals may as well come from another transmitter, or from the sky.

    A false sky that shows the true place of a receiver has no range difference to what that receiver gets from the sky
    either. So of pairings that share signals one comes from one antenna only if the others are much worse. Not even
    then if every pairing that agrees with the known antenna geometry shares signals with it.
    """
    alpha = window.settings.false_alarm_probability
    alternatives = (other for other in could_be if other is not pairing and other.takes & pairing.takes)
    if any(window.compare(other, pairing).p_value >= alpha for other in alternatives):
        return True
    skies = _select_agreeing(window, [p for p in window.pairings if p.kinds & pairing.kinds], could_be)
    return bool(skies) and all(sky.takes & pairing.takes for sky in skies)


def _select_agreeing(window: Window, pairings: Sequence[Pairing], beside: Sequence[Pairing]) -> list[Pairing]:
    """Select the pairings that are not from one antenna, and show the antennas where they are known to stand.

    beside : pairings that may be false, for `_p_each`.
    """
    found = []
    for p in pairings:
        geometry = window.settings.geometry(p.receivers)
        apart = geometry is not None and _p_each(window, p, beside) < window.settings.false_alarm_probability
        if geometry is not None and apart and window.agrees(p, geometry):
            found.append(p)
    return found


def _shows_one_place(window: Window, pairing: Pairing) -> bool:
    """Tell if its baselines are zero, by the noise as it looks: one antenna puts the receivers in one place.

    False signals from several antennas, or with few satellites in common, may leave the true sky over near
    antennas as the pairing of the least contrast. Then only its baseline shows that it is the sky.
    """
    if not pairing.baselines:
        return True
    nowhere = AntennaPlaces(dict.fromkeys(pairing.receivers, (0.0, 0.0, 0.0)), sigma_m=0.0)
    return consistency_p_value(nowhere, pairing.baselines[:1]) >= window.settings.accept_probability


def _p_by_others(window: Window, pairing: Pairing, could_be: Sequence[Pairing]) -> float | None:
    """Return the p-value of "it comes from one antenna" beside pairings of its kind's other signals that could.

    None without any.
    """
    others = [p for p in could_be if p is not pairing and p.kinds == pairing.kinds and not p.takes & pairing.takes]
    p_values = [window.compare(pairing, other).p_value for other in others]
    return min(1.0, len(others) * min(p_values)) if others else None


def _p_each(window: Window, sky: Pairing, false: Sequence[Pairing]) -> float:
    """Return the p-value of "one antenna" of any kind of signals: by the noise over time, or beside false signals."""
    p_beside, p_each = _p_by_others(window, sky, false), window.p_each(sky)
    if p_beside is None:
        return p_each
    kinds = len({p.kinds for p in window.pairings})  # of each, one pairing at most comes from one antenna
    return min(1.0, 2.0 * min(p_each, kinds * p_beside))


def _test_false_group(window: Window, pairing: Pairing, false: list[Pairing], *, decided: bool) -> Finding | None:
    """Name a pairing that comes from one antenna; None if it does not.

    decided : the other sets make one sky, so the other false groups are no alternatives."""
    alpha = window.settings.false_alarm_probability
    alternatives = [p for p in window.pairings if p is not pairing and not (decided and p in false)]
    tests = [window.compare(alternative, pairing) for alternative in alternatives]
    worst = max(tests, key=lambda test: test.p_value, default=None)
    # With two skies in every receiver one of the pairings is false altogether; with fewer it may have been missed.
    complete = all(len(sets) >= 2 for sets in window.sets.values())
    if complete and worst is not None and worst.p_value < alpha:
        contrast: dict[str, Datum] = {
            "scatter_m": float(pairing.scatter_m),
            "others_m": float(min(p.scatter_m for p in alternatives)),
            **_compare_p(worst.p_value, alpha),
            "log_likelihood_ratio": worst.log_likelihood_ratio,
            "group": next(window.groups),
        }
        return window.report.find(
            pairing.subject,
            "least_contrast",
            {Cause.CLEAN: worst.p_value},
            singled_out=True,
            data={**describe_pairing(pairing), **contrast},
        )
    geometry = window.settings.geometry(pairing.receivers)
    p_false = min(1.0, window.tests * window.p_not_sky(pairing, geometry))
    if p_false >= alpha:
        return None
    return window.report.find(
        pairing.subject,
        "one_antenna_if_apart" if geometry is None else "one_antenna_of_several",
        {Cause.CLEAN: p_false},
        singled_out=True,
        data={**describe_pairing(pairing), **window.describe_known(geometry), "group": next(window.groups)},
        estimates=collect_estimates((), window.build_statement(pairing, geometry, agrees=False)),
    )


def _test_sky_group(window: Window, sky: Pairing, false: list[Pairing], *, shown: bool) -> Finding | None:
    """Report a pairing as authentic if it comes from the sky. shown : the others are shown to be false."""
    alpha, p_one = window.settings.false_alarm_probability, _p_each(window, sky, false)
    if p_one >= alpha:
        return None
    geometry = window.settings.geometry(sky.receivers)
    data: dict[str, Datum] = {}
    if window.p_each(sky) >= alpha:
        data = {"by": "skies", **_compare_p(p_one, alpha)}
    if geometry is not None:
        # As with one set in each receiver: it is told from the false ones by where the antennas stand.
        if not window.agrees(sky, geometry):
            return None
        statement = window.build_statement(sky, geometry, agrees=True)
        data = {**geometry.data, **data}
        return window.find_authentic(sky, "as_known", p_one, geometry.assumes, data=data, statement=statement)
    if not shown:  # beside what may be the sky's, or echoes, nothing is true for being no such
        return None
    p_ratio = max((window.compare(sky, pairing).p_value for pairing in false), default=0.0)
    if p_ratio >= alpha or window.p_possible(sky) < alpha:
        return None
    p_value, baselines = max(p_one, p_ratio), window.select_believed(sky)
    assumes = ("one_false_sky",)
    return window.find_authentic(sky, BESIDE_FALSE_SKY, p_value, assumes, data=data, baselines=baselines)


def _compare_p(p_value: float, alpha: float) -> dict[str, Datum]:
    """Return a p-value and the largest that rejects as a statistic and its threshold: their negative logarithms."""
    return {"statistic": -float(np.log10(max(p_value, np.finfo(float).tiny))), "threshold": -float(np.log10(alpha))}


def _select_remaining(window: Window, false: list[Pairing]) -> list[Pairing]:
    """Return the groups, one per kind, of sets that no false group takes.

    Empty unless only those can be the sky, and none comes from one antenna.

    Several groups may remain, or some receiver shows one set only. Then a known baseline decides: of the pairings that
    agree with it there must be just one of each kind.
    """
    taken = set[tuple[int, Kind]]().union(*(p.takes for p in false))
    free = [p for p in window.pairings if not taken & p.takes]
    free = [p for p in free if _p_each(window, p, false) < window.settings.false_alarm_probability]
    if free and all(window.settings.geometry(p.receivers) is not None for p in free):
        free = _select_agreeing(window, free, false)
        return [p for p in free if not any(p is not q and p.kinds & q.kinds for q in free)]
    whole = {id(s) for pairing in false for s in pairing.sets}
    single = all(sum(id(s) not in whole for s in sets) == 1 for sets in window.sets.values())
    free = [p for p in free if not whole & {id(s) for s in p.sets}]
    return free if false and single else []


def _leave_open(window: Window) -> Finding:
    """Return that several skies are received, and the pairings do not show which is false, or chance makes them."""
    p_values = [
        second_sky_p_value(
            next(o for o in window.records.observations if o.receiver == receiver),
            tuple(sets),
            unrelated_spread_m=window.settings.unrelated_spread_m,
            multipath_sigma_m=max(window.settings.multipath_sigma_m, 1.0),
        )
        for receiver, sets in window.sets.items()
    ]
    p_value = min(1.0, len(p_values) * min(p_values))
    data: dict[str, Datum] = {
        "receivers": tuple(window.sets),
        "sets": tuple(float(len(sets)) for sets in window.sets.values()),
    }
    if p_value >= window.settings.false_alarm_probability:
        return window.report.pass_over(window.signals(), NotTested("sets_by_chance", data))
    p = {Cause.CLEAN: p_value, Cause.REFLECTIONS: p_value}
    return window.report.find(window.signals(), "several_skies", p, data=data)
