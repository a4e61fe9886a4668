"""Decide on one set of signals in each receiver: from one antenna, from the sky, or of two skies that they share."""

import itertools

from skyproof.detectors.base import leave_open
from skyproof.detectors.multi_receiver.known_geometry import AntennaGeometry, LearntDistance
from skyproof.detectors.multi_receiver.pairing import Pairing, pair_up
from skyproof.detectors.multi_receiver.window import Window, collect_estimates, describe_distances, describe_pairing
from skyproof.records import Cause, Datum, Finding, Hypothesis

__all__ = ["decide_one_set"]


def decide_one_set(window: Window, pairing: Pairing) -> list[Finding]:
    """Decide on the one set that each receiver has."""
    alpha, geometry = window.settings.false_alarm_probability, window.geometry(pairing)
    if (p_each := window.p_each(pairing)) < alpha:
        if geometry is None:
            return [_leave_sky_open(window, pairing, p_each)]
        return _test_against(window, pairing, geometry, p_each)
    p_one, p_known = window.p_one(pairing), window.p_not_sky(pairing, geometry)
    p_false = min(1.0, p_known + window.p_of_echoes(pairing.receivers, pairing))
    if p_one >= window.settings.accept_probability and p_false < alpha:
        data = {**describe_pairing(pairing), **window.describe_known(geometry), "group": next(window.groups)}
        return [
            window.report.find(
                pairing.subject,
                "one_antenna_if_apart" if geometry is None else "one_antenna",
                {Cause.CLEAN: p_known, Cause.REFLECTIONS: p_false},
                singled_out=True,
                data=data if geometry is None else {**data, "assumes": geometry.stated},
                estimates=collect_estimates((), window.build_statement(pairing, geometry, agrees=False)),
            )
        ]
    if geometry is None and (p_place := window.p_of_one_place(pairing)) < alpha:
        cause, data = leave_open((Cause.STATEMENT,)), describe_pairing(pairing)
        return [window.find_open(pairing.subject, "one_place", p_place, cause, data=data)]
    return [_leave_sender_open(window, pairing, geometry, p_each=p_each, p_known=p_known, p_false=p_false)]


def _leave_sender_open(
    window: Window, pairing: Pairing, geometry: AntennaGeometry | None, *, p_each: float, p_known: float, p_false: float
) -> Finding:
    """Report that signals come from the sky or from one antenna.

    p_known : of "the sky over antennas that stand as known". p_false : of that, or of echoes.
    """
    alpha, accept = window.settings.false_alarm_probability, window.settings.accept_probability
    code, causes = "one_antenna_or_sky", leave_open((Cause.REFLECTIONS, Cause.STATEMENT))
    if window.p_one(pairing) >= accept and p_known < alpha:
        code, causes = "one_antenna_or_few_echoes", {Cause.REFLECTIONS: p_false, **leave_open((Cause.STATEMENT,))}
    failed = p_known < alpha
    p = {Cause.CLEAN: p_known, **causes} if failed else {Cause.FALSE_SKY: p_each, Cause.CLEAN: p_known}
    known: dict[str, Datum] = {
        "antennas_known": geometry is not None,
        "scatter_m": float(pairing.scatter_m),
        "carriers": window.judge_carriers(pairing),
        "p_one_antenna": p_each,
    }
    return window.report.find(
        pairing.subject,
        code,
        p,
        hypothesis=None if failed else Hypothesis.ONE_ANTENNA,
        data={**describe_pairing(pairing), **known},
        estimates=collect_estimates((), window.weigh_open_statement(pairing, geometry, p_known)),
    )


def _test_against(window: Window, pairing: Pairing, geometry: AntennaGeometry, p_one: float) -> list[Finding]:
    """Test signals, not from one antenna, against the sky: do the antennas stand where they are known to?"""
    alpha = window.settings.false_alarm_probability
    if window.agrees(pairing, geometry):
        return [_report_agreeing(window, pairing, geometry, p_one)]
    p_known = pairing.survival(geometry)
    steady = pairing.noise_m <= pairing.noise.bound_m
    learnt = isinstance(geometry, LearntDistance)  # antennas may have moved apart since
    found = _find_agreeing_pairs(window, pairing) if len(pairing.sets) > 2 else []
    confirmed = {ref for finding in found for ref in finding.signals}
    rest = tuple(ref for ref in pairing.subject if ref not in confirmed)
    if not rest:
        return found
    p_attack = min(1.0, p_known + window.p_of_echoes({ref.receiver for ref in rest}, pairing))
    data: dict[str, Datum] = {
        **describe_pairing(pairing),
        **describe_distances(pairing),
        **geometry.data,
        "noise_m": float(pairing.noise_m),
        "multipath_sigma_m": window.settings.multipath_sigma_m,
    }
    statement = window.build_statement(pairing, geometry, agrees=False) if steady else None
    if p_attack < alpha and steady and not learnt:
        attack = window.report.find(
            rest,
            "elsewhere_than_known",
            {Cause.CLEAN: p_known, Cause.REFLECTIONS: p_attack},
            data={**data, "assumes": geometry.stated},
            estimates=collect_estimates((), statement),
        )
        return [*found, attack]
    code, causes = "maybe_elsewhere", leave_open((Cause.REFLECTIONS, Cause.STATEMENT, Cause.MOTION))
    if not steady:
        code = "swings"
    elif p_known < alpha <= p_attack and not learnt:
        code, causes = "elsewhere_by_few", {**causes, Cause.REFLECTIONS: p_attack}
    p_sky = window.p_sky(pairing, geometry)
    return [*found, window.find_open(rest, code, p_sky, causes, data=data, statement=statement)]


def _find_agreeing_pairs(window: Window, pairing: Pairing) -> list[Finding]:
    """Find, of three receivers or more, pairs that agree with the known places among themselves.

    One transmitter cannot bring two receivers to agree, and one that holds one of them alone shows its true place.
    """
    pairs = list(itertools.combinations(pairing.sets, 2))
    settings, found = window.settings, []
    kind = next(iter(pairing.kinds)) if len(pairing.kinds) == 1 else None
    tests = len(pairs) * window.tests
    for sets in pairs:
        noise = settings.noise(tests)
        pair = pair_up(window.records, sets, noise, min_satellites=settings.min_satellites, kind=kind)
        geometry = settings.geometry(pair.receivers)
        if not window.enough(pair):
            continue
        p_one = min(1.0, tests * pair.one_antenna_each_p_value)
        if geometry is not None and p_one < settings.false_alarm_probability and window.agrees(pair, geometry):
            found.append(_report_agreeing(window, pair, geometry, p_one))
    return found


def _report_agreeing(window: Window, pairing: Pairing, geometry: AntennaGeometry, p_one: float) -> Finding:
    statement = window.build_statement(pairing, geometry, agrees=True)
    return window.find_authentic(pairing, "as_known", p_one, geometry.assumes, data=geometry.data, statement=statement)


def _leave_sky_open(window: Window, pairing: Pairing, p_one: float) -> Finding:
    """Report signals that are not from one antenna, if the true baseline is unknown."""
    settings, causes = window.settings, leave_open((Cause.STATEMENT, Cause.REFLECTIONS))
    data: dict[str, Datum] = {**describe_pairing(pairing), "p_one_antenna": p_one}
    apart: dict[str, Datum] = {"farthest_m": float(max(pairing.distances_m or (0.0,)))}
    if (p_possible := window.p_possible(pairing)) < settings.false_alarm_probability:
        data |= {**apart, "limit_m": settings.max_separation_m}
        return window.find_open(pairing.subject, "too_far", p_possible, causes, data=data)
    if (p_near := window.p_not_sky(pairing, None)) < settings.false_alarm_probability:
        data |= {**apart, "limit_m": settings.antenna_separation_m}
        statement = window.build_statement(pairing, None, agrees=False)
        return window.find_open(pairing.subject, "too_near", p_near, causes, data=data, statement=statement)
    borne_out = window.build_statement(pairing, None, agrees=True) if window.is_apart(pairing) else None
    return window.report.find(
        pairing.subject,
        "one_may_be_false",
        leave_open((Cause.FALSE_SKY,)),
        hypothesis=Hypothesis.FALSE_SKY,
        data=data,
        estimates=collect_estimates(window.select_believed(pairing), borne_out),
    )
