"""`platform.toml`: what the inputs of a run cannot say of the platform that carries the receivers."""

from collections.abc import Sequence
from math import dist, hypot
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field, ValidationError, ValidationInfo, field_validator

from skyproof.app.common.platform_tables import PlatformImu, PlatformReceiver, StatedAttitude
from skyproof.app.common.settings import Settings
from skyproof.errors import SettingsError
from skyproof.formats.documents import read_toml
from skyproof.formats.models import Model, Number, describe_faults, find_repeated
from skyproof.fusion.policy import POLICY

__all__ = ["SCHEMA_PATH", "Platform", "platform_schema", "read_platform"]

SCHEMA_PATH: Final = Path(__file__).with_name("platform.schema.json")


class Platform(Model):
    """What carries the receivers, what there is besides their recordings, and the settings of a run."""

    motion: Literal["static", "moving"] | None = Field(
        default=None,
        description='Whether it moves: "static" if it is known to stand still, or "moving"; not known if absent.',
        examples=["static"],
    )
    speed_max_m_s: Number | None = Field(
        default=None,
        gt=0.0,
        le=1e5,
        description="Highest speed, metres per second; not known if absent.",
        examples=[40.0],
    )
    oscillator: Literal["quartz", "tcxo", "ocxo", "csac", "rubidium"] | None = Field(
        default=None,
        description="What the receivers' clocks run on, freely: quartz, tcxo, ocxo, csac or rubidium; not known if "
        "absent.",
        examples=["tcxo"],
    )
    receivers: tuple[PlatformReceiver, ...] = Field(default=(), max_length=64, description="A table for each.")
    attitude: StatedAttitude | None = Field(
        default=None, description="Attitude of the body, where no inertial unit gives it."
    )
    imu: PlatformImu | None = Field(default=None, description="An inertial unit, one for all receivers.")
    protect: Settings = Field(default=Settings(), description="The settings.")

    @field_validator("receivers")
    @classmethod
    def _agree(cls, receivers: tuple[PlatformReceiver, ...]) -> tuple[PlatformReceiver, ...]:
        names = [receiver.name or f"[{number}]" for number, receiver in enumerate(receivers)]
        for number in find_repeated(names):
            raise ValueError(f"[{number}].name repeats {names[number]}; give each receiver a name of its own")
        files = [(number, path) for number, receiver in enumerate(receivers) for path in receiver.inputs]
        for at in find_repeated([path for _, path in files]):
            number, path = files[at]
            raise ValueError(
                f"[{number}].inputs repeats {path.name}: two receivers that are one would look like signals from "
                "one antenna; give each its own"
            )
        _require_one_place(receivers)
        return receivers

    @field_validator("protect")
    @classmethod
    def _once(cls, protect: Settings, info: ValidationInfo) -> Settings:
        for key in ("speed_max_m_s", "oscillator"):
            if getattr(protect, key) is not None and info.data.get(key) is not None:
                raise ValueError(f"{key} is given for the platform as well; leave one out")
        return protect


def _require_one_place(receivers: Sequence[PlatformReceiver]) -> None:
    """Raise ValueError where surveyed positions are far apart, or contradict the places in the body frame."""
    placed = [(number, r, r.position) for number, r in enumerate(receivers) if r.position is not None]
    for at, (number, receiver, place) in enumerate(placed):
        for other, other_receiver, other_place in placed[:at]:
            apart_m = dist(place.ecef_m, other_place.ecef_m)
            if apart_m > POLICY.compared_within_m:
                raise ValueError(
                    f"[{number}].position is {apart_m / 1e3:.0f} km from [{other}].position, expected "
                    f"{POLICY.compared_within_m / 1e3:.0f} km or less; check latitude and longitude of both"
                )
            if receiver.body_m is None or other_receiver.body_m is None:
                continue
            body_m = dist(receiver.antennas_body_m[0], other_receiver.antennas_body_m[0])
            sigma_m = hypot(place.sigma_m, other_place.sigma_m, receiver.body_sigma_m, other_receiver.body_sigma_m)
            if abs(apart_m - body_m) > POLICY.statements_agree_sigmas * sigma_m:
                raise ValueError(
                    f"[{number}].position is {apart_m:.2f} m from [{other}].position, but their body_m are "
                    f"{body_m:.2f} m apart (one sigma {sigma_m:.2f} m); correct one of the two"
                )


def read_platform(path: Path) -> Platform:
    """Read the platform of a TOML file; paths in it are relative to its folder.

    Raises
    ------
    InputError : the file cannot be read or is no TOML.
    SettingsError : every fault at once, each with the path of its key and the nearest one that is known.
    """
    to_do = "a platform file is TOML: fix that line", "check the name and the folder"
    table = read_toml(path, "the platform file", *to_do)
    try:
        return Platform.model_validate(table, context={"folder": path.parent})
    except ValidationError as error:
        raise SettingsError(f"{path}: {'; '.join(describe_faults(error, Platform))}") from error


def platform_schema() -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of a platform file, for editors that complete and check keys.

    It is published as `SCHEMA_PATH`; what keys must agree on among each other is checked when the file is read.
    """
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **Platform.model_json_schema()}
