"""A position from tens of milliseconds of samples, with orbits and a rough time from elsewhere."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skyproof.app.receive.policy import POLICY
from skyproof.app.receive.tracker import carrier_at_hz
from skyproof.arrays import Floats, Reals
from skyproof.errors import NotEnoughData
from skyproof.formats.bounds import list_names
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS
from skyproof.gnss.time import timedelta_from_s
from skyproof.navigation.coarse_time import CoarseFix, CoarseSettings, solve_coarse_fix
from skyproof.receiver.acquisition import Peak, Searcher, SearchSettings
from skyproof.receiver.snapshot import CodePhase, measure_code_phase
from skyproof.records import Fix, FixStatus, NavigationData, Samples, SignalId
from skyproof.remarks import Remark, RemarkKind

__all__ = ["RoughKnowledge", "Snapshot", "search_samples", "snapshot", "solve_position"]

_DOPPLER_STEP_HZ = 500.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Snapshot:
    """What a stretch of samples gave.

    fix : one epoch, in the form of every other fix; None unless `coarse.status` is 0. Its clock bias is the rough time
        minus true time as found, with a sigma of some milliseconds, not nanoseconds.
    phases : the signals used, in the order of `coarse.sats`; all that were found if there is no fix.
    """

    coarse: CoarseFix
    phases: tuple[CodePhase, ...]
    fix: Fix | None
    remarks: tuple[str, ...] = ()


def snapshot(
    samples: Samples,
    navigation: NavigationData,
    *,
    rough_gpst: np.datetime64 | None = None,
    rough_sigma_s: float = 60.0,
    place_ecef_m: Reals | None = None,
    place_sigma_m: float = 100e3,
    start_s: float = 0.0,
    duration_s: float = 0.05,
    doppler_max_hz: float = 7000.0,
    settings: CoarseSettings | None = None,
) -> Snapshot:
    """Search, measure and solve one stretch of a recording.

    Parameters
    ----------
    rough_gpst, rough_sigma_s : when the recording began, and one sigma of it; by default the recording's own date.
    place_ecef_m, place_sigma_m : (3,) rough place and one sigma of each coordinate; without one the Dopplers give it.
    start_s, duration_s : the stretch; 0.02 to 0.1 s are useful, 0.16 s the most.
    doppler_max_hz : how far the search goes; the oscillator's error comes on top of the satellites' 5 kHz.

    Raises
    ------
    NotEnoughData : no time is known, the recording ends before the stretch does, or it is shorter than 4 ms.
    """
    where = samples.path or samples.name
    begin = samples.start_gpst if rough_gpst is None else rough_gpst
    if begin is None:
        raise NotEnoughData(f"{where}: no start_gpst in its description; give the rough time (to a minute or so)")
    first, count = round(start_s * samples.rate_hz), round(duration_s * samples.rate_hz)
    if duration_s < 0.004 or first + count > samples.n_samples:
        raise NotEnoughData(
            f"{where}: {duration_s:g} s from {start_s:g} s on asked for, but it lasts {samples.duration_s:g} s and "
            "4 ms is the least; ask for a stretch within it"
        )
    planes = samples.read(first, count)
    if_hz = carrier_at_hz(samples)
    remarks: list[str] = []
    phases = [
        measure_code_phase(planes, samples.rate_hz, if_hz, peak.sat, peak.delay_s, peak.doppler_hz)
        for peak in _keep_strongest(search_samples(planes, samples.rate_hz, if_hz, doppler_max_hz), remarks)
    ]
    phases = _keep_credible(phases, remarks)
    middle_s = start_s + 0.5 * (count - 1) / samples.rate_hz
    at_gpst = begin + timedelta_from_s(middle_s)
    known = RoughKnowledge(rough_sigma_s=rough_sigma_s, place_ecef_m=place_ecef_m, place_sigma_m=place_sigma_m)
    coarse, used = solve_position(phases, at_gpst, navigation, known, remarks, settings)
    return Snapshot(
        coarse=coarse,
        phases=tuple(used),
        fix=_fix_from_coarse(samples.name, coarse) if coarse.status == 0 else None,
        remarks=tuple(remarks),
    )


def search_samples(planes: Floats, rate_hz: float, if_hz: float, doppler_max_hz: float) -> list[Peak]:
    """Search one antenna's samples (2, n) for all signals."""
    periods = int((min(planes.shape[1] / rate_hz, POLICY.searched_s) - 2.0 / rate_hz) / GPS_L1_CA.period_s)
    searcher = Searcher(GPS_L1_CA, rate_hz, SearchSettings(n_sums=periods, doppler_step_hz=_DOPPLER_STEP_HZ))
    reach = int(np.ceil(doppler_max_hz / _DOPPLER_STEP_HZ))
    grid_hz = _DOPPLER_STEP_HZ * np.arange(-reach, reach + 1, dtype=np.float64)
    return searcher.search(planes, if_hz, dict.fromkeys(GPS_SATS, grid_hz), {})


@dataclass(frozen=True, eq=False, kw_only=True)
class RoughKnowledge:
    """What is known before a snapshot is solved, as `snapshot` takes it."""

    rough_sigma_s: float = 60.0
    place_ecef_m: Reals | None = None
    place_sigma_m: float = 100e3


def solve_position(
    phases: Sequence[CodePhase],
    at_gpst: np.datetime64,
    navigation: NavigationData,
    known: RoughKnowledge,
    remarks: list[str],
    settings: CoarseSettings | None = None,
) -> tuple[CoarseFix, list[CodePhase]]:
    """Solve the position of code phases of one instant, and return the phases used; all if none fits.

    One phase a satellite.

    remarks : gets what is omitted.
    """

    def solve(some: Sequence[CodePhase]) -> CoarseFix:
        rows = [(p.code_s, p.code_sigma_s, p.doppler_hz, p.doppler_sigma_hz) for p in some]
        code_s, code_sigma_s, doppler_hz, doppler_sigma_hz = np.array(rows, np.float64).reshape(-1, 4).T
        return solve_coarse_fix(
            tuple(p.sat for p in some),
            code_s,
            code_sigma_s,
            doppler_hz,
            doppler_sigma_hz,
            at_gpst,
            known.rough_sigma_s,
            navigation,
            place_ecef_m=known.place_ecef_m,
            place_sigma_m=known.place_sigma_m,
            signal=GPS_L1_CA,
            settings=settings,
        )

    coarse, used = solve(phases), list(phases)
    # A false peak is a weak one. So the weakest goes first, while enough are left to catch a wrong set.
    least = max(POLICY.least_left, int(np.ceil(2 * len(phases) / 3)))
    while coarse.status == 4 and len(used) > least:
        weakest = min(used, key=lambda p: p.cn0_dbhz)
        used = [p for p in used if p is not weakest]
        coarse = solve(used)
    if coarse.status != 0:
        return coarse, list(phases)
    if len(used) < len(phases):
        left_out = list_names([p.sat for p in phases if p not in used])
        weakest_words = f"{left_out}: the weakest, left out until the others fitted one position"
        remarks.append(Remark(weakest_words, RemarkKind.BEARS))
    return coarse, used


def _keep_strongest(peaks: list[Peak], remarks: list[str]) -> list[Peak]:
    """Keep the strongest peak of each satellite.

    In so short a time the true one cannot be known.
    """
    kept: dict[str, Peak] = {}
    for peak in sorted(peaks, key=lambda p: -p.cn0_dbhz):
        if peak.sat in kept:
            second = (
                f"{peak.sat}: a second signal, {kept[peak.sat].cn0_dbhz - peak.cn0_dbhz:.1f} dB weaker; "
                "the stronger is used"
            )
            remarks.append(Remark(second, RemarkKind.BEARS))
        kept.setdefault(peak.sat, peak)
    return [kept[sat] for sat in sorted(kept)]


def _keep_credible(phases: list[CodePhase], remarks: list[str]) -> list[CodePhase]:
    """Keep the phases that were measured and are too strong for a cross-correlation of the strongest."""
    strongest_dbhz = max((p.cn0_dbhz for p in phases), default=0.0)
    kept = []
    for phase in phases:
        if not phase.found:
            unmeasured = f"{phase.sat}: found by the search, but its delay could not be measured; left out"
            remarks.append(Remark(unmeasured, RemarkKind.BEARS))
        elif phase.cn0_dbhz < strongest_dbhz - POLICY.cross_db:
            weak = (
                f"{phase.sat}: {strongest_dbhz - phase.cn0_dbhz:.1f} dB below the strongest, as its "
                "cross-correlation would be; left out"
            )
            remarks.append(Remark(weak, RemarkKind.BEARS))
        else:
            kept.append(phase)
    return kept


def _fix_from_coarse(receiver: str, coarse: CoarseFix) -> Fix:
    """Convert a coarse fix: its clock is the rough time, so the bias is minus that time's error."""
    to_fix = np.zeros((4, 5))
    to_fix[range(3), range(3)] = 1.0
    to_fix[3, 4] = -SPEED_OF_LIGHT_M_S
    return Fix(
        receiver=receiver,
        signals=tuple(SignalId(sat) for sat in coarse.sats),
        gpst=np.array([coarse.gpst]),
        position_ecef_m=coarse.position_ecef_m[None],
        velocity_ecef_m_s=coarse.velocity_ecef_m_s[None],
        clock_bias_s=np.array([-coarse.time_error_s]),
        clock_drift=np.array([coarse.clock_drift]),
        covariance_m2=(to_fix @ coarse.covariance @ to_fix.T)[None],
        residual_m=coarse.residual_m[None],
        status=np.full(1, FixStatus.OK, np.uint8),
    )
