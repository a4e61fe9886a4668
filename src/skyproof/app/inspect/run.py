"""What is in a recording, and is it usable: front end, satellites, lost samples, mirrored spectrum, oscillator."""

import json
import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from skyproof.app.inspect.advice import advice, correction_remark, oscillator_remarks, signal_remarks, summary
from skyproof.app.inspect.guess import Guess, Proposal, guess
from skyproof.app.inspect.signal_pictures import write_pictures
from skyproof.arrays import Floats
from skyproof.errors import InputError, NotEnoughData, OutputError, SettingsError, fault_words
from skyproof.formats.atomic_write import write_lines
from skyproof.formats.raw import SampleLayout, open_raw_channels, read_sidecar, sidecar_text
from skyproof.formats.recording import open_recording
from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS
from skyproof.gnss.time import iso
from skyproof.receiver.acquisition import Peak, Searcher, SearchSettings
from skyproof.receiver.clock_agreement import Disagreement, corrected, in_survey
from skyproof.recording.conditioning import FrontEnd, conditioned, measure_front_end
from skyproof.recording.survey import DOPPLER_LIMIT_HZ, OscillatorError, Survey, oscillator_error, survey
from skyproof.records import Samples
from skyproof.verdict import notebook_html

__all__ = [
    "Inspection",
    "NotUnderstood",
    "Satellite",
    "document_json",
    "inspect",
    "inspect_recording",
    "inspect_samples",
    "oscillator_remarks",
    "write_pictures",
]

FALSE_ALARM_PROBABILITY: Final = 1e-4
"""Of each search, of the lines, and of the gaps."""

_ENOUGH_SATS: Final = 4
_ATTEMPTS: Final = ((20, 7e3), (100, 20e3))
"""Code periods and reach in Doppler of the first looks: short and near, then long and wide."""
_LONGEST_PERIODS: Final = 100
"""Of a search: finds 34 dB-Hz. Five times as many find cross-correlations of what cannot be taken out well enough."""
_LEAST_PERIODS: Final = 2
_OTHER_RATES_PPM: Final = (-50.0, 50.0, -100.0, 100.0)
"""Off the rate given, where that shows too few satellites: a search of 20 ms reaches 25 to either side."""
_LEVELS_TOLD: Final = 16


@dataclass(frozen=True, kw_only=True)
class Satellite:
    """One satellite heard. `code_phase_chips`: how long after the recording's first sample a code period begins, 0 to
    1023. `peaks` : how many signals of it there are; the numbers are those of the strongest."""

    sat: str
    cn0_dbhz: float
    doppler_hz: float
    code_phase_chips: float
    peaks: int


@dataclass(frozen=True, eq=False, kw_only=True)
class Inspection:
    """What `inspect` finds in one recording.

    conjugate : whether the samples, as they were read, are the complex conjugate of what they should be; None if that
        is not known. Dopplers are those of the right reading.
    stretch : first and last sample (exclusive) of the longest stretch without a gap; satellites are those of its first
        tenth of a second.
    advice : what `protect` can do with it, and what would make it stronger.
    sources : where each fact of how to read it comes from; keys as in a sidecar, and "duration".
    proposals : where nothing described it, the ways to read it that were found; `taken` is the number of the one that
        was taken, from 0.
    sidecar : what was written to say so, if it was; None otherwise.
    given : the recording as it is described, where `samples` are read at another rate or carrier, by which its codes
        and carriers agree; None otherwise. disagreement : how far they were apart.
    """

    samples: Samples
    front_end: FrontEnd
    satellites: tuple[Satellite, ...]
    survey: Survey
    conjugate: bool | None
    oscillator: OscillatorError
    stretch: tuple[int, int]
    remarks: tuple[str, ...]
    summary: str
    advice: str = ""
    sources: Mapping[str, str] = field(default_factory=dict)
    layout: SampleLayout | None = None
    proposals: tuple[Proposal, ...] = ()
    taken: int = 0
    sidecar: str | None = None
    given: Samples | None = None
    disagreement: Disagreement | None = None

    def document(self) -> dict[str, Any]:
        """As `--json` prints it: keys in order, numbers unrounded, None for what is absent."""
        samples, front, survey = self.samples, self.front_end, self.survey
        few = front.levels.size <= _LEVELS_TOLD
        start, apart = samples.start_gpst, self.disagreement
        document = {
            "format": "skyproof-inspect/1",
            "path": samples.path,
            "name": samples.name,
            "sample_format": samples.format,
            "kind": "real" if front.real else "complex",
            "rate_hz": samples.rate_hz,
            "centre_hz": samples.centre_hz,
            "if_hz": samples.if_hz,
            "given": None if self.given is None else {"rate_hz": self.given.rate_hz, "if_hz": self.given.if_hz},
            "code_minus_carrier_ppm": None if apart is None else apart.code_minus_carrier * 1e6,
            "code_minus_carrier_sigma_ppm": None if apart is None else apart.sigma * 1e6,
            "duration_s": samples.duration_s,
            "start_gpst": None if start is None else iso(start),
            "layout": None if self.layout is None else _layout_document(self.layout),
            "sources": dict(self.sources),
            "levels": {
                "rms": front.rms,
                "dc_over_rms": np.where(front.rms > 0.0, front.dc / np.where(front.rms > 0.0, front.rms, 1.0), 0.0),
                "gain_imbalance_db": front.gain_imbalance_db,
                "phase_imbalance_deg": front.phase_imbalance_deg,
                "image_db": front.image_db,
                "values": front.levels if few else None,
                "shares": front.level_shares if few else None,
                "extreme_share": front.extreme_share,
            },
            "band_hz": list(front.band_hz),
            "noise_bandwidth_hz": front.noise_bandwidth_hz,
            "lines": [
                {
                    "frequency_hz": line.frequency_hz,
                    "over_floor_db": line.over_floor_db,
                    "jn0_dbhz": line.jn0_dbhz,
                    "loss_db": line.loss_db,
                    "notched": line in front.notched,
                }
                for line in front.lines
            ],
            "line_threshold_db": front.line_threshold_db,
            "conjugate": self.conjugate,
            "conjugate_error_probability": survey.conjugate_error_probability,
            "doppler_ratio": survey.doppler_ratio,
            "doppler_ratio_sigma": survey.doppler_ratio_sigma,
            "gaps": [
                {
                    "at_sample": gap.at_sample,
                    "at_sigma_samples": gap.at_sigma_samples,
                    "missing_samples_modulo_period": gap.missing_samples,
                    "missing_sigma_samples": gap.missing_sigma_samples,
                    "period_samples": gap.period_samples,
                }
                for gap in survey.gaps
            ],
            "gaps_stated": [
                {"at_sample": gap.at_sample, "missing_samples": gap.missing_samples} for gap in samples.gaps
            ],
            "oscillator_error_hz": self.oscillator.doppler_hz,
            "oscillator_error_sigma_hz": self.oscillator.sigma_hz,
            "oscillator_error_ppm": self.oscillator.doppler_hz / GPS_L1_CA.carrier_hz * 1e6,
            "oscillator_error_sigma_ppm": self.oscillator.sigma_hz / GPS_L1_CA.carrier_hz * 1e6,
            "clock_minus_lo_ppm": survey.clock_minus_lo_ppm,
            "clock_minus_lo_sigma_ppm": survey.clock_minus_lo_sigma_ppm,
            "examined_samples": list(self.stretch),
            "satellites": [vars(satellite) for satellite in self.satellites],
            "remarks": list(self.remarks),
            "summary": self.summary,
            "advice": self.advice,
            "proposals": [proposal.document() for proposal in self.proposals],
            "proposal_taken": self.taken if self.proposals else None,
            "sidecar_written": self.sidecar,
        }
        cleaned: dict[str, Any] = _plain(document)
        return cleaned

    def _repr_html_(self) -> str:
        """What it is, what is odd and which satellites were heard, for a notebook."""
        samples = self.samples
        kind = "real" if self.front_end.real else "complex"
        columns = ("satellite", "C/N0, dB-Hz", "Doppler, Hz", "code phase, chips", "signals")
        return notebook_html(
            samples.path or samples.name,
            [
                self.summary,
                f"{kind}, {samples.rate_hz / 1e6:.12g} MHz, {samples.centre_hz / 1e6:.12g} MHz at "
                f"{samples.if_hz / 1e6:.12g} MHz, {samples.duration_s:.4g} s.",
                *self.remarks,
                self.advice,
            ],
            (
                columns,
                [
                    (
                        one.sat,
                        f"{one.cn0_dbhz:.1f}",
                        f"{one.doppler_hz:+.0f}",
                        f"{one.code_phase_chips:.1f}",
                        str(one.peaks),
                    )
                    for one in self.satellites
                ],
            ),
        )


class NotUnderstood(InputError):
    """Nothing tells how to read a file, and nothing convincing was found in it. guess : what was tried."""

    def __init__(self, tried: Guess) -> None:
        super().__init__(f"{tried.path}: {tried.summary}")
        self.guess = tried

    def document(self) -> dict[str, Any]:
        """For --json, in place of an inspection's."""
        cleaned: dict[str, Any] = _plain(
            {
                "format": "skyproof-inspect/1",
                "path": str(self.guess.path),
                "summary": self.guess.summary,
                "proposals": [proposal.document() for proposal in self.guess.proposals],
            }
        )
        return cleaned

    def likeliest(self) -> Inspection:
        """The front end in the first proposal, without satellites: its frequencies are as sure as its rate.

        Raises InputError if the samples do not change.
        """
        samples = _read_as(self.guess.path, self.guess.proposals[0].layout, "proposal.toml")
        front = measure_front_end(samples, false_alarm_probability=FALSE_ALARM_PROBABILITY)
        return _inspection(samples, front, (), Survey(), None, (0, samples.n_samples))


def inspect(
    path: str | Path,
    *,
    sidecar: str | Path | None = None,
    layout: Mapping[str, object] | None = None,
    write: bool | int = False,
) -> tuple[Inspection, ...]:
    """Say what is in a recording: one `Inspection` for each channel that the file holds.

        (inspection,) = sp.inspect("rx1.bin")
        print(inspection.summary, inspection.satellites)

    A file that nothing describes is read in the way that shows satellites, if there is one.

    Parameters
    ----------
    path : any file that `skyproof.formats.recording.open_recording` opens, or raw samples that nothing describes.
    sidecar : how to read raw samples; NAME.toml beside NAME.bin if not given.
    layout : keys of a sidecar's table [samples], which go before those of the sidecar and may stand for it.
    write : whether to write NAME.toml for a file that nothing describes; a number takes that of `proposals`, from 1 on,
        in place of the best. What is there already is never overwritten.

    Returns
    -------
    tuple of Inspection : one for each channel.

    Raises
    ------
    InputError : the file cannot be opened or read. SettingsError : the layout makes no sense.
    NotUnderstood : nothing describes the file, and nothing in it does. NotEnoughData : fewer than two code periods.
    """
    path = Path(path)
    given = {key: value for key, value in (layout or {}).items() if value is not None}
    if given:
        recordings, sources, used = _opened_as(path, sidecar, given)
    elif sidecar is not None or _is_described(path):
        recordings, sources, used = _opened(path, sidecar)
    else:
        return (_guessed(path, write),)
    found = [inspect_recording(samples) for samples in recordings]
    return tuple(replace(one, sources=sources | _measured_sources(one), layout=used) for one in found)


def _measured_sources(found: Inspection) -> dict[str, str]:
    """Of what is read otherwise than it is described."""
    if found.given is None:
        return {}
    key = "rate_hz" if found.given.rate_hz != found.samples.rate_hz else "if_hz"
    return {key: f"measured: codes against carriers; given: {getattr(found.given, key):.12g}"}


def document_json(inspections: Sequence[Inspection]) -> str:
    """The document of one recording; of several channels, a list of them."""
    documents = [inspection.document() for inspection in inspections]
    return json.dumps(documents[0] if len(documents) == 1 else documents, indent=1, allow_nan=False) + "\n"


def _layout_document(layout: SampleLayout) -> dict[str, Any]:
    values = {key: getattr(layout, key) for key in type(layout).model_fields}
    return {key: iso(value) if isinstance(value, np.datetime64) else value for key, value in values.items()}


# --- opening


def _is_described(path: Path) -> bool:
    """By SigMF or a sidecar. A file that is not there is left to those, who say so."""
    beside = (path.with_suffix(".toml"), path.with_suffix(".sigmf-meta"))
    return ".sigmf" in path.suffix or not path.is_file() or any(one.exists() for one in beside)


def _opened(path: Path, sidecar: str | Path | None) -> tuple[tuple[Samples, ...], dict[str, str], SampleLayout | None]:
    recordings = open_recording(path, sidecar)
    if recordings[0].format != "raw":
        return recordings, _sources_of(recordings[0], SampleLayout.model_fields, "SigMF metadata"), None
    beside = Path(sidecar) if sidecar is not None else path.with_suffix(".toml")
    stated = read_sidecar(beside)
    return recordings, _sources_of(recordings[0], stated.model_fields_set, f"sidecar {beside.name}"), stated


def _opened_as(
    path: Path, sidecar: str | Path | None, given: Mapping[str, object]
) -> tuple[tuple[Samples, ...], dict[str, str], SampleLayout | None]:
    beside = Path(sidecar) if sidecar is not None else path.with_suffix(".toml")
    stated = read_sidecar(beside).model_dump(exclude_unset=True) if sidecar is not None or beside.is_file() else {}
    stated = {key: iso(value) if isinstance(value, np.datetime64) else value for key, value in stated.items()}
    try:
        layout = SampleLayout.model_validate({**stated, **given})
    except ValidationError as error:
        faults = "; ".join(fault_words(".".join(map(str, one["loc"])), one) for one in error.errors(include_url=False))
        raise SettingsError(
            f"{path}: the options do not say how to read it: {faults}; give rate_hz, kind, encoding and bits at least"
        ) from error
    recordings = _channels_as(path, layout, "options.toml")
    sources = _sources_of(recordings[0], stated, f"sidecar {beside.name}") | {key: "option" for key in given}
    return recordings, sources, layout


def _sources_of(samples: Samples, stated: Any, by: str) -> dict[str, str]:
    keys = ("encoding", "bits", "kind", "rate_hz", "centre_hz", "if_hz", "start_gpst")
    sources = {key: by if key in stated else "default" for key in keys}
    if samples.start_gpst is None:
        sources["start_gpst"] = "nothing states it"
    return sources | {"duration": "length of the file"}


def _read_as(path: Path, layout: SampleLayout, name: str) -> Samples:
    return _channels_as(path, layout, name)[0]


def _channels_as(path: Path, layout: SampleLayout, name: str) -> tuple[Samples, ...]:
    with tempfile.TemporaryDirectory() as folder:
        written = Path(folder) / name
        written.write_text(sidecar_text(layout), encoding="utf-8")
        return open_raw_channels(path, written)


# --- what nothing describes


def _guessed(path: Path, write: bool | int) -> Inspection:
    """The reading that shows satellites, set right by what they tell, and written down if asked for."""
    found = guess(path)
    chosen = isinstance(write, int) and not isinstance(write, bool) and write > 0
    if chosen and write > len(found.proposals):
        raise SettingsError(
            f"{path}: proposal {write} asked for, but there are {len(found.proposals)}; give one of them"
        )
    number = int(write) - 1 if chosen else 0
    if not chosen and not found.convincing:
        raise NotUnderstood(found)
    proposal = found.proposals[number]
    layout, sources, name = proposal.layout, dict(proposal.sources), path.with_suffix(".toml").name
    inspection = inspect_samples(_read_as(path, layout, name), peaks=proposal.peaks)
    if not proposal.round_rate and (better := _better_rate_hz(layout, inspection.survey)) is not None:
        layout = layout.model_copy(update={"rate_hz": better})
        sources["rate_hz"] = "measured: code period and drift"
        inspection = inspect_samples(_read_as(path, layout, name), peaks=proposal.peaks)
    if inspection.conjugate:
        layout, sources = _righted(layout, sources)
        inspection = _inspection_righted(inspection, _read_as(path, layout, name))
    inspection = replace(
        inspection,
        layout=layout,
        sources=sources | {"start_gpst": _start_words(found), "duration": "length of the file"},
        proposals=tuple(
            replace(one, layout=layout, sources=sources) if one is proposal else one for one in found.proposals
        ),
        taken=number,
        remarks=inspection.remarks
        + (
            (
                f"it looks like {proposal.interleaved} whose samples take turns: satellites, their "
                "number and C/N0 are those of a mixture",
            )
            if proposal.interleaved
            else ()
        ),
    )
    return _with_sidecar(inspection, path.with_suffix(".toml")) if write else inspection


def _start_words(found: Guess) -> str:
    return (
        "nothing states it" if found.start_utc is None else f"not taken; the file's name has {iso(found.start_utc, 0)}"
    )


def _better_rate_hz(layout: SampleLayout, survey: Survey) -> float | None:
    """The rate by which sampling clock and local oscillator are one, as round as its error allows; None if unknown."""
    sigma_hz = 1e-6 * survey.clock_minus_lo_sigma_ppm * layout.rate_hz
    if not abs(survey.clock_minus_lo_ppm) > 4.0 * survey.clock_minus_lo_sigma_ppm:
        return None
    exact_hz = layout.rate_hz * (1.0 + 1e-6 * survey.clock_minus_lo_ppm)
    # An oscillator is a few ppm off, or an intermediate frequency a few kilohertz: then so is this. A round number that
    # near is the rate, if such numbers are not so dense that there is one anyway.
    near_hz = 3e-6 * exact_hz
    round_hz = round(exact_hz, -math.ceil(math.log10(8.0 * near_hz)))
    if abs(round_hz - exact_hz) < near_hz:
        return round_hz
    digits = next((n for n in range(-5, 3) if abs(round(exact_hz, n) - exact_hz) < 3.0 * sigma_hz), 3)
    return round(exact_hz, digits)


def _righted(layout: SampleLayout, sources: Mapping[str, str]) -> tuple[SampleLayout, dict[str, str]]:
    """The reading that turns the spectrum round."""
    sign = "measured: drift of code and carrier"
    key = "conjugate" if layout.kind == "complex" else "if_hz"
    changes: dict[str, Any] = {"conjugate": True} if layout.kind == "complex" else {"if_hz": -layout.if_hz}
    if layout.kind == "complex":
        changes["if_hz"] = -layout.if_hz + 0.0
    return SampleLayout.model_validate({**layout.model_dump(exclude_unset=True), **changes}), {**sources, key: sign}


def _inspection_righted(inspection: Inspection, samples: Samples) -> Inspection:
    """The same inspection of the recording read the other way round: its Dopplers are right already."""
    front = measure_front_end(samples, false_alarm_probability=FALSE_ALARM_PROBABILITY)
    ratio = -inspection.survey.doppler_ratio if inspection.survey.conjugate else inspection.survey.doppler_ratio
    right = replace(inspection.survey, conjugate=False, doppler_ratio=ratio)
    return _inspection(samples, front, inspection.satellites, right, False, inspection.stretch)


def _with_sidecar(inspection: Inspection, sidecar: Path) -> Inspection:
    """Write how to read the recording beside it, and which of it was measured; a remark where that cannot be."""
    assert inspection.layout is not None
    lines = [
        f"{line}  # {inspection.sources[key]}" if (key := line.split(" = ")[0]) in inspection.sources else line
        for line in sidecar_text(inspection.layout).splitlines()
    ]
    lines[0] += ", found out by `skyproof inspect`"
    try:
        if sidecar.exists():
            return inspection
        write_lines(sidecar, lines, encoding="utf-8")
    except OutputError as error:
        return replace(inspection, remarks=(*inspection.remarks, f"the sidecar was not written: {error}"))
    return replace(inspection, sidecar=str(sidecar))


# --- one recording


@dataclass(frozen=True, eq=False, kw_only=True)
class _View:
    """The samples in one reading of their spectrum, and where the nominal carrier lies in that."""

    samples: Samples
    carrier_hz: float
    mirrored: bool = False

    def flipped(self, *, carrier_too: bool) -> "_View":
        """The complex conjugate. With `carrier_too` what lay at the carrier is still looked at, mirrored in itself."""
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
    """Say what is in an open recording, from its front end's statistics and half a second of signals at most.

    Where codes and carriers tell that its rate, or where the carrier lies, is given wrong, it is read as they tell.

    Raises NotEnoughData for fewer than two code periods.
    """
    first = inspect_samples(samples)
    near = first if len(first.satellites) >= _ENOUGH_SATS else _at_another_rate(first)
    apart = in_survey(near.survey, {one.sat: one.doppler_hz for one in near.satellites})
    if apart is None or not apart.certain or near.conjugate:
        return first
    right = corrected(near.samples, apart)
    inspection = inspect_samples(right)
    return replace(
        inspection,
        given=samples,
        disagreement=apart,
        remarks=(correction_remark(samples, right, apart.sigma), *inspection.remarks),
    )


def _at_another_rate(first: Inspection) -> Inspection:
    """The inspection at the nearest rate that shows enough satellites; that at the rate given if none does."""
    if abs(first.front_end.carrier_hz) > 0.5 * first.samples.rate_hz:
        return first
    for ppm in _OTHER_RATES_PPM:
        other = replace(first.samples, rate_hz=first.samples.rate_hz * (1.0 + 1e-6 * ppm))
        view = _View(samples=conditioned(other, first.front_end), carrier_hz=first.front_end.carrier_hz)
        periods, reach_hz = _ATTEMPTS[0]
        peaks = _search(view, 0, min(periods, _periods(other, other.n_samples)), 0.0, reach_hz)
        if len({peak.sat for peak in peaks}) >= _ENOUGH_SATS:
            return inspect_samples(other)
    return first


def inspect_samples(samples: Samples, *, peaks: Sequence[Peak] = ()) -> Inspection:
    """Say what is in an open recording, read as it is described.

    peaks : what a search of its start has found, Dopplers off the nominal carrier; enough of them spare another.

    Raises NotEnoughData for fewer than two code periods.
    """
    if samples.duration_s < _LEAST_PERIODS * GPS_L1_CA.period_s:
        raise NotEnoughData(
            f"{samples.path or samples.name}: {samples.duration_s * 1e3:.2g} ms of samples; a search needs "
            f"{_LEAST_PERIODS} ms at least: give a longer recording, or check rate_hz and bits"
        )
    front = measure_front_end(samples, false_alarm_probability=FALSE_ALARM_PROBABILITY)
    view = _View(samples=conditioned(samples, front), carrier_hz=front.carrier_hz)
    if abs(front.carrier_hz) > 0.5 * samples.rate_hz:
        away = f"the band recorded, around {samples.centre_hz / 1e6:.3f} MHz, does not hold {GPS_L1_CA.name}"
        return _inspection(samples, front, (), Survey(), None, (0, 0), (f"{away}; nothing was looked for",))
    found = [peak for peak in peaks if abs(peak.doppler_hz) < _ATTEMPTS[-1][1]]
    if len(found) < _ENOUGH_SATS:
        view, found = _first_looks(view, front.real)
    if not found:
        return _inspection(samples, front, (), Survey(), None, (0, samples.n_samples))
    measured = survey(view.samples, view.carrier_hz, found, false_alarm_probability=FALSE_ALARM_PROBABILITY)
    conjugate = None if _readings(view, front.real) == 1 else view.mirrored
    if measured.conjugate is not None:
        conjugate = view.mirrored != measured.conjugate
    if measured.conjugate:
        view = view.flipped(carrier_too=True)
        found = [replace(peak, doppler_hz=-peak.doppler_hz) for peak in found]
    stretch = _longest_stretch(samples, measured)
    common = oscillator_error([peak.doppler_hz for peak in found])
    reach_hz = DOPPLER_LIMIT_HZ + 2.0 * common.sigma_hz
    periods = _periods(samples, stretch[1] - stretch[0])
    final = _search(view, stretch[0], periods, common.doppler_hz, reach_hz)
    satellites = _satellites(final, stretch[0], samples) if final else _satellites(found, 0, samples)
    return _inspection(samples, front, satellites, measured, conjugate, stretch)


def _periods(samples: Samples, n_samples: int) -> int:
    """Whole code periods in so many samples, up to the most that are searched."""
    return min(math.floor(n_samples / samples.rate_hz / GPS_L1_CA.period_s + 1e-6), _LONGEST_PERIODS)


def _readings(view: _View, real: bool) -> int:
    """How many readings of the spectrum differ in where they show satellites: one if the carrier is at zero."""
    return 1 if real or abs(view.carrier_hz) < 1.0 / GPS_L1_CA.period_s else 2


def _first_looks(view: _View, real: bool) -> tuple[_View, list[Peak]]:
    """The reading of the spectrum that shows satellites, and those: the first that shows enough, else the one that
    shows most."""
    views = [view, view.flipped(carrier_too=False)][: _readings(view, real)]
    best: tuple[int, _View, list[Peak]] = (0, view, [])
    for periods, reach_hz in _ATTEMPTS:
        for one in views:
            length = min(periods, _periods(one.samples, one.samples.n_samples))
            peaks = _search(one, 0, length, 0.0, reach_hz)
            n_sats = len({peak.sat for peak in peaks})
            if n_sats > best[0]:
                best = (n_sats, one, peaks)
        if best[0] >= _ENOUGH_SATS:
            break
    return best[1], best[2]


def _search(view: _View, start: int, periods: int, middle_hz: float, reach_hz: float) -> list[Peak]:
    settings = SearchSettings(false_alarm_probability=FALSE_ALARM_PROBABILITY, n_sums=periods)
    searcher = Searcher(GPS_L1_CA, view.samples.rate_hz, settings)
    step_hz = settings.doppler_step_hz
    steps = np.arange(math.floor((middle_hz - reach_hz) / step_hz), math.ceil((middle_hz + reach_hz) / step_hz) + 1)
    dopplers_hz = steps.astype(np.float64) * step_hz
    planes = view.samples.read(start, searcher.n_samples)
    return searcher.search(planes, view.carrier_hz, {sat: dopplers_hz for sat in GPS_SATS}, {})


def _longest_stretch(samples: Samples, survey: Survey) -> tuple[int, int]:
    """Between gaps, found or survey; the first of those that are all but as long as the longest."""
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


# --- telling


def _inspection(
    samples: Samples,
    front: FrontEnd,
    satellites: tuple[Satellite, ...],
    survey: Survey,
    conjugate: bool | None,
    stretch: tuple[int, int],
    remarks: Sequence[str] = (),
) -> Inspection:
    oscillator = oscillator_error([satellite.doppler_hz for satellite in satellites])
    return Inspection(
        samples=samples,
        front_end=front,
        satellites=satellites,
        survey=survey,
        conjugate=conjugate,
        oscillator=oscillator,
        stretch=stretch,
        remarks=(*samples.remarks, *remarks, *front.remarks, *signal_remarks(samples, survey, conjugate, oscillator)),
        summary=summary(samples, satellites, survey, conjugate, front),
        advice=advice(samples, satellites, gaps=max(len(survey.gaps), len(samples.gaps)), mirrored=bool(conjugate)),
    )


def _plain(value: Any) -> Any:
    """For JSON: arrays as lists, numbers that are not finite as None."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(item) for item in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.integer):
        return int(value)
    return value
