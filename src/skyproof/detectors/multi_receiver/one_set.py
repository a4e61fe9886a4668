"""One set of signals in each receiver: from one antenna, from the sky, or of two skies that the receivers share."""

import itertools
from dataclasses import replace

from skyproof.detectors.multi_receiver.known_geometry import AntennaGeometry, LearntDistance
from skyproof.detectors.multi_receiver.pairing import Pairing, pair_up
from skyproof.detectors.multi_receiver.window import Window, far, names
from skyproof.records import Evidence

__all__ = ["one_set_each"]

FEW_ECHOES = "echoes of so few satellites, received in place of blocked signals, may fit a wrong place"
MORE_SATS = "more satellites in view"
BETTER = "a longer recording, to know better where the antennas stand, or to allow for longer reflections than"
MEASURED_AGAIN = "what was given of the antennas, measured again"


def one_set_each(window: Window, pairing: Pairing) -> list[Evidence]:
    """What is said of the one set that each receiver has."""
    alpha, p_one = window.settings.false_alarm_probability, window.p_one(pairing)
    geometry = window.geometry(pairing)
    if (p_each := window.p_each(pairing)) < alpha:
        if geometry is None:
            return [_open(window, pairing, p_each)]
        return _by_geometry(window, pairing, geometry, p_each)
    p_known, because = window.p_not_sky(pairing, geometry)
    p_false = min(1.0, p_known + window.p_of_echoes(pairing.receivers, pairing))
    if p_one >= window.settings.accept_probability and p_false < alpha:
        said = window.say(
            "spoofed",
            pairing.subject,
            p_value=p_false,
            because=because,
            group=next(window.groups),
            statement=window.statement(pairing, geometry, agrees=False),
        )
        return [said if geometry is None else replace(said, assumes=geometry.stated, would_need=MEASURED_AGAIN)]
    because = (
        f"{names(pairing)} could come from one antenna or from the sky: range differences between the receivers vary "
        f"by {pairing.scatter_m:.1f} m between satellites, which errors may explain"
    )
    would_need = f"a longer window, or antennas farther apart{window.of_carriers(pairing)}"
    would_need += "" if geometry is not None else f", or to know {window.where()}"
    if p_one >= window.settings.accept_probability and p_known < alpha:
        because, would_need = f"{names(pairing)} could come from one antenna, or from the sky: {FEW_ECHOES}", MORE_SATS
    tested = geometry is not None or window.settings.antenna_separation_m > 0.0  # the sky, over antennas that stand so
    return [
        window.say(
            "undecided",
            pairing.subject,
            p_value=p_known if tested else p_one,
            null="sky" if tested else "one antenna",
            because=because,
            would_need=would_need,
            may_also_be=("reflections", "statement"),
            statement=window.open_statement(pairing, geometry, p_known),
        )
    ]


def _by_geometry(window: Window, pairing: Pairing, geometry: AntennaGeometry, p_one: float) -> list[Evidence]:
    """Not of one antenna: of the sky if the antennas stand where they are known to."""
    alpha = window.settings.false_alarm_probability
    if window.agrees(pairing, geometry):
        return [_agreeing(window, pairing, geometry, p_one)]
    p_known = pairing.survival(geometry)
    steady = pairing.noise_m <= window.settings.error_bound_m
    learnt = isinstance(geometry, LearntDistance)  # antennas may have moved apart since
    found = _agreeing_pairs(window, pairing) if len(pairing.sets) > 2 else []
    vouched = {ref for e in found for ref in e.subject}
    rest = tuple(ref for ref in pairing.subject if ref not in vouched)
    p_echoes = window.p_of_echoes({ref.receiver for ref in rest}, pairing)
    p_attack = min(1.0, p_known + p_echoes)
    of_rest = f"{names(pairing)} disagree with {geometry.words}" + (f": {far(pairing)}" if far(pairing) else "")
    if p_attack < alpha and rest and steady and not learnt:
        found.append(
            window.say(
                "attack",
                rest,
                p_value=p_attack,
                because=f"{of_rest}; some of them are imitations, or what was given is wrong",
                would_need=MEASURED_AGAIN,
                assumes=geometry.stated,
                statement=window.statement(pairing, geometry, agrees=False),
            )
        )
    elif rest:
        because, would_need = of_rest, f"{BETTER} the {window.settings.multipath_sigma_m:g} m of multipath_sigma_m"
        if not steady:
            because = f"the range differences of {names(pairing)} swing by {pairing.noise_m:.0f} m within the window"
        elif p_known < alpha <= p_attack and not learnt:
            because, would_need = f"{because}; {FEW_ECHOES}", MORE_SATS
        found.append(
            window.say(
                "undecided",
                rest,
                p_value=window.p_sky(pairing, geometry),
                because=because,
                would_need=would_need,
                may_also_be=("reflections", "statement", "motion"),
                statement=window.statement(pairing, geometry, agrees=False) if steady else None,
            )
        )
    return found


def _agreeing_pairs(window: Window, pairing: Pairing) -> list[Evidence]:
    """Of three receivers or more: pairs that agree with the known places among themselves.

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
            found.append(_agreeing(window, pair, geometry, p_one))
    return found


def _agreeing(window: Window, pairing: Pairing, geometry: AntennaGeometry, p_one: float) -> Evidence:
    return window.authentic(
        pairing,
        p_one,
        geometry.assumes,
        because=f"; they agree with {geometry.words}",
        statement=window.statement(pairing, geometry, agrees=True),
    )


def _open(window: Window, pairing: Pairing, p_one: float) -> Evidence:
    """Not of one antenna, and nothing says whether the baseline is the true one."""
    p_possible = window.p_possible(pairing)
    if p_possible < window.settings.false_alarm_probability:
        return window.say(
            "undecided",
            pairing.subject,
            p_value=p_possible,
            may_also_be=("statement", "reflections"),
            because=window.toofar(pairing),
            would_need=f"{window.where()}; or, if they may be that far apart, a larger max_separation_m in the "
            "table [protect] of a platform file",
        )
    p_near = window.p_not_sky(pairing, None)[0]
    if p_near < window.settings.false_alarm_probability:
        return window.say(
            "undecided",
            pairing.subject,
            p_value=p_near,
            may_also_be=("statement", "reflections"),
            because=window.toonear(pairing),
            would_need=MEASURED_AGAIN,
            statement=window.statement(pairing, None, agrees=False),
        )
    return window.say(
        "undecided",
        pairing.subject,
        p_value=p_one,
        null="one antenna",
        baselines=window.believed(pairing),
        statement=window.statement(pairing, None, agrees=True) if window.is_apart(pairing) else None,
        because=f"{names(pairing)} do not come from one antenna, but one receiver alone may follow a false sky",
        would_need="the distance between the antennas (antenna_distance_m), or where they stand (antennas_enu_m)",
    )
