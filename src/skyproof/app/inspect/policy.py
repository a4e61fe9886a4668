"""Numbers by which it is decided what an input is, and what it is good for."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "InspectPolicy"]


@dataclass(frozen=True)
class InspectPolicy:
    """Numbers by which it is decided what an input is, each with its reason."""

    fix_satellites: int = number(4, "1", "Three coordinates and a clock take four ranges.", "Kaplan & Hegarty, 2.5.2")
    test_satellites: int = number(5, "1", "Four ranges fit any position: five test it.", "Kaplan & Hegarty, 2.5.2")
    ephemeris_s: float = number(
        36.0, "s", "Three subframes of 6 s, repeated every 30 s, begun anywhere.", "IS-GPS-200N, 20.3.2"
    )
    subframe_s: float = number(12.0, "s", "A whole subframe of 6 s, begun anywhere.", "IS-GPS-200N, 20.3.2")
    tracked_s: float = number(2.0, "s", "The shortest window that a run may be cut into.")
    reach_hz: float = number(
        7e3, "Hz", "Satellites give 5 kHz to a receiver at rest; the rest is an oscillator 1.3 ppm off."
    )
    log_s: float = number(
        60.0, "s", "Chosen: two windows, or a minute of the past, which most tests of one receiver need."
    )
    alarm_probability: float = number(1e-4, "1", "Chosen: noise makes a satellite, a line or a gap of it so rarely.")
    first_periods: int = number(20, "1", "A bit: a first search that is quick finds all but weak satellites.")
    second_periods: int = number(
        100, "1", "Finds 34 dB-Hz; five times as many find cross-correlations that cannot be taken out."
    )
    second_reach_hz: float = number(20e3, "Hz", "Satellites, and an oscillator that is 10 ppm off.")
    least_periods: int = number(2, "1", "One code period does not show that it repeats.")
    other_rates_ppm: tuple[float, ...] = number(
        (-50.0, 50.0, -100.0, 100.0), "ppm", "A search of 20 ms reaches 25 ppm to either side: together 125 ppm."
    )
    gain_sigma_db: float = number(
        1.0, "dB", "Assumed: by which the gain of a front end wanders, as the method `levels` assumes."
    )
    convincing_probability: float = number(
        1e-6, "1", "Chosen: noise gives what was found, in all that was tried, so rarely when a sidecar is written."
    )
    repeats_probability: float = number(1e-3, "1", "Chosen: what repeats by chance so rarely is searched first.")
    clear_probability: float = number(1e-10, "1", "Chosen: what repeats by chance so rarely needs no more samples.")
    imaged_share: float = number(
        0.02, "1", "Assumed: of images in what repeats: imbalance of I and Q makes less, and real samples make as much."
    )
    image_costs_share: float = number(0.5, "1", "Real samples read as complex have half their power in images.")
    far_carrier_costs_share: float = number(
        0.1, "1", "Complex samples have their carrier within a quarter of the rate; real ones, read so, beyond."
    )
    near_hz: float = number(8e3, "Hz", "Satellites and a good oscillator, 2 ppm off.")
    wide_hz: float = number(60e3, "Hz", "Of a search around the measured carrier, which may be off by twice as much.")
    carrier_off_hz: float = number(
        120e3, "Hz", "The measured carrier is the middle of a spectrum 2 MHz wide, found to a few per cent of that."
    )


POLICY: Final = InspectPolicy()
