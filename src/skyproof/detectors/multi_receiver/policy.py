"""Numbers by which the test of several receivers decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.detectors.policy import policy_field

__all__ = ["POLICY", "MultiReceiverPolicy"]


@dataclass(frozen=True)
class MultiReceiverPolicy:
    """Numbers by which the test of several receivers decides, each with its reason."""

    carrier_satellites: int = policy_field(
        5,
        unit="1",
        reason="Fewer satellites fit some baseline whatever the fractions of their carriers are.",
    )
    steady_phasor_length: float = policy_field(
        0.8,
        unit="1",
        reason="The mean phasor of a difference over the window is so long at 0.1 cycles of scatter.",
    )
    cycles_by_chance: float = policy_field(
        0.05,
        unit="1",
        reason=("Where more ways to choose whole cycles are expected to fit any fractions, a fit says nothing."),
    )
    carrier_fit_probability: float = policy_field(
        1e-3,
        unit="1",
        reason="A true choice of whole cycles is missed so rarely.",
    )
    cycle_reach_sigmas: float = policy_field(
        5.0,
        unit="sigma",
        reason="Whole cycles are sought so far from where the others put them; beyond is one in a million.",
    )
    few_epochs: int = policy_field(
        5,
        unit="1",
        reason="Where there are no more epochs, a signal that lacks one would take it from all.",
    )
    agreeing_windows_share: float = policy_field(
        0.5,
        unit="1",
        reason=(
            "Where fewer of the windows in which both skies are received agree on the baseline, the antennas move."
        ),
    )
    credible_cn0_dbhz: float = policy_field(
        30.0,
        unit="dB-Hz",
        reason="Weaker signals may be noise that a loop follows.",
    )
    independent_echoes_m: float = policy_field(
        1000.0,
        unit="m",
        reason=(
            "Echoes of the model, but for one in a hundred, are late by less; antennas farther apart "
            "have echoes of their own."
        ),
        source="the model of detectors/second_signals/echoes.py",
    )
    same_delay_sigmas: float = policy_field(
        5.0,
        unit="sigma",
        reason="Delays that differ by more are not one.",
    )
    course_coefficients: int = policy_field(
        3,
        unit="1",
        reason="A parabola follows a range over a window: its rate changes by less than 0.2 m/s in a second.",
    )
    unsteady_m: float = policy_field(
        10.0,
        unit="m",
        reason=("A code that a loop follows scatters less about a smooth course; damaged numbers scatter more."),
    )
    blocked_db: float = policy_field(
        20.0,
        unit="dB",
        reason=("A satellite without a true signal may be blocked by anything: so weak its own is taken to be."),
    )
    early_echo_share: float = policy_field(
        1e-3,
        unit="1",
        reason=(
            "An echo in place of a true signal fits its receiver and the baseline in 3 % of cases "
            "each, over delays of 300 m."
        ),
    )
    reach_sigmas: float = policy_field(
        5.0,
        unit="sigma",
        reason="A stated distance or position is looked for so far from where it is stated.",
    )
    least_distance_sigma_m: float = policy_field(
        0.01,
        unit="m",
        reason="Nobody states a distance better than a centimetre.",
    )
    unknown_height_sigma_m: float = policy_field(
        1e4,
        unit="m",
        reason="A height that is not stated may be any on Earth.",
    )
    learnt_windows: int = policy_field(
        3,
        unit="1",
        reason="Three windows show whether baselines scatter as their sigmas say.",
    )
    remembered_windows: int = policy_field(
        12,
        unit="1",
        reason="Two minutes of usual windows: antennas that turn with a platform are forgotten soon.",
    )
    learnt_spread_sigmas: float = policy_field(
        3.0,
        unit="sigma",
        reason=("Baselines that are off their middle by more are of antennas that move apart, which have no distance."),
    )
    least_elevation_sine: float = policy_field(
        0.05,
        unit="1",
        reason="Below 3 degrees the bending of air is not modelled.",
    )
    part_s: float = policy_field(
        2.0,
        unit="s",
        reason="A false sky that is dragged off at 10 m/s is then noticed before it is 20 m away.",
    )
    part_epochs: int = policy_field(
        4,
        unit="1",
        reason="A part's baseline rests on so many epochs at least.",
    )
    glonass_channel_sigma_m: float = policy_field(
        3.0,
        unit="m",
        reason=(
            "Each GLONASS satellite has a frequency of its own, and receivers' filters delay frequencies differently."
        ),
    )
    longest_run_windows: int = policy_field(
        12,
        unit="1",
        reason="Two minutes of usual windows: longer, satellites turn and errors are no longer as stated.",
    )
    kept_instants: int = policy_field(
        20,
        unit="1",
        reason="So many instants of a window are kept: what lasts for a window averages no more.",
    )
    satellite_turn_rad_s: float = policy_field(
        1.5e-4,
        unit="rad/s",
        reason="The direction of a satellite turns by no more, seen from the ground.",
    )
    same_antenna_sigmas: float = policy_field(
        3.3,
        unit="sigma",
        reason="A signal of the antenna is within so many in all but one case in a thousand.",
    )
    slow_noise_factor: float = policy_field(
        19.0,
        unit="1",
        reason="A mean varies by (1 + a) / (1 - a) more where noise lasts from epoch to epoch by a = 0.9.",
    )
    fix_satellites: int = policy_field(
        4,
        unit="1",
        reason="Fewer satellites make no fix.",
    )
    distance_share: float = policy_field(
        0.05,
        unit="1",
        reason="To which a distance is known in 95 of 100 cases, if nothing is said of that.",
    )
    decimal_slip: float = policy_field(
        10.0,
        unit="1",
        reason="A decimal point that is one place off makes a statement ten times too small.",
    )
    statement_sigmas: float = policy_field(
        5.0,
        unit="sigma",
        reason="A distance that is farther above what a slip of the point explains contradicts it.",
    )
    least_range_m: float = policy_field(
        19_000e3,
        unit="m",
        reason="Of a satellite in medium orbit, overhead; the others are farther.",
    )


POLICY: Final = MultiReceiverPolicy()
