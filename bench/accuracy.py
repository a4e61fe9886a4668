"""How exact the receiver is: errors against signals whose motion is known in closed form, beside what theory allows.

One satellite a rendering, so that no other signal adds noise. Channels are started by hand where the signal is, since
a search would not find the weakest; all but that is the receiver as it runs. Theory:

- code: the discriminator's formula (`receiver.discriminator`; Kaplan & Hegarty, 8.7.3) and the Cramer-Rao bound
of the
  front end's band, 1/(2 C/N0 T b^2) with b the rms bandwidth of the signal (Kay, Estimation Theory, 3.11);
- carrier and Doppler: the bound of a phase that may accelerate over T = 0.2 s, 9/4 of 1/(2 C/N0 T) in the middle, and
  6/(C/N0 T^3) of the slope (rad and rad/s, squared).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS
from skyproof.receiver import kernels as k
from skyproof.receiver import measurement as m
from skyproof.receiver.acquisition import Peak
from skyproof.receiver.discriminator import compute_discriminator
from skyproof.receiver.keeping import holds_signal
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.tracking import LoopSettings, Receiver, ReceiverSettings, ReceiverState
from skyproof.simulator.ideal import SignalDelays, make_ideal_signals
from skyproof.simulator.samples import BLOCK, Rendering, render
from skyproof.simulator.scenario import FrontEnd

BANDS_HZ = ((2.6e6, 2.0e6), (4e6, 3.2e6), (5e6, 4e6), (25e6, 20e6))
SPACINGS_CHIPS = (0.1, 0.25, 0.5, 1.0)
INTEGRATIONS = (1, 2, 5, 10, 20)
PLAIN = BANDS_HZ[0]
SATS = ("G05", "G11", "G23")
BLOCK_S = 0.2
SETTLED_S = 2.6
"""Bits are known after two seconds, and the loops have changed to what they then are."""
SPREAD_S = 40.0  # of signal for each spread, which is then known to 5 %
_NO_SEARCH: dict[str, Any] = {"sats": (), "near_search_s": 1e9}
CHIP_M = SPEED_OF_LIGHT_M_S / GPS_L1_CA.chip_rate_hz
TWO_G_M_S2 = 19.6


@dataclass(frozen=True, kw_only=True)
class Case:
    """One signal: front end (rate, bandwidth or None), strength, motion, length; noise or none."""

    front_end_hz: tuple[float, float | None] = PLAIN
    cn0_dbhz: float = 45.0
    doppler_hz: float = 1234.5
    accelerations: tuple[tuple[float, float], ...] = ()
    duration_s: float = SETTLED_S + SPREAD_S
    noise: bool = True
    sat: str = "G05"
    seed: int = 0


@dataclass(frozen=True, eq=False, kw_only=True)
class Errors:
    """Measured minus true, an epoch a row; carrier modulo half a cycle, how often it jumped by one, and was said to."""

    elapsed_s: Reals
    code_m: Reals
    carrier_cyc: Reals
    doppler_hz: Reals
    cn0_dbhz: Reals
    stated: Reals  # (n, 3): sigmas of code, carrier, Doppler
    slips: int
    flags: int

    def where(self, keep: NDArray[np.bool_]) -> "Errors":
        """Some of the epochs."""
        return Errors(
            elapsed_s=self.elapsed_s[keep],
            code_m=self.code_m[keep],
            carrier_cyc=self.carrier_cyc[keep],
            doppler_hz=self.doppler_hz[keep],
            cn0_dbhz=self.cn0_dbhz[keep],
            stated=self.stated[keep],
            slips=self.slips,
            flags=self.flags,
        )


@dataclass(frozen=True, kw_only=True)
class Theory:
    """One sigma of a measurement over `BLOCK_S`."""

    code_m: float
    code_bound_m: float
    carrier_cyc: float
    doppler_hz: float


def report() -> Iterator[str]:
    """Rows of the tables."""
    yield from _without_noise()
    yield from _bands_and_spacings()
    yield from _strengths()
    yield from _integrations()
    yield from _motions()
    yield from _carrier_to_noise()
    yield from _holding()
    yield from _locks()


# ---------------------------------------------------------------------- what is measured


def errors(case: Case, settings: Sequence[ReceiverSettings]) -> list[Errors]:
    """Errors of receivers of these settings on the same samples."""
    rate_hz, bandwidth_hz = case.front_end_hz
    front_end = FrontEnd(rate_hz=rate_hz, bandwidth_hz=bandwidth_hz, encoding="float", bits=32)
    # Code phases and starts of bits that differ from case to case.
    rng = np.random.default_rng((case.seed, int(case.sat[1:]), int(abs(case.doppler_hz))))
    motion = SignalDelays(
        delay_s=rng.uniform(0.065, 0.085, 1), doppler_hz=np.array([case.doppler_hz]), accelerations=case.accelerations
    )
    rendering = make_ideal_signals(
        [case.sat], motion, case.cn0_dbhz, front_end, duration_s=case.duration_s, seed=case.seed
    )
    receivers = [Receiver(rate_hz, 0.0, replace(s, **_NO_SEARCH)) for s in settings]
    states = [_started(receiver, [case.sat], motion, case.cn0_dbhz) for receiver in receivers]
    parts: list[list[Measurements]] = [[] for _ in receivers]
    for block in range(-(-rendering.n_samples // BLOCK)):
        planes = render(rendering, block, noise=case.noise)[:, : rendering.n_samples - block * BLOCK]
        for i, receiver in enumerate(receivers):
            output, states[i] = receiver.step(states[i], planes)
            parts[i].append(output.measurements)
    return [_against_truth(Measurements.join(p), motion) for p in parts]


def _started(receiver: Receiver, sats: Sequence[str], motion: SignalDelays, cn0_dbhz: float) -> ReceiverState:
    """Channels on all signals, 2 Hz beside."""
    state = ReceiverState()
    for sat, delay_s, doppler_hz in zip(sats, motion.delay_s.tolist(), motion.doppler_hz.tolist(), strict=True):
        peak = Peak(
            sat=sat,
            delay_s=delay_s % GPS_L1_CA.period_s,
            doppler_hz=doppler_hz + 2.0,
            power=1.0,
            p_value=0.0,
            cn0_dbhz=cn0_dbhz,
        )
        state = receiver.start_channel(state, peak)
    return state


def _against_truth(measured: Measurements, motion: SignalDelays) -> Errors:
    keep = measured.elapsed_s > SETTLED_S - 1e-6
    t, table = measured.elapsed_s[keep], measured.table[keep]
    sent_s = table[:, m.PERIODS] * GPS_L1_CA.period_s + table[:, m.FRACTION_S]
    late_s = t - motion.code_delay_s(t)[:, 0] - sent_s  # modulo the code's period: which one is not known
    late_s -= GPS_L1_CA.period_s * np.rint(late_s / GPS_L1_CA.period_s)
    cycles = table[:, m.CARRIER_CYC] - motion.carrier_delay_s(t)[:, 0] * GPS_L1_CA.carrier_hz
    return Errors(
        elapsed_s=t,
        code_m=SPEED_OF_LIGHT_M_S * late_s,
        carrier_cyc=cycles - 0.5 * np.rint(2.0 * cycles),
        doppler_hz=table[:, m.DOPPLER_HZ] - motion.doppler_at_hz(t)[:, 0],
        cn0_dbhz=table[:, m.CN0_DBHZ],
        stated=table[:, [m.CODE_SIGMA_S, m.CARRIER_SIGMA_CYC, m.DOPPLER_SIGMA_HZ]] * (SPEED_OF_LIGHT_M_S, 1.0, 1.0),
        slips=int(np.sum(np.abs(np.diff(cycles)) > 0.3)),
        flags=int(np.sum(table[:, m.SLIP])),
    )


def theory(case: Case, spacing_chips: float) -> Theory:
    """What theory says of a case."""
    rate_hz, bandwidth_hz = case.front_end_hz
    ratio = 10.0 ** (0.1 * case.cn0_dbhz) * BLOCK_S
    spread = compute_discriminator(GPS_L1_CA.chip_rate_hz / rate_hz, spacing_chips)
    f = np.linspace(0.0, 0.5 * rate_hz, 20_001) / GPS_L1_CA.chip_rate_hz  # cycles a chip
    power = np.sinc(f) ** 2
    if bandwidth_hz is not None:
        fall = np.clip((2.0 * f * GPS_L1_CA.chip_rate_hz / bandwidth_hz - 0.75) / 0.5, 0.0, 1.0)
        power *= (0.5 + 0.5 * np.cos(np.pi * fall)) ** 2
    rms = np.sum((2.0 * np.pi * f) ** 2 * power) / np.sum(power)
    return Theory(
        code_m=CHIP_M * float(np.sqrt(spread.noise_chips2 / ratio)),
        code_bound_m=CHIP_M * float(np.sqrt(1.0 / (2.0 * ratio * rms))),
        carrier_cyc=float(np.sqrt(9.0 / (8.0 * ratio))) / (2.0 * np.pi),
        doppler_hz=float(np.sqrt(6.0 / ratio)) / (2.0 * np.pi * BLOCK_S),
    )


# ---------------------------------------------------------------------- tables


@dataclass
class _Table:
    """Rows with a bar between the columns, as Markdown has them."""

    title: str
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]] = field(default_factory=list)

    def text(self) -> Iterator[str]:
        widths = [max(map(len, cells)) for cells in zip(self.columns, *self.rows, strict=True)]
        yield ""
        yield self.title
        yield ""
        for cells in (self.columns, tuple("-" * (w - 1) + ":" for w in widths), *self.rows):
            yield "| " + " | ".join(cell.rjust(width) for cell, width in zip(cells, widths, strict=True)) + " |"


_SPREADS = (
    "code bias m",
    "spread",
    "/ discr.",
    "/ bound",
    "carrier bias cyc",
    "spread",
    "/ bound",
    "Doppler bias Hz",
    "spread",
    "/ bound",
    "spread / stated",
    "slips",
    "flags",
    "epochs",
)


def _spreads(e: Errors, expected: Theory) -> tuple[str, ...]:
    """Biases with their own standard error, spreads, and these over theory and over what the receiver states."""
    cells: list[str] = []
    stated = []
    n = e.code_m.size
    if n < 10:
        return ("lost", *[""] * (len(_SPREADS) - 4), str(e.slips), str(e.flags), str(n))
    kinds = (
        (e.code_m, (expected.code_m, expected.code_bound_m), 3),
        (e.carrier_cyc, (expected.carrier_cyc,), 5),
        (e.doppler_hz, (expected.doppler_hz,), 4),
    )
    for i, (values, sigmas, digits) in enumerate(kinds):
        spread = float(np.std(values))
        cells += [f"{np.mean(values):.{digits}f} ± {spread / n**0.5:.{digits}f}", f"{spread:.3g}"]
        cells += [f"{spread / sigma:.2f}" for sigma in sigmas]
        stated.append(f"{spread / np.sqrt(np.mean(e.stated[:, i] ** 2)):.2f}")
    return (*cells, " ".join(stated), str(e.slips), str(e.flags), str(n))


def _without_noise() -> Iterator[str]:
    """The worst of three satellites at three Dopplers: codes that stand still, creep and run past the samples."""
    table = _Table(
        "bias without noise: the worst of 3 satellites and 3 Dopplers (0, 60, 1234.5 Hz), 45 dB-Hz",
        ("Msps", "band MHz", *(f"code m, d = {d:g}" for d in SPACINGS_CHIPS), "carrier cyc", "Doppler Hz"),
    )
    settings = [ReceiverSettings(early_late_chips=d) for d in SPACINGS_CHIPS]
    for band in (*BANDS_HZ, (4e6, None)):
        sats, dopplers_hz = (SATS[:1], (0.0, 1234.5)) if band[0] > 1e7 else (SATS, (0.0, 60.0, 1234.5))
        found = [
            errors(Case(front_end_hz=band, doppler_hz=f, sat=sat, noise=False, duration_s=4.7, seed=i), settings)
            for i, sat in enumerate(sats)
            for f in dopplers_hz
        ]
        code = [max(abs(float(np.mean(run[i].code_m))) for run in found) for i in range(len(settings))]
        carrier = max(abs(float(np.mean(e.carrier_cyc))) for run in found for e in run)
        doppler = max(abs(float(np.mean(e.doppler_hz))) for run in found for e in run)
        table.rows.append((*_named(band), *(f"{c:.3f}" for c in code), f"{carrier:.6f}", f"{doppler:.5f}"))
    yield from table.text()


def _named(band_hz: tuple[float, float | None]) -> tuple[str, str]:
    return f"{band_hz[0] / 1e6:g}", "open" if band_hz[1] is None else f"{band_hz[1] / 1e6:g}"


def _bands_and_spacings() -> Iterator[str]:
    table = _Table("front ends and tap spacings, 45 dB-Hz", ("Msps", "band MHz", "spacing", *_SPREADS))
    settings = [ReceiverSettings(early_late_chips=d) for d in SPACINGS_CHIPS]
    for seed, band in enumerate((*BANDS_HZ, (4e6, None))):
        case = Case(front_end_hz=band, seed=seed, duration_s=SETTLED_S + (SPREAD_S if band[0] < 1e7 else 10.0))
        for d, e in zip(SPACINGS_CHIPS, errors(case, settings), strict=True):
            table.rows.append((*_named(band), f"{d:g}", *_spreads(e, theory(case, d))))
    yield from table.text()


def _strengths() -> Iterator[str]:
    table = _Table("strengths, 2.6 Msps, 2 MHz, spacing 0.25", ("C/N0", *_SPREADS))
    for cn0_dbhz in (30.0, 35.0, 40.0, 45.0, 50.0):
        case = Case(cn0_dbhz=cn0_dbhz, seed=int(cn0_dbhz))
        table.rows.append((f"{cn0_dbhz:g}", *_spreads(*errors(case, [ReceiverSettings()]), theory(case, 0.25))))
    yield from table.text()


def _integrations() -> Iterator[str]:
    """Coherent integration of the loops; the carrier's bandwidth is what this time allows, at most 15 Hz."""
    table = _Table("integration of the loops, 2.6 Msps, 2 MHz, spacing 0.25", ("C/N0", "ms", *_SPREADS))
    settings = []
    for n in INTEGRATIONS:
        loops = LoopSettings(integration=n, pll_bandwidth_hz=min(15.0, 120.0 / n))
        settings.append(ReceiverSettings(tracking=loops, weak=replace(loops, integration=n)))
    for cn0_dbhz in (35.0, 45.0):
        case = Case(cn0_dbhz=cn0_dbhz, seed=int(cn0_dbhz) + 100)
        for n, e in zip(INTEGRATIONS, errors(case, settings), strict=True):
            table.rows.append((f"{cn0_dbhz:g}", f"{n}", *_spreads(e, theory(case, 0.25))))
    yield from table.text()


def _motions() -> Iterator[str]:
    """Steps fall on the edge of two blocks, and in the middle of one, by turns."""
    table = _Table("motion, 2.6 Msps, 2 MHz, spacing 0.25, 45 dB-Hz", ("motion", *_SPREADS))
    steps_s = SETTLED_S + np.arange(0.9, SPREAD_S, 1.1)
    signs = np.resize([1.0, 0.0, -1.0, 0.0], steps_s.size)
    motions: dict[str, tuple[tuple[float, float], ...]] = {
        "at rest": (),
        "1 Hz/s": ((0.0, -SPEED_OF_LIGHT_M_S / GPS_L1_CA.carrier_hz),),
        "2 g": ((2.0, TWO_G_M_S2),),
        "2 g steps": tuple(zip(steps_s.tolist(), (TWO_G_M_S2 * signs).tolist(), strict=True)),
    }
    for seed, (name, accelerations) in enumerate(motions.items()):
        doppler_hz = 3000.0 if name == "2 g" else 1234.5
        case = Case(accelerations=accelerations, seed=seed + 200, doppler_hz=doppler_hz)
        (e,) = errors(case, [ReceiverSettings()])
        if name == "2 g steps":
            near = np.abs(e.elapsed_s[:, None] - steps_s).min(axis=1) < 0.5 * BLOCK_S - 1e-6
            table.rows.append(("blocks with a 2 g step in them", *_spreads(e.where(near), theory(case, 0.25))))
            name, e = "all other blocks", e.where(~near)
        table.rows.append((name, *_spreads(e, theory(case, 0.25))))
    yield from table.text()


def _carrier_to_noise() -> Iterator[str]:
    table = _Table(
        "C/N0 as reported, 2.6 Msps, 2 MHz: mean of the ratio in dB less the true one, and spread of one epoch",
        ("C/N0", "bias dB", "spread dB", "epochs"),
    )
    for cn0_dbhz in range(25, 60, 5):
        (e,) = errors(Case(cn0_dbhz=float(cn0_dbhz), seed=cn0_dbhz + 300, duration_s=42.6), [ReceiverSettings()])
        n = e.cn0_dbhz.size
        if n < 20:
            table.rows.append((f"{cn0_dbhz}", "lost", "", f"{n}"))
            continue
        ratio = 10.0 ** (0.1 * e.cn0_dbhz)
        bias_db = 10.0 * float(np.log10(np.mean(ratio))) - cn0_dbhz
        own_db = 4.34 * float(np.std(ratio) / np.mean(ratio)) / n**0.5
        table.rows.append((f"{cn0_dbhz}", f"{bias_db:.2f} ± {own_db:.2f}", f"{np.std(e.cn0_dbhz):.2f}", f"{n}"))
    yield from table.text()


HOLDING_S = 24.0
_STRONG_S = 3.0  # so long all signals are strong, so that all are held when they fade
_DEFAULT = ReceiverSettings()
LOOPS = {
    "tracking": replace(_DEFAULT, weak=_DEFAULT.tracking),
    "weak": replace(_DEFAULT, tracking=_DEFAULT.weak),
    "by strength": _DEFAULT,
}


def _fading(cn0_dbhz: float, duration_s: float, n: int = 16) -> tuple[Rendering, SignalDelays]:
    """Signals of n satellites, of 42 dB-Hz for 3 s and then of this strength."""
    rng = np.random.default_rng(1000 + int(10 * cn0_dbhz))
    motion = SignalDelays(delay_s=rng.uniform(0.065, 0.08, n), doppler_hz=rng.uniform(-4e3, 4e3, n))
    front_end = FrontEnd(rate_hz=PLAIN[0], bandwidth_hz=PLAIN[1], encoding="float", bits=32)
    rendering = make_ideal_signals(
        GPS_SATS[:n], motion, cn0_dbhz, front_end, duration_s=duration_s, seed=100 + int(cn0_dbhz)
    )

    def strength(elapsed_s: Reals) -> Reals:
        return np.where(np.asarray(elapsed_s)[..., None] < _STRONG_S, 42.0, cn0_dbhz) * np.ones(n)

    return replace(rendering, sky=replace(rendering.sky, cn0_dbhz=strength)), motion  # type: ignore[arg-type]


def _holding() -> Iterator[str]:
    """How long signals are held that fade to a strength, and how often their carriers slip meanwhile."""
    table = _Table(
        f"holding faded signals: 16 for {HOLDING_S - _STRONG_S:g} s each, 2.6 Msps, 2 MHz",
        ("C/N0", "loops", "lost", "mean time to lose s", "slips a minute", "of them flagged", "other flags a minute"),
    )
    for cn0_dbhz in (24.0, 26.0, 27.0, 28.0, 33.0):
        rendering, motion = _fading(cn0_dbhz, HOLDING_S)
        sats = [heard.id.sat for heard in rendering.sky.signals]
        receivers = [Receiver(PLAIN[0], 0.0, replace(s, **_NO_SEARCH)) for s in LOOPS.values()]
        states = [_started(receiver, sats, motion, 42.0) for receiver in receivers]
        parts: list[list[Measurements]] = [[] for _ in receivers]
        ends_s: list[dict[str, float]] = [{} for _ in receivers]
        signals: list[dict[int, str]] = [{} for _ in receivers]
        for block in range(-(-rendering.n_samples // BLOCK)):
            planes = render(rendering, block)[:, : rendering.n_samples - block * BLOCK]
            for i, receiver in enumerate(receivers):
                output, states[i] = receiver.step(states[i], planes)
                parts[i].append(output.measurements)
                signals[i] |= {number: arc.signal.sat for number, arc in output.arcs.items()}
                ends_s[i].update((c.sat, states[i].frame * _DEFAULT.frame_s) for c in states[i].channels)
        for name, measured, ends, sat_of in zip(LOOPS, parts, ends_s, signals, strict=True):
            table.rows.append((f"{cn0_dbhz:g}", name, *_held(Measurements.join(measured), motion, ends, sat_of)))
    yield from table.text()


def _held(
    measured: Measurements, motion: SignalDelays, ends_s: dict[str, float], sat_of: dict[int, str]
) -> tuple[str, ...]:
    begin_s = _STRONG_S + 1.0
    held_s = sum(max(end - begin_s, 0.0) for end in ends_s.values())
    lost = sum(end < HOLDING_S - 0.3 for end in ends_s.values())
    slips = flagged = flags = 0
    for i, sat in enumerate(GPS_SATS[: motion.delay_s.size]):
        numbers = [number for number, of in sat_of.items() if of == sat]
        rows = np.isin(measured.arc, numbers) & (measured.elapsed_s > begin_s)
        t, table = measured.elapsed_s[rows], measured.table[rows]
        cycles = table[:, m.CARRIER_CYC] - motion.carrier_delay_s(t)[:, i] * GPS_L1_CA.carrier_hz
        slipped = np.abs(np.diff(cycles)) > 0.3
        slips += int(slipped.sum())
        flagged += int(np.sum(table[1:, m.SLIP][slipped]))
        flags += int(np.sum(table[:, m.SLIP]))
    minutes = max(held_s, 1.0) / 60.0
    mean_s = f"{held_s / lost:.0f}" if lost else f"> {held_s:.0f}"
    return f"{lost}", mean_s, f"{slips / minutes:.1f}", f"{flagged} of {slips}", f"{(flags - flagged) / minutes:.1f}"


def _locks() -> Iterator[str]:
    """The lock detector: loops run on noise, which they follow, and on weak signals that they hold."""
    table = _Table(
        f"looks of the lock detector, 16 channels for {HOLDING_S:g} s",
        ("signal", "loops", "look s", "looks", "held", "stated for noise"),
    )
    for cn0_dbhz in (-40.0, 22.0, 25.0, 28.0):
        rendering, motion = _fading(cn0_dbhz, HOLDING_S)
        sats = [heard.id.sat for heard in rendering.sky.signals]
        planes = [render(rendering, b) for b in range(-(-rendering.n_samples // BLOCK))]
        samples = np.concatenate(planes, axis=1)[:, : rendering.n_samples]
        for name in ("tracking", "weak"):
            # Never confirmed, so never dropped: all looks are seen.
            receiver = Receiver(PLAIN[0], 0.0, replace(LOOPS[name], confirm_s=1e9, **_NO_SEARCH))
            state = _started(receiver, sats, motion, 42.0)
            held: dict[int, list[NDArray[np.bool_]]] = {2: [], 5: []}
            for frame in range(int(HOLDING_S / _DEFAULT.frame_s)):
                begin, end = receiver.frame_start(frame), receiver.frame_start(frame + 1)
                _, state = receiver.step(state, samples[:, begin:end])
                on_signal = np.ones(len(sats), bool) if cn0_dbhz < 0.0 else _is_near(receiver, state, motion, end)
                for n_frames, seen in held.items():
                    if frame > 40 and frame % n_frames == 0:
                        seen.append(holds_signal(state, n_frames, receiver.settings)[on_signal])
            for n_frames, seen in held.items():
                looks = np.concatenate(seen)
                stated = f"{_DEFAULT.false_hold_probability if n_frames == 5 else 0.01:g}" if cn0_dbhz < 0.0 else ""
                signal = "noise" if cn0_dbhz < 0.0 else f"{cn0_dbhz:g} dB-Hz"
                share = f"{looks.mean():.4f}"
                table.rows.append((signal, name, f"{0.1 * n_frames:g}", f"{looks.size}", share, stated))
    yield from table.text()


def _is_near(receiver: Receiver, state: ReceiverState, motion: SignalDelays, sample: int) -> NDArray[np.bool_]:
    """Which channels are within a tenth of a chip and 5 Hz of their signal."""
    at_s = sample / receiver.rate_hz
    late_s = receiver._delay_s(state.loops, sample) - motion.code_delay_s([at_s])[0] + at_s
    late_s -= GPS_L1_CA.period_s * np.rint(late_s / GPS_L1_CA.period_s)
    beside_hz = state.loops[:, k.FREQUENCY] - motion.doppler_at_hz([at_s])[0]
    return np.asarray((np.abs(late_s) * GPS_L1_CA.chip_rate_hz < 0.1) & (np.abs(beside_hz) < 5.0))
