"""Numbers in plain words, for people who want to know how sure something is."""

import math

__all__ = ["chance_words", "instant_words", "rate_words", "seconds_words"]

_SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


def _count(number: float) -> str:
    """A large number, cut to one figure: 3 000, 10⁹."""
    if not math.isfinite(number):  # the inverse of a denormal
        return "10³⁰⁰"
    power = math.floor(math.log10(number) + 1e-9)
    if power >= 7:
        return "10" + str(power).translate(_SUPERSCRIPTS)
    size = 10**power
    return f"{int(number / size + 1e-9) * size:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def chance_words(probability: float) -> str:
    """How often something of this probability happens; rare things are told a little more often than they are."""
    if probability < 1e-300:
        return "practically never"
    if probability >= 0.01:
        percent = 100.0 * probability
        return f"in {percent:.{0 if percent >= 9.95 else 1}f} of 100 cases".replace(".0 ", " ")
    return f"once in {_count(1.0 / probability)} cases"


def rate_words(probability_per_hour: float) -> str:
    """How often something of this probability per hour happens."""
    if probability_per_hour < 1e-300:
        return "practically never"
    return f"once in {_count(1.0 / probability_per_hour)} hours" if probability_per_hour < 1.0 else "every hour"


def instant_words(gpst: str | None) -> str:
    """An instant of the verdict as a person writes it: date, space, time."""
    return "unknown" if gpst is None else gpst.replace("T", " ")


def seconds_words(seconds: float) -> str:
    """A time in the unit that suits its size, three figures."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if abs(seconds) >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds * 1e9:.3g} ns"
