"""Numbers by which the test of several receivers decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "MultiReceiverPolicy"]


@dataclass(frozen=True)
class MultiReceiverPolicy:
    """Numbers by which the test of several receivers decides, each with its reason."""

    carrier_satellites: int = number(
        5, "1", "Four unknowns, baseline and clock, fit the fractions of four carriers whatever they are."
    )
    steady_phasor_length: float = number(
        0.8, "1", "The mean phasor of a difference over the window is so long at 0.1 cycles of scatter."
    )
    cycles_by_chance: float = number(
        0.05,
        "1",
        "Chosen: if a wrong choice of whole cycles fits with more than this chance, a fit is no evidence.",
    )
    carrier_fit_probability: float = number(1e-3, "1", "Chosen: a true choice of whole cycles is missed so rarely.")
    cycle_reach_sigmas: float = number(
        5.0, "sigma", "Whole cycles are sought so far from where the others put them; beyond is one in a million."
    )
    few_epochs: int = number(
        5, "1", "A median of five epochs outvotes two; with fewer, a signal that lacks one would take it from all."
    )
    agreeing_windows_share: float = number(
        0.5, "1", "Of windows in which both skies are received: where most disagree on the baseline, antennas move."
    )
    credible_cn0_dbhz: float = number(
        30.0, "dB-Hz", "Below, noise alone makes receivers lose a signal, or follow none.", "Kaplan & Hegarty, 8.9"
    )
    independent_echoes_m: float = number(
        1000.0,
        "m",
        "All but one in a hundred echoes of the model are late by less: antennas farther apart have their own.",
        "the model of detectors/second_signals/echoes.py",
    )
    same_delay_sigmas: float = number(
        5.0, "sigma", "Normal errors exceed it once in two million: delays that differ by more are not one."
    )
    course_coefficients: int = number(
        3, "1", "A parabola follows a range over a window: its rate changes by less than 0.2 m/s in a second."
    )
    unsteady_m: float = number(
        10.0,
        "m",
        "Assumed: a code that a loop follows scatters less about a smooth course; damaged numbers scatter more.",
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
        5.0, "sigma", "Normal errors exceed it once in two million: farther off a statement is wrong, not inexact."
    )
    least_distance_sigma_m: float = number(
        0.01, "m", "Assumed: a tape's error over some metres: no one states a distance better than a centimetre."
    )
    unknown_height_sigma_m: float = number(1e4, "m", "Above any mountain, and as far as most aircraft fly.")
    learnt_windows: int = number(3, "1", "The least that have a middle and a scatter.")
    remembered_windows: int = number(
        12, "1", "Two minutes of usual windows: antennas that turn with a platform are forgotten soon."
    )
    learnt_spread_sigmas: float = number(
        3.0, "sigma", "Normal errors exceed it once in 370: more scatter comes from antennas that move apart."
    )
    least_elevation_sine: float = number(0.05, "1", "Three degrees: lower, the bending of the air is not modelled.")
    part_s: float = number(
        2.0, "s", "A false sky that is dragged off at 10 m/s is then noticed before it is 20 m away."
    )
    part_epochs: int = number(4, "1", "So many epochs show a scatter besides the mean.")
    glonass_channel_sigma_m: float = number(
        3.0,
        "m",
        "Assumed: a delay of 10 ns: GLONASS satellites differ in frequency, and filters delay each by another amount.",
    )
    longest_run_windows: int = number(
        12, "1", "Two minutes of usual windows: longer, satellites turn by a degree and errors are not as stated."
    )
    kept_instants: int = number(
        20, "1", "Two a second of a usual window: errors that last for a window average no more."
    )
    satellite_turn_rad_s: float = number(
        1.5e-4, "rad/s", "A turn in 11 h 58 min is 0.000146 rad/s: directions from the ground change about as fast."
    )
    same_antenna_sigmas: float = number(
        3.3, "sigma", "A signal of the antenna is within so many in all but one case in a thousand."
    )
    slow_noise_factor: float = number(
        19.0, "1", "A mean varies by (1 + a) / (1 - a) more where noise lasts from epoch to epoch by a = 0.9."
    )
    fix_satellites: int = number(4, "1", "Three coordinates and a clock take four ranges.", "Kaplan & Hegarty, 2.5.2")
    fixes_share: float = number(
        0.8, "1", "Chosen: of the rate, of the test along baselines that takes all noise: the most powerful gets most."
    )
    differences_share: float = number(
        0.15, "1", "Chosen: of the rate, of the one between receivers, for errors that receivers share."
    )
    alone_share: float = number(
        0.05, "1", "The remainder: pairings that mix two skies are hundreds of metres off, so their test needs little."
    )
    distance_share: float = number(
        0.05, "1", "Chosen: who paces or looks at a map is off by more in five of a hundred cases."
    )
    decimal_slip: float = number(
        10.0, "1", "A decimal point that is one place off makes a statement ten times too small."
    )
    statement_sigmas: float = number(
        5.0,
        "sigma",
        "Normal errors exceed it once in two million: farther above, no slip of the point explains a distance.",
    )
    least_range_m: float = number(
        19_000e3, "m", "GLONASS satellites are the nearest, 19 100 km above the ground.", "GLONASS ICD L1, L2 5.1, 1.2"
    )


POLICY: Final = MultiReceiverPolicy()
