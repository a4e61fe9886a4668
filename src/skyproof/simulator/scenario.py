"""Models of a scene as a person writes it: frozen tables that refuse what makes no sense.

Times that end in `_s` count from `start_gpst`, in GPS time; places are geodetic, WGS-84; body axes are forward, right,
down.
"""

from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

from pydantic import Field, ValidationError, model_validator

from skyproof.errors import InputError, ScenarioError, shorten
from skyproof.formats.documents import read_toml
from skyproof.formats.models import Instant, Model, Name, describe_faults
from skyproof.gnss.imu_grades import GRADES
from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.simulator.attacks import Attack, Interference, Meaconer, Spoofer, Takeover, TransmitAntenna
from skyproof.simulator.sites import SatName, ScenePlace, Site

__all__ = [
    "Antenna",
    "Attack",
    "FrontEnd",
    "Interference",
    "Meaconer",
    "Multipath",
    "SatelliteDirection",
    "Scenario",
    "SceneImu",
    "ScenePlace",
    "SceneReceiver",
    "SceneSpin",
    "Site",
    "Sky",
    "Spoofer",
    "Takeover",
    "TransmitAntenna",
    "parse_scenario",
    "read_scenario",
]

Vector = tuple[float, float, float]


class SceneSpin(Model):
    """An arm that carries an antenna round a vertical axis of the body; clockwise from above if the rate is positive.

    start_deg : angle at the start of the scene, from forward to the right.
    """

    radius_m: float = Field(gt=0, le=100)
    rate_hz: float = Field(ge=-50, le=50)
    start_deg: float = 0.0


class Antenna(Model):
    """One antenna of a receiver, with a channel of samples of its own; all channels share the receiver's clock.

    body_m : forward, right, down from the receiver's position.
    gain : "isotropic", or "patch": 10 sin(elevation over the body's plane) dB, relative to the level body.
    line_bias_cyc : carrier delay of the line.
    """

    name: Name
    body_m: Vector = (0.0, 0.0, 0.0)
    gain: Literal["isotropic", "patch"] = "isotropic"
    line_bias_cyc: float = Field(default=0.0, ge=-1e3, le=1e3)
    spin: SceneSpin | None = None


class Multipath(Model):
    """A reflection of true signals.

    delay_m : extra path; or give height_m.
    height_m : height of the antenna over a level reflector; the extra path is 2 h sin(elevation).
    power_db : power relative to the direct signal. phase_deg : phase of the reflection. rate_hz : its extra Doppler.
    sats, antennas : which it affects; all if absent.
    """

    delay_m: float | None = Field(default=None, gt=0, le=3000)
    height_m: float | None = Field(default=None, gt=0, le=1000)
    power_db: float = Field(ge=-60, le=20)
    phase_deg: float = 180.0
    rate_hz: float = Field(default=0.0, ge=-1000, le=1000)
    sats: tuple[SatName, ...] | None = Field(default=None, min_length=1)
    antennas: tuple[Name, ...] | None = Field(default=None, min_length=1)

    @model_validator(mode="after")
    def _check_delay(self) -> Self:
        if (self.delay_m is None) == (self.height_m is None):
            raise ValueError("give delay_m or height_m, and not both")
        return self


class SceneImu(Model):
    """An inertial unit. grade : grade of its errors; none if absent.

    mounting_deg : roll, pitch, heading of the unit's axes in the body.
    """

    grade: str | None = None
    rate_hz: float = Field(default=100.0, gt=0, le=5000)
    body_m: Vector = (0.0, 0.0, 0.0)
    mounting_deg: Vector = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _require_known(self) -> Self:
        if self.grade is not None:
            require_known_name(self.grade, GRADES, "grade")
        return self


class SceneReceiver(Site):
    """A receiver at a place or on a way. One oscillator makes its sampling clock and its local carrier.

    start_offset_s : true time of the first sample after `start_gpst`.
    clock_offset_s : its clock minus true time at the first sample.
    lo_ppm : frequency error of the oscillator, positive if fast.
    oscillator : class that gives its noise; without noise if absent.
    antennas : one at the receiver's position if absent.
    """

    name: Name
    start_offset_s: float = Field(default=0.0, ge=-3600, le=3600)
    clock_offset_s: float = Field(default=0.0, ge=-1, le=1)
    lo_ppm: float = Field(default=0.0, ge=-100, le=100)
    oscillator: str | None = None
    antennas: tuple[Antenna, ...] = Field(default=(Antenna(name="1"),), min_length=1)
    multipath: tuple[Multipath, ...] = ()
    imu: SceneImu | None = None

    @model_validator(mode="after")
    def _require_known(self) -> Self:
        if self.oscillator is not None:
            require_known_name(self.oscillator, OSCILLATORS, "oscillator")
        names = [antenna.name for antenna in self.antennas]
        if len(set(names)) < len(names):
            raise ValueError(f"two antennas have one name ({', '.join(names)}); give each its own")
        for number, ray in enumerate(self.multipath):
            for name in ray.antennas or ():
                require_known_name(name, names, f"multipath[{number}].antennas")
        return self


class FrontEnd(Model):
    """How every receiver samples. Rates are whole hertz, so that sample counts make exact times.

    bandwidth_hz : two-sided bandwidth at half amplitude; unfiltered if absent, which aliases and moves codes by
        decimetres at a few Msps. 0.8 of the rate is usual; `skyproof.simulator.samples` has the filter's shape.
    agc : true if the gain follows the received power; false if it is fixed to the receiver's noise.
    """

    rate_hz: float = Field(default=2.6e6, ge=1e6, le=1e9, multiple_of=1)
    if_hz: float = Field(default=0.0, multiple_of=1)
    kind: Literal["complex", "real"] = "complex"
    encoding: Literal["sign", "sign-magnitude", "int", "float"] = "sign"
    bits: int = 1
    bandwidth_hz: float | None = Field(default=None, ge=1e5)
    agc: bool = False

    BITS: ClassVar[Mapping[str, tuple[int, ...]]] = {
        "sign": (1,),
        "sign-magnitude": (2,),
        "int": (8, 16),
        "float": (32,),
    }

    @model_validator(mode="after")
    def _check_possible(self) -> Self:
        if self.bits not in self.BITS[self.encoding]:
            choice = " or ".join(map(str, self.BITS[self.encoding]))
            raise ValueError(f"encoding {self.encoding!r} has {choice} bits, not {self.bits}")
        if self.kind == "real" and not 0 < self.if_hz < self.rate_hz / 2:
            raise ValueError(f"real samples need 0 < if_hz < {self.rate_hz / 2:g} (half the rate), not {self.if_hz:g}")
        if abs(self.if_hz) >= self.rate_hz / 2:
            raise ValueError(f"if_hz {self.if_hz:g} is not below half the rate, {self.rate_hz / 2:g}")
        if self.bandwidth_hz is not None and self.bandwidth_hz > self.band_hz:
            raise ValueError(
                f"bandwidth_hz {self.bandwidth_hz:g} is more than {self.kind} samples hold, {self.band_hz:g}"
            )
        return self

    @property
    def band_hz(self) -> float:
        """Return the width of the sampled band: the rate of complex samples, half of that of real ones."""
        return self.rate_hz if self.kind == "complex" else 0.5 * self.rate_hz


class SatelliteDirection(Model):
    """Where a satellite stands at the scene's start, seen from the first receiver.

    It moves on a circular orbit through there, northward, or southward if `descending`.
    """

    sat: SatName
    az_deg: float = Field(ge=-360, le=360)
    el_deg: float = Field(ge=0, le=90)
    descending: bool = False


class Sky(Model):
    """The true signals. Carrier-to-noise density: horizon + (zenith - horizon) sin(elevation).

    ionosphere, troposphere : true if it delays signals, also those that attackers make.
    sats : satellites; all above the mask if absent.
    directions : directions of all satellites, instead of a navigation file or the nominal constellation.
    until_s : end of all true signals, as for an unplugged antenna; none if absent.
    """

    zenith_cn0_dbhz: float = Field(default=50.0, ge=0, le=80)
    horizon_cn0_dbhz: float = Field(default=40.0, ge=0, le=80)
    ionosphere: bool = True
    troposphere: bool = True
    sats: tuple[SatName, ...] | None = Field(default=None, min_length=1)
    directions: tuple[SatelliteDirection, ...] | None = Field(default=None, min_length=1)
    until_s: float | None = None

    @model_validator(mode="after")
    def _check_directions(self) -> Self:
        known = [direction.sat for direction in self.directions or ()]
        if len(set(known)) < len(known):
            raise ValueError(f"directions: a satellite stands in two places ({', '.join(known)}); give each one")
        for sat in self.sats or () if known else ():
            require_known_name(sat, known, "sats")
        return self


class Scenario(Model):
    """One scene: receivers under the true sky, the attacks on them, and what else transmits.

    source : publication that describes the scene.
    duration_s : duration of each recording.
    navigation : a RINEX navigation file; if absent, the nominal constellation, for any date.
    """

    name: Name = "scene"
    description: str = ""
    source: str = ""
    seed: int = Field(default=0, ge=0)
    start_gpst: Instant
    duration_s: float = Field(gt=0, le=7200)  # one ephemeris a satellite serves the whole scene
    mask_deg: float = Field(default=5.0, ge=0, lt=90)
    navigation: Path | None = None
    receivers: tuple[SceneReceiver, ...] = Field(min_length=1)
    front_end: FrontEnd = FrontEnd()
    sky: Sky = Sky()
    attacks: tuple[Attack, ...] = ()
    interference: tuple[Interference, ...] = ()

    @model_validator(mode="after")
    def _check_names_and_times(self) -> Self:
        receivers = [receiver.name for receiver in self.receivers]
        for title, names in (("receivers", receivers), ("attacks", self.attack_names)):
            if len(set(names)) < len(names):
                raise ValueError(f"two {title} have one name ({', '.join(names)}); give each its own")
        for title, transmitters in (("attacks", self.attacks), ("interference", self.interference)):
            for index, transmitter in enumerate(transmitters):
                if transmitter.onset_s >= self.end_s:
                    raise ValueError(
                        f"{title}[{index}].onset_s {transmitter.onset_s:g} is not "
                        f"before the scene's end, {self.end_s:g}"
                    )
        if self.navigation is not None and self.sky.directions is not None:
            raise ValueError("sky.directions and navigation both say where the satellites are; leave one out")
        for index, attack in enumerate(self.attacks):
            if isinstance(attack, Takeover):
                require_known_name(attack.target, receivers, f"attacks[{index}].target")
        return self

    @property
    def end_s(self) -> float:
        """Return when the last receiver stops."""
        return self.duration_s + max(receiver.start_offset_s for receiver in self.receivers)

    @property
    def attack_names(self) -> list[str]:
        return [attack.name or attack.kind for attack in self.attacks]


def require_known_name(name: str, names: Mapping[str, Any] | list[str], what: str) -> None:
    """Raise ValueError, with the nearest known name, unless `name` is one of `names`."""
    if name not in names:
        near = get_close_matches(name[:60], list(names), 1, cutoff=0.4)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise ValueError(f"{what} {shorten(name)!r} is not known; {hint}known: {', '.join(names)}")


def parse_scenario(table: Mapping[str, Any], *, source: str = "scenario") -> Scenario:
    """Parse a scenario from nested tables, as TOML gives them.

    Raises
    ------
    ScenarioError : every fault at once, each with the path of its key and the nearest name that is known.
    """
    try:
        return Scenario.model_validate(dict(table))
    except ValidationError as error:
        raise ScenarioError(f"{source}: {'; '.join(describe_faults(error, Scenario))}") from error


def read_scenario(path: Path) -> Scenario:
    """Read the scenario in a TOML file; files that it names are looked for beside it.

    Raises ScenarioError if it cannot be read or makes no sense.
    """
    try:
        table = read_toml(path, "the scenario", "a scenario is TOML: fix that line", "check the name and the folder")
    except InputError as error:
        raise ScenarioError(str(error)) from error
    return parse_scenario(_resolve_beside(table, path.parent), source=str(path))


def _resolve_beside(value: Any, folder: Path) -> Any:
    """Resolve files in a table against a folder: the navigation file, and recorded ways."""
    if isinstance(value, list):
        return [_resolve_beside(member, folder) for member in value]
    if not isinstance(value, dict):
        return value
    table = {key: _resolve_beside(member, folder) for key, member in value.items()}
    for key in ("navigation", "path") if table.get("kind", "file") == "file" else ():
        if isinstance(table.get(key), str):
            table[key] = str(folder / table[key])
    return table
