"""Bring ranges of the same transmissions in several receivers to common instants, by their own Dopplers."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from skyproof.arrays import Booleans, Indices, Reals
from skyproof.detectors.multi_receiver.policy import POLICY
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import service_of
from skyproof.gnss.time import seconds_between
from skyproof.records import BY_NAME, ConsistentSet, Kind, Observations, Records, SignalId

__all__ = ["CommonPhases", "CommonRanges", "align_ranges", "count_common_kinds"]


@dataclass(frozen=True, eq=False, kw_only=True)
class CommonPhases:
    """Carriers of K transmissions in R receivers at N common instants.

    cyc, sigma_cyc (N, K, R) : carriers, NaN where there is none, and the noise of each. The noise includes that of
    moving a carrier to its instant. half_open (N, K, R) : where one may be half a cycle off. wave_m, whole_cycles (K,)
    : wavelength; whether differences between satellites are whole cycles. Those of GLONASS are not, as each satellite
    has a frequency of its own.
    """

    cyc: Reals
    sigma_cyc: Reals
    wave_m: Reals
    half_open: Booleans
    whole_cycles: Booleans

    def take(self, rows: Indices) -> "CommonPhases":
        """Return those transmissions alone."""
        cells = {name: getattr(self, name)[:, rows] for name in _OF_CELLS}
        return replace(self, **cells, wave_m=self.wave_m[rows], whole_cycles=self.whole_cycles[rows])

    def at(self, instants: Indices | Booleans) -> "CommonPhases":
        """Return the same transmissions at these of the instants."""
        return replace(self, **{name: getattr(self, name)[instants] for name in _OF_CELLS})


_OF_CELLS = ("cyc", "sigma_cyc", "half_open")


@dataclass(frozen=True, eq=False, kw_only=True)
class CommonRanges:
    """range_m, range_sigma_m (N, K, R) of K transmissions in R receivers at N common instants, and the thermal noise of
    each. tracks (R, K) : each receiver's signals. time_s (N,) : since the window's start. step_s : the usual one
    between instants. phases : carriers of the same; None where they were not kept.

    Every range is there: transmissions and epochs that would leave holes are left out.
    """

    tracks: tuple[tuple[SignalId, ...], ...]
    range_m: Reals
    range_sigma_m: Reals
    time_s: Reals
    step_s: float
    phases: CommonPhases | None = None

    @property
    def gaps(self) -> Reals:
        """Return the gaps between the instants (N-1,), in usual steps."""
        return np.asarray(np.diff(self.time_s) / self.step_s)

    @property
    def signals(self) -> tuple[SignalId, ...]:
        """Return the signals (K,) as the first receiver names them."""
        return self.tracks[0]

    @property
    def sats(self) -> tuple[str, ...]:
        """Return the satellite of each transmission (K,)."""
        return tuple(signal.sat for signal in self.signals)

    @cached_property
    def kinds(self) -> Indices:
        """Return the number (K,) of each transmission's kind of signal."""
        names = [str(signal.kind) for signal in self.signals]
        number = {name: k for k, name in enumerate(sorted(set(names)))}
        return np.array([number[name] for name in names], np.intp)

    @cached_property
    def transmissions(self) -> frozenset[tuple[SignalId, ...]]:
        """Return the signals of each transmission, by receiver."""
        return frozenset(zip(*self.tracks, strict=True))

    def take(self, rows: Indices) -> "CommonRanges":
        """Return those transmissions alone, at the same instants."""
        tracks = tuple(tuple(receiver_tracks[k] for k in rows) for receiver_tracks in self.tracks)
        phases = None if self.phases is None else self.phases.take(rows)
        range_m, range_sigma_m = self.range_m[:, rows], self.range_sigma_m[:, rows]
        return replace(self, tracks=tracks, range_m=range_m, range_sigma_m=range_sigma_m, phases=phases)

    def at(self, instants: Indices | Booleans) -> "CommonRanges":
        """Return the same transmissions at these of the instants, without their carriers."""
        range_m, range_sigma_m = self.range_m[instants], self.range_sigma_m[instants]
        return replace(self, range_m=range_m, range_sigma_m=range_sigma_m, time_s=self.time_s[instants], phases=None)

    @property
    def sigma_m(self) -> Reals:
        """Return the thermal noise (K, R) of one range, root mean square over the instants."""
        return np.asarray(np.sqrt((self.range_sigma_m**2).sum(axis=0) / max(len(self.range_sigma_m), 1)))

    @property
    def apart_m(self) -> Reals:
        """Return mean differences (K, R - 1) from the first receiver, less those of all of the kind."""
        difference_m, kinds = self.mean_m[:, 1:] - self.mean_m[:, :1], self.kinds
        kind_means = [difference_m[kinds == kind].mean(axis=0) for kind in range(int(kinds.max(initial=-1)) + 1)]
        return np.asarray(difference_m - np.reshape(kind_means, (-1, difference_m.shape[1]))[kinds])

    @property
    def mean_m(self) -> Reals:
        """Return the means (K, R) over the window."""
        return np.asarray(self.range_m.mean(axis=0))

    @property
    def mean_sigma_m(self) -> Reals:
        """Return the sigma (K, R) of the means, thermal, as if white.

        For equal correlation it is right up to a common factor.
        """
        return np.asarray(self.sigma_m / np.sqrt(max(len(self.range_m), 1)))


def count_common_kinds(sets: tuple[ConsistentSet, ...]) -> dict[Kind, int]:
    """Count the transmissions of each kind of signal that all sets have in common."""
    kinds = [tracks[0].kind for tracks in _match_transmissions(sets)]
    return {kind: kinds.count(kind) for kind in sorted(set(kinds))}


@lru_cache(16)  # the sets of a window are looked at kind by kind
def _match_transmissions(sets: tuple[ConsistentSet, ...]) -> tuple[tuple[SignalId, ...], ...]:
    """Match the transmissions that all sets have, by service, in the order of the first one's names."""
    by_service = []
    for chosen in sets:
        signals: dict[tuple[str, str, str], SignalId] = {}
        for s in sorted(chosen.signals, key=BY_NAME):
            signals.setdefault((s.sat, s.band, service_of(s.sat[0], s.band, s.code)), s)
        by_service.append(signals)
    sent = set.intersection(*(set(signals) for signals in by_service))
    rows = (tuple(signals[name] for signals in by_service) for name in sent)
    return tuple(sorted(rows, key=lambda tracks: [BY_NAME(signal) for signal in tracks]))


def align_ranges(
    records: Records,
    sets: tuple[ConsistentSet, ...],
    *,
    kind: Kind | None = None,
    min_share: float = 0.5,
    min_satellites: int = 5,
) -> CommonRanges:
    """Align pseudoranges of transmissions that all `sets` have, at the instants of the first receiver.

    There is one set a receiver.

    A receiver's label minus its set's clock bias is GPS time, as these signals give it. False signals give it wrongly,
    but alike to all receivers to within their distances over c. So the difference between receivers is right to
    microseconds. Each measurement moves from its own instant to the nearest one of the first receiver by its own
    Doppler, -lambda * doppler * dt, whatever the clocks. An acceleration of 0.13 m/s^2 leaves 4 cm for dt = 0.5 s with
    two measurements.

    Parameters
    ----------
    kind : of the transmissions, as the first receiver names it; all if absent.
    min_share : a transmission with less than this share of the best one's epochs is left out, if `min_satellites`
        remain. So is one with less than five epochs, if the best one has as many.
    """
    shared = [tracks for tracks in _match_transmissions(sets) if kind in (None, tracks[0].kind)]
    receivers = {o.receiver: o for o in records.observations}
    instants_s = _true_time_s(receivers[sets[0].receiver], records, sets[0])
    step_s = float(np.median(np.diff(instants_s))) if instants_s.size > 1 else 1.0
    ranges = np.full((instants_s.size, len(shared), len(sets)), np.nan)
    sigma_m, phase_cyc, phase_sigma_cyc = (np.full_like(ranges, np.nan) for _ in range(3))
    half_open = np.zeros(ranges.shape, np.bool_)
    paces_m_s: list[Reals] = []
    for i, chosen in enumerate(sets):
        observations = receivers[chosen.receiver]
        columns = np.array([observations.column_of[tracks[i]] for tracks in shared], dtype=np.intp)
        rate_m_s = -SPEED_OF_LIGHT_M_S / observations.carrier_hz[columns] * observations.doppler_hz[:, columns]
        time_s = _true_time_s(observations, records, chosen)
        paces_m_s.append(rate_m_s)
        time_s -= _estimate_drift(rate_m_s, paces_m_s[0]) * (
            time_s - float(seconds_between(chosen.gpst, records.start_gpst))
        )
        nearest = _nearest(time_s, instants_s)
        if nearest.size == 0:
            continue
        dt_s = instants_s - time_s[nearest]
        cells = np.ix_(nearest, columns)
        moved = np.abs(dt_s)[:, None] > 1e-9  # with equal instants the Doppler is not needed, and may be missing
        shift_m = np.where(moved, rate_m_s[nearest] * dt_s[:, None], 0.0)
        near = np.abs(dt_s) <= 0.51 * step_s
        ranges[..., i] = np.where(near[:, None], observations.pseudorange_m[cells] + shift_m, np.nan)
        sigma_m[..., i] = observations.pseudorange_sigma_m[cells]
        steady_hz, pace_hz_s = _smooth_dopplers(observations.doppler_hz[:, columns], time_s)
        middle_hz = steady_hz[nearest] + 0.5 * pace_hz_s * dt_s[:, None]
        turned_cyc = np.where(moved, -middle_hz * dt_s[:, None], 0.0)
        turned_sigma_cyc = np.where(moved, observations.doppler_sigma_hz[cells] * dt_s[:, None], 0.0)
        phase_sigma_cyc[..., i] = np.hypot(observations.carrier_sigma_cyc[cells], turned_sigma_cyc)
        phase_cyc[..., i] = np.where(near[:, None], observations.carrier_cyc[cells] + turned_cyc, np.nan)
        half_open[..., i] = observations.half_cycle_open[cells]
    first = receivers[sets[0].receiver]
    phases = CommonPhases(
        cyc=np.where(np.isfinite(phase_sigma_cyc), phase_cyc, np.nan),
        sigma_cyc=phase_sigma_cyc,
        wave_m=SPEED_OF_LIGHT_M_S / first.carrier_hz[[first.column_of[tracks[0]] for tracks in shared]],
        half_open=half_open,
        whole_cycles=np.array([tracks[0].kind[0] != "R" for tracks in shared], np.bool_),
    )
    return _drop_holes(shared, ranges, sigma_m, phases, instants_s, step_s, min_share, min_satellites)


def _smooth_dopplers(doppler_hz: Reals, time_s: Reals) -> tuple[Reals, Reals]:
    """Smooth Dopplers (N, K): keep their common part, and a line of each beside it; and return the slopes (K,), Hz/s.

    Over half a second a line fits a Doppler to better than 0.1 mm of range, while its slope makes up to 16 mm. The
    common part is the receiver's clock, which cancels between satellites.
    """
    if len(time_s) < POLICY.few_epochs:
        return doppler_hz, np.zeros(doppler_hz.shape[1])
    common_hz = np.nanmean(doppler_hz, axis=1, keepdims=True) if np.isfinite(doppler_hz).any(axis=1).all() else 0.0
    own_hz = doppler_hz - common_hz
    known = np.isfinite(own_hz)
    known &= known.sum(axis=0) >= POLICY.few_epochs
    count = np.maximum(known.sum(axis=0), 1)
    middle_s = np.where(known, time_s[:, None], 0.0).sum(axis=0) / count
    middle_hz = np.where(known, own_hz, 0.0).sum(axis=0) / count
    at_s, beside_hz = np.where(known, time_s[:, None] - middle_s, 0.0), np.where(known, own_hz - middle_hz, 0.0)
    squares_s2 = np.sum(at_s**2, axis=0)
    pace_hz_s = np.sum(at_s * beside_hz, axis=0) / np.where(squares_s2 > 0.0, squares_s2, 1.0)
    smooth_hz = np.where(known, middle_hz + pace_hz_s * at_s, np.nan)
    return smooth_hz + common_hz, pace_hz_s


def _estimate_drift(rate_m_s: Reals, reference_m_s: Reals) -> float:
    """Estimate by how much faster a receiver's clock runs than the first one's, by the growth of most ranges.

    Antennas d apart see a range grow differently by 4 km/s times d over 20 000 km: 1 m/s, or 3e-9, at 5 km.
    """
    known = np.isfinite(rate_m_s).any(axis=0) & np.isfinite(reference_m_s).any(axis=0)
    if not known.any():
        return 0.0
    faster_m_s = np.nanmean(rate_m_s[:, known], axis=0) - np.nanmean(reference_m_s[:, known], axis=0)
    return float(np.median(faster_m_s)) / SPEED_OF_LIGHT_M_S


def _true_time_s(observations: Observations, records: Records, chosen: ConsistentSet) -> Reals:
    """Return seconds since the window's start, by GPS time: to pair and move epochs, never a measurement."""
    return np.asarray(seconds_between(observations.gpst, records.start_gpst) - chosen.clock_bias_s, float)


def _nearest(times_s: Reals, wanted_s: Reals) -> Indices:
    """Return the index into ascending `times_s` of the value nearest to each of `wanted_s`."""
    if times_s.size == 0:
        return np.zeros(0, np.intp)
    after = np.clip(np.searchsorted(times_s, wanted_s), 1, max(times_s.size - 1, 1))
    after = np.minimum(after, times_s.size - 1)
    before = np.maximum(after - 1, 0)
    return np.where(wanted_s - times_s[before] <= times_s[after] - wanted_s, before, after)


def _drop_holes(
    shared: Sequence[tuple[SignalId, ...]],
    ranges: Reals,
    sigma_m: Reals,
    phases: CommonPhases,
    time_s: Reals,
    step_s: float,
    min_share: float,
    min_satellites: int,
) -> CommonRanges:
    whole = np.asarray(np.isfinite(ranges + sigma_m).all(axis=2))  # (N, K)
    epochs = whole.sum(axis=0)
    best = int(epochs.max(initial=1))
    kept = epochs >= max(min_share * best, min(POLICY.few_epochs, best))
    if kept.sum() < min_satellites:
        kept = epochs > 0
    rows = np.asarray(whole[:, kept].all(axis=1))
    complete = [tracks for tracks, keep in zip(shared, kept, strict=True) if keep]
    return CommonRanges(
        tracks=tuple(tuple(tracks[i] for tracks in complete) for i in range(ranges.shape[2])),
        range_m=ranges[rows][:, kept],
        range_sigma_m=sigma_m[rows][:, kept],
        time_s=time_s[rows],
        step_s=step_s,
        phases=phases.at(rows).take(np.flatnonzero(kept)),
    )
