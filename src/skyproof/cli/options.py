"""The options that several commands have."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from skyproof.app.common.settings import Settings

__all__ = [
    "Debug",
    "Duration",
    "Json",
    "Nav",
    "OneDocument",
    "Overwrite",
    "Place",
    "Reach",
    "Start",
    "Tracking",
    "setting",
]


_NOT_GIVEN = {
    "duration_s": "the end",
    "place_deg": "every satellite is looked for",
    "antenna_distance_m": "not known",
    "antenna_distance_sigma_m": "2.5 % of it, at least 0.5 m",
}
_UNITS = {"s": "seconds", "hz": "hertz", "m": "metres", "deg": "degrees"}


def setting(name: str) -> Parameter:
    """Build the help of an option that is a setting from its description, unit and default."""
    field = Settings.model_fields[name]
    default = _NOT_GIVEN[name] if field.default is None else _write_default(field.default)
    unit = _UNITS.get(name.rpartition("_")[2])
    return Parameter(help=" ".join(filter(None, (field.description, unit and f"In {unit}.", f"Default: {default}."))))


def _write_default(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"


Nav = Annotated[Path | None, Parameter(help="RINEX navigation file; without it the signals' own messages are used.")]
Start = Annotated[float | None, setting("start_s")]
Duration = Annotated[float | None, setting("duration_s")]
Place = Annotated[tuple[float, float] | None, setting("place_deg")]
Reach = Annotated[float | None, setting("doppler_max_hz")]
Tracking = Annotated[Literal["scalar", "vector"] | None, setting("tracking")]
Overwrite = Annotated[
    bool,
    Parameter(help="Replace what an earlier run wrote into the folder, which is refused otherwise. Other files stay."),
]
Json = Annotated[bool, Parameter(name="--json", help="Print verdict.json on standard output, and nothing else there.")]
OneDocument = Annotated[bool, Parameter(name="--json", help="Print one JSON document, and nothing else there.")]
# `main` looks for --debug itself, since it is to work for errors in the options as well; here it is for the help.
Debug = Annotated[bool, Parameter(help="Show the traceback of an error.")]
