"""The settings of a run: what options and the platform file say, else defaults; written with every output."""

from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from skyproof.errors import SettingsError
from skyproof.formats.models import Number, describe_faults
from skyproof.gnss.signals import GPS_SATS

__all__ = ["Settings", "resolve_settings"]

_Metres = Annotated[Number, Field(ge=-1e5, le=1e5)]
_Latitude = Annotated[Number, Field(ge=-90.0, le=90.0)]
_Longitude = Annotated[Number, Field(ge=-180.0, le=360.0)]


def _gps(sat: str) -> str:
    if sat not in GPS_SATS:
        raise ValueError(f"{sat!r:.20} is no GPS satellite, expected G01 to G32")
    return sat


_GpsSatellite = Annotated[str, AfterValidator(_gps)]


class Settings(BaseModel):
    """Everything that a user may set. The same keys stand in the table [protect] of a platform file."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    false_alarm_probability_per_hour: Number = Field(
        default=1e-3, gt=0.0, lt=0.5, description="Probability of a false label or verdict in an hour of clean sky."
    )
    antenna_separation_m: Number = Field(
        default=0.0,
        ge=0.0,
        le=1e5,
        description="Least horizontal distance between the antennas; 0 if they may share one or it is not known.",
    )
    max_separation_m: Number = Field(
        default=300.0, gt=0.0, le=1e5, description="Largest horizontal distance between the antennas."
    )
    antenna_distance_m: Number | None = Field(
        default=None,
        examples=[61.5],
        gt=0.0,
        le=1e5,
        description="Distance between the antennas of two receivers. It reveals an attack on one of them alone, "
        "unless the false position lies at this distance from the other.",
    )
    antenna_distance_sigma_m: Number | None = Field(
        default=None,
        examples=[0.5],
        gt=0.0,
        le=1e5,
        description="Standard deviation of antenna_distance_m.",
    )
    antennas_enu_m: dict[str, tuple[_Metres, _Metres, _Metres]] | None = Field(
        default=None,
        examples=[{"rx1": [0.0, 0.0, 0.0], "rx2": [50.7, -33.4, -1.0]}],
        description="Where each receiver's antenna stands: east, north, up of any common point; by receiver name.",
    )
    antennas_sigma_m: Number = Field(
        default=0.1, ge=0.0, le=1e5, description="Standard deviation of antennas_enu_m on each axis."
    )
    speed_max_m_s: Number | None = Field(
        default=None,
        examples=[40.0],
        ge=0.0,
        le=1e5,
        description="No antenna is faster; 0 if all stand still. Jumps over a time without measurements that need more "
        "are then noticed.",
    )
    oscillator: Literal["quartz", "tcxo", "ocxo", "csac", "rubidium"] | None = Field(
        default=None,
        examples=["ocxo"],
        description="What the receivers' clocks run on, freely, for `common_change` and the choice between skies; not "
        "for a receiver that steers its clock.",
    )
    clean_start_s: Number = Field(
        default=30.0,
        ge=0.0,
        le=1e5,
        description="For so long from the start signals count as true, unless there is a sign against it, and teach "
        "the predictions that choose between two skies. An inertial unit is corrected as long as no test fails. 0 "
        "takes nothing for true.",
    )
    wrong_choice_probability: Number = Field(
        default=1e-3,
        gt=0.0,
        lt=0.5,
        description="Of two skies none is chosen by prediction while the probability of a wrong choice is above this.",
    )
    integrity_risk: Number = Field(
        default=1e-7,
        gt=0.0,
        lt=0.1,
        description="Probability that a trusted fix is off by more than its protection level, whatever one satellite "
        "is wrong by; for the horizontal and the vertical level each.",
    )
    multipath_sigma_m: Number = Field(
        default=1.0,
        ge=0.0,
        le=1e4,
        description="Constant error of one pseudorange that multipath may cause, one sigma. The filter of vector "
        "tracking takes 1 m.",
    )
    window_s: Number = Field(
        default=10.0, ge=2.0, le=1e5, description="Length of the windows that are decided one by one."
    )
    smoothing_s: Number = Field(default=100.0, gt=0.0, le=1e5, description="Carrier smoothing of the positions given.")
    elevation_mask_deg: Number = Field(
        default=5.0,
        ge=0.0,
        lt=90.0,
        description="Satellites below are not used for positions, nor by tests that hold all ranges of a receiver "
        "against positions (`residual`, `vector_sqm`, `code_motion`). Other tests, vector tracking and recordings of a "
        "few seconds use all.",
    )
    tracking: Literal["scalar", "vector"] = Field(
        default="scalar",
        description="scalar: every channel follows its own signal; vector: one position and clock of all channels "
        "steers their loops, once it is known.",
    )
    not_driving: tuple[_GpsSatellite, ...] | None = Field(
        default=None,
        examples=[["G02"]],
        description="Satellites that do not drive vector tracking, such as those labelled spoofed before: each of "
        "their channels follows its own signal.",
    )
    doppler_max_hz: Number = Field(
        default=7000.0, gt=0.0, le=1e6, description="Largest Doppler searched, oscillator error included."
    )
    place_deg: tuple[_Latitude, _Longitude] | None = Field(
        default=None,
        examples=[[57.7, 11.9]],
        description="Latitude and longitude, roughly. With a navigation file and a dated recording, only satellites "
        "above the horizon there are searched for, so false signals of others are missed.",
    )
    position_format: Literal["degrees", "degrees-minutes"] = Field(
        default="degrees",
        description="How the report and the terminal write latitudes and longitudes: 57.7059123° N, or degrees and "
        "decimal minutes, 57° 42.35474′ N. Files for programs have degrees.",
    )
    start_s: Number = Field(default=0.0, ge=0.0, le=1e9, description="Start this far into every recording.")
    duration_s: Number | None = Field(
        default=None, examples=[60.0], gt=0.0, le=1e9, description="Use at most this much of every recording."
    )

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> Self:
        if self.antenna_separation_m > self.max_separation_m:
            raise ValueError(
                f"antenna_separation_m = {self.antenna_separation_m:g} is more than max_separation_m = "
                f"{self.max_separation_m:g}; the antennas cannot stand at least that far and at most that near: give "
                "a larger max_separation_m as well, in the table [protect] of a platform file"
            )
        return self


def resolve_settings(given: Settings | None = None, **options: Any) -> Settings:
    """Combine options, then what a platform file gives, then defaults.

    An option that is None was not given.

    Raises SettingsError: what is wrong and what is expected.
    """
    table = {} if given is None else given.model_dump(exclude_unset=True)
    try:
        return Settings(**(table | {key: value for key, value in options.items() if value is not None}))
    except ValidationError as error:
        raise SettingsError(f"setting {'; '.join(describe_faults(error, Settings))}") from error
