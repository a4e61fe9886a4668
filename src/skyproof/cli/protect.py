"""`skyproof protect`."""

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from skyproof import app
from skyproof.cli.options import Debug, Duration, Json, Nav, Overwrite, Place, Reach, Start, Tracking, setting
from skyproof.cli.progress import progress
from skyproof.cli.screen import whatever_is_missing
from skyproof.cli.summary import print_result
from skyproof.interruption import get_exit_code

__all__ = ["protect"]

EXIT_CODES = {"authentic": 0, "spoofed": 1, "suspect": 3, "no_attack_seen": 4}


def protect(
    inputs: Annotated[
        list[Path] | None,
        Parameter(
            name="INPUT",
            help="One per receiver: a recording with its sidecar, an observation file or a receiver's log. Leave them "
            "out if the platform file names them.",
        ),
    ] = None,
    /,
    *,
    out: Annotated[Path, Parameter(help="Folder for the verdict, the report, fixes and all other files.")],
    nav: Nav = None,
    imu: Annotated[
        Path | None,
        Parameter(help="Inertial readings (CSV, Parquet); the platform file states how the unit is mounted."),
    ] = None,
    platform: Annotated[
        Path | None, Parameter(help="Platform file: receivers, inputs, positions and settings.")
    ] = None,
    false_alarm_probability_per_hour: Annotated[float | None, setting("false_alarm_probability_per_hour")] = None,
    antenna_distance_m: Annotated[float | None, setting("antenna_distance_m")] = None,
    antenna_distance_sigma_m: Annotated[float | None, setting("antenna_distance_sigma_m")] = None,
    antenna_separation_m: Annotated[float | None, setting("antenna_separation_m")] = None,
    tracking: Tracking = None,
    doppler_max_hz: Reach = None,
    place_deg: Place = None,
    position_format: Annotated[Literal["degrees", "degrees-minutes"] | None, setting("position_format")] = None,
    start_s: Start = None,
    duration_s: Duration = None,
    overwrite: Overwrite = False,
    json: Json = False,
    exit_code: Annotated[
        bool, Parameter(help="Exit with 0 authentic, 1 spoofed, 3 suspect, 4 no attack seen.")
    ] = False,
    debug: Debug = False,
) -> int:
    """Detect spoofed signals, which and since when, and give a position that can be trusted."""
    with whatever_is_missing(partial(print_result, as_json=json, incomplete=True)):
        result = app.protect.protect(
            inputs or [],
            nav=nav,
            imu=imu,
            platform=platform,
            out=out,
            false_alarm_probability_per_hour=false_alarm_probability_per_hour,
            antenna_distance_m=antenna_distance_m,
            antenna_distance_sigma_m=antenna_distance_sigma_m,
            antenna_separation_m=antenna_separation_m,
            tracking=tracking,
            doppler_max_hz=doppler_max_hz,
            place_deg=place_deg,
            position_format=position_format,
            start_s=start_s,
            duration_s=duration_s,
            overwrite=overwrite,
            progress=progress(),
        )
    print_result(result, as_json=json)
    if result.interrupted:
        return get_exit_code()
    return EXIT_CODES[result.verdict.verdict] if exit_code else 0
