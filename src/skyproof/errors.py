"""What can go wrong, in the user's words.

    SkyproofError           the root: the command line catches it once and prints one line
    ├── InputError          a file or stream that cannot be read as what it should be
    ├── OutputError         a place that cannot be written
    │   └── IncompleteOutput    files that could not be written; what was found is in its `result`
    ├── SettingsError       an option, platform file or setting that makes no sense
    ├── ScenarioError       a scene that cannot be simulated
    └── NotEnoughData       readable, but too little or too poor to work on

Each message says what came, where (file, byte, line, key), what was expected and what to do about it; the table of all
of them is made by the tests (`pytest --messages FILE`).
"""

from collections.abc import Mapping
from math import isfinite
from typing import Any, Final

__all__ = [
    "IncompleteOutput",
    "InputError",
    "NotEnoughData",
    "OutputError",
    "ScenarioError",
    "SettingsError",
    "SkyproofError",
    "describe_fault",
    "make_readable",
    "require_probability",
    "shorten",
    "write_value",
]

_LONGEST: Final = 60
"""Of a value or a key that is named, in characters."""
_LONGEST_MESSAGE: Final = 3000
_BOUNDS: Final = {"ge": "{:g} or more", "gt": "more than {:g}", "le": "{:g} or less", "lt": "less than {:g}"}
_KINDS: Final = {
    "int_": "a whole number",
    "float_": "a number",
    "string_type": "a text",
    "path_type": "a text",
    "bool_": "true or false",
    "tuple_type": "a list",
    "list_type": "a list",
    "dict_type": "a table",
    "model_": "a table",
}
"""What Pydantic expects, by the beginning of its fault's type."""


class SkyproofError(Exception):
    """Root of the errors that a user can put right; anything else that is raised is our mistake.

    The middle of a very long message is left out: what came may be as long as the file that it came from.
    """

    def __init__(self, message: str = "") -> None:
        half = _LONGEST_MESSAGE // 2
        super().__init__(message if len(message) <= 2 * half else f"{message[:half]} ... {message[-half:]}")


class InputError(SkyproofError):
    """A file or stream cannot be read as what it should be."""


class OutputError(SkyproofError):
    """A file or folder cannot be written."""


class IncompleteOutput(OutputError):
    """Some files could not be written. result : what the use case would have returned, so that nothing is lost."""

    def __init__(self, message: str, result: Any) -> None:
        super().__init__(message)
        self.result = result


class SettingsError(SkyproofError):
    """An option, platform file or setting makes no sense."""


class ScenarioError(SkyproofError):
    """A scene cannot be simulated."""


class NotEnoughData(SkyproofError):
    """The input is readable, but too little or too poor to work on."""


def shorten(text: str, longest: int = _LONGEST) -> str:
    """Shorten a text to so many characters, ending in "..."."""
    return text if len(text) <= longest else f"{text[: longest - 3]}..."


def make_readable(text: str) -> str:
    """Escape what no person can read: control characters, and bytes of a name that are not UTF-8.

    Control characters would command a terminal. Python holds such bytes as lone surrogates, which no document takes.
    """
    if text.isprintable():
        return text
    return "".join(sign if sign.isprintable() or sign == "\n" else _escape(sign) for sign in text)


def _escape(sign: str) -> str:
    code = ord(sign)
    if 0xDC80 <= code <= 0xDCFF:
        return f"\\x{code - 0xDC00:02x}"
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def require_probability(owner: str, name: str, value: float) -> None:
    """Raise SettingsError unless a setting is a probability between 0 and 1, neither of them included."""
    if not 0.0 < value < 1.0:
        raise SettingsError(f"{owner}: {name} is {value}, expected above 0 and below 1; give one such as 0.001")


def describe_fault(place: str, fault: Mapping[str, Any]) -> str:
    """Describe one fault that Pydantic found, with what came and what was expected.

    Parameters
    ----------
    place : the path of the key, as it stands in the file; empty for the whole.
    fault : a member of the list that `ValidationError.errors()` gives.
    """
    place = shorten(place)
    kind, message = str(fault["type"]), str(fault["msg"]).removeprefix("Value error, ")
    if kind == "missing":
        return f"{place} is missing"
    context = fault.get("ctx", {})
    if kind in ("too_short", "too_long") and "actual_length" in context:
        least, most = context.get("min_length"), context.get("max_length")
        return f"{place} holds {context['actual_length']}, expected {f'{least} or more' if most is None else most}"
    expected = next((words.format(float(context[key])) for key, words in _BOUNDS.items() if key in context), "")
    expected = expected or next((words for begin, words in _KINDS.items() if kind.startswith(begin)), "")
    if kind in ("float_type", "int_type") and isinstance(fault["input"], str) and _is_number(fault["input"]):
        expected += f" without quotes: {shorten(fault['input'])}"
    if not expected and message.startswith("Input should be "):
        expected = message.removeprefix("Input should be ")
    if not expected:
        return f"{place}: {message}" if place else message
    came = fault["input"]
    return f"{place or 'the whole'} = {write_value(came)}, expected {expected}"


def _is_number(text: str) -> bool:
    try:
        return isfinite(float(text))
    except ValueError:
        return False


def write_value(value: object) -> str:
    """Write a value as it stands in a file, shortened."""
    try:
        text = f'"{value}"' if isinstance(value, str) else str(value)
    except ValueError:  # a whole number of thousands of digits
        return "a number of thousands of digits"
    return shorten(text.lower() if isinstance(value, bool) else text)
