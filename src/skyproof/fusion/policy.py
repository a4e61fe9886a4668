"""Numbers by which evidence becomes labels, a verdict and a trusted position."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from skyproof.records.policy import number

__all__ = ["POLICY", "FusionPolicy"]


@dataclass(frozen=True)
class FusionPolicy:
    """Numbers by which evidence becomes labels, a verdict and a trusted position, each with its reason.

    `app` reads those of windows, of receivers that are one, and of where sources stand.
    """

    # Receivers and windows
    compared_within_m: float = number(
        100e3,
        "m",
        "Receivers that are compared see nearly the same sky: elevations differ by less than two degrees.",
    )
    statements_agree_sigmas: float = number(
        5.0, "sigma", "Stated places that differ by more contradict each other: chance does it once in two million."
    )
    least_window_epochs: int = number(5, "1", "A median of five epochs outvotes two that are wrong.")
    interval_epochs: int = number(
        8, "1", "First epochs of a receiver, by which its usual interval is known: three of seven may be missing."
    )
    ends_together_s: float = number(
        2.0, "s", "Receivers that begin or end so nearly together lose a fifth of a usual window, which stays one."
    )
    last_window_share: float = number(
        0.5, "1", "A last window of less than half is nearer to none than to a whole one: it joins the one before."
    )
    covered_share: float = number(
        0.9, "1", "Of a recording: one that covers less leaves a window of every ten uncompared."
    )
    readings_missing_s: float = number(
        2.0, "s", "A unit may begin or end so much beside the run, as receivers may among themselves."
    )
    most_tilt_rad: float = number(
        np.radians(60.0),
        "rad",
        "Between the stated vertical and that of accelerometers: a level turn banked by so much pulls 2 g.",
    )
    levelled_s: float = number(
        10.0,
        "s",
        "Accelerometers are averaged over a usual window, in which what a body does at one moment counts little.",
    )
    # Labels
    gap_intervals: float = number(1.5, "1", "Epochs that are more usual intervals apart have lost one between them.")
    window_in_arc_share: float = number(
        0.4, "1", "A window speaks for what fills it: cut into halves, and some epochs lost, for both."
    )
    bridged_s: float = number(
        11.0,
        "s",
        "A usual window of 10 s and an epoch: so long a tracked signal between two windows needs none of its own.",
    )
    begins_before_s: float = number(
        5.0,
        "s",
        "Half a usual window: a signal there for longer before the first that calls it false can have been captured.",
    )
    begins_before_share: float = number(0.5, "1", "Half a window again, of this run's where those are longer.")
    nearly_all_share: float = number(
        0.75,
        "1",
        "If fewer of the signals that failed a test together are authentic, that many are not just faulty ones.",
    )
    fix_signals: int = number(4, "1", "Three coordinates and a clock take four ranges.", "Kaplan & Hegarty, 2.5.2")
    moment_s: float = number(
        5.0, "s", "Half a usual window: so long after a loss of all signals no window speaks for the new ones."
    )
    moment_intervals: float = number(2.5, "1", "More usual intervals apart, two epochs are missing.")
    alone_s: float = number(
        30.0,
        "s",
        "Recorders started by hand are apart by less; an attack on what is alone for longer could begin or end then.",
    )
    # Signals that nothing explains
    counted_s: float = number(
        5.0,
        "s",
        "Half a usual window: what is received for less no window speaks for, nor does a false alarm live longer.",
    )
    counted_share: float = number(0.5, "1", "The same share of a shorter recording.")
    longer_windows: float = number(1.01, "1", "Longer than the longest window, by more than labels of epochs are off.")
    # When false signals came
    hidden_chips: float = number(
        2.0, "chip", "Nearer, the triangles of two codes of a satellite overlap, and a search may show one peak."
    )
    together_s: float = number(
        1.5, "s", "Three searches of half a second: signals found within them of the first came with it."
    )
    hidden_share: float = number(
        0.5, "1", "Where most of those that came together stood near others, all may have been there unseen."
    )
    searched_s: float = number(0.02, "s", "A search looks at one bit of the message.", "IS-GPS-200N, 3.2.2")
    ended_s: float = number(3.0, "s", "Six searches of half a second have missed a false signal that has ended.")
    # A receiver without protection, and the fix
    coasts_s: float = number(
        1.0, "s", "A loop of about a hertz coasts through fades of its time constant: the signal counts as followed."
    )
    searches_s: float = number(2.0, "s", "Four searches of half a second: then the strongest that was found is taken.")
    band_share: float = number(
        0.75, "1", "A band is not left for another that has a satellite or two more of eight, as the clock would step."
    )
    ordinary_alarm_probability: float = number(
        1e-3, "1", "A receiver without protection leaves measurements out readily, having nothing else against them."
    )
    # Which sky is true
    late_share: float = number(0.5, "1", "A set whose signals are mostly late copies is a copy of the sky.")
    at_end_epochs: int = number(
        4, "1", "A window that has no fix in so many last epochs has no fix at its end: three may be lost in a fade."
    )
    same_instant_s: float = number(
        0.02, "s", "At 50 m/s a receiver moves by 1 m meanwhile, as much as reflections put a fix off."
    )
    goes_on_probability: float = number(
        1e-6, "1", "Once in four months of windows of 10 s what is taken for true breaks by chance."
    )
    same_sky_share: float = number(
        0.75, "1", "Of a set's signals, by which it is the sky chosen before: the others rose since."
    )
    no_chance_satellites: int = number(
        7,
        "1",
        "Three ranges beyond the four that fit any position: mixed skies fit them within metres of hundreds never.",
    )
    refused_probability: float = number(1e-3, "1", "A true sky is refused as not fitting so rarely in a window.")
    least_wrong_probability: float = number(
        1e-12, "1", "Seven sigmas of a normal error: the model of errors does not reach below."
    )
    # One receiver twice, and where a source stands
    noise_beside_s: float = number(
        2.5, "s", "To either side of noise that is compared: half a usual window of what its signals show."
    )
    noise_cells: int = number(
        500,
        "1",
        "A quarter of the 2.046 MHz of C/A, in cells of 1 kHz.",
        "IS-GPS-200N, 3.2.1.3",
    )
    rays: int = number(
        32, "1", "From one body to a source, spread over the run; more add nothing, as their errors may be the same."
    )
    moved_p_value: float = number(1e-4, "1", "Rays that meet worse are of a source that moves, or of several.")
    ray_beside_s: float = number(
        5.0, "s", "A trusted place is near a ray's window if it is no farther from it than half a usual one."
    )
    learned_interval_s: float = number(
        1.0, "s", "Fixes nearer to each other have the same reflections, and correct inertia no further."
    )
    same_epoch_s: float = number(
        0.1, "s", "A receiver's label is that of its own clock: by so much its fix is of our epoch at ten a second."
    )


POLICY: Final = FusionPolicy()
