"""A receiver's positions of each kind, computed stretch by stretch, so that memory does not grow with the run."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, Literal

import numpy as np

from skyproof.app.common.settings import Settings
from skyproof.app.protect.hidden import HiddenDrag
from skyproof.arrays import Booleans, Indices, Instants, Reals
from skyproof.fusion.consistent import Consistent, Rest, select_consistent
from skyproof.fusion.fuse import Decision
from skyproof.fusion.policy import POLICY
from skyproof.fusion.trusted import apply_mask, carries, fix_of, mask_signals
from skyproof.fusion.unprotected import followed
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.time import timedelta_from_s
from skyproof.navigation.nav_estimate import NavEstimate
from skyproof.navigation.predictor import Predictor
from skyproof.navigation.screen import empty_epochs
from skyproof.navigation.smooth import smooth
from skyproof.records import (
    Fix,
    FixStatus,
    NavigationData,
    ObservationLog,
    Observations,
    SignalId,
    VerdictWord,
)
from skyproof.verdict import USABLE, Place

__all__ = [
    "KINDS",
    "STRETCH_EPOCHS",
    "Positions",
    "SatelliteKind",
    "Track",
    "place_of",
    "set_up_positions",
    "sigmas_enu_m",
]

SatelliteKind = Literal["trusted", "consistent"]
"""Of fixes that may be used, those of satellites."""
KINDS: Final = (*USABLE, "false", "unprotected")
"""Of a receiver's fixes. Others are named as the sources of false signals, or as skies, one of them possibly true."""
STRETCH_EPOCHS: Final = 1024


@dataclass(frozen=True, eq=False, kw_only=True)
class Track:
    """Times, places and clock biases of fixes of one kind; n_epochs each, NaN where there is no fix.

    last : the last fix alone, one epoch.
    """

    gpst: Instants
    position_ecef_m: Reals
    clock_bias_s: Reals
    last: Fix

    @property
    def fixed(self) -> Booleans:
        """Return where there is a fix, (n_epochs,)."""
        return np.isfinite(self.clock_bias_s)


@dataclass(frozen=True, eq=False, kw_only=True)
class BehindNull:
    """What samples give that sources were taken out of, judged alone.

    word : by these alone. positions : at the epochs of the samples as recorded; None if they give none. epochs :
    (n_epochs,) at which these stand for fixes that the samples as recorded do not give. seconds : how long these are.
    source_to_noise : power of the sources over one antenna's noise, median. cost_db : by how much C/N0 is lower than
    without a source; None where that does not show.
    """

    word: VerdictWord
    positions: "Positions | None"
    epochs: Booleans
    seconds: float
    source_to_noise: float
    cost_db: float | None


@dataclass(frozen=True, eq=False, kw_only=True)
class Positions:
    """masks : by kind, which cells (n_epochs, n_channels) of the log its fixes are made of. predictor : what is to be
    expected of the receiver, before anything was learned. overlapping : fixes of a true sky that was taken apart from a
    false one, in order. hidden : how far an attack may have moved it unnoticed; None where no test says. consistent :
    what consistent fixes are made of; doubtful ones correct no inertial unit. behind_null : further ones behind a
    null."""

    log: ObservationLog
    orbits: NavigationData
    settings: Settings
    masks: Mapping[str, Callable[[], Booleans]]
    predictor: Predictor | None = None
    overlapping: tuple[NavEstimate, ...] = ()
    hidden: HiddenDrag | None = None
    consistent: Callable[[], Consistent] | None = None
    behind_null: BehindNull | None = None

    def cut(self) -> Iterator[slice]:
        """Yield the epochs of the run in stretches."""
        n = self.log.gpst.size
        yield from (slice(first, min(first + STRETCH_EPOCHS, n)) for first in range(0, n, STRETCH_EPOCHS))

    def stretches(self, kind: str) -> Iterator[tuple[int, Fix]]:
        """Yield the fixes of a kind in stretches, each with its first epoch; empty ones are left out.

        Signals are chosen before they are smoothed, so what a channel followed while it was captured does not leak
        into its other fixes. Epochs with a trusted fix have no consistent one. Those behind a null are among them.
        """
        if kind != "consistent" or self.behind_null is None or self.behind_null.positions is None:
            yield from self._stretches(kind)
            return
        parts, behind = dict(self._stretches(kind)), dict(self.behind_null.positions.stretches(kind))
        for rows in self.cut():
            epochs = self.behind_null.epochs[rows]
            found, other = parts.get(rows.start), behind.get(rows.start)
            if other is not None and epochs.any():
                both = [(np.flatnonzero(at), fix.select(at)) for at, fix in ((~epochs, found), (epochs, other)) if fix]
                found = _join_rows(both, self.log.gpst[rows])
            if found is not None:
                yield rows.start, found

    def _stretches(self, kind: str) -> Iterator[tuple[int, Fix]]:
        """Yield the fixes of samples as they were recorded."""
        if (kept := self._kept.get(kind)) is not None:
            yield kept
            return
        mask = self.masks[kind]()
        trusted = self.masks["trusted"]() if kind == "consistent" else None
        since, last = (self._find_evidence_epochs(), _find_run_ends(mask)) if kind == "consistent" else (None, None)
        for rows in self.cut():
            first, stop = rows.start, rows.stop
            wanted: Booleans = np.asarray(mask[first:stop].any(axis=1))
            if trusted is not None and wanted.any():
                wanted &= ~self._is_trusted(trusted, first, stop)
            found = self._compute_fix(kind, mask, first, stop) if wanted.any() else None
            if found is None:
                continue
            if since is not None and last is not None:
                found = self._add_hidden(_keep_epochs(found, wanted), since, last, first)
            elif kind == "trusted":
                self._trusted[first] = _is_valid(found)
                found = replace(found, hidden_m=np.where(_is_valid(found), 0.0, np.nan))
            if len(mask) <= STRETCH_EPOCHS:  # a short run is not computed again
                self._kept[kind] = first, found
            yield first, found

    def _compute_fix(self, kind: str, mask: Booleans, first: int, stop: int) -> Fix | None:
        """Compute the fixes of epochs `first` to before `stop`, from the cells of a mask of the whole run."""
        elapsed_s, reach_s = self.log.elapsed_s, 0.5 * self.settings.smoothing_s * (1.0 + 1e-6)
        rim_s = [elapsed_s[first] - reach_s, elapsed_s[stop - 1] + reach_s]
        begin, end = (int(row) for row in np.searchsorted(elapsed_s, rim_s))
        kept = apply_mask(self.log.read(begin, end), mask[begin:end])
        rows = slice(first - begin, stop - begin)
        faults = self.consistent().faults[first:stop] if kind == "consistent" and self.consistent is not None else None
        return fix_of(
            smooth(kept, window_s=self.settings.smoothing_s).select(rows),
            self.orbits,
            multipath_sigma_m=self.settings.multipath_sigma_m,
            elevation_mask_deg=self.settings.elevation_mask_deg,
            ordinary=kind == "unprotected",
            integrity_risk=self.settings.integrity_risk if kind in ("trusted", "consistent") else None,
            faults=faults,
            quadrature_m=None if kind == "unprotected" else self._smooth_quadrature(kept, rows),
        )

    def _smooth_quadrature(self, kept: Observations, rows: slice) -> Reals | None:
        """Average what the code discriminators show off the carriers as the codes of these epochs are averaged."""
        if np.isnan(kept.quadrature_m).all():
            return None
        carrier_m = kept.carrier_cyc * SPEED_OF_LIGHT_M_S / kept.carrier_hz
        beside = replace(kept, pseudorange_m=carrier_m + kept.quadrature_m)
        return (smooth(beside, window_s=self.settings.smoothing_s).pseudorange_m - carrier_m)[rows]

    def _is_trusted(self, mask: Booleans, first: int, stop: int) -> Booleans:
        """(stop - first,) at which epochs there is a trusted fix."""
        if first not in self._trusted:
            found = self._compute_fix("trusted", mask, first, stop) if mask[first:stop].any() else None
            self._trusted[first] = np.zeros(stop - first, np.bool_) if found is None else _is_valid(found)
        return self._trusted[first]

    def _find_evidence_epochs(self) -> Indices:
        """Find for each epoch the last one until then with enough authentic signals for a fix.

        (n_epochs,); the first epoch where there is none.
        """
        enough = self.masks["trusted"]().sum(axis=1) >= POLICY.fix_signals
        return np.asarray(np.maximum.accumulate(np.where(enough, np.arange(enough.size), 0)))

    def _add_hidden(self, fix: Fix, since: Indices, last: Indices, first: int) -> Fix:
        """Add to a fix the bound of what an attack may have moved it by since these epochs, (n_epochs,).

        last : up to where each epoch is smoothed.
        """
        if self.hidden is None:
            return fix
        gpst = self.log.gpst
        rows = slice(first, first + fix.gpst.size)
        latest = np.minimum(gpst[rows] + timedelta_from_s(0.5 * self.settings.smoothing_s), gpst[last[rows]])
        hidden_m = self.hidden.bound_between(gpst[since[rows]], gpst[rows], latest)
        return replace(fix, hidden_m=np.where(_is_valid(fix), hidden_m, np.nan))

    @cached_property
    def _kept(self) -> dict[str, tuple[int, Fix]]:
        return {}

    @cached_property
    def _trusted(self) -> dict[int, Booleans]:
        """Return the epochs with a trusted fix, by the first epoch of their stretch."""
        return {}

    def track(self, kind: str) -> Track | None:
        """Reduce the fixes of a kind to a track; None if there is none."""
        n = self.log.gpst.size
        gpst, bias_s, place_m = self.log.gpst.copy(), np.full(n, np.nan), np.full((n, 3), np.nan)
        last: Fix | None = None
        for first, fix in self.stretches(kind):
            good = np.flatnonzero(_is_valid(fix))
            gpst[first + good], bias_s[first + good] = fix.gpst[good], fix.clock_bias_s[good]
            place_m[first + good] = fix.position_ecef_m[good]
            last = fix.select(good[-1:]) if good.size else last
        if last is None:
            return None
        return Track(gpst=gpst, position_ecef_m=place_m, clock_bias_s=bias_s, last=last)

    def whole(self, kind: str) -> Fix | None:
        """Join all fixes of a kind into one record; None if no stretch has any."""
        parts = list(self.stretches(kind)) if kind in self.masks else []
        if not parts:
            return None
        return _join_rows([(np.arange(first, first + fix.gpst.size), fix) for first, fix in parts], self.log.gpst)


def _join_rows(parts: Sequence[tuple[Indices, Fix]], gpst: Instants) -> Fix:
    """Join fixes, each with its epochs, into one record of all epochs (n_epochs,), empty where no part has one."""
    signals = tuple(sorted({signal for _, fix in parts for signal in fix.signals}))
    scales = sorted({scale for _, fix in parts for scale in fix.inter_system_s})
    shapes: dict[str, tuple[int, ...]] = {
        "position_ecef_m": (3,),
        "velocity_ecef_m_s": (3,),
        "clock_bias_s": (),
        "clock_drift": (),
        "covariance_m2": (4, 4),
        "residual_m": (len(signals),),
        "protection_m": (2,),
        "hidden_m": (),
    }
    values: dict[str, Any] = {name: np.full((gpst.size, *shape), np.nan) for name, shape in shapes.items()}
    values["gpst"] = gpst.copy()
    values["status"] = np.full(gpst.size, FixStatus.TOO_FEW, np.uint8)
    offsets = {scale: np.full(gpst.size, np.nan) for scale in scales}
    for rows, fix in parts:
        for name in (*shapes, "gpst", "status"):
            if name != "residual_m":
                values[name][rows] = getattr(fix, name)
        columns = np.array([signals.index(signal) for signal in fix.signals], np.intp)
        values["residual_m"][np.ix_(rows, columns)] = fix.residual_m
        for scale, offset_s in fix.inter_system_s.items():
            offsets[scale][rows] = offset_s
    return Fix(receiver=parts[0][1].receiver, signals=signals, inter_system_s=offsets, **values)


def _find_run_ends(mask: Booleans) -> Indices:
    """Find the last epoch of each epoch's run of epochs with any cell."""
    row = np.arange(len(mask))
    return np.asarray(np.minimum.accumulate(np.where(mask.any(axis=1), row.size, row)[::-1])[::-1] - 1)


def _is_valid(fix: Fix) -> Booleans:
    """Return which epochs have a valid fix, (n,)."""
    return np.asarray(fix.status == FixStatus.OK)


def _keep_epochs(fix: Fix, wanted: Booleans) -> Fix:
    """Keep a fix at some epochs, (n,)."""
    status = np.where(wanted | ~_is_valid(fix), fix.status, FixStatus.TOO_FEW).astype(np.uint8)
    return empty_epochs(fix, ~wanted, status)


def set_up_positions(
    log: ObservationLog,
    decision: Decision,
    orbits: NavigationData,
    settings: Settings,
    predictor: Predictor | None = None,
    overlapping: tuple[NavEstimate, ...] = (),
    hidden: HiddenDrag | None = None,
    rest: Rest | None = None,
) -> Positions:
    """Set up a receiver's positions of each kind.

    From authentic, consistent and spoofed signals, and as each source or open sky shows them. The kind without
    protection has them as an ordinary receiver does.
    """
    labels = decision.labels

    def select() -> Consistent:
        return select_consistent(log, decision, rest, within_s=settings.window_s)

    masks: dict[str, Callable[[], Booleans]] = {
        "trusted": lambda: carries(log, labels, "authentic"),
        "consistent": lambda: select().cells,
        "false": lambda: carries(log, labels, "spoofed"),
        "unprotected": lambda: followed(log),
    }

    def mask_of(signals: tuple[SignalId, ...], decided: bool) -> Callable[[], Booleans]:
        if decided:
            return lambda: mask_signals(log, signals) & carries(log, labels, "spoofed")
        return lambda: mask_signals(log, signals)

    for sources, decided in ((decision.sources, True), (decision.skies, False)):
        for source in sources:
            source_signals = tuple(ref.signal for ref in source.signals if ref.receiver == log.receiver)
            masks[source.name] = mask_of(source_signals, decided)
    return Positions(
        log=log,
        orbits=orbits,
        settings=settings,
        masks=masks,
        predictor=predictor,
        overlapping=overlapping,
        hidden=hidden,
        consistent=select,
    )


def place_of(ecef_m: Reals) -> Place:
    """Return a point on the Earth in degrees."""
    lat, lon, height = geodetic_from_ecef(ecef_m)
    return Place(lat_deg=float(np.degrees(lat)), lon_deg=float(np.degrees(lon)), height_m=float(height))


def sigmas_enu_m(fix: Fix) -> tuple[float, float, float]:
    """Return one sigma of a fix's first epoch to the east, to the north and up."""
    lat, lon, _ = geodetic_from_ecef(fix.position_ecef_m[0])
    rot = rot_enu_ecef(lat, lon)
    variances = np.diag(rot @ fix.covariance_m2[0, :3, :3] @ rot.T)
    east, north, up = (float(s) for s in np.sqrt(variances))
    return east, north, up
