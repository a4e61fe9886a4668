"""Extrapolate a receiver's position where no fix of satellites may be used.

A false signal does not move it.

A receiver that is known to stand is *held* where it was, as well known as it was, for as long as it takes. Its clock
runs on with the last drift; how far that is off is not stated. What is carried from stretch to stretch is the last
trusted or consistent fix and nothing else. Its error is that of the last fix, so the protection level of that fix and
what an attack may have moved it by (`hidden`) hold for as long.

One that has an inertial unit is where its navigator is, which all trusted and consistent fixes corrected, but for those
of the last window before a test fails, in which an attack may have been there already. It is as well known as that
says. What corrects it is also a true sky that overlaps with a false one, which stands in no row of measurements. A drag
that no test noticed has also moved the velocity, by which what it may have moved the position by grows on.
Its protection level is that of the last fix, for a constant bias of one satellite moves the velocity by
nothing, and what the navigator's own errors exceed as rarely. A bias that grows while it corrects the unit is not
bounded.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, get_args

import numpy as np

from skyproof.app.protect.hidden import HiddenDrag
from skyproof.app.protect.positions import Positions, SatelliteKind, Track
from skyproof.arrays import Booleans, Instants, Reals
from skyproof.fusion.policy import POLICY
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.time import seconds_between, timedelta_from_s
from skyproof.navigation.inertial_predictor import Inertial, scale_to_noise
from skyproof.navigation.nav_estimate import NavEstimate, estimates_from_fix
from skyproof.navigation.predictor import SkyFix
from skyproof.navigation.protection import compute_noise_levels
from skyproof.records import Fix, FixStatus
from skyproof.verdict import UsableKind

__all__ = ["Flown", "Last", "carry_track", "coast", "is_standing", "join_fixes", "step", "usable_fixes"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Last:
    """The last trusted or consistent fix: its label by the receiver's clock, position (3,), covariance (4, 4), clock
    bias, drift, protection levels (2,), and by how much more an attack may have moved it, and how fast."""

    gpst: np.datetime64
    position_ecef_m: Reals
    covariance_m2: Reals
    clock_bias_s: float
    clock_drift: float
    protection_m: Reals
    hidden_m: float
    hidden_m_s: float = 0.0


def is_standing(positions: Positions) -> bool:
    """Test whether the platform holds the receiver still: its motion bounds the speed to zero."""
    return positions.settings.speed_max_m_s == 0.0


def step(last: Last | None, receiver: str, gpst: Instants, fix: Fix | None) -> tuple[Fix | None, Last | None]:
    """Hold a standing receiver at its epochs (n,) without a fix, and return its last fix after them.

    gpst : labels by the receiver's clock. fix : those of satellites at the same epochs, None if there are none.
    """
    good = np.zeros(gpst.size, np.bool_) if fix is None else np.asarray(fix.status == FixStatus.OK)
    known = [] if last is None else [last]
    if fix is not None:
        known += [_last_from_fix(fix, gpst, int(row)) for row in np.flatnonzero(good)]
    after = known[-1] if known else None
    # Before the first fix there is nothing to carry on.
    rows = np.flatnonzero(~good & ((np.cumsum(good) > 0) | (last is not None)))
    if not rows.size:
        return None, after
    number = np.cumsum(good)[rows] - (last is None)  # which of `known`
    carried = [known[k] for k in number]
    ahead_s = np.array([seconds_between(gpst[row], last_fix.gpst) for row, last_fix in zip(rows, carried, strict=True)])
    drift = np.array([last_fix.clock_drift for last_fix in carried])
    bias_s = np.array([last_fix.clock_bias_s for last_fix in carried]) + ahead_s * np.nan_to_num(drift)
    covariance = np.stack([last_fix.covariance_m2 for last_fix in carried])
    covariance[:, 3, :3] = covariance[:, :3, 3] = 0.0
    covariance[:, 3, 3] = np.inf
    return Fix(
        receiver=receiver,
        signals=(),
        gpst=gpst[rows] - timedelta_from_s(bias_s),
        position_ecef_m=np.stack([last_fix.position_ecef_m for last_fix in carried]),
        velocity_ecef_m_s=np.zeros((rows.size, 3)),
        clock_bias_s=bias_s,
        clock_drift=drift,
        covariance_m2=covariance,
        residual_m=np.empty((rows.size, 0)),
        status=np.full(rows.size, FixStatus.OK, np.uint8),
        protection_m=np.stack([last_fix.protection_m for last_fix in carried]),
        hidden_m=np.array([last_fix.hidden_m for last_fix in carried]),
    ), after


@dataclass(frozen=True, eq=False, kw_only=True)
class Flown:
    """The state that carries a moving receiver: its predictor, and its last trusted or consistent fix.

    coming : those of `Positions.overlapping` that are later. hidden : as of `Positions`. integrity_risk : of the
    protection levels; None promises none.
    """

    predictor: Inertial
    last: Last | None = None
    coming: tuple[NavEstimate, ...] = ()
    hidden: HiddenDrag | None = None
    integrity_risk: float | None = None


def coast(
    flown: Flown, receiver: str, gpst: Instants, fix: Fix | None, doubtful: Booleans | None = None
) -> tuple[Fix | None, Flown]:
    """Propagate by inertia over a receiver's epochs (n,) without a fix, and return the state after them.

    gpst : labels by the receiver's clock. fix : those of satellites at the same epochs, None if there are none.
    doubtful : (n,) which of them correct nothing.
    """
    good = np.zeros(gpst.size, np.int64) if fix is None else (fix.status == FixStatus.OK).astype(np.int64)
    if doubtful is not None:
        good = np.where(doubtful, 2 * good, good)
    predictor, last, coming = flown.predictor, flown.last, flown.coming
    found: list[tuple[NavEstimate, Last]] = []
    for first, stop in pairwise([0, *(np.flatnonzero(good[1:] != good[:-1]) + 1), gpst.size]):
        if good[first] == 2:
            continue
        if fix is not None and good[first] == 1:
            estimates = list(estimates_from_fix(fix.select(slice(first, stop)), every_s=POLICY.learned_interval_s))
            predictor = predictor.learned(SkyFix(whole=estimates[0], each=tuple(map(scale_to_noise, estimates))))
            last = _last_from_fix(fix, gpst, stop - 1)
            if flown.hidden is not None and last.hidden_m != 0.0:
                last = replace(last, hidden_m_s=flown.hidden.rate_at(last.gpst))
            continue
        if last is not None:
            predictor, coming, last = _coast_freely(predictor, coming, last, gpst[first:stop], found)
    after = replace(flown, predictor=predictor, last=last, coming=coming)
    return (_fixes_from_states(receiver, found, flown.integrity_risk) if found else None), after


def _coast_freely(
    predictor: Inertial,
    coming: tuple[NavEstimate, ...],
    last: Last,
    gpst: Instants,
    found: list[tuple[NavEstimate, Last]],
) -> tuple[Inertial, tuple[NavEstimate, ...], Last]:
    """Propagate over epochs without any fix, adding the states to `found`; an unknown clock runs on.

    Positions that overlapping skies corrected have no protection level.
    """
    for label in gpst:
        bias_s = _extrapolate_bias_s(last, label)
        at = label - timedelta_from_s(bias_s)
        while coming and coming[0].gpst <= at:
            if coming[0].gpst > last.gpst:
                predictor = predictor.followed(SkyFix(whole=coming[0], each=coming[:1]))
                last = replace(last, protection_m=np.full(2, np.nan))
            coming = coming[1:]
        predictor = predictor.until(at)
        if (true := predictor.truth_at(at)) is not None:
            clock_m = SPEED_OF_LIGHT_M_S * np.array([bias_s, last.clock_drift])
            known = np.isfinite(np.diag(true.covariance))
            found.append((replace(true, mean=np.where(known, true.mean, np.append(np.zeros(6), clock_m))), last))
    return predictor, coming, last


def _extrapolate_bias_s(last: Last, gpst: np.datetime64) -> float:
    """Extrapolate the clock bias by the last drift."""
    return last.clock_bias_s + float(seconds_between(gpst, last.gpst)) * float(np.nan_to_num(last.clock_drift))


def _fixes_from_states(receiver: str, found: Sequence[tuple[NavEstimate, Last]], integrity_risk: float | None) -> Fix:
    """Fixes of a navigator, each beside the last one of satellites before it."""
    means, spreads = (np.stack([getattr(state, name) for state, _ in found]) for name in ("mean", "covariance"))
    rows = np.array([0, 1, 2, 6])
    ahead_s = np.array([float(seconds_between(state.gpst, last.gpst)) + last.clock_bias_s for state, last in found])
    levels_m = np.full((len(found), 2), np.nan)
    if integrity_risk is not None:
        lat_rad, lon_rad, _ = geodetic_from_ecef(means[:, :3])
        rot = rot_enu_ecef(lat_rad, lon_rad)
        levels_m = compute_noise_levels(spreads[:, :3, :3], rot, integrity_risk=integrity_risk)
        levels_m += np.stack([last.protection_m for _, last in found])
    return Fix(
        receiver=receiver,
        signals=(),
        gpst=np.array([state.gpst for state, _ in found]),
        position_ecef_m=means[:, :3],
        velocity_ecef_m_s=means[:, 3:6],
        clock_bias_s=means[:, 6] / SPEED_OF_LIGHT_M_S,
        clock_drift=means[:, 7] / SPEED_OF_LIGHT_M_S,
        covariance_m2=spreads[:, rows[:, None], rows],
        residual_m=np.empty((len(found), 0)),
        status=np.full(len(found), FixStatus.OK, np.uint8),
        protection_m=levels_m,
        hidden_m=np.array([last.hidden_m for _, last in found]) + ahead_s * [last.hidden_m_s for _, last in found],
    )


def _last_from_fix(fix: Fix, gpst: Instants, row: int) -> Last:
    return Last(
        gpst=gpst[row],
        position_ecef_m=fix.position_ecef_m[row],
        covariance_m2=fix.covariance_m2[row],
        clock_bias_s=float(fix.clock_bias_s[row]),
        clock_drift=float(fix.clock_drift[row]),
        protection_m=fix.protection_m[row],
        hidden_m=float(fix.hidden_m[row]),
    )


def usable_fixes(positions: Positions) -> Iterator[tuple[UsableKind, Fix]]:
    """Yield the fixes of a run that a user may use, stretch by stretch, one an epoch, each with its kind."""
    log, last = positions.log, None
    flown: Flown | None = None
    if isinstance(positions.predictor, Inertial):
        flown = Flown(
            predictor=positions.predictor,
            coming=positions.overlapping,
            hidden=positions.hidden,
            integrity_risk=positions.settings.integrity_risk,
        )
    doubtful = None if flown is None else _find_doubtful_epochs(positions)
    for rows, found in _walk_stretches(positions):
        yield from found.items()
        fix = join_fixes(tuple(found.values()))
        if flown is not None:
            doubtful_here = None if doubtful is None else doubtful[rows] & ~_is_fixed(found.get("trusted"), rows)
            between, flown = coast(flown, log.receiver, log.gpst[rows], fix, doubtful_here)
            if between is not None:
                yield "inertial", between
        elif is_standing(positions):
            between, last = step(last, log.receiver, log.gpst[rows], fix)
            if between is not None:
                yield "held", between


def _find_doubtful_epochs(positions: Positions) -> Booleans | None:
    """Find the epochs, (n_epochs,), whose consistent fixes may be false already; None where nothing says."""
    doubtful = None if positions.consistent is None else positions.consistent().doubtful
    behind = None if positions.behind_null is None else positions.behind_null.positions
    if doubtful is None or positions.behind_null is None or behind is None or behind.consistent is None:
        return doubtful
    return np.where(positions.behind_null.epochs, behind.consistent().doubtful, doubtful)


def _is_fixed(fix: Fix | None, rows: slice) -> Booleans:
    return np.zeros(rows.stop - rows.start, np.bool_) if fix is None else np.asarray(fix.status == FixStatus.OK)


def carry_track(positions: Positions) -> tuple[UsableKind, Track] | None:
    """Return the kind and track of the fixes that are carried on; None without any."""
    parts = [(kind, fix) for kind, fix in usable_fixes(positions) if kind in ("inertial", "held")]
    if not parts:
        return None
    fixes = [fix for _, fix in parts]
    gpst, place_m, bias_s = (
        np.concatenate([getattr(fix, name) for fix in fixes]) for name in ("gpst", "position_ecef_m", "clock_bias_s")
    )
    last = fixes[-1].select(slice(fixes[-1].gpst.size - 1, None))
    return parts[0][0], Track(gpst=gpst, position_ecef_m=place_m, clock_bias_s=bias_s, last=last)


def join_fixes(fixes: Sequence[Fix]) -> Fix | None:
    """Join fixes that share no epoch into one that names no signals; None without any."""
    if not fixes:
        return None
    names = [name for name in Fix.BY_ROW if name not in ("residual_m", "inter_system_s")]
    values: dict[str, Any] = {name: np.array(getattr(fixes[0], name)) for name in names}
    for fix in fixes[1:]:
        good = fix.status == FixStatus.OK
        for name in names:
            values[name][good] = getattr(fix, name)[good]
    return Fix(receiver=fixes[0].receiver, signals=(), residual_m=np.empty((len(values["gpst"]), 0)), **values)


def _walk_stretches(positions: Positions) -> Iterator[tuple[slice, dict[SatelliteKind, Fix]]]:
    """Yield all epochs of the run in stretches, each with its fixes of satellites."""
    kinds = get_args(SatelliteKind)
    coming = {kind: positions.stretches(kind) for kind in kinds if kind in positions.masks}
    ahead = {kind: next(stretches, None) for kind, stretches in coming.items()}
    for rows in positions.cut():
        present: dict[SatelliteKind, Fix] = {}
        for kind, pending in ahead.items():
            if pending is not None and pending[0] == rows.start:
                present[kind] = pending[1]
        ahead |= {kind: next(coming[kind], None) for kind in present}
        yield rows, present
