"""Strings 1 to 4 of GLONASS to ephemerides (GLONASS ICD L1, L2 5.1, 4.4 and table 4.5).

A string is 85 bits, the idle one first; bit 85 of the standard is bit 0 here.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from skyproof.gnss.ephemeris import GlonassEphemeris
from skyproof.gnss.messages.bit_fields import BitField, Words, read_fields
from skyproof.gnss.time import gpst_from_utc, utc_from_gpst, week_and_tow

__all__ = ["glonass_ephemeris", "glonass_string"]

_BITS: Final = 85
_MOSCOW_H: Final = 3  # ahead of UTC
_STEP_S: Final = 900.0


def _state(axis: str) -> tuple[BitField, ...]:
    return (
        BitField(f"{axis}_velocity_m_s", ((21, 24),), 1e3 * 2.0**-20, magnitude=True),
        BitField(f"{axis}_acceleration_m_s2", ((45, 5),), 1e3 * 2.0**-30, magnitude=True),
        BitField(f"{axis}_position_m", ((50, 27),), 1e3 * 2.0**-11, magnitude=True),
    )


_STRINGS: Final[dict[int, tuple[BitField, ...]]] = {
    1: (
        BitField("frame_h", ((9, 5),)),
        BitField("frame_min", ((14, 6),)),
        BitField("frame_half_min", ((20, 1),)),
        *_state("x"),
    ),
    2: (BitField("health", ((5, 3),)), BitField("reference_steps", ((9, 7),)), *_state("y")),
    3: (BitField("gamma_n", ((6, 11),), 2.0**-40, magnitude=True), BitField("ill", ((20, 1),)), *_state("z")),
    4: (
        BitField("tau_n", ((5, 22),), 2.0**-30, magnitude=True),
        BitField("delta_tau_n", ((27, 5),), 2.0**-30, magnitude=True),
        BitField("age_days", ((32, 5),)),
        BitField("day", ((59, 11),)),
        BitField("slot", ((70, 5),)),
    ),
}


def glonass_string(frame: int) -> tuple[int, Mapping[str, float]] | None:
    """Return number and contents of a string (85 bits); None where its first bit is not idle."""
    if frame >> 84:
        return None
    number = frame >> 80 & 15
    return number, read_fields(_STRINGS.get(number, ()), frame, _BITS)


def glonass_ephemeris(
    strings: Words, sat: str, received_gpst: np.datetime64, frequency_number: int
) -> GlonassEphemeris | None:
    """Return the ephemeris that strings 1 to 4 make; None where one is missing or another satellite's.

    received_gpst : when they came: the time of ephemeris is the one of its day that lies nearest.
    """
    if not all(number in strings for number in (1, 2, 3, 4)):
        return None
    merged: dict[str, Any] = {**strings[1], **strings[2], **strings[3], **strings[4]}
    if merged["slot"] not in (0, int(sat[1:])):
        return None
    moscow = utc_from_gpst(received_gpst) + np.timedelta64(_MOSCOW_H, "h")
    day = moscow.astype("datetime64[D]").astype("datetime64[ns]")
    reference = day + np.timedelta64(round(merged["reference_steps"] * _STEP_S), "s")
    half_day = np.timedelta64(12, "h")
    if reference - moscow > half_day:
        reference -= 2 * half_day
    elif moscow - reference > half_day:
        reference += 2 * half_day
    week, toe = week_and_tow(gpst_from_utc(reference - np.timedelta64(_MOSCOW_H, "h")))
    return GlonassEphemeris(
        sat=sat,
        week=week,
        toe=toe,
        tau_n=merged["tau_n"],
        gamma_n=merged["gamma_n"],
        frequency_number=frequency_number,
        position_m=(merged["x_position_m"], merged["y_position_m"], merged["z_position_m"]),
        velocity_m_s=(merged["x_velocity_m_s"], merged["y_velocity_m_s"], merged["z_velocity_m_s"]),
        acceleration_m_s2=(merged["x_acceleration_m_s2"], merged["y_acceleration_m_s2"], merged["z_acceleration_m_s2"]),
        health=int(merged["health"]) & 4 | int(merged["ill"]),
        age_days=merged["age_days"],
        delta_tau_n=merged["delta_tau_n"],
    )
