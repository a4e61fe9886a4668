"""Numbers by which it is decided how a recording is received, and what is said of it."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "ReceivePolicy"]


@dataclass(frozen=True)
class ReceivePolicy:
    """Numbers by which it is decided how a recording is received, each with its reason."""

    bridged_s: float = number(
        10.0, "s", "Of all gaps together: by then Doppler and delay change by less than the search near them reaches."
    )
    checked_s: float = number(3.0, "s", "A second for loops to settle, and two for the drift of the receiver's clock.")
    most_checks: int = number(
        3, "1", "A first correction by an inspection, a second by what is then tracked, and whether that holds."
    )
    one_event_s: float = number(
        3.0,
        "s",
        "Chosen: jumps of carriers and signals that come back are one gap within six searches of half a second.",
    )
    near_utc_s: float = number(0.5, "s", "Labels off by leap seconds and less than half a second are in UTC.")
    nearly_all_share: float = number(
        0.9, "1", "Chosen: the first antenna stands for the receiver unless another has measured a tenth more."
    )
    late_chips: float = number(1.0, "chip", "Codes nearer than a chip overlap: the antennas receive the same signals.")
    many_arcs: int = number(
        5, "1", "Chosen: a satellite; a spectrum that is read mirrored gives ten times as many, as no loop holds."
    )
    followed_s: float = number(2.0, "s", "Assumed: in less time a signal that is there may not have proved itself.")
    time_of_week_s: float = number(
        12.0, "s", "A time of week comes every 6 s: one is whole in twice that.", "IS-GPS-200N, 20.3.3.2"
    )
    snapshot_s: float = number(1.0, "s", "A shorter recording is judged by directions: loops need seconds to settle.")
    advised_snapshot_s: float = number(0.9, "s", "Safely below what is judged by directions alone.")
    least_s: float = number(0.004, "s", "Chosen: four code periods are the fewest that are looked at.")
    one_block_s: float = number(0.15, "s", "A block and a half of 0.1 s: what is no longer is summed whole.")
    noise_probability: float = number(
        1e-12, "1", "Noise has a signal's energy so rarely: of delays, Dopplers and messages thousands are tried."
    )
    vote_antennas: int = number(3, "1", "Of two antennas that differ none is outvoted.")
    same_signal_chips: float = number(0.5, "chip", "Half the width of a correlation: nearer, two peaks are one.")
    same_signal_hz: float = number(
        300.0, "Hz", "Less than the search's step of 500 Hz: carriers farther apart are two."
    )
    overlap_chips: float = number(
        1.2, "chip", "The correlation of a code is a chip wide to either side; the front end adds to its flanks."
    )
    late_likelihood: float = number(
        25.0, "1", "Logarithm by which data bits of an antenna fit later ones better: chance, once in e^25."
    )
    searched_s: float = number(
        0.02, "s", "A bit; twice as much finds cross-correlations before more satellites.", "IS-GPS-200N, 3.2.2"
    )
    cross_db: float = number(
        18.0,
        "dB",
        "Cross-correlations at other Dopplers stand 21.6 dB below what makes them; noise lifts some.",
        "Kaplan & Hegarty, 2nd edition, 4.3.4",
    )
    least_left: int = number(7, "1", "Five unknowns with the time, and two more that show a wrong set.")
    fix_satellites: int = number(4, "1", "Three coordinates and a clock take four ranges.", "Kaplan & Hegarty, 2.5.2")
    lapse_epochs: int = number(2, "1", "A guide not renewed lapses: scalar loops take over within half a second.")
    agreed_epochs: int = number(3, "1", "Chosen: in a row, before loops follow a filter that has just begun.")
    worst_start_m: float = number(150.0, "m", "Half a chip: with a worse fit, predictions miss the signal's peak.")
    farthest_m: float = number(
        8e6, "m", "From the Earth's centre: 1600 km of height, where no receiver of this kind is."
    )
    out_chips: float = number(0.5, "chip", "Farther off, early or late of half a chip is past the signal's peak.")
    out_hz: float = number(150.0, "Hz", "A carrier so far off turns by a radian in the millisecond of a sum.")
    comes_chips: float = number(
        0.625, "chip", "Chosen: from within, a channel that has not yet driven the filter may begin to."
    )
    comes_hz: float = number(375.0, "Hz", "Chosen: likewise, as its loops have a carrier of their own until then.")
    back_share: float = number(
        0.25, "1", "Chosen: of the limit that it has broken: a channel comes back from well within."
    )
    out_s: float = number(
        1.0, "s", "A loop settles within a second: only then a channel that went off may drive again."
    )
    most_sky_hz: float = number(
        2e6,
        "Hz",
        "Sixteen satellites at the most power, -153 dBW, over noise of 290 K, -204 dBW/Hz: 51 dB-Hz each.",
        "IS-GPS-200N, 6.3.1",
    )
    rise_sigma_db: float = number(
        0.5, "dB", "Assumed: antennas differ by as much in what they receive from one direction; noise adds far less."
    )
    sure_m: float = number(75.0, "m", "A quarter of a chip: a prediction that leads a loop to its signal.")
    sure_m_s: float = number(10.0, "m/s", "A carrier of 50 Hz: a prediction that leads a loop to its signal.")


POLICY: Final = ReceivePolicy()
