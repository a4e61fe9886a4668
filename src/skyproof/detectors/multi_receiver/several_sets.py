"""Several sets of signals in some receiver: which pairing comes from one antenna, and which is of the sky."""

from collections.abc import Sequence

from skyproof.detectors.base import NotTested
from skyproof.detectors.multi_receiver.known_geometry import AntennaPlaces, agreement
from skyproof.detectors.multi_receiver.pairing import Pairing, versus
from skyproof.detectors.multi_receiver.window import Window, collect_estimates, describe_pairing
from skyproof.detectors.second_signals.second_sky import second_sky_p_value
from skyproof.records import Cause, Datum, Finding, Kind

__all__ = ["BESIDE_FALSE_SKY", "several_sets"]

BESIDE_FALSE_SKY = "beside_false_sky"
"""Code of signals that are true, as others of their receivers come from one antenna."""


def several_sets(window: Window) -> list[Finding]:
    """Return what is found of sets of which some receiver has several."""
    alpha = window.settings.false_alarm_probability
    could_be = [p for p in window.pairings if window.p_one(p) >= max(window.settings.accept_probability, alpha)]
    could_be = [p for p in could_be if _shows_one_place(window, p)]
    could_be.sort(key=lambda p: float(p.one_antenna.statistic))
    false = [p for p in could_be if not _contested(window, p, could_be)]
    skies = _left_over(window, false)
    found = [_test_false_group(window, pairing, false, decided=bool(skies)) for pairing in false]
    shown = all(finding is not None for finding in found)
    found += [_test_sky_group(window, sky, false, shown=shown) for sky in skies]
    return [finding for finding in found if finding is not None] or [_leave_open(window)]


def _contested(window: Window, pairing: Pairing, could_be: Sequence[Pairing]) -> bool:
    """Whether some of its signals may as well be another transmitter's, or the sky's.

    A false sky that shows the true place of a receiver has no range difference to what that receiver gets from the sky
    either. So of pairings that share signals one is of one antenna only if the others are much worse; and not even then
    if all that agrees with where the antennas are known to stand shares signals with it.
    """
    alpha = window.settings.false_alarm_probability
    rivals = (other for other in could_be if other is not pairing and other.takes & pairing.takes)
    if any(versus(other, pairing).p_value >= alpha for other in rivals):
        return True
    skies = _agreeing(window, [p for p in window.pairings if p.kinds & pairing.kinds])
    return bool(skies) and all(sky.takes & pairing.takes for sky in skies)


def _agreeing(window: Window, pairings: Sequence[Pairing]) -> list[Pairing]:
    """Those that are not of one antenna, and show the antennas where they are known to stand."""
    found = []
    for p in pairings:
        geometry = window.settings.geometry(p.receivers)
        apart = geometry is not None and window.p_each(p) < window.settings.false_alarm_probability
        if geometry is not None and apart and window.agrees(p, geometry):
            found.append(p)
    return found


def _shows_one_place(window: Window, pairing: Pairing) -> bool:
    """Whether its baselines are zero, by the noise as it looks: one antenna puts the receivers in one place.

    False signals from several antennas, or with few satellites in common, may leave the true sky over near
    antennas as the pairing of the least contrast: all that shows it then is that its baseline is there.
    """
    if not pairing.baselines:
        return True
    nowhere = AntennaPlaces(dict.fromkeys(pairing.receivers, (0.0, 0.0, 0.0)), sigma_m=0.0)
    return agreement(nowhere, pairing.baselines[:1]) >= window.settings.accept_probability


def _test_false_group(window: Window, pairing: Pairing, false: list[Pairing], *, decided: bool) -> Finding | None:
    """Return that a pairing is of one antenna, if it is. decided : the sets left over make one sky, so the other false
    groups are no rivals."""
    alpha = window.settings.false_alarm_probability
    rivals = [p for p in window.pairings if p is not pairing and not (decided and p in false)]
    tests = [versus(rival, pairing) for rival in rivals]
    worst = max(tests, key=lambda test: float(test.p_value), default=None)
    # With two skies in every receiver one of the pairings is false altogether; with fewer it may have been missed.
    complete = all(len(sets) >= 2 for sets in window.sets.values())
    if complete and worst is not None and worst.p_value < alpha:
        contrast: dict[str, Datum] = {
            "scatter_m": float(pairing.scatter_m),
            "others_m": float(min(p.scatter_m for p in rivals)),
            "statistic": float(worst.statistic),
            "threshold": float(worst.threshold(alpha)),
            "log_likelihood_ratio": float(worst.log_likelihood_ratio),
            "group": next(window.groups),
        }
        return window.report.find(
            pairing.subject,
            "least_contrast",
            {Cause.CLEAN: float(worst.p_value)},
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
        estimates=collect_estimates((), window.statement(pairing, geometry, agrees=False)),
    )


def _test_sky_group(window: Window, sky: Pairing, false: list[Pairing], *, shown: bool) -> Finding | None:
    """Return that a pairing is of the sky, if it is. shown : the others are shown to be false."""
    alpha, p_one = window.settings.false_alarm_probability, window.p_each(sky)
    if p_one >= alpha:
        return None
    geometry = window.settings.geometry(sky.receivers)
    if geometry is not None:
        # As with one set in each receiver: it is told from the false ones by where the antennas stand.
        if not window.agrees(sky, geometry):
            return None
        statement = window.statement(sky, geometry, agrees=True)
        return window.find_authentic(sky, "as_known", p_one, geometry.assumes, data=geometry.data, statement=statement)
    if not shown:  # beside what may be the sky's, or echoes, nothing is true for being no such
        return None
    p_ratio = max((float(versus(sky, pairing).p_value) for pairing in false), default=0.0)
    if p_ratio >= alpha or window.p_possible(sky) < alpha:
        return None
    p_value, baselines = max(p_one, p_ratio), window.believed(sky)
    return window.find_authentic(sky, BESIDE_FALSE_SKY, p_value, ("one_false_sky",), baselines=baselines)


def _left_over(window: Window, false: list[Pairing]) -> list[Pairing]:
    """The groups, one per kind, of sets that no false group takes, if it can only be those and none is of one
    antenna.

    Which of several it is, and whether anything but the false is left over when some receiver shows one set only,
    a known baseline decides: of the pairings that agree with it there must be just one of each kind.
    """
    taken = set[tuple[int, Kind]]().union(*(p.takes for p in false))
    free = [p for p in window.pairings if not taken & p.takes]
    free = [p for p in free if window.p_each(p) < window.settings.false_alarm_probability]
    if free and all(window.settings.geometry(p.receivers) is not None for p in free):
        free = _agreeing(window, free)
        return [p for p in free if not any(p is not q and p.kinds & q.kinds for q in free)]
    whole = {id(s) for pairing in false for s in pairing.sets}
    single = all(sum(id(s) not in whole for s in sets) == 1 for sets in window.sets.values())
    free = [p for p in free if not whole & {id(s) for s in p.sets}]
    return free if false and single else []


def _leave_open(window: Window) -> Finding:
    """Return that several skies are there of which the pairings do not tell which is false, or chance makes them."""
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
