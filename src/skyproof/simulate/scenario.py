"""What a scene is made of, as a person writes it: frozen models that refuse what makes no sense.

Times that end in `_s` count from `start_gpst`, in GPS time; places are geodetic, WGS-84.
"""

import tomllib
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, PlainSerializer, PlainValidator, ValidationError, model_validator

from skyproof.errors import ScenarioError
from skyproof.gnss.signals import GPS_SATS
from skyproof.gnss.time import iso, parse_iso

__all__ = ["Attack", "FrontEnd", "Meaconer", "Place", "Receiver", "Scenario", "Sky", "Spoofer", "parse_scenario",
           "read_scenario"]  # fmt: skip

_NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]*$"  # names become file names


def _instant(value: Any) -> np.datetime64:
    if isinstance(value, datetime):
        if value.tzinfo is not None:
            raise ValueError("has a time zone; write GPS time without a zone, as in 2022-01-01T21:45:58")
        value = value.isoformat()
    return value.astype("datetime64[ns]") if isinstance(value, np.datetime64) else parse_iso(value)


def _written(value: np.datetime64) -> str:
    return iso(value, 9)


def _sat(value: Any) -> str:
    if value not in GPS_SATS:
        raise ValueError(f"{value!r} is no GPS satellite; write G01 to G32")
    return str(value)


Instant = Annotated[np.datetime64, PlainValidator(_instant), PlainSerializer(_written, return_type=str)]
SatName = Annotated[str, PlainValidator(_sat)]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, arbitrary_types_allowed=True)


class Place(_Model):
    """A point that stands still on the Earth. Heights outside -500 m to 20 km are taken for mistakes."""

    lat_deg: float = Field(ge=-90, le=90)
    lon_deg: float = Field(ge=-180, le=180)
    height_m: float = Field(ge=-500, le=20_000)  # above the ellipsoid; the standard atmosphere ends further up

    @property
    def geodetic_rad(self) -> tuple[float, float, float]:
        return float(np.radians(self.lat_deg)), float(np.radians(self.lon_deg)), self.height_m


class Receiver(Place):
    """A receiver that stands still. One oscillator makes its sampling clock and its local carrier.

    start_offset_s : true time of the first sample, after `start_gpst`.
    clock_offset_s : what its clock shows minus true time, at the first sample.
    lo_ppm : how much too fast the oscillator is.
    """

    name: str = Field(pattern=_NAME)
    start_offset_s: float = Field(default=0.0, ge=-3600, le=3600)
    clock_offset_s: float = Field(default=0.0, ge=-1, le=1)
    lo_ppm: float = Field(default=0.0, ge=-100, le=100)


class FrontEnd(_Model):
    """How every receiver samples. Rates are whole hertz, so that sample counts make exact times.

    bandwidth_hz : of the signals, on both sides of the carrier together, at half amplitude; all if absent. Chips that
        are sampled unfiltered fold back: their code is then off by decimetres at a few Msps, whoever receives it, as
        that of no real front end is. 0.8 of the rate is usual. `skyproof.simulate.samples` has the filter's shape.
    """

    rate_hz: float = Field(default=2.6e6, ge=1e6, le=1e9, multiple_of=1)
    if_hz: float = Field(default=0.0, multiple_of=1)
    kind: Literal["complex", "real"] = "complex"
    encoding: Literal["sign", "sign-magnitude", "int", "float"] = "sign"
    bits: int = 1
    bandwidth_hz: float | None = Field(default=None, ge=1e5)

    BITS: ClassVar[Mapping[str, tuple[int, ...]]] = {
        "sign": (1,), "sign-magnitude": (2,), "int": (8, 16), "float": (32,),
    }  # fmt: skip

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.bits not in self.BITS[self.encoding]:
            choice = " or ".join(map(str, self.BITS[self.encoding]))
            raise ValueError(f"encoding {self.encoding!r} has {choice} bits, not {self.bits}")
        if self.kind == "real" and not 0 < self.if_hz < self.rate_hz / 2:
            raise ValueError(f"real samples need 0 < if_hz < {self.rate_hz / 2:g} (half the rate), not {self.if_hz:g}")
        if abs(self.if_hz) >= self.rate_hz / 2:
            raise ValueError(f"if_hz {self.if_hz:g} is not below half the rate, {self.rate_hz / 2:g}")
        room_hz = self.rate_hz if self.kind == "complex" else self.rate_hz / 2
        if self.bandwidth_hz is not None and self.bandwidth_hz > room_hz:
            raise ValueError(f"bandwidth_hz {self.bandwidth_hz:g} is more than {self.kind} samples hold, {room_hz:g}")
        return self


class Sky(_Model):
    """Carrier-to-noise density of the true signals: horizon + (zenith - horizon) sin(elevation)."""

    zenith_cn0_dbhz: float = Field(default=50.0, ge=0, le=80)
    horizon_cn0_dbhz: float = Field(default=40.0, ge=0, le=80)


class _Transmitter(_Model):
    """What every attack has: one transmit antenna, a power, a time.

    onset_s, until_s : the first and the last wave leave the transmit antenna.
    power_db : of each false signal at the first receiver, relative to the true signal of the same satellite there;
        at the others it changes with the distance from the transmit antenna.
    noise_db : of the transmitter's own noise at the first receiver, relative to the receiver's noise.
    sats : which satellites are imitated; all that stand above the mask at the place shown if absent.
    sat_db : additional power of single satellites.
    """

    name: str = Field(default="", pattern=r"^$|" + _NAME)
    transmit: Place
    power_db: float = Field(default=0.0, ge=-60, le=60)
    noise_db: float | None = Field(default=None, ge=-60, le=60)
    onset_s: float = 0.0
    until_s: float | None = None
    sats: tuple[SatName, ...] | None = Field(default=None, min_length=1)
    sat_db: dict[SatName, float] = {}

    @model_validator(mode="after")
    def _ends_after_it_begins(self) -> Self:
        if self.until_s is not None and self.until_s <= self.onset_s:
            raise ValueError(f"until_s {self.until_s:g} is not after onset_s {self.onset_s:g}")
        return self


class Meaconer(_Transmitter):
    """Repeats the sky that it hears with its receive antenna."""

    kind: Literal["meaconer"] = "meaconer"
    receive: Place
    delay_s: float = Field(default=0.0, ge=0, le=1)

    @property
    def shows(self) -> Place:
        return self.receive

    @property
    def added_delay_s(self) -> float:
        return self.delay_s


class Spoofer(_Transmitter):
    """Makes the signals that a receiver at the place shown would hear, `clock_offset_s` later than true."""

    kind: Literal["spoofer"] = "spoofer"
    shows: Place
    clock_offset_s: float = Field(default=0.0, ge=-0.5, le=0.5)

    @property
    def added_delay_s(self) -> float:
        return self.clock_offset_s


Attack = Annotated[Meaconer | Spoofer, Field(discriminator="kind")]


class Scenario(_Model):
    """One scene: receivers that stand still under the true sky, and the attacks on them."""

    name: str = Field(default="scene", pattern=_NAME)
    seed: int = Field(default=0, ge=0)
    start_gpst: Instant
    duration_s: float = Field(gt=0, le=7200)  # one ephemeris a satellite serves the whole scene
    mask_deg: float = Field(default=5.0, ge=0, lt=90)
    receivers: tuple[Receiver, ...] = Field(min_length=1)
    front_end: FrontEnd = FrontEnd()
    sky: Sky = Sky()
    attacks: tuple[Attack, ...] = ()

    @model_validator(mode="after")
    def _names_and_times(self) -> Self:
        for what, names in (("receivers", [r.name for r in self.receivers]), ("attacks", self.attack_names)):
            if len(set(names)) < len(names):
                raise ValueError(f"two {what} have one name ({', '.join(names)}); give each its own")
        for index, attack in enumerate(self.attacks):
            if attack.onset_s >= self.duration_s:
                raise ValueError(
                    f"attacks[{index}].onset_s {attack.onset_s:g} is not before the scene's end, {self.duration_s:g}"
                )
        return self

    @property
    def attack_names(self) -> list[str]:
        return [attack.name or attack.kind for attack in self.attacks]


_MODELS: dict[str, type[_Model]] = {
    "receivers": Receiver, "front_end": FrontEnd, "sky": Sky, "meaconer": Meaconer, "spoofer": Spoofer,
    "receive": Place, "transmit": Place, "shows": Place,
}  # fmt: skip


def parse_scenario(table: Mapping[str, Any], *, source: str = "scenario") -> Scenario:
    """A scenario from nested tables, as TOML gives them.

    Raises
    ------
    ScenarioError : every fault at once, each with the path of its key.
    """
    try:
        return Scenario.model_validate(dict(table))
    except ValidationError as error:
        faults = "; ".join(_fault(fault["type"], fault["loc"], fault["msg"]) for fault in error.errors())
        raise ScenarioError(f"{source}: {faults}") from error


def read_scenario(path: Path) -> Scenario:
    """The scenario in a TOML file. Raises ScenarioError if it cannot be read or makes no sense."""
    try:
        return parse_scenario(tomllib.loads(path.read_text(encoding="utf-8")), source=str(path))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ScenarioError(f"{path}: cannot be read as a scenario: {error}; give a TOML file") from error


def _fault(kind: str, loc: tuple[int | str, ...], message: str) -> str:
    tags = [i for i, part in enumerate(loc) if i and isinstance(loc[i - 1], int) and part in ("meaconer", "spoofer")]
    parts = [f"[{part}]" if isinstance(part, int) else f".{part}" for i, part in enumerate(loc) if i not in tags]
    if kind == "extra_forbidden":
        names = [part for part in loc[:-1] if isinstance(part, str)]
        model = _MODELS[names[-1]] if names else Scenario
        message = f"unknown key; known here: {', '.join(model.model_fields)}"
    path = "".join(parts).lstrip(".")
    message = message.removeprefix("Value error, ")
    return f"{path}: {message}" if path else message
