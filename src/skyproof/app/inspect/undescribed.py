"""A recording that nothing describes: read in the way that shows satellites, and the sidecar that describes it."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from skyproof.app.inspect.guess import Guess, guess
from skyproof.app.inspect.inspection import Inspection, make_plain
from skyproof.app.inspect.opening import read_as
from skyproof.app.inspect.policy import POLICY
from skyproof.app.inspect.signals import assemble_inspection, inspect_samples
from skyproof.errors import InputError, OutputError, SettingsError
from skyproof.formats.atomic_write import write_lines
from skyproof.formats.raw import SampleLayout, write_sidecar_text
from skyproof.gnss.time import format_iso
from skyproof.recording.conditioning import measure_front_end
from skyproof.recording.survey import Survey
from skyproof.records import Samples

__all__ = ["NotUnderstood", "inspect_by_guess", "write_sidecar_lines"]


class NotUnderstood(InputError):
    """Nothing states how to read a file, and nothing convincing was found in it. guess : what was tried."""

    def __init__(self, tried: Guess) -> None:
        super().__init__(f"{tried.path}: {tried.summary}")
        self.guess = tried

    def document(self) -> dict[str, Any]:
        """Return what `--json` prints in place of an inspection."""
        cleaned: dict[str, Any] = make_plain(
            {
                "format": "skyproof-inspect/1",
                "path": str(self.guess.path),
                "summary": self.guess.summary,
                "proposals": [proposal.document() for proposal in self.guess.proposals],
            }
        )
        return cleaned

    def inspect_first_proposal(self) -> Inspection:
        """Measure the front end in the first proposal, without satellites.

        Raises InputError if the samples do not change.
        """
        samples = read_as(self.guess.path, self.guess.proposals[0].layout, "proposal.toml")
        front = measure_front_end(samples, false_alarm_probability=POLICY.alarm_probability)
        return assemble_inspection(samples, front, (), Survey(), None, (0, samples.n_samples))


def inspect_by_guess(path: Path, write: bool | int) -> Inspection:
    """Inspect in the reading that shows satellites, corrected by them; write its sidecar if asked."""
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
    inspection = inspect_samples(read_as(path, layout, name), peaks=proposal.peaks)
    if not proposal.round_rate and (better := _choose_rate_hz(layout, inspection.survey)) is not None:
        layout = layout.model_copy(update={"rate_hz": better})
        sources["rate_hz"] = "measured: code period and drift"
        inspection = inspect_samples(read_as(path, layout, name), peaks=proposal.peaks)
    if inspection.conjugate:
        layout, sources = _mirror_layout(layout, sources)
        inspection = _mirror_inspection(inspection, read_as(path, layout, name))
    inspection = replace(
        inspection,
        layout=layout,
        sources=sources | {"start_gpst": _start_words(found), "duration": "length of the file"},
        proposals=tuple(replace(p, layout=layout, sources=sources) if p is proposal else p for p in found.proposals),
        taken=number,
        remarks=inspection.remarks
        + (
            (
                f"it seems to interleave {proposal.interleaved}: the satellites, their number and C/N0 are those of "
                "a mixture",
            )
            if proposal.interleaved
            else ()
        ),
    )
    return _with_sidecar(inspection, path.with_suffix(".toml")) if write else inspection


def _start_words(found: Guess) -> str:
    return (
        "nothing states it"
        if found.start_utc is None
        else f"not taken; the file's name has {format_iso(found.start_utc, 0)}"
    )


def _choose_rate_hz(layout: SampleLayout, survey: Survey) -> float | None:
    """Choose the rate at which sampling clock and oscillator agree, rounded within its error."""
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


def _mirror_layout(layout: SampleLayout, sources: Mapping[str, str]) -> tuple[SampleLayout, dict[str, str]]:
    """Invert the reading of the spectrum in the layout."""
    sign = "measured: drift of code and carrier"
    key = "conjugate" if layout.kind == "complex" else "if_hz"
    changes: dict[str, Any] = {"conjugate": True} if layout.kind == "complex" else {"if_hz": -layout.if_hz}
    if layout.kind == "complex":
        changes["if_hz"] = -layout.if_hz + 0.0
    return SampleLayout.model_validate({**layout.model_dump(exclude_unset=True), **changes}), {**sources, key: sign}


def _mirror_inspection(inspection: Inspection, samples: Samples) -> Inspection:
    """Repeat the inspection's results for the mirrored recording: its Dopplers are right already."""
    front = measure_front_end(samples, false_alarm_probability=POLICY.alarm_probability)
    ratio = -inspection.survey.doppler_ratio if inspection.survey.conjugate else inspection.survey.doppler_ratio
    right = replace(inspection.survey, conjugate=False, doppler_ratio=ratio)
    return assemble_inspection(samples, front, inspection.satellites, right, False, inspection.stretch)


def write_sidecar_lines(inspection: Inspection) -> list[str]:
    """Write the lines of the sidecar of an undescribed recording, with what was measured."""
    assert inspection.layout is not None
    lines = [
        f"{line}  # {inspection.sources[key]}" if (key := line.split(" = ")[0]) in inspection.sources else line
        for line in write_sidecar_text(inspection.layout).splitlines()
    ]
    lines[0] += ", determined by `skyproof inspect`"
    return lines


def _with_sidecar(inspection: Inspection, sidecar: Path) -> Inspection:
    """Write how to read the recording beside it; a remark where that cannot be."""
    try:
        if sidecar.exists():
            return inspection
        write_lines(sidecar, write_sidecar_lines(inspection), encoding="utf-8")
    except OutputError as error:
        return replace(inspection, remarks=(*inspection.remarks, f"the sidecar was not written: {error}"))
    return replace(inspection, sidecar=str(sidecar))
