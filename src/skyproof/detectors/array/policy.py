"""Numbers by which the tests of antenna arrays and turning antennas decide."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from skyproof.records.policy import number

__all__ = ["POLICY", "ArrayPolicy"]


@dataclass(frozen=True)
class ArrayPolicy:
    """Numbers by which the tests of antenna arrays and turning antennas decide, each with its reason."""

    free_attitude_sigma_rad: float = number(
        1.0, "rad", "Wider than any error of an attitude once it is found, and narrow beside a full turn."
    )
    free_line_sigma_cyc: float = number(
        1.0, "cycle", "A whole cycle, in which any line delay lies once whole cycles are taken off."
    )
    first_gate_cyc: float = number(
        0.2,
        "cycle",
        "Chosen: a component this near a candidate attitude counts for it at first, beside noise and reflections.",
    )
    most_tilt_rad: float = number(
        np.radians(60.0), "rad", "A level turn banked by so much pulls 2 g: bodies that carry antennas tilt less."
    )
    as_good_cost: float = number(
        20.0, "1", "Twice a log likelihood ratio of 10: an attitude that much worse is not the true one."
    )
    alike_rad: float = number(np.radians(3.0), "rad", "Chosen: attitudes that differ by less are one.")
    missed_direction_probability: float = number(
        1e-3, "1", "Chosen: the true direction is none of those given once in a thousand windows."
    )
    one_direction_squared_sigmas: float = number(
        9.0, "sigma^2", "Directions nearer to each other than three sigmas are one."
    )
    jump_epochs: int = number(
        3, "1", "From one phase to the next at most: where an antenna's phase jumps it may have none."
    )
    least_phases_share: float = number(
        0.5, "1", "Chosen: an antenna with fewer than half the phases of the best one is failing."
    )
    jump_cyc: float = number(
        0.08, "cycle", "Half a wavelength in a tenth of a second turns no array by so much for most signals at once."
    )
    step_noise_cyc: float = number(
        0.04,
        "cycle",
        "Half of the smallest jump: reflections, which change by less in a tenth of a second, stay below.",
    )
    jump_sigmas: float = number(
        6.0,
        "sigma",
        "Normal noise exceeds it once in 5e8: in a day of ten epochs a second, for a hundred signals, hardly ever.",
    )
    noise_excess: float = number(
        3.0, "1", "Chosen: noise so many times what the signal's strength gives comes from the antenna or its line."
    )
    one_place_satellites: int = number(3, "1", "Two signals from one place may be reflected by one thing.")
    fitted_missed_probability: float = number(
        1e-3, "1", "Chosen: a true signal is no part of a fit so rarely. Wider gates let in false ones by chance."
    )
    gates_missed_probability: tuple[float, ...] = number(
        (0.03, 0.5, 0.9),
        "1",
        "True signals missed by the gates within which agreement counts: fewer others are within narrow gates.",
    )
    overlap_chips: float = number(
        1.5,
        "chip",
        "Farther apart, no correlator of half a chip sees both signals of a satellite.",
        "Kaplan & Hegarty, 9.5",
    )
    covered_db: float = number(
        10.0,
        "dB",
        "What filters and side lobes leave of a signal so much stronger turns phases by hundredths of a cycle.",
    )
    reflections_alike_probability: float = number(
        0.01, "1", "Chosen: reflections come from one direction by chance so rarely; above, reflections stay possible."
    )
    vague_sigma_cyc: float = number(
        0.1,
        "cycle",
        "Three sigmas to either side fill more than half a cycle: a phase expected no better tests nothing.",
    )
    attitude_off_sigmas: float = number(
        5.0, "sigma", "Normal errors exceed it once in two million: an attitude that is off by more is not as stated."
    )
    lowest_transmitter_sine: float = number(
        -0.17, "1", "No transmitter is taken to stand more than ten degrees below the horizon."
    )
    early_sigmas: float = number(3.0, "sigma", "A reflection is late; noise lets it look early by more once in 700.")
    blended_chips: float = number(
        0.25,
        "chip",
        "Half of the half chip from early to late: opposite reflections draw a signal off by so much.",
        "Kaplan & Hegarty, 9.5",
    )
    blended_gain_db: float = number(
        6.0,
        "dB",
        "A reflection as strong as the direct signal and in phase with it doubles the amplitude of their sum.",
        "Kaplan & Hegarty, 9.5",
    )
    level_scale_cyc: float = number(
        0.24, "cycle", "Baseline of an array that measures level direction cosines without whole cycles."
    )
    bent_for_s: float = number(
        60.0,
        "s",
        "A dragged-off signal shows in half of the windows: for six of them nothing that was bent is authentic.",
    )
    block_lengths: int = number(
        8, "1", "Windows are tested alone, and in blocks of 2 to 256: of windows of 10 s, three quarters of an hour."
    )
    lasting_forgotten_s: float = number(
        300.0,
        "s",
        "A satellite turns by 1.3e-4 rad/s: the path by a reflector 5 m away changes by a wavelength in 290 s.",
    )
    pattern_sigma_m: float = number(
        0.001,
        "m",
        "Phase patterns of antennas of one type differ by a millimetre, and stay.",
        "igs14.atx, individual calibrations against type means",
    )
    coupled_pattern_sigma_m: float = number(
        0.004,
        "m",
        "Three neighbours, each coupled by -20 dB, turn a phase by 0.12 rad together: 3.7 mm on L1.",
        "Balanis, Antenna Theory, 14.6",
    )
    most_noticed_rad: float = number(
        0.5 * np.pi, "rad", "Chosen: an angle beyond a quarter of a turn says that signals from most directions pass."
    )
    quadratic_lasts_s: float = number(
        15.0,
        "s",
        "Longer, a quadratic leaves 1 or more of noncentrality of the motion of two satellites: a cubic follows.",
    )


POLICY: Final = ArrayPolicy()
