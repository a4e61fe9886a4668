"""Measure what the front end did to the samples, and remove what costs signals.

Measured on stretches spread over a recording: DC, imbalance of I and Q, levels, the band, narrow-band lines. A line of
power J at the distance f from the carrier raises the noise density N0 that a signal with the chip rate Rc meets to

    N0 + J sinc^2(f / Rc) / Rc

(Betz, Navigation 48(4), 2001, eqs. 6 and 7, the spectrum of the code taken as smooth; DC is a line at zero frequency).
What costs more than `LOSS_LIMIT_DB` is taken off; nothing is done where nothing hurts, and then it costs nothing.

Effects on signals: removing DC and balancing I and Q change them by a common factor only. A notch is one minus a
triangular low-pass around the line, symmetric in time after a delay of `delay_samples`, so its frequency response is
real: every correlation function stays Hermitian around its peak, for any code, Doppler and bandwidth. Code and carrier
are therefore not biased (`tests/recording/test_conditioning.py` measures it), and the delay is common to all
satellites. `condition` takes the delay off; `Conditioner.step`, for what runs over time, states it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import special

from skyproof.arrays import Complexes, Floats, Reals
from skyproof.compiled import compiled
from skyproof.gnss.signals import GPS_L1_CA, SignalPlan
from skyproof.recording.spectrum import (
    GUARD,
    compute_line_threshold,
    count_noise_bins,
    estimate_density,
    find_floor_and_lines,
    measure_tone,
)
from skyproof.records import Samples, freeze

__all__ = [
    "LOSS_LIMIT_DB",
    "Conditioner",
    "ConditionerState",
    "MeasuredFrontEnd",
    "SpectralLine",
    "condition",
    "measure_front_end",
    "measure_power",
]

LOSS_LIMIT_DB: Final = 0.05
"""Of C/N0, averaged over Doppler. A line that costs less than that has 41 dB-Hz over the noise density; met by one of
the strongest lines of a C/A code (21 dB below the whole) it stays under the noise of a millisecond by 10 dB."""

IMAGE_LIMIT_DB: Final = -30.0
"""A signal of 60 dB-Hz has then an image at the negative frequency of 30 dB-Hz, about the weakest a search finds."""

IMBALANCE_SIGMAS: Final = 5.0
NOTCH_HZ: Final = 10e3
"""Least width of a notch: about a hundredth of a C/A signal is lost with it, 0.03 dB; a line known to 200 Hz is
attenuated by more than 50 dB."""
FEW_NOTCHES: Final = 4
MOST_NOTCHES: Final = 8
"""Of the least width, or of fewer that are wider: more would take so much out of the middle of a code's spectrum that
every correlation peak has others beside it, which look like second signals of all satellites with one delay. Beside a
peak of amplitude 1 they leave up to 1 % each (their width times a chip): four leave of 55 dB-Hz 27, which a search
hardly finds. Eight leave 6 dB more, and only of what `WORTH_DB` each have weakened is that little."""
WORTH_DB: Final = 1.0

_STRETCHES, _STRETCH_SAMPLES = 16, 32768
_SEGMENTS, _LEAST_FFT, _MOST_FFT = 16, 256, 4096
_LEVELS = 256
_BELOW = 0.86  # share of magnitudes by which a normal sigma is known best; within 1 % of the best from 0.83 to 0.88
_RENEW = 4096  # samples after which a notch's phasor is worked out anew, counted from the recording's first


@dataclass(frozen=True, kw_only=True)
class SpectralLine:
    """A narrow-band line.

    frequency_hz : in the samples, -rate/2 to rate/2 (real samples: 0 to rate/2).
    over_floor_db : power in the bin of the spectrum where it is highest, over the floor there.
    jn0_dbhz : its power over the noise density at the signal.
    width_hz : its own rms width, 0 where the spectrum does not resolve it.
    loss_db : what it takes of the C/N0 of signals, averaged over their Dopplers.
    """

    frequency_hz: float
    over_floor_db: float
    jn0_dbhz: float
    width_hz: float
    loss_db: float

    @property
    def hurts(self) -> bool:
        return self.loss_db > LOSS_LIMIT_DB


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredFrontEnd:
    """What `measure_front_end` finds. Powers are in squares of the samples' own unit; planes are I, Q.

    dc, rms : (2,), the rms without DC. dc_loss_db : as a line's.
    gain_imbalance_db, phase_imbalance_deg : I over Q, and how much less than 90 degrees lie between them; each with
        one sigma; NaN for real samples. image_db : power of the image of a signal over the signal's, by both.
    stretch_s, power_db : (n,) middles of the stretches after the first sample, and the power in the band of each over
        the mean of all, by `measure_power`; NaN where that does not show, as with one bit.
    levels, level_shares : the values that occur and how often, or up to 256 equal classes of them.
    extreme_share : of samples at the least or greatest value.
    frequency_hz, density : (n_bins,) power per hertz, one-sided for real samples, lines included.
    floor : (n_bins,) the density without the lines, smooth over some 50 bins. n0 : the floor as the signal meets it.
    noise_bandwidth_hz : of white noise with the density n0 and the floor's whole power.
    band_hz : where the floor first falls 3 dB below its highest on either side of it.
    resolution_hz : noise bandwidth of a bin. line_threshold_db : over the floor; noise alone exceeds it anywhere in the
        spectrum with `false_alarm_probability` at most.
    """

    rate_hz: float
    real: bool
    carrier_hz: float
    n_examined: int
    dc: Reals
    rms: Reals
    dc_loss_db: float
    gain_imbalance_db: float
    gain_imbalance_sigma_db: float
    phase_imbalance_deg: float
    phase_imbalance_sigma_deg: float
    image_db: float
    stretch_s: Reals
    power_db: Reals
    levels: Reals
    level_shares: Reals
    extreme_share: float
    frequency_hz: Reals
    density: Reals
    floor: Reals
    n0: float
    noise_bandwidth_hz: float
    band_hz: tuple[float, float]
    resolution_hz: float
    line_threshold_db: float
    false_alarm_probability: float
    lines: tuple[SpectralLine, ...]

    def __post_init__(self) -> None:
        freeze(
            self,
            {
                "dc": ("2",),
                "rms": ("2",),
                "stretch_s": ("stretch",),
                "power_db": ("stretch",),
                "levels": ("level",),
                "level_shares": ("level",),
                "frequency_hz": ("bin",),
                "density": ("bin",),
                "floor": ("bin",),
            },
        )

    @property
    def removes_dc(self) -> bool:
        return self.dc_loss_db > LOSS_LIMIT_DB

    @property
    def balances(self) -> bool:
        """Return whether the imbalance is both certain and felt."""
        certain = (
            abs(self.gain_imbalance_db) > IMBALANCE_SIGMAS * self.gain_imbalance_sigma_db
            or abs(self.phase_imbalance_deg) > IMBALANCE_SIGMAS * self.phase_imbalance_sigma_deg
        )
        return certain and self.image_db > IMAGE_LIMIT_DB

    @property
    def notched(self) -> tuple[SpectralLine, ...]:
        """List the lines that are removed: harmful ones, the worst first, as far as there is room."""
        taken: tuple[SpectralLine, ...] = ()
        for line in sorted((line for line in self.lines if line.hurts), key=lambda line: -line.loss_db):
            most = MOST_NOTCHES if line.loss_db > WORTH_DB else FEW_NOTCHES
            if (len(taken) + 1) * _notch_hz((*taken, line)) <= most * NOTCH_HZ:
                taken = (*taken, line)
        return taken

    @property
    def notch_hz(self) -> float:
        """Return the width of all notches, wide enough for the widest of the lines."""
        return _notch_hz(self.notched)

    @property
    def acts(self) -> bool:
        return self.removes_dc or self.balances or bool(self.notched)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Describe findings and actions; empty for a clean front end."""
        remarks = []
        if self.removes_dc:
            offsets = " and ".join(f"{o:+.2f}" for o in (self.dc / self.rms)[: 1 if self.real else 2])
            remarks.append(f"DC of {offsets} rms costs {self.dc_loss_db:.2f} dB of C/N0 and is removed")
        if self.balances:
            remarks.append(
                f"I/Q imbalance of {self.gain_imbalance_db:+.2f} dB and {self.phase_imbalance_deg:+.1f} degrees makes "
                f"images of {self.image_db:.0f} dB and is corrected"
            )
        hurting = [line for line in self.lines if line.hurts]
        for line in self.notched:
            remarks.append(
                f"a line at {line.frequency_hz / 1e3:+.1f} kHz, {line.jn0_dbhz:.0f} dB-Hz over the noise "
                f"density, costs {line.loss_db:.2f} dB of C/N0 and is notched"
            )
        if left_in := len(hurting) - len(self.notched):
            words = "line hurts and is" if left_in == 1 else "lines hurt and are"
            remarks.append(
                f"{left_in} more {words} left in: notches of more than {FEW_NOTCHES * NOTCH_HZ / 1e3:g} kHz together "
                f"({MOST_NOTCHES * NOTCH_HZ / 1e3:g} kHz of lines that cost {WORTH_DB:g} dB each) bend the signals"
            )
        if harmless := [line for line in self.lines if not line.hurts]:
            at = ", ".join(f"{line.frequency_hz / 1e3:+.1f}" for line in harmless[:6])
            more = f" and {len(harmless) - 6} more" if len(harmless) > 6 else ""
            words = "line that costs" if len(harmless) == 1 else "lines that cost"
            remarks.append(f"{len(harmless)} narrow {words} less than {LOSS_LIMIT_DB:g} dB left in, at {at} kHz{more}")
        return tuple(remarks)


def _notch_hz(lines: Sequence[SpectralLine]) -> float:
    """Choose the width of notches that remove wide lines as well as sharp ones.

    It is twenty times the widest line's, at least.
    """
    return max([NOTCH_HZ, *(20.0 * line.width_hz for line in lines)])


# --- measuring


def measure_front_end(
    samples: Samples, *, signal: SignalPlan = GPS_L1_CA, false_alarm_probability: float = 1e-3
) -> MeasuredFrontEnd:
    """Measure the front end on at most half a million samples, in 16 stretches spread over the recording.

    Parameters
    ----------
    samples : the recording; samples whose Q is zero throughout are taken as real.
    signal : what is to be received, for what hurts it.
    false_alarm_probability : of one line or more reported where there is only noise, of any spectrum that changes
    little over some 60 bins of rate/4096.

    Raises
    ------
    ValueError : fewer than 1024 samples, or samples that never change.
    """
    if samples.n_samples < 4 * _LEAST_FFT:
        raise ValueError(f"{samples.n_samples} samples are too few to measure a front end; at least {4 * _LEAST_FFT}")
    places = _choose_stretches(samples.n_samples)
    stretches = [samples.read(start, count).astype(np.float64) for start, count in places]
    planes = np.concatenate(stretches, axis=1)
    real = not planes[1].any()
    dc, rms = planes.mean(axis=1), planes.std(axis=1)
    if not rms.any():
        raise ValueError("the samples never change")
    carrier_hz = samples.if_hz + signal.carrier_hz - samples.centre_hz
    n_fft = _choose_fft_length(min(stretch.shape[1] for stretch in stretches), planes.shape[1])
    frequency_hz, density, n_averaged = estimate_density(stretches, dc, samples.rate_hz, n_fft, real=real)
    step_hz = samples.rate_hz / n_fft
    usable = np.ones(frequency_hz.size, bool)
    if real:  # next to zero and to half the rate a bin holds its own image: another distribution
        usable[:GUARD] = usable[-GUARD:] = False
    threshold = compute_line_threshold(n_averaged, false_alarm_probability / np.count_nonzero(usable))
    mean_over_median = n_averaged / float(special.gammaincinv(n_averaged, 0.5))
    floor, groups = find_floor_and_lines(density, threshold, usable, mean_over_median, circular=not real)
    weight = np.sinc((frequency_hz - carrier_hz) / signal.chip_rate_hz) ** 2
    inside = np.abs(carrier_hz) <= samples.rate_hz / 2.0
    n0 = float(np.sum(floor * weight) / np.sum(weight)) if inside else math.nan

    def loss_db(power: float, at_hz: float) -> float:
        share = float(np.sinc((at_hz - carrier_hz) / signal.chip_rate_hz) ** 2) / signal.chip_rate_hz
        return 10.0 * math.log10(1.0 + power * share / n0) if inside else 0.0

    lines = []
    for bins in groups:
        at_hz, power, width_hz = measure_tone(bins, frequency_hz, density, floor, step_hz)
        lines.append(
            SpectralLine(
                frequency_hz=at_hz,
                over_floor_db=float(10.0 * np.log10(np.max(density[bins] / floor[bins]))),
                jn0_dbhz=10.0 * math.log10(power / n0) if inside else math.nan,
                width_hz=width_hz,
                loss_db=loss_db(power, at_hz),
            )
        )
    gain, skew, image_db = (math.nan, math.nan, math.nan) if real else _estimate_imbalance(planes, dc, rms)
    levels, shares, extreme = _count_levels(planes[:1] if real else planes)
    low, high = _find_band(frequency_hz, floor, carrier_hz)
    powers = np.array([measure_power(stretch[:1] if real else stretch) for stretch in stretches])
    return MeasuredFrontEnd(
        rate_hz=samples.rate_hz,
        real=real,
        carrier_hz=carrier_hz,
        n_examined=planes.shape[1],
        dc=dc,
        rms=rms,
        dc_loss_db=loss_db(float(np.sum(dc**2)), 0.0),
        gain_imbalance_db=20.0 * math.log10(gain) if not real else gain,
        # of two standard deviations and of a correlation coefficient, each from n independent numbers
        gain_imbalance_sigma_db=math.nan if real else 20.0 / math.log(10.0) / math.sqrt(planes.shape[1]),
        phase_imbalance_deg=math.degrees(skew),
        image_db=image_db,
        phase_imbalance_sigma_deg=math.nan if real else math.degrees(1.0 / math.sqrt(planes.shape[1])),
        stretch_s=np.array([start + 0.5 * count for start, count in places]) / samples.rate_hz,
        power_db=10.0 * np.log10(powers / np.nanmean(powers)) if np.isfinite(powers).any() else powers,
        levels=levels,
        level_shares=shares,
        extreme_share=extreme,
        frequency_hz=frequency_hz,
        density=density,
        floor=floor,
        n0=n0,
        noise_bandwidth_hz=float(np.sum(floor) * step_hz / n0),
        band_hz=(low, high),
        resolution_hz=count_noise_bins(n_fft) * step_hz,
        line_threshold_db=10.0 * math.log10(threshold),
        false_alarm_probability=false_alarm_probability,
        lines=tuple(sorted(lines, key=lambda line: (-line.loss_db, -line.over_floor_db))),
    )


def measure_power(planes: Reals) -> float:
    """Measure the power of noise (n_planes, n) that a quantiser may clip, in squares of the samples' unit.

    The share of magnitudes below a level t is erf(t / sigma / sqrt 2), whatever is made of those above. Of a line
    alone it gives up to 2 dB too much. NaN where there is one magnitude only.
    """
    magnitude = np.sort(np.abs(planes), axis=None)
    n = magnitude.size
    at = magnitude[int(_BELOW * n)]
    counts = [c for c in (np.searchsorted(magnitude, at), np.searchsorted(magnitude, at, "right")) if 0 < c < n]
    if not counts:
        return math.nan
    count = int(min(counts, key=lambda c: abs(c - _BELOW * n)))
    level = 0.5 * float(magnitude[count - 1] + magnitude[count])
    return len(planes) * (level / math.sqrt(2.0) / float(special.erfinv(count / n))) ** 2


def _choose_stretches(n_samples: int) -> list[tuple[int, int]]:
    if n_samples <= _STRETCHES * _STRETCH_SAMPLES:
        count = min(n_samples, _STRETCH_SAMPLES)
        return [(start, count) for start in range(0, n_samples - count + 1, count)]
    starts = np.linspace(0, n_samples - _STRETCH_SAMPLES, _STRETCHES).astype(np.int64)
    return [(int(start), _STRETCH_SAMPLES) for start in starts]


def _choose_fft_length(stretch: int, n_samples: int) -> int:
    wanted = min(_MOST_FFT, stretch, max(n_samples // _SEGMENTS, _LEAST_FFT))
    return int(2 ** math.floor(math.log2(wanted)))


def _estimate_imbalance(planes: Reals, dc: Reals, rms: Reals) -> tuple[float, float, float]:
    """Estimate gain of I over Q, skew from a right angle (rad), and the image's power in dB.

    Noise and signals from a band that is not symmetric around zero by chance have E[I^2] = E[Q^2] and E[IQ] = 0.
    """
    if not rms.all():
        return math.nan, math.nan, 0.0
    skew = math.asin(float(np.clip(np.mean((planes[0] - dc[0]) * (planes[1] - dc[1])) / (rms[0] * rms[1]), -1.0, 1.0)))
    gain = float(rms[0] / rms[1])
    turn = np.exp(1j * skew)
    return gain, skew, float(10.0 * np.log10(max(abs(gain - turn) ** 2 / abs(gain + turn) ** 2, 1e-12)))


def _count_levels(planes: Reals) -> tuple[Reals, Reals, float]:
    values, counts = np.unique(planes, return_counts=True)
    extreme = float((counts[0] + counts[-1]) / planes.size)
    if values.size > _LEVELS:
        counts, edges = np.histogram(planes, _LEVELS)
        values = 0.5 * (edges[:-1] + edges[1:])
    return values, counts / planes.size, extreme


def _find_band(frequency_hz: Reals, floor: Reals, carrier_hz: float) -> tuple[float, float]:
    """Find where the floor falls to half its level at the carrier, on either side of it."""
    smooth = np.convolve(np.pad(floor, 8, mode="edge"), np.ones(17) / 17.0, mode="valid")
    near = int(np.argmin(np.abs(frequency_hz - carrier_hz)))
    low_bins = np.flatnonzero(smooth[: near + 1] < 0.5 * smooth[near])
    high_bins = np.flatnonzero(smooth[near:] < 0.5 * smooth[near])
    low = frequency_hz[low_bins[-1]] if low_bins.size else frequency_hz[0]
    high = frequency_hz[near + high_bins[0]] if high_bins.size else frequency_hz[-1]
    return float(low), float(high)


# --- correcting


@dataclass(frozen=True, eq=False, kw_only=True)
class ConditionerState:
    """Where the conditioner stands: how many samples went in, the last of them, and the notches' running sums."""

    position: int
    held: Floats  # (2, delay_samples)
    waves: Complexes  # (n_notches, length)
    firsts: Complexes  # (n_notches, length)
    sums: Complexes  # (n_notches, 3): the first and the second running sum, and the phasor


class Conditioner:
    """Takes off what hurts: DC, imbalance of I and Q, lines. Does nothing, at no cost, where nothing hurts."""

    def __init__(self, front_end: MeasuredFrontEnd) -> None:
        self.front_end = front_end
        self.turns = np.array([line.frequency_hz / front_end.rate_hz for line in front_end.notched])
        self.length = max(round(front_end.rate_hz / front_end.notch_hz), 2) if self.turns.size else 1
        self.matrix, self.offset = _compute_correction(front_end)

    @property
    def delay_samples(self) -> int:
        """Return how much later each sample comes out than it went in: the same for all signals."""
        return self.length - 1

    @property
    def initial(self) -> ConditionerState:
        n, length = self.turns.size, self.length
        return ConditionerState(
            position=0,
            held=np.zeros((2, length - 1), np.float32),
            waves=np.zeros((n, length), np.complex128),
            firsts=np.zeros((n, length), np.complex128),
            sums=np.zeros((n, 3), np.complex128),
        )

    def step(self, state: ConditionerState | None, block: Floats) -> tuple[Floats, ConditionerState]:
        """Correct the next samples; return them `delay_samples` late, and the state after them.

        Parameters
        ----------
        state : what the step before gave; None at the start (zeros are taken to come before it).
        block : float32, shape (2, n), any n; not changed.

        Returns
        -------
        float32, shape (2, n), the same block if nothing is to be done; and the new state. Pieces of any lengths give
        the result of the whole, bit by bit.
        """
        state = state if state is not None else self.initial
        n = block.shape[1]
        position = state.position + n
        if not self.front_end.acts:
            return block, replace(state, position=position)
        straight = np.empty((2, n), np.float32)
        _balance(block, self.matrix, self.offset, straight)
        if not self.turns.size:
            return straight, replace(state, position=position)
        late = np.concatenate([state.held, straight], axis=1)
        held = late[:, n:].copy()
        out = late[:, :n].copy()
        waves, firsts, sums = state.waves.copy(), state.firsts.copy(), state.sums.copy()
        for row in range(self.turns.size):
            _apply_notch(
                straight,
                out,
                waves[row],
                firsts[row],
                sums[row],
                self.turns[row],
                state.position,
                2.0 if self.front_end.real else 1.0,
            )
        if self.front_end.real:
            out[1] = 0.0
        return out, ConditionerState(position=position, held=held, waves=waves, firsts=firsts, sums=sums)


def condition(samples: Samples, front_end: MeasuredFrontEnd) -> Samples:
    """Correct a recording sample for sample at its own time; itself if nothing hurts.

    A stretch read is the same whatever was read before, but for the last bit of the rounding. Within two
    `delay_samples` of the recording's ends a notch knows only part of the line, and leaves the rest.
    """
    if not front_end.acts:
        return samples
    conditioner = Conditioner(front_end)
    ahead = conditioner.delay_samples
    lead = 2 * ahead  # all that a notch remembers

    def read(start: int, count: int) -> Floats:
        if start < 0 or count < 0:
            raise ValueError(f"start {start} and count {count} must not be negative")
        count = max(0, min(count, samples.n_samples - start))
        first = max(0, start - lead)
        block = samples.read(first, start + count + ahead - first)
        missing = start + count + ahead - first - block.shape[1]
        block = np.pad(block, ((0, 0), (0, missing))) if missing else block
        state = replace(conditioner.initial, position=first)
        out, _ = conditioner.step(state, block)
        return out[:, start - first + ahead :]

    return replace(samples, read=read)


def _compute_correction(front_end: MeasuredFrontEnd) -> tuple[Reals, Reals]:
    """Compute matrix and offset so that matrix @ (planes - offset) is centred and balanced; I keeps its scale."""
    matrix, offset = np.eye(2), np.zeros(2)
    if front_end.removes_dc:
        offset = np.array(front_end.dc)
    if front_end.balances:
        gain = 10.0 ** (front_end.gain_imbalance_db / 20.0)
        skew = math.radians(front_end.phase_imbalance_deg)
        matrix[1] = -math.tan(skew), gain / math.cos(skew)
    return matrix, offset


@compiled
def _balance(block: Floats, matrix: Reals, offset: Reals, out: Floats) -> None:
    a = np.float32(matrix[1, 0])
    b = np.float32(matrix[1, 1])
    at_i = np.float32(offset[0])
    at_q = np.float32(offset[1])
    for k in range(block.shape[1]):
        i = block[0, k] - at_i
        out[0, k] = i
        out[1, k] = a * i + b * (block[1, k] - at_q)


@compiled
def _apply_notch(
    block: Floats,
    out: Floats,
    waves: Complexes,
    firsts: Complexes,
    sums: Complexes,
    turns: float,
    position: int,
    factor: float,
) -> None:
    """Take the line at `turns` cycles a sample off `out`, which is `block` delayed by the length less one.

    The line is turned to zero frequency and averaged by two running means, one after the other: a triangle, whose
    middle is `length - 1` samples ago. Sums run in double precision; what goes in comes out again exactly later, so
    rounding adds up to nothing that float32 would show in 10^10 samples.
    """
    length, n_samples = waves.shape[0], block.shape[1]
    scale = factor / (length * length)
    step = complex(math.cos(2.0 * math.pi * turns), -math.sin(2.0 * math.pi * turns))
    back_angle = 2.0 * math.pi * ((turns * (length - 1)) % 1.0)
    back = complex(math.cos(back_angle), -math.sin(back_angle)) * scale
    first, second, phasor = sums[0], sums[1], sums[2]
    done = 0
    while done < n_samples:
        n = position + done
        place = n % length
        if n % _RENEW == 0 or phasor == 0.0:
            angle = 2.0 * math.pi * ((turns * n) % 1.0)
            phasor = complex(math.cos(angle), -math.sin(angle))
        # a span has neither the ring's end nor the phasor's renewal inside
        span = min(n_samples - done, _RENEW - n % _RENEW, length - place)
        for k in range(span):
            wave = complex(block[0, done + k], block[1, done + k]) * phasor
            first += wave - waves[place + k]
            waves[place + k] = wave
            second += first - firsts[place + k]
            firsts[place + k] = first
            line = second * phasor.conjugate() * back
            out[0, done + k] -= np.float32(line.real)
            out[1, done + k] -= np.float32(line.imag)
            phasor *= step
        done += span
    sums[0], sums[1], sums[2] = first, second, phasor
