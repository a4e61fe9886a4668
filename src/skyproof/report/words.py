"""Numbers in plain words, for people who want to know how sure something is."""

import math

import numpy as np

from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.gnss.time import format_instant, leap_seconds
from skyproof.verdict import Verdict

__all__ = [
    "angle_words",
    "chance_words",
    "distance_words",
    "evidence_words",
    "leap_words",
    "number_words",
    "offset_m",
    "offset_words",
    "p_value_words",
    "place_words",
    "power_words",
    "rate_words",
    "seconds_apart",
    "seconds_words",
    "span_words",
    "uses_minutes",
]

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_HOLD = "\N{NO-BREAK SPACE}"
_DIGITS_OF_A_MINUTE = 2  # fewer than of degrees: a minute is about a hundredth of a degree
_LEAST_CLAIMED = 1e-6
"""Less is not claimed of evidence: false alarms were counted down to about this, and no model of noise is known to hold
further out. An attacker is not chance: how probable an attack is no p-value says."""
_LEAST = 1e-300  # below this a float64 soon holds nothing; said as "practically never"


def power_words(exponent: int) -> str:
    """Write a power of ten: 10⁻³."""
    return "10" + str(exponent).translate(_SUPERSCRIPTS)


def _write_count(number: float) -> str:
    """Write a number of at least one, cut to one figure: 3 000, 7·10⁸."""
    power = math.floor(math.log10(number) + 1e-9)
    figure = math.floor(number / 10.0**power + 1e-9)
    if power >= 7:
        return f"{figure}·{power_words(power)}" if figure > 1 else power_words(power)
    return f"{figure * 10**power:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def chance_words(probability: float) -> str:
    """State how often something of this probability happens; of rare things slightly too often."""
    if probability < _LEAST:
        return "practically never"
    if probability >= 0.01:
        percent = 100.0 * probability
        return f"in {percent:.{0 if percent >= 9.95 else 1}f} of 100 cases".replace(".0 ", " ")
    return f"once in {_write_count(1.0 / probability)} cases"


def evidence_words(p_value: float) -> str:
    """State how often chance gives evidence of this p-value, and no less than is known to hold."""
    if p_value < _LEAST_CLAIMED:
        return f"less than {chance_words(_LEAST_CLAIMED)}"
    return chance_words(p_value)


def number_words(value: float) -> str:
    """Write a number of any size to four figures, without an exponent as long as that is readable."""
    text = f"{value:.0f}" if 1e3 <= abs(value) < 1e7 else f"{value:.4g}"
    return text.replace("-", "\N{MINUS SIGN}")


def p_value_words(p_value: float) -> str:
    """Write a p-value to two figures without line breaks: p = 0.33, p = 1.3·10⁻⁹, p < 10⁻³⁰⁰."""
    if p_value < _LEAST:
        return f"p{_HOLD}<{_HOLD}{power_words(-300)}"
    if p_value >= 1e-3:
        return f"p{_HOLD}={_HOLD}{p_value:.2g}"
    figures, exponent = f"{p_value:.1e}".split("e")
    return f"p{_HOLD}={_HOLD}{figures}·{power_words(int(exponent))}"


def rate_words(probability_per_hour: float) -> str:
    """State how often something of this probability per hour happens."""
    if probability_per_hour < _LEAST:
        return "practically never"
    return f"once in {_write_count(1.0 / probability_per_hour)} hours" if probability_per_hour <= 0.5 else "every hour"


def leap_words(gpst: str) -> str:
    """State how GPS time differs from UTC: UTC + 18 s."""
    return f"UTC + {leap_seconds(np.datetime64(gpst, 'ns'))} s"


def seconds_apart(later: str, earlier: str) -> float:
    """Return the seconds between two instants of the verdict, for words only: to the microsecond."""
    return float((np.datetime64(later, "us") - np.datetime64(earlier, "us")) / np.timedelta64(1, "s"))


def span_words(first: str | None, last: str | None, day: str = "") -> str:
    """Write a stretch of time; the date stands once if it is the same, and not at all if it is `day`."""
    begin, end = ("unknown" if instant is None else format_instant(instant) for instant in (first, last))
    same_day = first is not None and last is not None and first[:10] == last[:10]
    return f"{begin} to {end[11:] if same_day else end}".removeprefix(f"{day} " if same_day and day else "")


def seconds_words(seconds: float) -> str:
    """Write a time in the unit that suits its size, three figures."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if abs(seconds) >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds * 1e9:.3g} ns"


def distance_words(metres: float) -> str:
    """Write a distance in the unit that suits its size: 3.3 m, 902 m, 12.4 km."""
    if metres < 10e3:
        return f"{metres:.{1 if metres < 100.0 else 0}f} m"
    return f"{metres / 1e3:.{1 if metres < 1e6 else 0}f} km"


def place_words(lat_deg: float, lon_deg: float, digits: int = 6, *, minutes: bool = False) -> str:
    """Write latitude and longitude: 59.412099° N, 16.883698° E.

    digits : of degrees. minutes : degrees and decimal minutes instead, as fine: 59° 24.7259′ N, 16° 53.0219′ E.
    """
    return ", ".join(angle_words(lat_deg, lon_deg, digits, minutes=minutes))


def angle_words(lat_deg: float, lon_deg: float, digits: int, *, minutes: bool) -> tuple[str, str]:
    """Write latitude and longitude separately, as `place_words`."""
    return _angle(lat_deg, "NS", digits, minutes), _angle(lon_deg, "EW", digits, minutes)


def _angle(angle_deg: float, sides: str, digits: int, minutes: bool) -> str:
    side = sides[0] if angle_deg >= 0.0 else sides[1]
    if not minutes:
        return f"{abs(angle_deg):.{digits}f}° {side}"
    digits = max(digits - _DIGITS_OF_A_MINUTE, 0)
    whole, rest = divmod(round(abs(angle_deg) * 60.0 * 10**digits), 60 * 10**digits)
    return f"{whole}° {rest / 10**digits:0{digits + 3 if digits else 2}.{digits}f}′ {side}"


def uses_minutes(verdict: Verdict) -> bool:
    """Test whether the run's settings ask for degrees and decimal minutes."""
    return verdict.settings.get("position_format") == "degrees-minutes"


_COMPASS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")


def offset_m(from_deg: tuple[float, float], to_deg: tuple[float, float]) -> tuple[float, float]:
    """Return metres east and north from a place (latitude, longitude) to another, in its tangent plane."""
    (lat, lon), (other, further) = ((math.radians(a), math.radians(b)) for a, b in (from_deg, to_deg))
    step_m = ecef_from_geodetic(other, further, 0.0) - ecef_from_geodetic(lat, lon, 0.0)
    east, north, _ = (float(part) for part in rot_enu_ecef(lat, lon) @ step_m)
    return east, north


def offset_words(from_deg: tuple[float, float], to_deg: tuple[float, float]) -> str:
    """State how far and in which direction a place lies from another: 902 m to the south-east.

    In the plane that touches the Earth at the first one.
    """
    east, north = offset_m(from_deg, to_deg)
    metres = math.hypot(east, north)
    point = _COMPASS[round(math.atan2(east, north) / (math.pi / 4.0)) % 8]
    return f"{distance_words(metres)} to the {point}"
