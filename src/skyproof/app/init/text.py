"""The lines of a platform file that a person completes: keys that are known, and examples behind a #."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import Any, Final

import tomli_w
from pydantic import BaseModel

from skyproof.app.common.platform import Platform
from skyproof.app.common.platform_tables import ERRORS, GAIN_ERRORS, PlatformImu, PlatformReceiver, StatedAttitude
from skyproof.app.common.settings import Settings

__all__ = ["FoundReceiver", "write_one_line", "write_platform_lines"]

_WIDTH: Final = 100
_INSTEAD: Final = (
    {"file": "heading_deg, pitch_deg and roll_deg"}
    | dict.fromkeys(ERRORS, "grade, with the three others")
    | dict.fromkeys(GAIN_ERRORS, "grade, beside the four numbers")
)
"""Keys that stand in the place of others."""
_OF_RECEIVERS: Final = ("antennas_enu_m", "antennas_sigma_m", "speed_max_m_s", "oscillator")
"""Settings that follow from other tables."""
_SPACING_M: Final = 0.19
"""Between antennas of an example: one wavelength of L1."""
_APART_M: Final = 5.0
"""Between receivers of an example."""


@dataclass(frozen=True)
class FoundReceiver:
    """A receiver by its input: what that says in words, and how many antennas it has."""

    name: str
    input: str
    says: tuple[str, ...]
    antennas: int


def write_platform_lines(receivers: Sequence[FoundReceiver], files: Mapping[str, str], version: str) -> Iterator[str]:
    """Yield the lines of `platform.toml`.

    files : of the tables "imu" and "attitude", where there are any.
    """
    yield f"# A platform file, begun by skyproof init {version}: what the inputs cannot say of what carries them."
    yield "# Lines with # right before a key are examples: where one holds, correct it and take its # away."
    yield "#     skyproof protect --platform THIS_FILE --nav NAVIGATION_FILE --out FOLDER"
    yield from ("", *_examples(Platform))
    if sum(receiver.antennas == 1 for receiver in receivers) > 1:
        yield ""
        yield from _prose("Files of several antennas of one receiver stand in inputs of one table, one per antenna.")
    for number, receiver in enumerate(receivers):
        yield from ("", *_receiver(number, receiver))
    yield from ("", *_attitude(files.get("attitude")))
    yield from ("", *_imu(files.get("imu")))
    yield from ("", *_prose("The settings, with their defaults where they have one."), "#[protect]")
    yield from _examples(Settings, skip=_OF_RECEIVERS)


def _receiver(number: int, receiver: FoundReceiver) -> Iterator[str]:
    yield from (
        "[[receivers]]",
        f"name = {write_one_line(receiver.name)}",
        f"inputs = {write_one_line([receiver.input])}",
    )
    yield from (line for words in receiver.says for line in _prose(words))
    of_several = {
        "antennas_m": [[0.0, round(_SPACING_M * antenna, 2), 0.0] for antenna in range(receiver.antennas)],
        "line_bias_cyc": [0.0] * receiver.antennas,
    }
    skip = ("name", "inputs", *(of_several if receiver.antennas == 1 else ["spin"]))
    known = of_several | {"body_m": [-_APART_M * number, 0.0, 0.0] if number else [0.0, 0.0, 0.0]}
    yield from _examples(PlatformReceiver, skip=skip, known=known, words=number == 0)


def _attitude(file: str | None) -> Iterator[str]:
    """Yield the table of the attitude behind #: only a person knows how good a file's angles are."""
    yield from _prose(str(Platform.model_fields["attitude"].description))
    yield "#[attitude]"
    if file is None:
        yield from _examples(StatedAttitude)
        return
    yield f"#file = {write_one_line(file)}"
    yield from _examples(StatedAttitude, skip=("file", "heading_deg", "pitch_deg", "roll_deg"))


def _imu(file: str | None) -> Iterator[str]:
    yield from _prose(str(Platform.model_fields["imu"].description))
    if file is None:
        yield "#[imu]"
        yield from (*_prose(str(PlatformImu.model_fields["file"].description)), '#file = "imu.csv"')
    else:
        yield from ("[imu]", f"file = {write_one_line(file)}")
    yield from _examples(PlatformImu, skip=("file",))


def _examples(
    model: type[BaseModel], *, skip: Collection[str] = (), known: Mapping[str, Any] | None = None, words: bool = True
) -> Iterator[str]:
    """Yield each key behind a # with its meaning and a value.

    known : values that are better than the model's examples.
    """
    for key, field in model.model_fields.items():
        value = (known or {}).get(key, field.examples[0] if field.examples else field.default)
        if key in skip or value is None or isinstance(value, tuple | BaseModel):
            continue
        if words:
            yield from _prose(str(field.description))
        line = f"{key} = {write_one_line(value)}"
        yield from _prose(f"In place of {_INSTEAD[key]}: {line}") if key in _INSTEAD else [f"#{line}"]


def _prose(text: str) -> list[str]:
    return [f"# {line}" for line in wrap(text, _WIDTH, break_long_words=False, break_on_hyphens=False)]


def write_one_line(value: Any) -> str:
    """Write a value as TOML on one line; tomli-w does so for single values only."""
    if isinstance(value, list):
        return f"[{', '.join(map(write_one_line, value))}]"
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {write_one_line(element)}' for key, element in value.items())} }}"
    return tomli_w.dumps({"x": value}).removeprefix("x = ").removesuffix("\n")
