"""Numbers by which the test for second signals decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.detectors.policy import policy_field

__all__ = ["POLICY", "SecondSignalsPolicy"]


@dataclass(frozen=True)
class SecondSignalsPolicy:
    """Numbers by which the test for second signals decides, each with its reason."""

    late_copy_hz: float = policy_field(
        10.0,
        unit="Hz",
        reason="The carrier of a late copy differs by no more: it is not sent anew.",
    )
    same_delay_sigmas: float = policy_field(
        4.0,
        unit="sigma",
        reason=("Second signals whose delays differ from the satellites' median by less are one late copy of the sky."),
    )
    delays_agree_probability: float = policy_field(
        0.05,
        unit="1",
        reason="Above this chance that as many delays of echoes agree, they show no late copy.",
    )
    attack_satellites: int = policy_field(
        2,
        unit="1",
        reason="One satellite's second signal makes no attack.",
    )
    telling_p_value: float = policy_field(
        0.05,
        unit="1",
        reason="A satellite has an echo at all with such a chance: a larger p-value says nothing.",
    )
    most_late_m: float = policy_field(
        3000.0,
        unit="m",
        reason="No reflector that counts is farther off, nor a repeater's cable longer.",
    )
    copy_weaker_db: float = policy_field(
        1.0,
        unit="dB",
        reason="A copy that is as strong is no reflection.",
    )
    same_place_probability: float = policy_field(
        1e-3,
        unit="1",
        reason=("A late copy is missed so rarely because its place differs by more than the errors of both explain."),
    )
    sets_fit_probability: float = policy_field(
        1e-4,
        unit="1",
        reason="A set of signals that are of one position is missed so rarely.",
    )
    elevation_class_deg: float = policy_field(
        15.0,
        unit="deg",
        reason="Width of the classes of elevation for which the source gives the law of delays.",
        source="doi 10.1186/s43020-020-00027-7, table 1",
    )
    delay_shapes: tuple[float, ...] = policy_field(
        (2.62, 2.77, 2.81, 2.56, 2.47, 2.40),
        unit="1",
        reason="Of the gamma law of an echo's delay, for each class of elevation.",
        source="doi 10.1186/s43020-020-00027-7, table 1",
    )
    delay_scales_m: tuple[float, ...] = policy_field(
        (129.83, 105.52, 80.93, 65.12, 53.22, 43.24),
        unit="m",
        reason="Of the gamma law of an echo's delay, for each class of elevation.",
        source="doi 10.1186/s43020-020-00027-7, table 1",
    )
    echo_level_db: float = policy_field(
        -12.35,
        unit="dB",
        reason="Mean of an echo's power beside that of the direct signal, at no delay.",
        source="doi 10.1186/s43020-020-00027-7, table 1",
    )
    echo_fall_db_m: float = policy_field(
        -0.0016,
        unit="dB/m",
        reason="By which the mean of an echo's power changes with its delay.",
        source="doi 10.1186/s43020-020-00027-7, table 1",
    )
    far_echo_m: float = policy_field(
        4500.0,
        unit="m",
        reason="An echo from afar is up to 15 us late, as is assumed on the careful side.",
    )
    headroom_db: float = policy_field(
        20.0,
        unit="dB",
        reason="A direct signal farther below the strongest may be blocked by anything.",
    )
    doppler_edges_hz: tuple[float, ...] = policy_field(
        (50.0, 550.0),
        unit="Hz",
        reason="Classes of Doppler: of reflectors at up to 5 m/s, at up to 50 m/s, faster.",
    )
    echo_doppler_shares: tuple[float, ...] = policy_field(
        (0.95, 0.05 - 1e-6, 1e-6),
        unit="1",
        reason="Of echoes, in each class of Doppler: assumed, as few reflectors move.",
    )
    false_doppler_shares: tuple[float, ...] = policy_field(
        (0.7, 0.15, 0.15),
        unit="1",
        reason="Of false signals, in each class of Doppler: assumed, as no source tells.",
    )
    false_near_m: float = policy_field(
        3000.0,
        unit="m",
        reason="Half of the false signals have delays within this, to either side.",
    )
    false_anywhere_m: float = policy_field(
        150e3,
        unit="m",
        reason="The other false signals have any delay: half a code period to either side.",
    )
    false_near_share: float = policy_field(
        0.5,
        unit="1",
        reason="Of the false signals, near to the true ones.",
    )
    false_levels_db: tuple[float, ...] = policy_field(
        (-12.0, 30.0),
        unit="dB",
        reason=("From the weakest that is looked at to the strongest, any level of a false signal is as likely."),
    )


POLICY: Final = SecondSignalsPolicy()
