"""Two signals of one satellite within a chip and a half, followed as one channel of two components.

At the correlators: looks with the noise that they have, through the channel as it is; a second signal begins beside a
first that is followed. `followed` is the share of rows, from 0.4 s after its beginning, in which both are there, each
within a quarter of a chip of the truth and nearer to its own than to the other. Errors are those of rows alone, white
from row to row, over the Cramer-Rao bound of a row (0.2 s; amplitudes, phases, Dopplers and their rates unknown, too);
those of the filter stand beside, over the sigma that it states. Through samples: the same, from sharp chips in white
noise, correlators and all.

`python bench/joint.py --rate 5e6 --draws 20` writes the table as markdown; `--samples` that from samples.
"""

import argparse
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from following import following
from waves import SAT, Cell, Wave, add, pair_of
from waves import noise as noise_of

from skyproof.arrays import Floats, Reals
from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS, prn_of
from skyproof.receiver import joint as j
from skyproof.receiver.joint_channel import JointRow, bits, started
from skyproof.receiver.joint_model import JointModel
from skyproof.receiver.joint_tracker import JointState, JointTracker, Replica

ONSET_S = 0.2
GRACE_S = 0.4
END_S = 1.6
RHO = GPS_L1_CA.chip_rate_hz / GPS_L1_CA.carrier_hz

APART_CHIPS = (0.1, 0.2, 0.3, 0.5, 0.75, 1.0, 1.5)
POWERS_DB = (-10.0, -6.0, 0.0, 6.0, 10.0)
DIFFERENCES_HZ = (2.0, 10.0, 50.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Result:
    """One draw: (rows, 2) where both are followed; seconds to the birth, NaN if there was none."""

    wait_s: float
    followed: Reals
    over_bound: Reals
    over_sigma: Reals
    bound: Reals
    error: Reals


def model_of(rate_hz: float) -> JointModel:
    """Of the satellite of the bench."""
    return JointModel(signal=GPS_L1_CA, code=GPS_L1_CA.code(prn_of(SAT)), rate_hz=rate_hz)


def cells(apart: Sequence[float] = APART_CHIPS) -> Iterator[Cell]:
    """Every separation at every power without, and at equal power with a difference of Doppler."""
    for apart_chips in apart:
        for relative_db in POWERS_DB:
            yield Cell(apart_chips=apart_chips, relative_db=relative_db, apart_hz=0.0)
        for apart_hz in DIFFERENCES_HZ:
            yield Cell(apart_chips=apart_chips, relative_db=0.0, apart_hz=apart_hz)


def draws_of(model: JointModel, cell: Cell, rng: np.random.Generator, count: int) -> list[Result]:
    """Pairs at the correlators."""
    mean = np.zeros((count, 2, j.N_STATE))
    size = math.sqrt(model.energy(cell.cn0_dbhz)) * np.array([1.0, 10.0 ** (cell.relative_db / 20.0)])
    amplitude = size * np.exp(2j * np.pi * rng.random((count, 2)))
    mean[..., j.RE], mean[..., j.IM] = amplitude.real, amplitude.imag
    mean[:, 1, j.HZ] = cell.apart_hz * rng.choice([-1.0, 1.0], count)
    middle_s = 0.5 * (ONSET_S + END_S)
    mean[:, 1, j.CHIPS] = cell.apart_chips * rng.choice([-1.0, 1.0], count) + RHO * mean[:, 1, j.HZ] * middle_s
    channels = [started(model, complex(a) * np.exp(0.2j), 0.5) for a in amplitude[:, 0]]
    rows: list[list[tuple[float, JointRow, Reals]]] = [[] for _ in range(count)]
    for number in range(round(END_S / model.bit_s)):
        t_s = (number + 0.5) * model.bit_s
        there = j.carried(mean, t_s, RHO)[:, : 2 if t_s > ONSET_S else 1]
        looks = j.signals_in(there, model.bit_times_s, model.look_s, model.dictionary)
        looks = looks * rng.choice([-1.0, 1.0], (count, 1, 1))
        noise = rng.standard_normal((2, *looks.shape)) * math.sqrt(0.5)
        done = bits(model, channels, (looks + noise[0] + 1j * noise[1])[:, None])
        channels = [channel for channel, _ in done]
        truth = j.carried(mean, t_s - 0.09, RHO)
        for i, (_, row) in enumerate(done):
            if row is not None:
                rows[i].append((t_s - 0.09, row, truth[i]))
    return [_result(one, model) for one in rows]


def drawn_from_samples(model: JointModel, cell: Cell, rng: np.random.Generator) -> tuple[Result, float]:
    """One pair from samples; and the tracker's time on the processor, s a second."""
    rate_hz = model.rate_hz
    waves = pair_of(rng, cell, ONSET_S, 0.5 * (ONSET_S + END_S), END_S + 0.1)
    first = waves[0]
    start = math.ceil(first.delay_s * rate_hz)
    chip = float(first.sent_s(start / rate_hz)) * GPS_L1_CA.chip_rate_hz
    tracker = JointTracker(model)
    replica = Replica(start=start, chip=chip + 0.02 * rng.standard_normal(), phase_cyc=0.0, hz=first.doppler_hz - 1.0)
    phase_cyc = first.phase_cyc + first.doppler_hz * start / rate_hz
    amplitude = math.sqrt(model.energy(cell.cn0_dbhz)) * np.exp(2j * np.pi * phase_cyc)
    noise = model.look_s * rate_hz * 2.0 * tracker.replica_power
    state = JointState(replica=replica, row_began=replica, channel=started(model, complex(amplitude), 1.0), noise=noise)
    n, tail, begin, spent_s, rows = round(0.1 * rate_hz), np.empty((2, 0), np.float32), 0, 0.0, []
    for block in range(round((END_S + 0.05) / 0.1)):
        planes: Floats = noise_of(rng, n)
        for wave in waves:
            add(wave, block * n, planes, rate_hz)
        tail = np.concatenate([tail, planes], axis=1)
        since = process_time()
        found, state = tracker.step(state, tail, begin)
        spent_s += process_time() - since
        for row, followed in found:
            t_s = followed[0].at / rate_hz
            # Where the replica was, from what the row made of it.
            zero = followed[0].code_chips + float((row.alone.mean if followed[0].alone else row.filtered)[0, j.CHIPS])
            hz = followed[0].hz - float((row.alone.mean if followed[0].alone else row.filtered)[0, j.HZ])
            rows.append((t_s, row, _truth(model, cell, waves, t_s, zero, hz)))
        skip = max(state.replica.start - begin - 8, 0)
        tail, begin = tail[:, skip:], begin + skip
    return _result(rows, model), spent_s / END_S


def _truth(model: JointModel, cell: Cell, waves: Sequence[Wave], t_s: float, zero_chips: float, hz: float) -> Reals:
    """States beside a replica that shows `zero_chips` at that moment."""
    mean = np.zeros((2, j.N_STATE))
    for n, (wave, db) in enumerate(zip(waves, (0.0, cell.relative_db), strict=True)):
        phase = 2.0 * math.pi * (wave.phase_cyc + wave.doppler_hz * t_s)
        a = math.sqrt(model.energy(cell.cn0_dbhz + db)) * np.exp(1j * phase)
        sent = float(wave.sent_s(t_s)) * GPS_L1_CA.chip_rate_hz
        mean[n, [j.RE, j.IM, j.HZ]] = a.real, a.imag, wave.doppler_hz - hz
        mean[n, j.CHIPS] = (zero_chips - sent + 10230.0) % 20460.0 - 10230.0
    return mean


def _result(rows: Sequence[tuple[float, JointRow, Reals]], model: JointModel) -> Result:
    wait_s = next((t_s + 0.1 - ONSET_S for t_s, row, _ in rows if row.came), math.nan)
    followed, over_bound, over_sigma, bounds, errors = [], [], [], [], []
    for t_s, row, truth in rows:
        if t_s < ONSET_S + GRACE_S:
            continue
        good = False
        if len(row.names) == 2:
            off = row.filtered[:, j.CHIPS] - truth[:, j.CHIPS]
            good = bool(np.all(np.abs(off) < min(0.25, 0.5 * abs(truth[1, j.CHIPS] - truth[0, j.CHIPS]))))
        followed.append(good)
        if good:
            limit = j.bound(truth, model.row_times_s, model.look_s, model.dictionary)
            at_best = np.sqrt(np.diagonal(limit)[j.CHIPS :: j.N_FITTED])
            over_bound.append((row.alone.mean[:, j.CHIPS] - truth[:, j.CHIPS]) / at_best)
            over_sigma.append(off / row.sigma[:, j.CHIPS])
            bounds.append(at_best)
            errors.append(off)
    return Result(
        wait_s=wait_s,
        followed=np.array(followed, np.float64),
        over_bound=np.array(over_bound).reshape(-1, 2),
        over_sigma=np.array(over_sigma).reshape(-1, 2),
        bound=np.array(bounds).reshape(-1, 2),
        error=np.array(errors).reshape(-1, 2),
    )


HEAD = (
    "| Msps | apart, chips | second, dB | Doppler, Hz | C/N0 | born | wait median / most, s | followed "
    "| row rms over bound, first / second | bound, chips | filter rms, chips | over its sigma |\n|" + " --- |" * 12
)


def line_of(model: JointModel, cell: Cell, results: Sequence[Result]) -> str:
    """A cell's draws as a row of the table."""
    waits = [one.wait_s for one in results if math.isfinite(one.wait_s)]

    def both(values: list[Reals], digits: int) -> str:
        found = np.concatenate(values)
        if not len(found):
            return "–"
        return " / ".join(f"{v:.{digits}f}" for v in np.sqrt(np.mean(found**2, axis=0)))

    parts = [
        f"{model.rate_hz / 1e6:g}",
        f"{cell.apart_chips:g}",
        f"{cell.relative_db:+.0f}",
        f"{cell.apart_hz:g}",
        f"{cell.cn0_dbhz:g}",
        f"{len(waits)}/{len(results)}",
        f"{np.median(waits):.1f} / {max(waits):.1f}" if waits else "–",
        f"{np.mean(np.concatenate([one.followed for one in results])):.3f}",
        both([one.over_bound for one in results], 2),
        both([one.bound for one in results], 4),
        both([one.error for one in results], 4),
        both([one.over_sigma for one in results], 2),
    ]
    return "| " + " | ".join(parts) + " |"


def seed_of(cell: Cell) -> list[int]:
    """A cell's draws are its own whatever other cells are asked for."""
    parts = (100 * cell.apart_chips, cell.relative_db + 100, cell.apart_hz, cell.cn0_dbhz)
    return [round(part) for part in parts]


def table(rate_hz: float, draws: int, chosen: Sequence[Cell]) -> Iterator[str]:
    """Rows of the table at the correlators."""
    model = model_of(rate_hz)
    for cell in chosen:
        rng = np.random.default_rng(seed_of(cell))
        yield line_of(model, cell, draws_of(model, cell, rng, draws))


def table_of_samples(rate_hz: float, draws: int, chosen: Sequence[Cell]) -> Iterator[str]:
    """Rows of the table through samples, with the tracker's cost."""
    model = model_of(rate_hz)
    for cell in chosen:
        rng = np.random.default_rng(seed_of(cell))
        drawn = [drawn_from_samples(model, cell, rng) for _ in range(draws)]
        cost = np.median([spent for _, spent in drawn])
        yield line_of(model, cell, [one for one, _ in drawn]) + f" {1e3 * cost:.0f} ms of CPU a second |"


def report() -> Iterator[str]:
    """The cells of the aim at the correlators, and the cost from samples."""
    yield "two signals of a satellite in one channel, 45 dB-Hz: share followed; rms of rows over their bound"
    yield HEAD
    for rate_hz, apart in ((5e6, (0.5, 1.0)), (25e6, (0.2, 0.5))):
        yield from table(rate_hz, 20, [one for one in cells(apart) if abs(one.relative_db) < 7.0])
    cell = Cell(apart_chips=0.5, relative_db=0.0, apart_hz=2.0)
    for rate_hz in (2.6037e6, 5.0037e6, 25.0037e6):
        model = model_of(rate_hz)
        for seed in (0, 1):  # compiled before it is timed
            spent = [drawn_from_samples(model, cell, np.random.default_rng(seed))[1] for _ in range(3 * seed + 1)]
            alone = [single_channel(rate_hz, np.random.default_rng(seed)) for _ in range(3 * seed + 1)]
        joint_ms, single_ms = 1e3 * np.median(spent), 1e3 * np.median(alone)
        yield (
            f"  {rate_hz / 1e6:.1f} Msps: {joint_ms:.1f} ms of CPU a second for a joint channel of two signals, "
            f"{single_ms:.1f} for the loops of one, {joint_ms / single_ms:.1f} times"
        )


def single_channel(rate_hz: float, rng: np.random.Generator, more: int = 6) -> float:
    """Time on the processor, s a second, of a receiver's step for each channel `more`; searches left out."""
    few, many = (_receiver_s(rate_hz, GPS_SATS[:n], rng) for n in (2, 2 + more))
    return (many - few) / more


def _receiver_s(rate_hz: float, sats: tuple[str, ...], rng: np.random.Generator) -> float:
    """Time on the processor, s a second, of a receiver that follows these satellites."""
    receiver, state, planes = following(rate_hz, sats, END_S, rng)
    n = round(0.1 * rate_hz)
    _, state = receiver.step(state, planes[:, :n])  # which makes the tables of the codes
    since = process_time()
    for begin in range(n, planes.shape[1], n):
        _, state = receiver.step(state, planes[:, begin : begin + n])
    spent_s = process_time() - since
    assert len(state.channels) == len(sats)
    return spent_s / (END_S - 0.1)


def main() -> None:
    """The tables as markdown."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--rate", type=float, default=5e6, help="samples a second")
    options.add_argument("--draws", type=int, default=20, help="of each cell")
    options.add_argument("--apart", type=float, nargs="*", default=APART_CHIPS, help="separations, chips")
    options.add_argument("--cn0", type=float, default=45.0, help="of the first signal, dB-Hz")
    options.add_argument("--samples", action="store_true", help="through samples")
    options.add_argument("--short", action="store_true", help="-6, 0 and +6 dB at no Doppler, and 50 Hz, alone")
    asked = options.parse_args()
    chosen = [
        Cell(apart_chips=one.apart_chips, relative_db=one.relative_db, apart_hz=one.apart_hz, cn0_dbhz=asked.cn0)
        for one in cells(asked.apart)
        if not asked.short or (abs(one.relative_db) < 7.0 and one.apart_hz in (0.0, 50.0))
    ]
    print(HEAD, flush=True)
    for line in (table_of_samples if asked.samples else table)(asked.rate, asked.draws, chosen):
        print(line, flush=True)


if __name__ == "__main__":
    main()
