"""Where a receiver is while nothing is trusted: carried on from its trusted fixes. A false signal does not move it.

A receiver that is known to stand is where it was, as well known as it was, for as long as it takes. Its clock runs on
with the last drift; how far that is off is not stated. What is carried from stretch to stretch is the last trusted fix
and nothing else. Its error is that of the last fix, so the protection level of that fix holds for as long.

One that has an inertial unit is where its navigator is, which all trusted fixes corrected, as well known as that says;
also those of a true sky that overlaps with a false one, which stand in no row of measurements.
No protection level is promised of it: what becomes of a bias that one satellite had in all those fixes is not bounded.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from skyproof.app.protect.positions import STRETCH_EPOCHS, Positions
from skyproof.arrays import Instants, Reals
from skyproof.fusion.policy import POLICY
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import seconds_between, timedelta_from_s
from skyproof.navigation.foresight import SkyFix
from skyproof.navigation.inertial_foresight import Inertial, noise_of
from skyproof.navigation.known import Known, known_of
from skyproof.records import Fix, FixStatus

__all__ = ["Flown", "Last", "flown_on", "stands", "step", "trusted_and_coasted"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Last:
    """The last trusted fix: its label by the receiver's clock, position (3,), covariance (4, 4), clock bias, drift, and
    protection levels (2,)."""

    gpst: np.datetime64
    position_ecef_m: Reals
    covariance_m2: Reals
    clock_bias_s: float
    clock_drift: float
    protection_m: Reals


def stands(positions: Positions) -> bool:
    """Whether the receiver is known not to move: the platform's `motion`, by the bound of its speed."""
    return positions.settings.speed_max_m_s == 0.0


def step(last: Last | None, receiver: str, gpst: Instants, fix: Fix | None) -> tuple[Fix | None, Last | None]:
    """Fixes of a receiver that stands at those of its epochs (n,) that have none, and the last fix after them.

    gpst : labels by the receiver's clock. fix : the trusted ones at the same epochs, None if there are none.
    """
    good = np.zeros(gpst.size, np.bool_) if fix is None else np.asarray(fix.status == FixStatus.OK)
    known = [] if last is None else [last]
    if fix is not None:
        known += [_of(fix, gpst, int(row)) for row in np.flatnonzero(good)]
    after = known[-1] if known else None
    # Before the first fix there is nothing to carry on.
    rows = np.flatnonzero(~good & ((np.cumsum(good) > 0) | (last is not None)))
    if not rows.size:
        return None, after
    number = np.cumsum(good)[rows] - (last is None)  # which of `known`
    carried = [known[k] for k in number]
    ahead_s = np.array([seconds_between(gpst[row], one.gpst) for row, one in zip(rows, carried, strict=True)])
    drift = np.array([one.clock_drift for one in carried])
    bias_s = np.array([one.clock_bias_s for one in carried]) + ahead_s * np.nan_to_num(drift)
    covariance = np.stack([one.covariance_m2 for one in carried])
    covariance[:, 3, :3] = covariance[:, :3, 3] = 0.0
    covariance[:, 3, 3] = np.inf
    return Fix(
        receiver=receiver,
        signals=(),
        gpst=gpst[rows] - timedelta_from_s(bias_s),
        position_ecef_m=np.stack([one.position_ecef_m for one in carried]),
        velocity_ecef_m_s=np.zeros((rows.size, 3)),
        clock_bias_s=bias_s,
        clock_drift=drift,
        covariance_m2=covariance,
        residual_m=np.empty((rows.size, 0)),
        status=np.full(rows.size, FixStatus.OK, np.uint8),
        protection_m=np.stack([one.protection_m for one in carried]),
    ), after


@dataclass(frozen=True, eq=False, kw_only=True)
class Flown:
    """What is carried of a receiver that moves: what is expected of it, and its last trusted fix.

    coming : those of `Positions.overlapping` that are later.
    """

    foresight: Inertial
    last: Last | None = None
    coming: tuple[Known, ...] = ()


def flown_on(flown: Flown, receiver: str, gpst: Instants, fix: Fix | None) -> tuple[Fix | None, Flown]:
    """Fixes by inertia at those of a receiver's epochs (n,) that have none, and what is carried on after them.

    gpst : labels by the receiver's clock. fix : the trusted ones at the same epochs, None if there are none.
    """
    good = np.zeros(gpst.size, np.bool_) if fix is None else np.asarray(fix.status == FixStatus.OK)
    foresight, last, coming, found = flown.foresight, flown.last, flown.coming, list[Known]()
    for first, stop in pairwise([0, *(np.flatnonzero(good[1:] != good[:-1]) + 1), gpst.size]):
        if fix is not None and good[first:stop].all():
            own = list(known_of(fix.select(slice(first, stop)), every_s=POLICY.learned_interval_s))
            foresight = foresight.learned(SkyFix(whole=own[0], each=tuple(map(noise_of, own))))
            last = _of(fix, gpst, stop - 1)
            continue
        if last is not None:
            foresight, coming = _free(foresight, coming, last, gpst[first:stop], found)
    return (_fixes(receiver, found) if found else None), Flown(foresight=foresight, last=last, coming=coming)


def _free(
    foresight: Inertial, coming: tuple[Known, ...], last: Last, gpst: Instants, found: list[Known]
) -> tuple[Inertial, tuple[Known, ...]]:
    """Carried on over epochs, what is true at which is added to `found`; a clock that is not known runs on."""
    for label in gpst:
        bias_s = _bias_s(last, label)
        at = label - timedelta_from_s(bias_s)
        while coming and coming[0].gpst <= at:
            if coming[0].gpst > last.gpst:
                foresight = foresight.followed(SkyFix(whole=coming[0], each=coming[:1]))
            coming = coming[1:]
        foresight = foresight.until(at)
        if (true := foresight.truth_at(at)) is not None:
            clock_m = SPEED_OF_LIGHT_M_S * np.array([bias_s, last.clock_drift])
            known = np.isfinite(np.diag(true.covariance))
            found.append(replace(true, mean=np.where(known, true.mean, np.append(np.zeros(6), clock_m))))
    return foresight, coming


def _bias_s(last: Last, gpst: np.datetime64) -> float:
    """Of a clock that runs on."""
    return last.clock_bias_s + float(seconds_between(gpst, last.gpst)) * float(np.nan_to_num(last.clock_drift))


def _fixes(receiver: str, found: Sequence[Known]) -> Fix:
    means, spreads = (np.stack([getattr(one, name) for one in found]) for name in ("mean", "covariance"))
    rows = np.array([0, 1, 2, 6])
    return Fix(
        receiver=receiver,
        signals=(),
        gpst=np.array([one.gpst for one in found]),
        position_ecef_m=means[:, :3],
        velocity_ecef_m_s=means[:, 3:6],
        clock_bias_s=means[:, 6] / SPEED_OF_LIGHT_M_S,
        clock_drift=means[:, 7] / SPEED_OF_LIGHT_M_S,
        covariance_m2=spreads[:, rows[:, None], rows],
        residual_m=np.empty((len(found), 0)),
        status=np.full(len(found), FixStatus.OK, np.uint8),
    )


def _of(fix: Fix, gpst: Instants, row: int) -> Last:
    return Last(
        gpst=gpst[row],
        position_ecef_m=fix.position_ecef_m[row],
        covariance_m2=fix.covariance_m2[row],
        clock_bias_s=float(fix.clock_bias_s[row]),
        clock_drift=float(fix.clock_drift[row]),
        protection_m=fix.protection_m[row],
    )


def trusted_and_coasted(positions: Positions) -> Iterator[tuple[str, Fix]]:
    """The trusted fixes of a run, stretch by stretch, each with where it comes from: "satellites" or "inertia"."""
    log, last = positions.log, None
    flown: Flown | None = None
    if isinstance(positions.foresight, Inertial):
        flown = Flown(foresight=positions.foresight, coming=positions.overlapping)
    for rows, fix in _stretches(positions):
        if fix is not None:
            yield "satellites", fix
        if flown is not None:
            between, flown = flown_on(flown, log.receiver, log.gpst[rows], fix)
            if between is not None:
                yield "inertia", between
        elif stands(positions):
            between, last = step(last, log.receiver, log.gpst[rows], fix)
            if between is not None:
                yield "inertia", between


def _stretches(positions: Positions) -> Iterator[tuple[slice, Fix | None]]:
    """All epochs of the run in stretches, with their trusted fixes; None where a stretch has none."""
    done, n = 0, positions.log.gpst.size
    for first, fix in positions.stretches("trusted"):
        yield from ((rows, None) for rows in _cut(done, first))
        done = first + fix.gpst.size
        yield slice(first, done), fix
    yield from ((rows, None) for rows in _cut(done, n))


def _cut(begin: int, stop: int) -> Iterator[slice]:
    for first in range(begin, stop, STRETCH_EPOCHS):
        yield slice(first, min(first + STRETCH_EPOCHS, stop))
