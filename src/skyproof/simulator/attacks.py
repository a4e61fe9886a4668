"""Transmitters of false signals, and of noise, as a person writes them.

Times that end in `_s` count from the scenario's `start_gpst`, in GPS time.
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from skyproof.arrays import Reals
from skyproof.formats.models import Model, Name
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.simulator.sites import CORNER_S, SatName, Site, interpolate_points, require_rising

__all__ = ["Attack", "Interference", "Meaconer", "Spoofer", "Takeover", "TransmitAntenna"]

LEAST_PAUSE_S = 0.1
LEAST_AMPLITUDE = 1e-5
"""Of what grows from nothing: 100 dB below the true signal, so that it has a level in decibels."""

Points = tuple[tuple[float, float], ...]


class TransmitAntenna(Site):
    """One more antenna of a transmitter. sats : the satellites that it sends."""

    sats: tuple[SatName, ...] = Field(min_length=1)


class _Transmitter(Model):
    """What every attack has.

    transmit : the antenna that sends all signals that no other antenna names.
    power_db : of each false signal relative to the true signal of the same satellite, at the first receiver at the
        onset; elsewhere and later it follows the distance from the transmit antenna.
    power_points_db : (time, additional power): linear in between, constant beyond the ends.
    noise_db : noise of the transmitter at the first receiver, relative to the receiver's noise.
    onset_s : start of transmission.
    until_s : end of transmission; none if absent.
    off_s : (from, until): pauses.
    sats : which satellites are imitated; if absent, all above the mask at the position shown.
    sat_db : additional power of single satellites.
    sat_code_m, sat_code_m_s, sat_doppler_hz : offset of the code, its rate and the carrier of single satellites;
    independent, so code and carrier may diverge.
    clock_offset_s : constant delay of the false signals.
    clock_drift : growth of their delay since the onset.
    clock_points_s : (time, additional delay): linear in between, with rounded corners.
    clock_corner_s : duration of those corners; 0 for sharp ones.
    message : "true"; "inverted": every bit; "random": random bits.
    message_later_s : added to the time of week in the message.
    guess_s : at the start of each bit the transmitter guesses its sign for this long, wrong in half of the bits; then
        it knows the sign from the true signal (security code estimation and replay).
    """

    name: str = Field(default="", pattern=r"^$|^[A-Za-z0-9][A-Za-z0-9._-]*$")
    transmit: Site
    antennas: tuple[TransmitAntenna, ...] = ()
    power_db: float = Field(default=0.0, ge=-60, le=60)
    power_points_db: Points = ()
    noise_db: float | None = Field(default=None, ge=-60, le=60)
    onset_s: float = 0.0
    until_s: float | None = None
    off_s: Points = ()
    sats: tuple[SatName, ...] | None = Field(default=None, min_length=1)
    sat_db: Mapping[SatName, float] = Field(default_factory=dict)
    sat_code_m: Mapping[SatName, float] = Field(default_factory=dict)
    sat_code_m_s: Mapping[SatName, float] = Field(default_factory=dict)
    sat_doppler_hz: Mapping[SatName, float] = Field(default_factory=dict)
    clock_drift: float = Field(default=0.0, ge=-1e-4, le=1e-4)
    clock_points_s: Points = ()
    clock_corner_s: float = Field(default=CORNER_S, ge=0, le=60)
    message: Literal["true", "inverted", "random"] = "true"
    message_later_s: int = Field(default=0, ge=-604_800, le=604_800, multiple_of=6)
    guess_s: float = Field(default=0.0, ge=0, lt=GPS_L1_CA.symbol_s)

    @model_validator(mode="after")
    def _check_times(self) -> Self:
        if self.until_s is not None and self.until_s <= self.onset_s:
            raise ValueError(f"until_s {self.until_s:g} is not after onset_s {self.onset_s:g}")
        require_rising([row[0] for row in self.clock_points_s], "clock_points_s")
        require_rising([row[0] for row in self.power_points_db], "power_points_db")
        edges = [self.onset_s, *(edge for pause in self.off_s for edge in pause)]
        if self.until_s is not None and self.off_s:
            edges.append(self.until_s)
        for edge_s, next_s in pairwise(edges):
            if next_s - edge_s < LEAST_PAUSE_S:
                raise ValueError(
                    f"off_s: {next_s:g} s is not {LEAST_PAUSE_S:g} s after {edge_s:g} s; give pauses in order, within "
                    "onset_s and until_s"
                )
        return self

    @property
    def windows_s(self) -> tuple[tuple[float, float], ...]:
        """Return from when to when its waves leave."""
        starts = [self.onset_s, *(until for _, until in self.off_s)]
        ends = [*(start for start, _ in self.off_s), np.inf if self.until_s is None else self.until_s]
        return tuple(zip(starts, ends, strict=True))

    def power_at_db(self, left_s: ArrayLike) -> Reals:
        """Compute the power over that at the onset, of waves that leave at times (n,), before any spreading."""
        return _compute_power_db(self.power_db, self.power_points_db, left_s)

    def clock_s(self, left_s: ArrayLike) -> Reals:
        """Compute by how much waves that leave at times (n,) are late, besides the constant part."""
        at_s = np.asarray(left_s, np.float64)
        drifted_s = self.clock_drift * np.maximum(at_s - self.onset_s, 0.0)
        return np.asarray(drifted_s + interpolate_points(self.clock_points_s, at_s, 1, self.clock_corner_s)[..., 0])

    def find_antenna(self, sat: str) -> int:
        """Find the antenna that sends a satellite's signal: 0 for `transmit`, else its number from 1 on."""
        return next((n for n, antenna in enumerate(self.antennas, 1) if sat in antenna.sats), 0)

    @property
    def transmit_sites(self) -> tuple[Site, ...]:
        return self.transmit, *self.antennas


class Meaconer(_Transmitter):
    """Repeats the sky that its receive antenna receives, `delay_s` later than the waves alone would take."""

    kind: Literal["meaconer"] = "meaconer"
    receive: Site
    delay_s: float = Field(default=0.0, ge=0, le=1)

    @property
    def shows(self) -> Site:
        return self.receive

    @property
    def added_delay_s(self) -> float:
        return self.delay_s


class Spoofer(_Transmitter):
    """Makes the signals that a receiver at the place, or on the way, shown would receive; `clock_offset_s` late."""

    kind: Literal["spoofer"] = "spoofer"
    shows: Site
    clock_offset_s: float = Field(default=0.0, ge=-0.5, le=0.5)

    @property
    def added_delay_s(self) -> float:
        return self.clock_offset_s


class Takeover(_Transmitter):
    """Aligns its signals with the true ones of one receiver, and drags them off.

    target : the receiver's name. Signals are aligned at its first antenna; for an antenna on an arm, at the axis.
    away_points_enu_m : (time, east, north, up): displacement of the position shown; linear in between, with rounded
        corners.
    code_offset_m : offset of all false codes at the onset.
    carrier : "follows" the code, or stays at the true frequency ("locked") while the code is dragged.
    phase : carrier phase relative to the true signal at the target: "aligned", or "random" for each satellite.
    phase_points_deg : (time, additional delay of the carrier): linear in between, constant beyond the ends.
    amplitude_points : (time, factor of the amplitude): linear in between, constant beyond the ends.
    seamless_s : (from, until): the false phase turns evenly from 90 to 180 degrees ahead of the true one, with an
        amplitude of -2 cos(phase). The sum keeps the true amplitude and turns by half a cycle; then the false signal
        is antipodal and twice as strong (Humphreys, TEXBAT data sets 7 and 8, 2016, section 4).
    """

    kind: Literal["takeover"] = "takeover"
    target: Name
    away_points_enu_m: tuple[tuple[float, float, float, float], ...] = ()
    code_offset_m: float = Field(default=0.0, ge=-1e5, le=1e5)
    carrier: Literal["follows", "locked"] = "follows"
    phase: Literal["aligned", "random"] = "random"
    phase_points_deg: Points = ()
    amplitude_points: tuple[tuple[float, Annotated[float, Field(gt=0, le=1e3)]], ...] = ()
    seamless_s: tuple[float, float] | None = None

    @model_validator(mode="after")
    def _check_points(self) -> Self:
        require_rising([row[0] for row in self.away_points_enu_m], "away_points_enu_m")
        require_rising([row[0] for row in self.phase_points_deg], "phase_points_deg")
        require_rising([row[0] for row in self.amplitude_points], "amplitude_points")
        if self.seamless_s is not None:
            require_rising(self.seamless_s, "seamless_s")
            if self.onset_s > self.seamless_s[0]:
                raise ValueError(
                    f"seamless_s begins at {self.seamless_s[0]:g} s, before onset_s {self.onset_s:g}; the false "
                    "signals grow from nothing, so begin at the onset or later"
                )
            if self.phase != "aligned":
                raise ValueError(f'seamless_s needs phase = "aligned", not {self.phase!r}; set it')
        return self

    def power_at_db(self, left_s: ArrayLike) -> Reals:
        """Compute the power over that at the onset, of waves that leave at times (n,), before any spreading."""
        amplitude = _interpolate_linear(self.amplitude_points, left_s, without=1.0)
        if self.seamless_s is not None:
            amplitude = amplitude * np.maximum(
                -2.0 * np.cos(np.radians(self._compute_ahead_deg(left_s))), LEAST_AMPLITUDE
            )
        return np.asarray(super().power_at_db(left_s) + 20.0 * np.log10(amplitude))

    def phase_cyc(self, left_s: ArrayLike) -> Reals:
        """Compute by how much the carrier is late besides, of waves that leave at times (n,)."""
        late_deg = _interpolate_linear(self.phase_points_deg, left_s)
        if self.seamless_s is not None:
            late_deg = late_deg - self._compute_ahead_deg(left_s)
        return np.asarray(late_deg / 360.0)

    def _compute_ahead_deg(self, left_s: ArrayLike) -> Reals:
        """Compute the phase ahead of the true carrier in a seamless takeover."""
        assert self.seamless_s is not None
        return np.asarray(np.interp(np.asarray(left_s, np.float64), self.seamless_s, (90.0, 180.0)))

    @property
    def added_delay_s(self) -> float:
        return 0.0


Attack = Annotated[Meaconer | Spoofer | Takeover, Field(discriminator="kind")]


class Interference(Model):
    """Noise from a transmitter, stationary but for its switching.

    power_db : power at the first receiver over its noise in the sampled band; elsewhere by distance.
    kind : "cw", a line at `offset_hz` from the nominal carrier; "chirp", a line that sweeps up over `sweep_hz` around
        it in `period_s`; "noise", white over the band.
    """

    kind: Literal["cw", "chirp", "noise"]
    name: str = Field(default="", pattern=r"^$|^[A-Za-z0-9][A-Za-z0-9._-]*$")
    transmit: Site
    power_db: float = Field(ge=-60, le=80)
    power_points_db: Points = ()
    offset_hz: float = 0.0
    sweep_hz: float = Field(default=1e6, gt=0)
    period_s: float = Field(default=1e-4, ge=1e-6, le=1.0)
    onset_s: float = 0.0
    until_s: float | None = None

    @model_validator(mode="after")
    def _check_end(self) -> Self:
        if self.until_s is not None and self.until_s <= self.onset_s:
            raise ValueError(f"until_s {self.until_s:g} is not after onset_s {self.onset_s:g}")
        require_rising([row[0] for row in self.power_points_db], "power_points_db")
        return self

    def power_at_db(self, left_s: ArrayLike) -> Reals:
        """Compute the power over the receiver's noise at the first receiver, of waves that leave at times (n,)."""
        return _compute_power_db(self.power_db, self.power_points_db, left_s)


def _compute_power_db(power_db: float, points_db: Points, at_s: ArrayLike) -> Reals:
    return power_db + _interpolate_linear(points_db, at_s)


def _interpolate_linear(points: Points, at_s: ArrayLike, *, without: float = 0.0) -> Reals:
    """Interpolate between (time, value), linearly, held beyond the ends; `without` points one value everywhere."""
    at_s = np.asarray(at_s, np.float64)
    if not points:
        return np.full(at_s.shape, without)
    rows = np.array(points)
    return np.asarray(np.interp(at_s, rows[:, 0], rows[:, 1]))
