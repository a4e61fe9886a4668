"""An inspection in words: what a recording is, what is odd about it, what `skyproof protect` can do with it."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from skyproof.app.inspect.policy import POLICY
from skyproof.gnss.received_power import JammerToNoise, estimate_jammer_to_noise
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.recording.conditioning import MeasuredFrontEnd
from skyproof.recording.survey import OscillatorError, Survey
from skyproof.records import Samples

__all__ = [
    "FoundSatellite",
    "advise",
    "estimate_power_over_quietest",
    "remark_on_correction",
    "remark_on_oscillator",
    "remark_on_power",
    "remark_on_signals",
    "summary",
]


class FoundSatellite(Protocol):
    """A satellite of an inspection."""

    @property
    def sat(self) -> str: ...
    @property
    def cn0_dbhz(self) -> float: ...
    @property
    def doppler_hz(self) -> float: ...
    @property
    def peaks(self) -> int: ...


def advise(samples: Samples, satellites: Sequence[FoundSatellite], *, gaps: int, mirrored: bool) -> str:
    """Describe in one sentence what `protect` can do, and what would make it stronger.

    mirrored : whether the description reads the spectrum the wrong way round.
    """
    n, several = len(satellites), sum(satellite.peaks > 1 for satellite in satellites)
    if n == 0:
        return (
            "`protect` can do nothing with it: no satellite was found; check rate_hz, centre_hz and if_hz first, then "
            "the antenna."
        )
    needs = []
    if mirrored:
        needs.append("conjugate = true where its layout is described")
    if samples.duration_s < POLICY.tracked_s:
        needs.append(f"{POLICY.ephemeris_s:.0f} s of recording (with --nav {POLICY.subframe_s:.0f} s)")
        can = "is too short for `protect`, which follows signals for seconds"
        can += "; that several signals of one satellite are received suggests false ones already" if several else ""
        return f"It {can}; what it needs: {_join_words(needs)}."
    if n < POLICY.fix_satellites:
        can = "can look for second signals of a satellite, but give no position"
        needs.append("a better view of the sky")
    elif n < POLICY.test_satellites:
        can = "can give a position, but not test it"
        needs.append("a better view of the sky")
    else:
        can = "can label its signals, test their consistency and give a position"
    if samples.duration_s < POLICY.subframe_s:
        needs.append(f"{POLICY.subframe_s:.0f} s or more, for the time in the messages")
    if samples.duration_s < POLICY.ephemeris_s:
        needs.append("--nav, for it is too short to hold all orbits")
    if samples.start_gpst is None:
        needs.append("start_gpst, for the week")
    if any(abs(satellite.doppler_hz) > POLICY.reach_hz for satellite in satellites):
        farthest_hz = max(abs(satellite.doppler_hz) for satellite in satellites)
        needs.append(f"--doppler-max-hz {1e3 * (farthest_hz // 1e3 + 2.0):.0f}")
    if gaps:
        needs.append("a recorder that loses no samples")
    needs.append("a second receiver some tens of metres away, recorded at the same time")
    return f"`protect` {can}; stronger with {_join_words(needs)}."


def estimate_power_over_quietest(front: MeasuredFrontEnd) -> JammerToNoise | None:
    """Estimate what comes in over the noise of the quietest stretch; None if the power stays the same or is unknown."""
    if not np.isfinite(front.power_db).any():
        return None
    rise_db = float(np.nanmax(front.power_db) - np.nanmin(front.power_db))
    return estimate_jammer_to_noise(rise_db, np.sqrt(2.0) * POLICY.gain_sigma_db)


def remark_on_power(front: MeasuredFrontEnd) -> tuple[str, ...]:
    """Report power in the band that rises by more than a gain wanders."""
    jammer = estimate_power_over_quietest(front)
    if jammer is None or jammer.low_db is None or jammer.high_db is None:
        return ()
    most, least = int(np.nanargmax(front.power_db)), int(np.nanargmin(front.power_db))
    return (
        f"the power in the band at {front.stretch_s[most]:.1f} s is {np.ptp(front.power_db[[least, most]]):.1f} dB "
        f"over that at {front.stretch_s[least]:.1f} s: the gain changed, or what came in has J/N {jammer.db:.0f} dB "
        f"({jammer.low_db:.0f} to {jammer.high_db:.0f} in 95 %)",
    )


def remark_on_signals(
    samples: Samples, survey: Survey, conjugate: bool | None, oscillator: OscillatorError
) -> list[str]:
    """List what is odd about the signals."""
    remarks = []
    if conjugate:
        remarks.append(
            "the spectrum is mirrored: negate Q (or swap I and Q, or give the intermediate frequency the "
            "other sign) in what says how to read the file"
        )
    for gap in survey.gaps:
        remarks.append(
            f"samples are missing at sample {gap.at_sample} ± {gap.at_sigma_samples:.0f} "
            f"({gap.at_sample / samples.rate_hz * 1e3:.2f} ms): {gap.missing_samples:.1f} "
            f"± {gap.missing_sigma_samples:.1f}, or that and whole code periods of {gap.period_samples:g}"
        )
    for known in samples.gaps:
        remarks.append(f"the recording says that {known.missing_samples} samples are missing at {known.at_sample}")
    remarks += remark_on_oscillator(oscillator)
    if abs(survey.clock_minus_lo_ppm) > 4.0 * survey.clock_minus_lo_sigma_ppm:
        remarks.append(
            f"the sampling clock is {survey.clock_minus_lo_ppm:+.3f} ± {survey.clock_minus_lo_sigma_ppm:.3f} ppm off "
            "the local oscillator: they are not of one source, or rate_hz is not exact"
        )
    return remarks


def remark_on_correction(given: Samples, taken: Samples, sigma: float) -> str:
    """Describe what was wrong in a recording's description, and what is used in its place."""
    if taken.rate_hz != given.rate_hz:
        ppm = 1e6 * (given.rate_hz / taken.rate_hz - 1.0)
        return (
            f"rate_hz = {given.rate_hz:.12g} is {abs(ppm):.3f} ± {1e6 * sigma:.3f} ppm too "
            f"{'high' if ppm > 0.0 else 'low'}: the codes of all satellites run that much "
            f"{'faster' if ppm > 0.0 else 'slower'} than their carriers; {taken.rate_hz:.3f} was measured and is used "
            "(or the sampling clock is off the local oscillator by as much)"
        )
    off_hz = given.if_hz - taken.if_hz
    return (
        f"if_hz = {given.if_hz:.12g} is {abs(off_hz):.0f} ± {sigma * GPS_L1_CA.carrier_hz:.0f} Hz too "
        f"{'high' if off_hz > 0.0 else 'low'} (or centre_hz as much too {'low' if off_hz > 0.0 else 'high'}): the "
        f"carriers of all satellites are off against their codes, whose rates are right; {taken.if_hz:.0f} is used"
    )


def remark_on_oscillator(oscillator: OscillatorError) -> tuple[str, ...]:
    """Report an oscillator whose error is certain."""
    if not abs(oscillator.doppler_hz) > 3.0 * oscillator.sigma_hz:
        return ()
    high = "high" if oscillator.doppler_hz > 0.0 else "low"
    off_khz, sigma_khz = abs(oscillator.doppler_hz) / 1e3, oscillator.sigma_hz / 1e3
    ppm = 1e9 / GPS_L1_CA.carrier_hz
    return (
        f"all signals appear {off_khz:.1f} ± {sigma_khz:.1f} kHz too {high}: the local oscillator is off by "
        f"{off_khz * ppm:.1f} ± {sigma_khz * ppm:.1f} ppm",
    )


def summary(
    samples: Samples,
    satellites: Sequence[FoundSatellite],
    survey: Survey,
    conjugate: bool | None,
    front: MeasuredFrontEnd,
) -> str:
    """Summarize in one or two sentences what is in the recording, and whether it is usable."""
    long = f"{samples.duration_s:.1f} s" if samples.duration_s >= 1.0 else f"{samples.duration_s * 1e3:.0f} ms"
    n = len(satellites)
    if n == 0:
        text = f"{long} in which no {GPS_L1_CA.name} signal was found"
    else:
        strongest = max(satellite.cn0_dbhz for satellite in satellites)
        text = f"{long} with {n} GPS satellite{'' if n == 1 else 's'}, the strongest at {strongest:.0f} dB-Hz"
    if several := [satellite.sat for satellite in satellites if satellite.peaks > 1]:
        text += f"; more than one signal of {', '.join(several)}"
    but = []
    if conjugate:
        but.append("the spectrum is mirrored")
    if n_gaps := max(len(survey.gaps), len(samples.gaps)):
        but.append("samples are missing" + ("" if n_gaps == 1 else f" in {n_gaps} places"))
    if front.notched:
        hurting = len(front.notched)
        but.append("a narrow-band line hurts" if hurting == 1 else f"{hurting} narrow-band lines hurt")
    if n and n < POLICY.fix_satellites:
        but.append("fewer than four satellites give no position")
    return text + (f"; but {', '.join(but[:-1])}{' and ' if but[:-1] else ''}{but[-1]}." if but else ".")


def _join_words(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
