"""Numbers by which the tests of antenna arrays and turning antennas decide."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from skyproof.detectors.policy import policy_field

__all__ = ["POLICY", "ArrayPolicy"]


@dataclass(frozen=True)
class ArrayPolicy:
    """Numbers by which the tests of antenna arrays and turning antennas decide, each with its reason."""

    free_attitude_sigma_rad: float = policy_field(
        1.0,
        unit="rad",
        reason="Once an attitude that is not known is found, its error is small beside this.",
    )
    free_line_sigma_cyc: float = policy_field(
        1.0,
        unit="cycle",
        reason="Once line delays that are not known are found, their errors are small beside this.",
    )
    first_gate_cyc: float = policy_field(
        0.2,
        unit="cycle",
        reason=("A component this near a candidate attitude counts for it at first, beside noise and reflections."),
    )
    most_tilt_rad: float = policy_field(
        np.radians(60.0),
        unit="rad",
        reason="A body that carries antennas is not tilted by more than 60 degrees.",
    )
    as_good_cost: float = policy_field(
        20.0,
        unit="1",
        reason="Twice a log likelihood ratio of 10: an attitude that much worse is not the true one.",
    )
    alike_rad: float = policy_field(
        np.radians(3.0),
        unit="rad",
        reason="Attitudes that differ by less are one.",
    )
    missed_direction_probability: float = policy_field(
        1e-3,
        unit="1",
        reason="The true direction is none of those given so rarely.",
    )
    one_direction_squared_sigmas: float = policy_field(
        9.0,
        unit="sigma^2",
        reason="Directions nearer to each other than three sigmas are one.",
    )
    jump_epochs: int = policy_field(
        3,
        unit="1",
        reason="From one phase to the next at most: where an antenna's phase jumps it may have none.",
    )
    least_phases_share: float = policy_field(
        0.5,
        unit="1",
        reason="An antenna with fewer of the phases that the best antenna has is failing.",
    )
    jump_cyc: float = policy_field(
        0.08,
        unit="cycle",
        reason="Half a wavelength in a tenth of a second turns no array by so much for most signals at once.",
    )
    step_noise_cyc: float = policy_field(
        0.04,
        unit="cycle",
        reason="Root mean square of a step: reflections change more slowly.",
    )
    jump_sigmas: float = policy_field(
        6.0,
        unit="sigma",
        reason="Noise alone makes no jump so large in a day of epochs.",
    )
    noise_excess: float = policy_field(
        3.0,
        unit="1",
        reason="Noise so many times that of the signal's strength is of the antenna or its line.",
    )
    one_place_satellites: int = policy_field(
        3,
        unit="1",
        reason="Two signals from one place may be reflected by one thing.",
    )
    gates_missed_probability: tuple[float, ...] = policy_field(
        (0.03, 0.5, 0.9),
        unit="1",
        reason=(
            "True signals missed by the gates within which agreement counts: fewer others are within narrow gates."
        ),
    )
    overlap_chips: float = policy_field(
        1.5,
        unit="chip",
        reason="Two signals of a satellite farther apart are seen by no correlator of half a chip together.",
    )
    covered_db: float = policy_field(
        10.0,
        unit="dB",
        reason=(
            "What filters and side lobes leave of a signal so much stronger turns phases by hundredths of a cycle."
        ),
    )
    reflections_alike_probability: float = policy_field(
        0.01,
        unit="1",
        reason=(
            "Reflections come from one direction by chance so rarely; above, it stays open whether "
            "they are reflections."
        ),
    )
    vague_sigma_cyc: float = policy_field(
        0.1,
        unit="cycle",
        reason="A phase that is expected no better than this tests nothing.",
    )
    attitude_off_sigmas: float = policy_field(
        5.0,
        unit="sigma",
        reason="An attitude that is off by more is not what was stated.",
    )
    lowest_transmitter_sine: float = policy_field(
        -0.17,
        unit="1",
        reason="No transmitter is taken to stand more than ten degrees below the horizon.",
    )
    early_sigmas: float = policy_field(
        3.0,
        unit="sigma",
        reason="A reflection is late; noise lets it look early by so much at most.",
    )
    blended_chips: float = policy_field(
        0.25,
        unit="chip",
        reason="Half of the half chip from early to late: opposite reflections draw a signal off by so much.",
    )
    level_scale_cyc: float = policy_field(
        0.24,
        unit="cycle",
        reason="Baseline of an array that measures level direction cosines without whole cycles.",
    )
    bent_for_s: float = policy_field(
        60.0,
        unit="s",
        reason=(
            "What is laid upon true signals and dragged off shows in half of the windows, so long "
            "after nothing is authentic."
        ),
    )
    quadratic_lasts_s: float = policy_field(
        15.0,
        unit="s",
        reason=(
            "Up to here a quadratic leaves less than 1 of noncentrality of the motion of two "
            "satellites; then a cubic follows."
        ),
    )


POLICY: Final = ArrayPolicy()
