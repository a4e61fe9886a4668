"""What a recording's signals show of the recorder, in words: why little was received, and what was corrected."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from skyproof.app.inspect import Inspection, remark_on_oscillator
from skyproof.app.receive.policy import POLICY
from skyproof.errors import NotEnoughData
from skyproof.receiver.channels import Gap
from skyproof.recording.survey import estimate_oscillator_error
from skyproof.records import Samples
from skyproof.remarks import Remark, RemarkKind

__all__ = ["Diagnosis", "diagnose", "remark_on_dopplers", "remark_on_gaps"]

_REACH_STEP_HZ: Final = 1e3
_MOST_GAPS: Final = 4


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """mirrored : whether the spectrum is inverted. cure : what to do, in words. n_sats : how many are received in it,
    read by its description."""

    mirrored: bool
    cure: str
    n_sats: int = 0

    @property
    def is_misread(self) -> bool:
        """Return whether the recording, read by its description, shows too few satellites or an inverted spectrum."""
        return self.mirrored or self.n_sats < POLICY.fix_satellites


def diagnose(samples: Samples, doppler_max_hz: float, inspected: Callable[[], Inspection]) -> Diagnosis:
    """Explain why the receiver finds few satellites or none in a recording, or no message.

    doppler_max_hz : how far it searched. inspected : gives the recording's inspection.
    """
    more = f"`skyproof inspect {samples.path or samples.name}` says what is in it"
    try:
        found = inspected()
    except NotEnoughData:
        return Diagnosis(mirrored=False, cure=more)
    cures = []
    if found.conjugate:
        cures.append(
            "its spectrum is mirrored: give conjugate = true where its layout is described (false if that is so now; "
            "of real samples, if_hz with the other sign)"
        )
    highest_hz = max((abs(satellite.doppler_hz) for satellite in found.satellites), default=0.0)
    if highest_hz > doppler_max_hz:
        reach_hz = _REACH_STEP_HZ * math.ceil(highest_hz / _REACH_STEP_HZ + 0.5)
        cures.append(f"satellites appear at up to {highest_hz:.0f} Hz: give doppler_max_hz = {reach_hz:.0f}")
    received = 0 if cures or found.given is not None else len(found.satellites)
    return Diagnosis(mirrored=bool(found.conjugate), cure="; ".join([*cures, more]), n_sats=received)


def remark_on_dopplers(dopplers_hz: Sequence[float]) -> tuple[str, ...]:
    """Report the oscillator if the Dopplers of all satellites, one each, lie far to one side."""
    return remark_on_oscillator(estimate_oscillator_error(dopplers_hz))


def remark_on_gaps(gaps: Sequence[Gap], period_s: float) -> tuple[str, ...]:
    """Report missing samples that the receiver noticed unmarked."""
    events: list[Gap] = []
    for gap in sorted(gaps, key=lambda gap: gap.elapsed_s):
        if events and gap.elapsed_s - events[-1].elapsed_s < POLICY.one_event_s:
            if events[-1].shift_s == 0.0:
                events[-1] = gap
        else:
            events.append(gap)
    words = [_gap_remark(gap, period_s) for gap in events[:_MOST_GAPS]]
    if len(events) > _MOST_GAPS:
        words.append(f"and so at {len(events) - _MOST_GAPS} more places")
    return tuple(Remark(text, RemarkKind.BEARS) for text in words)


def _gap_remark(gap: Gap, period_s: float) -> str:
    if gap.shift_s == 0.0:
        return (
            f"whole code periods of samples are missing near {gap.elapsed_s:.1f} s: data bits or carriers of "
            f"{gap.signals} signals moved at once by what that makes of them; time was decoded again"
        )
    missing_ms = (-gap.shift_s % period_s) * 1e3
    about = "" if gap.missing_s < 0.5 else f", by the satellites' motion about {gap.missing_s:.1f} s in all"
    return (
        f"samples are missing near {gap.elapsed_s:.1f} s: {missing_ms:.4f} ms, or that and whole code periods of "
        f"{period_s * 1e3:g} ms{about} ({gap.signals} signals came back with one shift); time was decoded again"
    )
