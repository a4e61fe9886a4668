"""What a receiver that searches, follows and loses signals measures of a simulated scene, without samples.

Each antenna receives the true and the false signal of a satellite. Noise is the receiver's own, that of the
transmitter, and of the other signals' codes. A channel holds a signal above `HOLD_DBHZ`; a search finds one above
`FIND_DBHZ` that stands a chip or more from what is followed already. Where both overlap, code and carrier loops see
their sum: the code settles where early and late are equal, from where it was before, so that a stronger signal laid on
the tracked one and dragged off takes the channel with it without a slip, and the carrier follows the stronger one.
Which letter a channel bears after a loss is decided as the receiver does. `Receiver` is what is imitated; where it does
better, as with two signals less than a chip apart, this one does not.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from skyproof.app.receive.reception import Reception
from skyproof.app.receive.time_tag import compute_clock_biases_s, position_all_epochs
from skyproof.arrays import Reals
from skyproof.compiled import compiled
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import NavigationData
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.gnss.time import seconds_between
from skyproof.navigation.clock import anchor_label
from skyproof.receiver.channels import FORGET_S, DelayDoppler, Gap, LostSignal, letter, match_lost
from skyproof.records import Observations, Samples, SignalId
from skyproof.simulator.measurement_errors import FieldError, FieldErrors, draw_field_errors
from skyproof.simulator.measurements import IdealMeasurements, make_ideal_measurements
from skyproof.simulator.received import Scene

__all__ = ["ChannelNoise", "KnownReception", "add_truth", "model_receptions", "true_offset_s"]

CHIP_M = SPEED_OF_LIGHT_M_S / GPS_L1_CA.chip_rate_hz
WAVE_M = SPEED_OF_LIGHT_M_S / GPS_L1_CA.carrier_hz
INTERVAL_S = 0.5
HOLD_DBHZ, FIND_DBHZ = 27.0, 34.0
MASKED_DB = 20.0
"""A signal weaker by so much than another one of its satellite is lost among the side lobes of the code."""
CONFIRM_EPOCHS = 2
FULL_SEARCH_S, NEAR_HZ = 10.0, 125.0
APART_CHIPS, MERGED_CHIPS = 1.0, 0.5
PULLED_CHIPS, PULL_SHARE = 0.1, 0.05
SLIP_HZ = 2.0
HALF_CHIPS = 0.125
CLEARLY = 0.3
"""Of the distance to the other signal: what is measured nearer than this to one follows that one."""
PHASES = 9
"""At which the phase between two signals is taken within an epoch."""
CODE_NOISE = 2.0 / 3.0 / GPS_L1_CA.chip_rate_hz
"""Density of another code's noise, Hz^-1 of its power: that of a sharp chip against itself."""


@dataclass(frozen=True, eq=False, kw_only=True)
class KnownReception:
    """One receiver's measurements beside the truth.

    false_share : (n_epochs, n_channels) of the amplitude that each channel follows; NaN where it is not there.
    position_ecef_m : (n_epochs, 3) true. true_s : (n_epochs,) true time since the scene's start.
    """

    reception: Reception
    false_share: Reals
    position_ecef_m: Reals
    true_s: Reals


@dataclass(frozen=True, kw_only=True)
class ChannelNoise:
    """Of channels, at 45 dB-Hz and `INTERVAL_S`."""

    code_m: float
    ar1: float = 0.0
    constant_m: float = 0.0
    carrier_cyc: float = 0.01
    doppler_hz: float = 0.05
    field: bool = True


def model_receptions(scene: Scene, noise: ChannelNoise, *, rng: np.random.Generator) -> list[KnownReception]:
    """What every receiver of a scene measures."""
    geometries = make_ideal_measurements(scene, interval_s=INTERVAL_S)
    fields: list[FieldError | None] = [None] * len(geometries)
    if noise.field:
        fields = list(draw_field_errors(FieldErrors(), [g.exposure for g in geometries], INTERVAL_S, rng=rng))
    return [
        _receive(scene, index, geometry, noise, error, rng)
        for index, (geometry, error) in enumerate(zip(geometries, fields, strict=True))
    ]


# ---------------------------------------------------------------------- what arrives


@dataclass(frozen=True, eq=False)
class _Arriving:
    """The true and the false signal of one satellite: (n_epochs, 2) each, NaN while one is not there."""

    sat: str
    code_m: Reals
    carrier_cyc: Reals
    doppler_hz: Reals
    amplitude: Reals  # 0 while it is not there
    dbhz: Reals  # over all noise
    code_error_m: Reals
    carrier_error_cyc: Reals


def _collect_arriving(geometry: IdealMeasurements, error: FieldError | None) -> list[_Arriving]:
    power = np.where(np.isfinite(geometry.pseudorange_m), 10.0 ** (0.1 * geometry.cn0_dbhz), 0.0)
    floor = 1.0 + CODE_NOISE * power.sum(axis=1)
    columns: dict[str, list[int]] = {}
    for column, signal in enumerate(geometry.signals):
        columns.setdefault(signal.sat, [-1, -1])[geometry.labels[column] == "spoofed"] = column
    shape = geometry.elapsed_s.size, 2

    def of(values: Reals, pair: list[int], absent: float) -> Reals:
        both = np.full(shape, absent)
        for side, column in enumerate(pair):
            if column >= 0:
                both[:, side] = np.where(power[:, column] > 0.0, values[:, column], absent)
        return both

    nothing = np.zeros(power.shape)
    found = []
    for sat, pair in sorted(columns.items()):
        strength = of(power, pair, 0.0)
        with np.errstate(divide="ignore"):
            dbhz = 10.0 * np.log10(strength / floor[:, np.newaxis])
        found.append(
            _Arriving(
                sat=sat,
                code_m=of(geometry.pseudorange_m, pair, np.nan),
                carrier_cyc=of(geometry.carrier_cyc, pair, np.nan),
                doppler_hz=of(geometry.doppler_hz, pair, np.nan),
                amplitude=np.sqrt(strength),
                dbhz=dbhz,
                code_error_m=of(nothing if error is None else error.code_m, pair, 0.0),
                carrier_error_cyc=of(nothing if error is None else error.carrier_cyc, pair, 0.0),
            )
        )
    return found


# ---------------------------------------------------------------------- loops


@dataclass
class _Row:
    """A channel at one epoch. at_m : its code. share : of the false signal in what it follows."""

    at_m: float
    carrier_cyc: float
    doppler_hz: float
    dbhz: float
    share: float
    slipped: bool


@dataclass
class _Channel:
    """A channel in work: code and Doppler at `epoch`. side : the signal its carrier follows. turns : whole cycles over
    that one's.
    """

    sat: int
    side: int
    at_m: float
    doppler_hz: float
    epoch: int
    found_s: float
    missed_s: float
    from_epoch: int
    copy: str | None = None
    turns: float = 0.0
    reference_m: float = math.nan
    pulled: bool = False
    last: _Row | None = None


@compiled
def _triangle(lag: float) -> float:
    return max(0.0, 1.0 - abs(lag))


@compiled
def _settle(at: float, apart: float, first: float, second: float, phase_rad: Reals) -> tuple[float, float]:
    """Where a code loop that stands at `at` chips settles, and the mean power of its prompt.

    Signals of amplitudes `first` at 0 and `second` at `apart`, behind it by `phase_rad` over the epoch.
    """
    power = 0.0
    for _ in range(80):
        error = power = 0.0
        for phase in phase_rad:
            turn = complex(math.cos(phase), math.sin(phase))
            middle = first * _triangle(at) + second * turn * _triangle(at - apart)
            late = first * _triangle(at + HALF_CHIPS) + second * turn * _triangle(at + HALF_CHIPS - apart)
            early = first * _triangle(at - HALF_CHIPS) + second * turn * _triangle(at - HALF_CHIPS - apart)
            error += ((late - early) * middle.conjugate()).real
            power += abs(middle) ** 2
        if power <= 1e-12 * (first * first + second * second):
            return at, 0.0
        step = min(max(0.5 * error / power, -0.05), 0.05)
        at += step
        if abs(step) < 1e-7:
            break
    return at, power / phase_rad.size


def _follow(channel: _Channel, arriving: _Arriving, epoch: int) -> _Row | None:
    """The channel's measurement, and the channel moved on; None if it holds nothing."""
    code_m, amplitude = arriving.code_m[epoch], arriving.amplitude[epoch]
    if not amplitude.any():
        return None
    base = 0 if amplitude[0] > 0.0 else 1
    both = bool(amplitude.all())
    apart = (code_m[1] - code_m[0]) / CHIP_M if both else 0.0
    second = amplitude[1] if both else 0.0
    cycles = arriving.carrier_cyc[epoch]
    at_s = INTERVAL_S * (np.arange(PHASES) / (PHASES - 1) - 0.5)
    phase_rad = np.zeros(PHASES)
    if both:
        turning_hz = arriving.doppler_hz[epoch, 1] - arriving.doppler_hz[epoch, 0]
        phase_rad = 2.0 * np.pi * (-(cycles[1] - cycles[0]) + turning_hz * at_s)
    carried_m = channel.at_m - WAVE_M * channel.doppler_hz * INTERVAL_S * (epoch - channel.epoch)
    at, power = _settle((carried_m - code_m[base]) / CHIP_M, apart, amplitude[base], second, phase_rad)
    if power <= 0.0:
        return None
    parts = np.array([amplitude[0] * _triangle(at), amplitude[1] * _triangle(at - apart)])
    if base == 1:
        parts = np.array([0.0, amplitude[1] * _triangle(at)])
    side = int(parts[1] > parts[0])
    other = parts[1 - side] / parts[side]
    sign = 1.0 if side == 0 else -1.0
    bent_cyc = float(np.mean(np.angle(1.0 + other * np.exp(1j * sign * phase_rad)))) / (2.0 * np.pi)
    raw_cyc, doppler_hz = float(cycles[side]), float(arriving.doppler_hz[epoch, side])
    slipped = False
    if channel.last is not None and side != channel.side:
        expected_cyc = channel.last.carrier_cyc - 0.5 * (doppler_hz + channel.last.doppler_hz) * INTERVAL_S
        channel.turns = float(np.rint(expected_cyc - (raw_cyc - bent_cyc)))
        slipped = abs(float(np.diff(arriving.doppler_hz[epoch])[0])) > SLIP_HZ if both else True
    dbhz = 10.0 * math.log10(power) + float(arriving.dbhz[epoch, base] - 20.0 * math.log10(amplitude[base]))
    share = float(parts[1] / parts.sum())
    channel.side, channel.at_m = side, float(code_m[base] + at * CHIP_M)
    channel.doppler_hz, channel.epoch = doppler_hz, epoch
    if dbhz < HOLD_DBHZ:
        return None
    weights = np.array([1.0 - share, share])
    return _Row(
        at_m=channel.at_m + float(weights @ arriving.code_error_m[epoch]),
        carrier_cyc=raw_cyc - bent_cyc + channel.turns + float(arriving.carrier_error_cyc[epoch, side]),
        doppler_hz=doppler_hz,
        dbhz=dbhz,
        share=share,
        slipped=slipped,
    )


# ---------------------------------------------------------------------- the receiver


@dataclass
class _Receiver:
    """Channels, what was lost, and the rows of all letters."""

    arriving: list[_Arriving]
    elapsed_s: Reals
    channels: list[_Channel] = field(default_factory=list)
    lost: list[LostSignal] = field(default_factory=list)
    gaps: list[Gap] = field(default_factory=list)
    letters: dict[str, int] = field(default_factory=dict)
    rows: dict[tuple[str, str], dict[int, _Row]] = field(default_factory=dict)
    found: dict[tuple[str, str], tuple[float, float]] = field(default_factory=dict)
    searched_s: dict[int, float] = field(default_factory=dict)

    def step(self, epoch: int) -> None:
        now_s = float(self.elapsed_s[epoch])
        self._advance(epoch)
        self._confirm(epoch, now_s)
        self._drop_doubles(epoch, now_s)
        self.lost = [old for old in self.lost if now_s - old.place.at_s < FORGET_S]
        self._search(epoch, now_s)

    def _advance(self, epoch: int) -> None:
        for channel in list(self.channels):
            row = _follow(channel, self.arriving[channel.sat], epoch)
            if row is None:
                self._lose(channel, epoch)
                continue
            self._watch_pull(channel, row)
            if channel.copy is not None:
                self.rows[self._name(channel)][epoch] = row
            channel.last = row

    def _watch_pull(self, channel: _Channel, row: _Row) -> None:
        apart_m = row.at_m - row.carrier_cyc * WAVE_M
        if not math.isfinite(channel.reference_m) or row.slipped:
            channel.reference_m = apart_m
        elif abs(apart_m - channel.reference_m) > max(PULLED_CHIPS * CHIP_M, 6.0 * 10.0 ** ((45.0 - row.dbhz) / 20.0)):
            channel.reference_m, channel.pulled, row.slipped = apart_m, True, True
        else:
            channel.reference_m += PULL_SHARE * (apart_m - channel.reference_m)

    def _name(self, channel: _Channel) -> tuple[str, str]:
        assert channel.copy is not None
        return self.arriving[channel.sat].sat, channel.copy

    def _place(self, channel: _Channel, at_s: float) -> DelayDoppler:
        return DelayDoppler(at_s=at_s, delay_s=channel.at_m / SPEED_OF_LIGHT_M_S % 1e-3, doppler_hz=channel.doppler_hz)

    def _lose(self, channel: _Channel, epoch: int) -> None:
        self.channels.remove(channel)
        if channel.copy is not None:
            self.lost.append(
                LostSignal(
                    sat=self.arriving[channel.sat].sat,
                    copy=channel.copy,
                    found_s=channel.found_s,
                    missed_s=channel.missed_s,
                    place=self._place(channel, float(self.elapsed_s[channel.epoch])),
                )
            )

    def _confirm(self, epoch: int, now_s: float) -> None:
        due = [c for c in self.channels if c.copy is None and epoch >= c.from_epoch and c.last is not None]
        if not due:
            return
        places = [(self.arriving[c.sat].sat, self._place(c, now_s)) for c in due]
        matches, gap = match_lost(self.lost, places, GPS_L1_CA)
        if gap is not None:
            self.gaps.append(gap)
        for channel, old in zip(due, matches, strict=True):
            sat = self.arriving[channel.sat].sat
            if old is not None:
                channel.copy, channel.found_s, channel.missed_s = old.copy, old.found_s, old.missed_s
                self.lost.remove(old)
            else:
                channel.copy = letter(self.letters.get(sat, 0))
                self.letters[sat] = self.letters.get(sat, 0) + 1
            self.found.setdefault((sat, channel.copy), (channel.found_s, channel.missed_s))
            before = self.rows.setdefault((sat, channel.copy), {})
            assert channel.last is not None
            before[epoch] = replace(channel.last, slipped=bool(before))

    def _drop_doubles(self, epoch: int, now_s: float) -> None:
        by_right = sorted(self.channels, key=lambda c: (c.pulled, c.copy is None, c.found_s))
        for number, channel in enumerate(by_right):
            for other in by_right[:number]:
                near = abs(channel.at_m - other.at_m) < MERGED_CHIPS * CHIP_M
                if other.sat == channel.sat and near and channel in self.channels and other in self.channels:
                    self._lose(channel, epoch)

    def _search(self, epoch: int, now_s: float) -> None:
        full = epoch == 0 or now_s // FULL_SEARCH_S > float(self.elapsed_s[epoch - 1]) // FULL_SEARCH_S
        for number, arriving in enumerate(self.arriving):
            channels = [c for c in self.channels if c.sat == number]
            heard_hz = [c.doppler_hz for c in channels]
            heard_hz += [old.place.doppler_hz for old in self.lost if old.sat == arriving.sat]
            if not (full or heard_hz):
                continue
            strongest = float(arriving.dbhz[epoch].max())
            for side in np.argsort(-arriving.dbhz[epoch]):
                dbhz, at_m = float(arriving.dbhz[epoch, side]), float(arriving.code_m[epoch, side])
                hz = float(arriving.doppler_hz[epoch, side])
                near = any(abs(hz - peak) < NEAR_HZ for peak in heard_hz)
                if not (dbhz >= FIND_DBHZ and dbhz > strongest - MASKED_DB and (full or near)):
                    continue
                if any(abs(at_m - c.at_m) < APART_CHIPS * CHIP_M for c in channels):
                    continue
                new = _Channel(
                    sat=number,
                    side=int(side),
                    at_m=at_m,
                    doppler_hz=hz,
                    epoch=epoch,
                    found_s=now_s,
                    missed_s=self.searched_s.get(number, math.nan),
                    from_epoch=epoch + CONFIRM_EPOCHS,
                )
                channels.append(new)
                self.channels.append(new)
            self.searched_s[number] = now_s


def _receive(
    scene: Scene,
    index: int,
    geometry: IdealMeasurements,
    noise: ChannelNoise,
    error: FieldError | None,
    rng: np.random.Generator,
) -> KnownReception:
    sky = scene.skies[index]
    true_s = geometry.elapsed_s + sky.true_minus_elapsed_s(geometry.elapsed_s)
    arriving = _collect_arriving(geometry, error)
    receiver = _Receiver(arriving, geometry.elapsed_s)
    for epoch in range(geometry.elapsed_s.size):
        receiver.step(epoch)
    observations, share = _make_observations(geometry, receiver, noise, rng)
    left_out = None
    if observations is not None:
        biases_s = compute_clock_biases_s(position_all_epochs(iter([observations]), scene.navigation), receiver.gaps)
        observations = observations if biases_s is None else anchor_label(observations, biases_s)
    else:
        left_out = "no signal heard"
    samples = Samples(
        name=sky.name,
        rate_hz=1e6,
        n_samples=int(1e6 * scene.scenario.duration_s),
        read=_no_samples,
        start_gpst=scene.scenario.start_gpst,
    )
    reception = Reception(
        source=samples,
        observations=observations,
        decoded=NavigationData(ephemerides=()),
        left_out=left_out,
        n_signals=len(receiver.rows),
        examined_s=scene.scenario.duration_s,
    )
    return KnownReception(
        reception=reception, false_share=share, position_ecef_m=sky.point(true_s).position_ecef_m, true_s=true_s
    )


def _no_samples(start: int, count: int) -> NDArray[np.float32]:
    raise AssertionError(f"no samples here: {count} asked for from {start} on")


def _make_observations(
    geometry: IdealMeasurements, receiver: _Receiver, noise: ChannelNoise, rng: np.random.Generator
) -> tuple[Observations | None, Reals]:
    names = sorted(name for name, rows in receiver.rows.items() if rows)
    shape = geometry.elapsed_s.size, len(names)
    if not names:
        return None, np.empty(shape)
    at_m, carrier_cyc, doppler_hz, dbhz, share = (np.full(shape, np.nan) for _ in range(5))
    status = np.ones(shape, np.uint8)
    for column, name in enumerate(names):
        for epoch, row in receiver.rows[name].items():
            cell = epoch, column
            at_m[cell], carrier_cyc[cell], doppler_hz[cell] = row.at_m, row.carrier_cyc, row.doppler_hz
            dbhz[cell], share[cell], status[cell] = row.dbhz, row.share, 3 if row.slipped else 0
    growth = 10.0 ** ((45.0 - dbhz) / 20.0)
    unit = rng.standard_normal(shape)
    for epoch in range(1, shape[0]) if noise.ar1 else ():
        unit[epoch] = noise.ar1 * unit[epoch - 1] + math.sqrt(1.0 - noise.ar1**2) * unit[epoch]
    found = np.array([receiver.found[name] for name in names])
    return Observations(
        receiver=geometry.receiver,
        signals=tuple(SignalId(sat, copy=copy) for sat, copy in names),
        gpst=geometry.gpst,
        elapsed_s=geometry.elapsed_s,
        pseudorange_m=at_m + noise.code_m * growth * unit + noise.constant_m * rng.standard_normal(shape[1]),
        carrier_cyc=carrier_cyc + noise.carrier_cyc * growth * rng.standard_normal(shape),
        doppler_hz=doppler_hz + noise.doppler_hz * growth * rng.standard_normal(shape),
        cn0_dbhz=dbhz,
        pseudorange_sigma_m=noise.code_m * growth,
        carrier_sigma_cyc=noise.carrier_cyc * growth,
        doppler_sigma_hz=noise.doppler_hz * growth,
        status=status,
        found_elapsed_s=found[:, 0],
        missed_elapsed_s=found[:, 1],
        carrier_hz=np.full(len(names), GPS_L1_CA.carrier_hz),
        averaged_s=INTERVAL_S,
    ), share


def add_truth(scene: Scene, index: int, reception: Reception) -> KnownReception:
    """The truth beside what a receiver made of samples: a signal is the one of its satellite whose delay is clearly
    nearest, or not known.
    """
    sky, log = scene.skies[index], reception.observations
    assert log is not None
    o = log.read(0, log.gpst.size)
    true_s = o.elapsed_s + sky.true_minus_elapsed_s(o.elapsed_s)
    clock_s = seconds_between(o.gpst, scene.scenario.start_gpst) - true_s
    delay_m = SPEED_OF_LIGHT_M_S * sky.code_delay_s(true_s)
    for column, heard in enumerate(sky.signals):
        present = np.any([(begin <= true_s) & (true_s < end) for begin, end in heard.windows_s], axis=0)
        delay_m[~present, column] = np.inf
    is_false = np.array([heard.label == "spoofed" for heard in sky.signals], float)
    share = np.full(o.pseudorange_m.shape, np.nan)
    for channel, signal in enumerate(o.signals):
        truth = [column for column, heard in enumerate(sky.signals) if heard.id.sat == signal.sat]
        seen = np.isfinite(o.pseudorange_m[:, channel])
        if truth:
            off_m = np.abs((o.pseudorange_m[:, channel] - SPEED_OF_LIGHT_M_S * clock_s)[:, None] - delay_m[:, truth])
            best = np.sort(off_m[seen], axis=1)
            clear = best[:, 0] < CLEARLY * best[:, 1] if len(truth) > 1 else np.ones(best.shape[0], np.bool_)
            share[seen, channel] = np.where(clear, is_false[truth][np.argmin(off_m[seen], axis=1)], np.nan)
    return KnownReception(
        reception=reception, false_share=share, position_ecef_m=sky.point(true_s).position_ecef_m, true_s=true_s
    )


def true_offset_s(heard: KnownReception, gpst: NDArray[np.datetime64], start_gpst: np.datetime64) -> Reals:
    """By how much instants, one per epoch, are ahead of the true ones."""
    return np.asarray(seconds_between(gpst, start_gpst) - heard.true_s)
