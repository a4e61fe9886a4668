"""An open recording: front end, satellites, lost samples, mirrored spectrum, oscillator."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from skyproof.app.inspect.advice import advise, remark_on_correction, remark_on_power, remark_on_signals, summary
from skyproof.app.inspect.inspection import Inspection, Satellite
from skyproof.app.inspect.policy import POLICY
from skyproof.arrays import Floats
from skyproof.errors import NotEnoughData
from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS
from skyproof.receiver.acquisition import Peak, Searcher, SearchSettings
from skyproof.receiver.clock_agreement import correct_samples, estimate_from_survey
from skyproof.recording.conditioning import MeasuredFrontEnd, condition, measure_front_end
from skyproof.recording.survey import DOPPLER_LIMIT_HZ, Survey, estimate_oscillator_error, survey_recorder
from skyproof.records import Samples

__all__ = ["assemble_inspection", "inspect_recording", "inspect_samples"]


@dataclass(frozen=True, eq=False, kw_only=True)
class _View:
    """The samples in one reading of their spectrum, and where the nominal carrier lies in that."""

    samples: Samples
    carrier_hz: float
    mirrored: bool = False

    def flip(self, *, carrier_too: bool) -> "_View":
        """Return the complex conjugate. // With `carrier_too` the carrier's frequency is mirrored as well."""
        read = self.samples.read

        def conjugate(start: int, count: int) -> Floats:
            planes = read(start, count).copy()
            np.negative(planes[1], out=planes[1])
            return planes

        return _View(
            samples=replace(self.samples, read=conjugate),
            carrier_hz=(-1.0 if carrier_too else 1.0) * self.carrier_hz,
            mirrored=not self.mirrored,
        )


def inspect_recording(samples: Samples) -> Inspection:
    """Describe what is in an open recording, from its front end's statistics and half a second of signals at most.

    Where codes and carriers show that the rate or the carrier's frequency is stated wrong, it is read as they show.

    Raises NotEnoughData for fewer than two code periods.
    """
    first = inspect_samples(samples)
    near = first if len(first.satellites) >= POLICY.fix_satellites else _inspect_other_rates(first)
    apart = estimate_from_survey(near.survey, {satellite.sat: satellite.doppler_hz for satellite in near.satellites})
    if apart is None or not apart.certain or near.conjugate:
        return first
    right = correct_samples(near.samples, apart)
    inspection = inspect_samples(right)
    return replace(
        inspection,
        given=samples,
        disagreement=apart,
        remarks=(remark_on_correction(samples, right, apart.sigma), *inspection.remarks),
    )


def _inspect_other_rates(first: Inspection) -> Inspection:
    """Inspect at the nearest rate that shows enough satellites; at the rate given if none does."""
    if abs(first.front_end.carrier_hz) > 0.5 * first.samples.rate_hz:
        return first
    for ppm in POLICY.other_rates_ppm:
        other = replace(first.samples, rate_hz=first.samples.rate_hz * (1.0 + 1e-6 * ppm))
        view = _View(samples=condition(other, first.front_end), carrier_hz=first.front_end.carrier_hz)
        periods, reach_hz = POLICY.first_periods, POLICY.reach_hz
        peaks = _search(view, 0, min(periods, _count_periods(other, other.n_samples)), 0.0, reach_hz)
        if len({peak.sat for peak in peaks}) >= POLICY.fix_satellites:
            return inspect_samples(other)
    return first


def inspect_samples(samples: Samples, *, peaks: Sequence[Peak] = ()) -> Inspection:
    """Inspect an open recording by its description.

    peaks : found by an earlier search of its start, Dopplers from the nominal carrier; with enough of them no further
        search runs.

    Raises NotEnoughData for fewer than two code periods.
    """
    if samples.duration_s < POLICY.least_periods * GPS_L1_CA.period_s:
        raise NotEnoughData(
            f"{samples.path or samples.name}: {samples.duration_s * 1e3:.2g} ms of samples; a search needs "
            f"{POLICY.least_periods} ms at least: give a longer recording, or check rate_hz and bits"
        )
    front = measure_front_end(samples, false_alarm_probability=POLICY.alarm_probability)
    view = _View(samples=condition(samples, front), carrier_hz=front.carrier_hz)
    if abs(front.carrier_hz) > 0.5 * samples.rate_hz:
        away = f"the band recorded, around {samples.centre_hz / 1e6:.3f} MHz, does not hold {GPS_L1_CA.name}"
        return assemble_inspection(samples, front, (), Survey(), None, (0, 0), (f"{away}; nothing was looked for",))
    found = [peak for peak in peaks if abs(peak.doppler_hz) < POLICY.second_reach_hz]
    if len(found) < POLICY.fix_satellites:
        view, found = _search_readings(view, front.real)
    if not found:
        return assemble_inspection(samples, front, (), Survey(), None, (0, samples.n_samples))
    measured = survey_recorder(view.samples, view.carrier_hz, found, false_alarm_probability=POLICY.alarm_probability)
    conjugate = None if _count_readings(view, front.real) == 1 else view.mirrored
    if measured.conjugate is not None:
        conjugate = view.mirrored != measured.conjugate
    if measured.conjugate:
        view = view.flip(carrier_too=True)
        found = [replace(peak, doppler_hz=-peak.doppler_hz) for peak in found]
    stretch = _find_longest_stretch(samples, measured)
    common = estimate_oscillator_error([peak.doppler_hz for peak in found])
    reach_hz = DOPPLER_LIMIT_HZ + 2.0 * common.sigma_hz
    periods = _count_periods(samples, stretch[1] - stretch[0])
    final = _search(view, stretch[0], periods, common.doppler_hz, reach_hz)
    satellites = _satellites(final, stretch[0], samples) if final else _satellites(found, 0, samples)
    return assemble_inspection(samples, front, satellites, measured, conjugate, stretch)


def _count_periods(samples: Samples, n_samples: int) -> int:
    """Count the whole code periods in so many samples, up to the most that are searched."""
    return min(math.floor(n_samples / samples.rate_hz / GPS_L1_CA.period_s + 1e-6), POLICY.second_periods)


def _count_readings(view: _View, real: bool) -> int:
    """Count the readings of the spectrum that differ in where they show satellites."""
    return 1 if real or abs(view.carrier_hz) < 1.0 / GPS_L1_CA.period_s else 2


def _search_readings(view: _View, real: bool) -> tuple[_View, list[Peak]]:
    """Find the reading of the spectrum that shows satellites, and their peaks.

    The first that shows enough, else the one that shows most.
    """
    views = [view, view.flip(carrier_too=False)][: _count_readings(view, real)]
    best: tuple[int, _View, list[Peak]] = (0, view, [])
    for periods, reach_hz in ((POLICY.first_periods, POLICY.reach_hz), (POLICY.second_periods, POLICY.second_reach_hz)):
        for reading in views:
            length = min(periods, _count_periods(reading.samples, reading.samples.n_samples))
            peaks = _search(reading, 0, length, 0.0, reach_hz)
            n_sats = len({peak.sat for peak in peaks})
            if n_sats > best[0]:
                best = (n_sats, reading, peaks)
        if best[0] >= POLICY.fix_satellites:
            break
    return best[1], best[2]


def _search(view: _View, start: int, periods: int, middle_hz: float, reach_hz: float) -> list[Peak]:
    settings = SearchSettings(false_alarm_probability=POLICY.alarm_probability, n_sums=periods)
    searcher = Searcher(GPS_L1_CA, view.samples.rate_hz, settings)
    step_hz = settings.doppler_step_hz
    steps = np.arange(math.floor((middle_hz - reach_hz) / step_hz), math.ceil((middle_hz + reach_hz) / step_hz) + 1)
    dopplers_hz = steps.astype(np.float64) * step_hz
    planes = view.samples.read(start, searcher.n_samples)
    return searcher.search(planes, view.carrier_hz, {sat: dopplers_hz for sat in GPS_SATS}, {})


def _find_longest_stretch(samples: Samples, survey: Survey) -> tuple[int, int]:
    """Find the longest stretch without gaps, the first of those nearly as long."""
    guards = [(gap.at_sample, math.ceil(3.0 * gap.at_sigma_samples)) for gap in survey.gaps]
    guards += [(gap.at_sample, 0) for gap in samples.gaps]
    guards.sort()
    begins = [0, *(at + guard for at, guard in guards)]
    ends = [*(at - guard for at, guard in guards), samples.n_samples]
    stretches = [(begin, end) for begin, end in zip(begins, ends, strict=True) if end > begin]
    most = max(end - begin for begin, end in stretches)
    return next(stretch for stretch in stretches if stretch[1] - stretch[0] >= 0.9 * most)


def _satellites(peaks: Sequence[Peak], start: int, samples: Samples) -> tuple[Satellite, ...]:
    found: dict[str, list[Peak]] = {}
    for peak in peaks:
        found.setdefault(peak.sat, []).append(peak)
    satellites = []
    for sat, mine in sorted(found.items()):
        strongest = max(mine, key=lambda peak: peak.cn0_dbhz)
        start_s = start / samples.rate_hz
        period_s = GPS_L1_CA.period_s * (1.0 - strongest.doppler_hz / GPS_L1_CA.carrier_hz)
        phase_s = (start_s + strongest.delay_s) % period_s
        satellites.append(
            Satellite(
                sat=sat,
                cn0_dbhz=strongest.cn0_dbhz,
                doppler_hz=strongest.doppler_hz,
                code_phase_chips=float(phase_s / period_s * GPS_L1_CA.code_length),
                peaks=len(mine),
            )
        )
    return tuple(satellites)


def assemble_inspection(
    samples: Samples,
    front: MeasuredFrontEnd,
    satellites: tuple[Satellite, ...],
    survey: Survey,
    conjugate: bool | None,
    stretch: tuple[int, int],
    remarks: Sequence[str] = (),
) -> Inspection:
    """Assemble an inspection with the oscillator's error, remarks, summary and advice."""
    oscillator = estimate_oscillator_error([satellite.doppler_hz for satellite in satellites])
    return Inspection(
        samples=samples,
        front_end=front,
        satellites=satellites,
        survey=survey,
        conjugate=conjugate,
        oscillator=oscillator,
        stretch=stretch,
        remarks=(
            *samples.remarks,
            *remarks,
            *front.remarks,
            *remark_on_power(front),
            *remark_on_signals(samples, survey, conjugate, oscillator),
        ),
        summary=summary(samples, satellites, survey, conjugate, front),
        advice=advise(samples, satellites, gaps=max(len(survey.gaps), len(samples.gaps)), mirrored=bool(conjugate)),
    )
