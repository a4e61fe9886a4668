"""Numbers by which the test for second signals decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "SecondSignalsPolicy"]


@dataclass(frozen=True)
class SecondSignalsPolicy:
    """Numbers by which the test for second signals decides, each with its reason."""

    late_copy_hz: float = number(
        10.0, "Hz", "Assumed: the carrier of a late copy differs by no more: it is not generated again."
    )
    same_delay_sigmas: float = number(
        4.0,
        "sigma",
        "Normal errors exceed it once in 16 000: nearer to the median, delays belong to one late copy of the sky.",
    )
    delays_agree_probability: float = number(
        0.05, "1", "Chosen: where so many delays of echoes agree by chance more often, they show no late copy."
    )
    attack_satellites: int = number(2, "1", "One satellite's second signal gives no false position.")
    telling_p_value: float = number(
        0.05, "1", "The share of satellites with an echo: a larger p-value tells no more than that."
    )
    most_late_m: float = number(
        3000.0,
        "m",
        "Assumed: a delay of 10 us: no reflector that counts is farther off, nor a repeater's cable longer.",
    )
    copy_weaker_db: float = number(1.0, "dB", "Chosen: a copy that is as strong is no reflection.")
    same_place_probability: float = number(
        1e-3, "1", "Chosen: a late copy is missed so rarely for its place, which differs by the errors of both."
    )
    sets_fit_probability: float = number(1e-4, "1", "Chosen: a set of signals from one position is missed so rarely.")
    elevation_class_deg: float = number(
        15.0,
        "deg",
        "Width of the classes of elevation for which the source gives the law of delays.",
        "doi 10.1186/s43020-020-00027-7, table 1",
    )
    delay_shapes: tuple[float, ...] = number(
        (2.62, 2.77, 2.81, 2.56, 2.47, 2.40),
        "1",
        "Of the gamma law of an echo's delay, for each class of elevation.",
        "doi 10.1186/s43020-020-00027-7, table 1",
    )
    delay_scales_m: tuple[float, ...] = number(
        (129.83, 105.52, 80.93, 65.12, 53.22, 43.24),
        "m",
        "Of the gamma law of an echo's delay, for each class of elevation.",
        "doi 10.1186/s43020-020-00027-7, table 1",
    )
    echo_level_db: float = number(
        -12.35,
        "dB",
        "Mean of an echo's power beside that of the direct signal, at no delay.",
        "doi 10.1186/s43020-020-00027-7, table 1",
    )
    echo_fall_db_m: float = number(
        -0.0016,
        "dB/m",
        "By which the mean of an echo's power changes with its delay.",
        "doi 10.1186/s43020-020-00027-7, table 1",
    )
    far_echo_m: float = number(4500.0, "m", "An echo from afar is up to 15 us late, as is assumed on the careful side.")
    headroom_db: float = number(20.0, "dB", "A direct signal farther below the strongest may be blocked by anything.")
    doppler_edges_hz: tuple[float, ...] = number(
        (50.0, 550.0), "Hz", "Classes of Doppler: of reflectors at up to 5 m/s, at up to 50 m/s, faster."
    )
    echo_doppler_shares: tuple[float, ...] = number(
        (0.95, 0.05 - 1e-6, 1e-6), "1", "Of echoes, in each class of Doppler: assumed, as few reflectors move."
    )
    false_doppler_shares: tuple[float, ...] = number(
        (0.7, 0.15, 0.15), "1", "Of false signals, in each class of Doppler: assumed, as no source tells."
    )
    false_near_m: float = number(
        3000.0, "m", "Ten chips to either side, for the false signals that are near to the true ones."
    )
    false_anywhere_m: float = number(
        150e3,
        "m",
        "Half a code period of 1 ms to either side, where the other false signals lie.",
        "IS-GPS-200N, 3.2.1.3",
    )
    false_near_share: float = number(
        0.5, "1", "Assumed of false signals, as no source tells: near to the true ones or anywhere alike."
    )
    false_levels_db: tuple[float, ...] = number(
        (-12.0, 30.0),
        "dB",
        "From the weakest that is looked at to the strongest, any level of a false signal is as likely.",
    )


POLICY: Final = SecondSignalsPolicy()
