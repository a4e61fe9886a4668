"""Numbers by which the tests of correlators decide."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "CorrelatorPolicy"]


@dataclass(frozen=True)
class CorrelatorPolicy:
    """Numbers by which the tests of correlators decide, each with its reason."""

    fastest_loop_hz: float = number(
        2.0,
        "Hz",
        "Twice the bandwidth of a usual code loop, which does not follow faster beats: the signal stays in its taps.",
    )
    line_half_width_hz: float = number(1.0, "Hz", "Assumed: a line may spread so far to either side of a bin.")
    shape_error_share: float = number(
        0.1,
        "1",
        "Assumed: triangles may miss so much of the power of a line, where a front end rounds the correlation.",
    )
    longest_line_s: float = number(
        10.0, "s", "The beat of two signals drifts: a line is looked for over no more at once."
    )
    least_looks: int = number(100, "1", "Two seconds of looks every 20 ms resolve a line of half a hertz.")
    signal_probability: float = number(
        1e-4, "1", "Chosen: a signal counts as distorted by chance so rarely, one of ten in a thousand windows."
    )
    lasting_share: float = number(
        0.1, "1", "Chosen, of the false-alarm probability: that lasting errors are longer than their bound."
    )
    cusum_branches: tuple[tuple[int, float], ...] = number(
        ((5, 1.0), (50, 0.5)),
        "looks, sigma",
        "Looks of one step and reference: a tenth of a second and a second where looks come every 20 ms.",
    )
    guided_looks_share: float = number(
        0.8, "1", "Where fewer of a window's looks were guided, a fifth of each mean comes from unguided loops."
    )
    looks_more: int = number(
        20, "1", "With so many looks more than numbers tested, an estimated variance is known to a third."
    )
    bent_share: float = number(
        0.05,
        "1",
        "Assumed: of a code's offset, one sigma: its discriminator is not straight, as noise and front ends round it.",
    )
    least_beat_hz: float = number(
        0.3, "Hz", "Three beats in a window of ten seconds; below, loops and fading colour the noise."
    )
    most_beat_share: float = number(
        0.5, "1", "Of the rate of looks: the fastest beat that shows; faster ones repeat below."
    )
    beat_sigma_bins: float = number(
        0.1,
        "1",
        "Assumed, one sigma: a line is found to a tenth of a bin, as loops and geometry change within a window.",
    )
    beat_sigmas: float = number(3.0, "1", "Of 1000 lines three of a common motion are taken for others.")
    beats_more: int = number(2, "1", "Lines beyond the four that any motion and clock explain; fewer prove nothing.")
    bases: int = number(
        50, "1", "Sets of four lines that tell a motion best: some hold no line of a reflection unless most lines are."
    )
    repetitions: tuple[int, ...] = number(
        (0, 1), "1", "A sky that moves by 9 m/s beside the tracked one has beats up to the rate of 50 looks a second."
    )
    longest_gap_s: float = number(
        0.5, "s", "Between looks of two windows that are looked at as one: no line drifts so fast."
    )
    least_velocities: int = number(10, "1", "Fixes of a window whose scatter is known to a quarter.")
    refined: int = number(
        8, "1", "Motions that are fitted to all lines that they explain, those with most lines first."
    )


POLICY: Final = CorrelatorPolicy()
