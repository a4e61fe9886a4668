"""The templates of all pages, how they write numbers, and a figure as they set it."""

from dataclasses import dataclass
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from skyproof.gnss.time import format_instant, format_moment, format_utc
from skyproof.report.words import angle_words, p_value_words, place_words, seconds_words, span_words

__all__ = ["Figure", "load_environment"]


@dataclass(frozen=True)
class Figure:
    """One drawing with its heading and the words below it."""

    heading: str
    svg: Markup
    caption: str


def _write_fixed(value: float | None, digits: int) -> str | None:
    return None if value is None else f"{value:.{digits}f}"


@cache
def load_environment() -> Environment:
    """Load the templates of all pages, and define how they write numbers."""
    environment = Environment(
        loader=PackageLoader("skyproof.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "fixed": _write_fixed,
        "instant": format_instant,
        "moment": format_moment,
        "utc": format_utc,
        "p_value": p_value_words,
        "seconds": seconds_words,
    }
    environment.globals |= {"span": span_words, "angles": angle_words, "place": place_words}
    return environment
