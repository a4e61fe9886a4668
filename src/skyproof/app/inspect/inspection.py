"""What `inspect` finds in one recording: the record, and the document that `--json` prints."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

import numpy as np

from skyproof.app.inspect.advice import estimate_power_over_quietest
from skyproof.app.inspect.guess import Proposal
from skyproof.formats.raw import SampleLayout
from skyproof.gnss.received_power import JammerToNoise
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.gnss.time import format_iso
from skyproof.receiver.clock_agreement import Disagreement
from skyproof.recording.conditioning import MeasuredFrontEnd
from skyproof.recording.survey import OscillatorError, Survey
from skyproof.records import Samples
from skyproof.short_repr import ShortRepr, write_notebook_html

__all__ = ["Inspection", "Satellite", "make_plain", "write_document_json"]
_LEVELS_LISTED: Final = 16


@dataclass(frozen=True, kw_only=True)
class Satellite:
    """A satellite received. `code_phase_chips`: how long after the recording's first sample a code period begins, 0 to
    1023. `peaks` : how many signals of it there are; the numbers are those of the strongest."""

    sat: str
    cn0_dbhz: float
    doppler_hz: float
    code_phase_chips: float
    peaks: int


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Inspection(ShortRepr):
    """What `inspect` finds in one recording.

    conjugate : whether the samples, as they were read, are the complex conjugate of what they should be; None if that
        is not known. Dopplers are those of the right reading.
    stretch : first and last sample (exclusive) of the longest stretch without a gap; satellites are those of its first
        tenth of a second.
    advice : what `protect` can do with it, and what would make it stronger.
    sources : where each fact of how to read it comes from; keys as in a sidecar, and "duration".
    proposals : where nothing described it, the ways to read it that were found; `taken` is the number of the one that
        was taken, from 0.
    sidecar : the sidecar that was written; None if none was.
    given : the recording by its description, where `samples` are read at another rate or carrier, by which its codes
        and carriers agree; None otherwise. disagreement : how far they were apart.
    """

    samples: Samples
    front_end: MeasuredFrontEnd
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

    @property
    def jammer(self) -> JammerToNoise | None:
        """Estimate what comes in over the noise of the quietest stretch; None if the power stays the same."""
        return estimate_power_over_quietest(self.front_end)

    def document(self) -> dict[str, Any]:
        """Return the document that `--json` prints: keys in order, numbers unrounded, None for what is absent."""
        samples, front, survey = self.samples, self.front_end, self.survey
        few = front.levels.size <= _LEVELS_LISTED
        start, apart, jammer = samples.start_gpst, self.disagreement, self.jammer
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
            "start_gpst": None if start is None else format_iso(start),
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
            "power": {
                "seconds": front.stretch_s,
                "power_db": front.power_db,
                "jammer_to_noise_db": None if jammer is None else jammer.db,
                "jammer_to_noise_low_db": None if jammer is None else jammer.low_db,
                "jammer_to_noise_high_db": None if jammer is None else jammer.high_db,
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
        cleaned: dict[str, Any] = make_plain(document)
        return cleaned

    def _repr_html_(self) -> str:
        """Show the recording, its oddities and its satellites in a notebook."""
        samples = self.samples
        kind = "real" if self.front_end.real else "complex"
        columns = ("satellite", "C/N0, dB-Hz", "Doppler, Hz", "code phase, chips", "signals")
        return write_notebook_html(
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
                        satellite.sat,
                        f"{satellite.cn0_dbhz:.1f}",
                        f"{satellite.doppler_hz:+.0f}",
                        f"{satellite.code_phase_chips:.1f}",
                        str(satellite.peaks),
                    )
                    for satellite in self.satellites
                ],
            ),
        )


class _Documented(Protocol):
    def document(self) -> dict[str, Any]: ...


def write_document_json(inspections: Sequence[_Documented]) -> str:
    """Write the document of one recording; of several channels, a list of them."""
    documents = [inspection.document() for inspection in inspections]
    return json.dumps(documents[0] if len(documents) == 1 else documents, indent=1, allow_nan=False) + "\n"


def _layout_document(layout: SampleLayout) -> dict[str, Any]:
    values = {key: getattr(layout, key) for key in type(layout).model_fields}
    return {key: format_iso(value) if isinstance(value, np.datetime64) else value for key, value in values.items()}


def make_plain(value: Any) -> Any:
    """Convert values for JSON: arrays as lists, numbers that are not finite as None."""
    if isinstance(value, dict):
        return {key: make_plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [make_plain(item) for item in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.integer):
        return int(value)
    return value
