"""What the report draws of signals on top of a receiver's own, taken from a run's outcome: correlation and what it was
taken apart into, skies beside what was expected, and what positions came from.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from skyproof.app.protect.outcome import Outcome, ReceiverOutcome
from skyproof.app.protect.positions import Track
from skyproof.arrays import Integers, Reals
from skyproof.detectors.dccaf.bursts import autocorrelate_code, build_shapes, estimate_amplitudes, interpolate_taps
from skyproof.detectors.dccaf.delays import DccafSettings, Delays, estimate_delays, last_burst
from skyproof.detectors.dccaf.detector import Dccaf
from skyproof.detectors.prediction.choice import Compared
from skyproof.explain.bases import name_bases
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.signals import prn_of
from skyproof.gnss.time import seconds_between
from skyproof.navigation.nav_estimate import NavEstimate
from skyproof.records import Ccaf, Finding
from skyproof.report.pictures import FixTrack, Kind
from skyproof.report.takeover import ComparedSkies, CorrelationParts, FixOrigins, OriginSpan, TimeOffset
from skyproof.verdict import USABLE, UsableKind

__all__ = ["compare_skies", "decompose_correlations", "list_origins"]

_SATELLITES: Final = 6
"""Whose correlation is drawn: more would show the same again."""
_STEP_CHIPS: Final = 0.02
_RECEIVERS: Final = 6
_PLACE, _CLOCK = slice(0, 3), 6
_NS_A_M: Final = 1e9 / SPEED_OF_LIGHT_M_S


# ---------------------------------------------------------------------- correlation


def decompose_correlations(outcome: Outcome, zero: np.datetime64) -> list[CorrelationParts]:
    """Decompose the correlations of the window in which `dccaf` found most; none of a clean sky."""
    found = _find_most_telling(outcome)
    if found is None:
        return []
    name = found.signals[0].receiver
    reception = next(r.reception for r in outcome.receivers if r.reception.source.name == name)
    o, grids = reception.observations, reception.ccaf
    if o is None or grids is None:
        return []
    ends = np.searchsorted(o.gpst, np.array([found.start_gpst, found.end_gpst]))
    begin_s, end_s = (float(o.elapsed_s[min(int(row), o.elapsed_s.size - 1)]) for row in ends)
    ccaf = grids.select_between(begin_s, end_s)
    epochs = last_burst(ccaf) if ccaf.gpst.size else np.empty(0, np.int64)
    return _decompose_epoch(ccaf, epochs, float(seconds_between(ccaf.gpst[epochs[-1]], zero))) if epochs.size else []


def _find_most_telling(outcome: Outcome) -> Finding | None:
    """Find the last finding of the least p-value that is not of a clean sky."""
    best: Finding | None = None
    for e in outcome.evidence:
        if e.detector != Dccaf.name or e.says == "clean" or e.p_value is None or e.lacking or not e.signals:
            continue
        if best is None or best.p_value is None or e.p_value <= best.p_value:
            best = e
    return best


def _decompose_epoch(ccaf: Ccaf, epochs: Integers, at_s: float) -> list[CorrelationParts]:
    settings = DccafSettings()
    found = estimate_delays(ccaf, epochs, settings)
    rows = np.flatnonzero(np.isfinite(found.delay_chips).all(axis=1))
    surest: dict[str, int] = {}  # of each satellite's signals: a second one is followed with the first in its grid
    for row in rows[np.argsort(found.p_value[rows], kind="stable")].tolist():
        surest.setdefault(ccaf.signals[row].sat, row)
    chosen = dict(list(surest.items())[:_SATELLITES])
    return [_build_parts(ccaf, int(epochs[-1]), chosen[sat], found, settings, at_s) for sat in sorted(chosen)]


def _build_parts(
    ccaf: Ccaf, epoch: int, row: int, found: Delays, settings: DccafSettings, at_s: float
) -> CorrelationParts:
    taps = np.asarray(ccaf.delays_chips, np.float64)
    middle = int(np.argmin(np.abs(ccaf.dopplers_hz)))
    value = np.asarray(ccaf.value[epoch, row, middle], np.complex128) / np.sqrt(ccaf.noise_variance[epoch, row])
    signal, prn = ccaf.signals[row].plan, prn_of(ccaf.signals[row].sat)
    dictionary = build_shapes(signal, prn, tuple(taps.tolist()), ccaf.band_hz, settings.window_chips)

    def read(at: Reals, from_: Reals) -> Reals:
        return autocorrelate_code(signal, prn, at[:, None] - from_, ccaf.band_hz)

    delay = found.delay_chips[row]
    size = estimate_amplitudes(value, dictionary, read(taps, delay))
    order = np.argsort(-np.abs(size), kind="stable")
    delay, size = delay[order], size[order]
    drawn = np.arange(round((taps[-1] - taps[0]) / _STEP_CHIPS) + 1) * _STEP_CHIPS + taps[0]
    turned = np.exp(-1j * np.angle(size[0]))
    return CorrelationParts(
        receiver=ccaf.receiver,
        sat=ccaf.signals[row].sat,
        at_s=at_s,
        delays_chips=drawn - delay[0],
        value=interpolate_taps(value, dictionary, read(drawn, taps)) * turned,
        parts=np.abs(size)[:, None] * np.abs(read(drawn, delay).T),
        second_chips=float(delay[1] - delay[0]),
        second_db=float(20.0 * np.log10(np.abs(size[1]) / np.abs(size[0]))),
        second_deg=float(np.degrees(np.angle(size[1] * turned))),
    )


# ---------------------------------------------------------------------- skies


def compare_skies(outcome: Outcome, zero: np.datetime64) -> list[ComparedSkies]:
    """Compare the skies of each receiver that had two with its prediction."""
    return [
        _compare(compared, float(seconds_between(compared.expected.gpst, zero)))
        for compared in outcome.compared[:_RECEIVERS]
    ]


def _compare(one: Compared, at_s: float) -> ComparedSkies:
    chosen = one.choice.chosen
    named: list[tuple[str, Kind, NavEstimate]] = [("", "expected", one.expected)]
    for number, sky in enumerate(one.skies):
        kind: Kind = "possible" if chosen is None else "trusted" if number == chosen else "false"
        named.append((f"sky {number + 1}", kind, sky))
    places = all(set(range(3)) <= set(known.there) for _, _, known in named)
    clocks = all(_CLOCK in known.there for _, _, known in named)
    return ComparedSkies(
        receiver=one.receiver,
        at_s=at_s,
        by=name_bases(one.by),
        tracks=tuple(_fix(name or one.receiver, kind, known, one.expected) for name, kind, known in named)
        if places
        else (),
        offsets=tuple(_offset(name or "expected", kind, known, one.expected) for name, kind, known in named)
        if clocks
        else (),
        wrong=float(one.choice.wrong_probability),
        chosen=chosen is not None,
    )


def _fix(name: str, kind: Kind, known: NavEstimate, expected: NavEstimate) -> FixTrack:
    lat, lon, _ = geodetic_from_ecef(expected.mean[_PLACE])
    rot = np.asarray(rot_enu_ecef(lat, lon))
    east_m, north_m, _ = rot @ (known.mean[_PLACE] - expected.mean[_PLACE])
    return FixTrack(
        receiver=name,
        kind=kind,
        east_m=np.array([east_m]),
        north_m=np.array([north_m]),
        covariance_m2=(rot @ known.covariance[_PLACE, _PLACE] @ rot.T)[:2, :2],
    )


def _offset(name: str, kind: Kind, known: NavEstimate, expected: NavEstimate) -> TimeOffset:
    return TimeOffset(
        name=name,
        kind=kind,
        ns=float(known.mean[_CLOCK] - expected.mean[_CLOCK]) * _NS_A_M,
        sigma_ns=float(np.sqrt(known.covariance[_CLOCK, _CLOCK])) * _NS_A_M,
    )


# ---------------------------------------------------------------------- where positions come from


def list_origins(outcome: Outcome, zero: np.datetime64) -> list[FixOrigins]:
    """List the origins of usable positions, where there is an attack or there are several kinds."""
    found = [found_origins for r in outcome.receivers if (found_origins := _origins(r, zero)) is not None]
    attacked = outcome.decision.verdict == "spoofed"
    return [found_origins for found_origins in found if attacked or len({s.origin for s in found_origins.usable}) > 1][
        :_RECEIVERS
    ]


def _origins(r: ReceiverOutcome, zero: np.datetime64) -> FixOrigins | None:
    if r.usable is None or r.positions is None:
        return None
    gpst = r.positions.log.gpst
    place_m, origin = np.full((gpst.size, 3), np.nan), np.full(gpst.size, "", "U10")
    for kind in USABLE:
        if (track := r.tracks.get(kind)) is not None:
            fixed = np.flatnonzero(track.fixed)
            rows = np.clip(np.searchsorted(gpst, track.gpst[fixed]), 0, gpst.size - 1)
            rows = fixed if track.gpst.size == gpst.size else rows
            free = origin[rows] == ""
            place_m[rows[free]], origin[rows[free]] = track.position_ecef_m[fixed[free]], kind
    seconds = np.asarray(seconds_between(gpst, zero), np.float64)
    return FixOrigins(
        receiver=r.reception.source.name,
        usable=tuple(_stretches(origin, seconds)),
        seconds=seconds,
        away_m=_away_m(place_m, r.tracks.get("unprotected")),
    )


def _away_m(place_m: Reals, ordinary: Track | None) -> Reals:
    if ordinary is None:
        return np.full(len(place_m), np.nan)
    return np.asarray(np.linalg.norm(ordinary.position_ecef_m - place_m, axis=1))


def _stretches(origin: NDArray[np.str_], seconds: Reals) -> Iterator[OriginSpan]:
    """Runs of epochs of one origin, each until the next one begins."""
    edges = [0, *(np.flatnonzero(origin[1:] != origin[:-1]) + 1).tolist(), origin.size]
    for first, stop in pairwise(edges):
        if origin[first]:
            name: UsableKind = origin[first].item()
            yield OriginSpan(name, float(seconds[first]), float(seconds[min(stop, origin.size - 1)]))
