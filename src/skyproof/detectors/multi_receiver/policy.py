"""Numbers by which the test of several receivers decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "MultiReceiverPolicy"]


@dataclass(frozen=True)
class MultiReceiverPolicy:
    """Numbers by which the test of several receivers decides, each with its reason."""

    carrier_satellites: int = number(
        5, "1", "Fewer satellites fit some baseline whatever the fractions of their carriers are."
    )
    steady_phasor_length: float = number(
        0.8, "1", "The mean phasor of a difference over the window is so long at 0.1 cycles of scatter."
    )
    cycles_by_chance: float = number(
        0.05, "1", "Where more ways to choose whole cycles are expected to fit any fractions, a fit says nothing."
    )
    carrier_fit_probability: float = number(1e-3, "1", "A true choice of whole cycles is missed so rarely.")
    cycle_reach_sigmas: float = number(
        5.0, "sigma", "Whole cycles are sought so far from where the others put them; beyond is one in a million."
    )
    few_epochs: int = number(5, "1", "Where there are no more epochs, a signal that lacks one would take it from all.")
    agreeing_windows_share: float = number(
        0.5,
        "1",
        "Where fewer of the windows in which both skies are received agree on the baseline, the antennas move.",
    )
    credible_cn0_dbhz: float = number(30.0, "dB-Hz", "Weaker signals may be noise that a loop follows.")
    independent_echoes_m: float = number(
        1000.0,
        "m",
        "All but one in a hundred echoes of the model are late by less: antennas farther apart have their own.",
        "the model of detectors/second_signals/echoes.py",
    )
    same_delay_sigmas: float = number(5.0, "sigma", "Delays that differ by more are not one.")
    course_coefficients: int = number(
        3, "1", "A parabola follows a range over a window: its rate changes by less than 0.2 m/s in a second."
    )
    unsteady_m: float = number(
        10.0, "m", "A code that a loop follows scatters less about a smooth course; damaged numbers scatter more."
    )
    blocked_db: float = number(
        20.0, "dB", "A satellite without a true signal may be blocked by anything: so weak its own is taken to be."
    )
    early_echo_share: float = number(
        1e-3,
        "1",
        "An echo in place of a true signal fits its receiver, and the baseline, in 3 % of cases: 9e-4 for both.",
    )
    reach_sigmas: float = number(
        5.0, "sigma", "A stated distance or position is looked for so far from where it is stated."
    )
    least_distance_sigma_m: float = number(0.01, "m", "Nobody states a distance better than a centimetre.")
    unknown_height_sigma_m: float = number(1e4, "m", "A height that is not stated may be any on Earth.")
    learnt_windows: int = number(3, "1", "Three windows show whether baselines scatter as their sigmas say.")
    remembered_windows: int = number(
        12, "1", "Two minutes of usual windows: antennas that turn with a platform are forgotten soon."
    )
    learnt_spread_sigmas: float = number(
        3.0,
        "sigma",
        "Baselines that are off their middle by more are of antennas that move apart, which have no distance.",
    )
    least_elevation_sine: float = number(0.05, "1", "Below 3 degrees the bending of air is not modelled.")
    part_s: float = number(
        2.0, "s", "A false sky that is dragged off at 10 m/s is then noticed before it is 20 m away."
    )
    part_epochs: int = number(4, "1", "A part's baseline rests on so many epochs at least.")
    glonass_channel_sigma_m: float = number(
        3.0,
        "m",
        "Each GLONASS satellite has a frequency of its own, and receivers' filters delay frequencies differently.",
    )
    longest_run_windows: int = number(
        12, "1", "Two minutes of usual windows: longer, satellites turn and errors are no longer as stated."
    )
    kept_instants: int = number(
        20, "1", "So many instants of a window are kept: what lasts for a window averages no more."
    )
    satellite_turn_rad_s: float = number(
        1.5e-4, "rad/s", "The direction of a satellite turns by no more, seen from the ground."
    )
    same_antenna_sigmas: float = number(
        3.3, "sigma", "A signal of the antenna is within so many in all but one case in a thousand."
    )
    slow_noise_factor: float = number(
        19.0, "1", "A mean varies by (1 + a) / (1 - a) more where noise lasts from epoch to epoch by a = 0.9."
    )
    fix_satellites: int = number(4, "1", "Fewer satellites make no fix.")
    distance_share: float = number(
        0.05, "1", "To which a distance is known in 95 of 100 cases, if nothing is said of that."
    )
    decimal_slip: float = number(
        10.0, "1", "A decimal point that is one place off makes a statement ten times too small."
    )
    statement_sigmas: float = number(
        5.0, "sigma", "A distance that is farther above what a slip of the point explains contradicts it."
    )
    least_range_m: float = number(19_000e3, "m", "Of a satellite in medium orbit, overhead; the others are farther.")


POLICY: Final = MultiReceiverPolicy()
