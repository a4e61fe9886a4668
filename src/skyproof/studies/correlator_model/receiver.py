"""The receiver whose correlators and searches are drawn."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Floats, Integers, Reals
from skyproof.compiled import compiled
from skyproof.gnss.signals import prn_of
from skyproof.receiver import kernels as k
from skyproof.receiver.acquisition import KnownSignal, Peak
from skyproof.receiver.looking import Lookout
from skyproof.receiver.replica import CODE_SCALE
from skyproof.receiver.settings import ReceiverSettings
from skyproof.receiver.state import ReceiverState
from skyproof.receiver.tracking import Receiver
from skyproof.simulator.received import Scene
from skyproof.studies.correlator_model.correlation import POINTS, noise_root, tabulate_correlation
from skyproof.studies.correlator_model.grids import ModelGrids
from skyproof.studies.correlator_model.waves import SIGNAL, STEP_S, Waves, compute_waves
from skyproof.studies.receiver_model import FIND_DBHZ

__all__ = ["ModelReceiver"]

FIND_CHIPS, FOUND_CHIPS, FOUND_HZ = 1.0, 0.1, 25.0
"""How far a search keeps from what is followed, and how far off what it finds is."""


class ModelReceiver(Receiver):
    """The receiver, whose correlators are drawn; it takes samples of no plane, (0, n), which say how many there are."""

    def __init__(self, scene: Scene, index: int, settings: ReceiverSettings, rng: np.random.Generator) -> None:
        front_end = scene.scenario.front_end
        super().__init__(front_end.rate_hz, front_end.if_hz, settings)
        if self.taps_hz.size > 1:
            raise ValueError("only one Doppler is drawn")
        self.waves = compute_waves(scene, index)
        self._rng = rng
        self._shape = front_end.rate_hz, front_end.bandwidth_hz
        self._lookout = ModelLookout(self.rate_hz, self.if_hz, self.settings, self.waves, rng)
        if self.grids is not None:
            self.grids = ModelGrids(self.grids, front_end.bandwidth_hz, self.waves, rng)
        self._of: dict[str, tuple[Integers, Reals, Reals]] = {}

    def _advance(self, state: ReceiverState, begin: int, end: int) -> ReceiverState:
        n = len(state.channels)
        if n == 0:
            return state
        rows = np.zeros((n, self._max_periods, k.row_size(self.n_taps, 1)))
        counts, loops = np.zeros(n, np.int64), state.loops.copy()
        loops[:, [k.LOCK_I, k.LOCK_Q, k.LOCK_COUNT]] = 0.0
        power = float(self.waves.power[min(state.frame, len(self.waves.power) - 1)]) * CODE_SCALE**2
        noise = self._rng.standard_normal((n, self._max_periods, self.n_taps, 2))
        arriving = [(w, stop, i) for w, stop in self.stretches(begin, end) for i in range(n)]
        for w, stop, i in arriving:
            of, table, root = self._correlation_of(state.channels[i].sat)
            _track_periods(
                stop,
                power,
                loops[i],
                w.code_s[:, of],
                w.turns_cyc[:, of],
                w.amplitude[:, of],
                w.white[:, of[:1]],
                w.symbols[of],
                w.guesses[of],
                w.guessed[of],
                w.lead_s,
                table,
                root,
                noise[i],
                self.taps_chips,
                self._look_samples,
                self.settings.look_share,
                self.rate_hz,
                self.if_hz,
                SIGNAL.chip_rate_hz,
                SIGNAL.carrier_hz,
                SIGNAL.code_length,
                self.discriminator.gain,
                rows[i],
                counts[i : i + 1],
            )
        prompts = tuple(
            (*old, rows[i, : counts[i], k.OUT_TAPS + 2].astype(np.float32)) for i, old in enumerate(state.prompts)
        )
        noise_power = power * self.rate_hz * SIGNAL.period_s
        return replace(state, loops=loops, rows=rows, counts=counts, prompts=prompts, noise=noise_power)

    def stretches(self, begin: int, end: int) -> list[tuple[Waves, int]]:
        """Return what arrives from sample `begin` on, and up to where."""
        return [(self.waves, end)]

    def replace_waves(self, waves: Waves) -> None:
        """Replace what arrives from now on, in searches and grids as well."""
        self.waves = waves
        for searcher in (self._lookout.searcher, self._lookout.near_searcher):
            searcher.waves = waves  # type: ignore[attr-defined]
        if self.grids is not None:
            self.grids.waves = waves  # type: ignore[attr-defined]

    def _correlation_of(self, sat: str) -> tuple[Integers, Reals, Reals]:
        if sat not in self._of:
            shape = tabulate_correlation(prn_of(sat), *self._shape, None)
            self._of[sat] = self.waves.of(sat), shape.signal, noise_root(shape.replica, self.taps_chips)
        return self._of[sat]


@compiled
def _track_periods(
    end: int,
    sample_power: float,
    state: Reals,
    code_s: Reals,
    turns_cyc: Reals,
    amplitude: Reals,
    white: Reals,
    symbols: NDArray[np.int8],
    guesses: NDArray[np.int8],
    guessed: Reals,
    lead_s: float,
    table: Reals,
    root: Reals,
    noise: Reals,
    taps_chips: Reals,
    look_samples: float,
    look_share: float,
    rate_hz: float,
    if_hz: float,
    code_rate_hz: float,
    carrier_hz: float,
    code_length: int,
    code_gain: float,
    out: Reals,
    count: Integers,
) -> None:
    """Track one channel as `kernels.advance` does, with waves in place of samples before index `end`."""
    n_taps, n_waves = taps_chips.shape[0], code_s.shape[1]
    sums = np.empty((n_taps, 2))
    while count[0] < out.shape[0]:
        chips_per_sample = state[k.CODE_RATE] / rate_hz
        n = math.ceil((code_length - state[k.CHIP]) / chips_per_sample)
        if state[k.START] + n > end:
            break
        looked = state[k.START] % look_samples < look_share * look_samples
        taken = n_taps if looked else 3
        row = out[count[0]]
        at_s = (state[k.START] + 0.5 * (n - 1)) / rate_hz
        step = min(int(at_s / STEP_S), code_s.shape[0] - 1)
        u = at_s / STEP_S - step
        sums[:] = 0.0
        for wave in range(n_waves):
            size = amplitude[step, wave]
            if size <= 0.0:
                continue
            a, b, c = code_s[step, wave]
            sent_s = at_s + a + u * (b + u * c)
            lag = sent_s * code_rate_hz - state[k.CHIP] - 0.5 * (n - 1) * chips_per_sample
            a, b, c = turns_cyc[step, wave]
            mine = state[k.PHASE] + 0.5 * (n - 1) * state[k.FREQUENCY] / rate_hz
            cycles = a + u * (b + u * c) - mine
            off_hz = (b + 2.0 * u * c) / STEP_S - state[k.FREQUENCY]
            x = math.pi * off_hz * n / rate_hz
            size *= n * (math.sin(x) / x if abs(x) > 1e-6 else 1.0)
            symbol = (lead_s + sent_s) / (20.0 * code_length / code_rate_hz)
            number = int(symbol)
            if (symbol - number) * 20.0 < 1.0:
                size *= symbols[wave, number] * (1.0 - guessed[wave]) + guesses[wave, number] * guessed[wave]
            else:
                size *= symbols[wave, number]
            angle_rad = 2.0 * math.pi * (cycles - math.floor(cycles))
            real, imaginary = size * math.cos(angle_rad), size * math.sin(angle_rad)
            for tap in range(taken):
                at = (lag - taps_chips[tap]) * POINTS
                at -= math.floor(at / table.size) * table.size
                whole = int(at)
                share = at - whole
                value = table[whole % table.size] * (1.0 - share) + table[(whole + 1) % table.size] * share
                sums[tap, 0] += real * value
                sums[tap, 1] += imaginary * value
        spread = math.sqrt(white[step, 0] * n)
        for tap in range(taken):
            for lower in range(tap + 1):
                sums[tap, 0] += spread * root[tap, lower] * noise[count[0], lower, 0]
                sums[tap, 1] += spread * root[tap, lower] * noise[count[0], lower, 1]
        row[k.OUT_TAPS :] = math.nan
        for tap in range(taken):
            row[k.OUT_TAPS + 2 * tap] = CODE_SCALE * sums[tap, 0]
            row[k.OUT_TAPS + 2 * tap + 1] = CODE_SCALE * sums[tap, 1]
        row[k.OUT_START], row[k.OUT_CHIP], row[k.OUT_PHASE] = state[k.START], state[k.CHIP], state[k.PHASE]
        row[k.OUT_FREQUENCY], row[k.OUT_PERIOD], row[k.OUT_SHIFT] = state[k.FREQUENCY], state[k.PERIODS], 0.0
        k.close_period(state, row, n, rate_hz, chips_per_sample, code_length)
        if (state[k.PERIODS] - max(state[k.BIT_START], 0.0)) % state[k.INTEGRATION] == 0.0:
            k.steer(state, sample_power, rate_hz, if_hz, code_rate_hz, carrier_hz, code_gain)
        count[0] += 1


class ModelLookout(Lookout):
    """Searches that find what is there."""

    def __init__(
        self, rate_hz: float, if_hz: float, settings: ReceiverSettings, waves: Waves, rng: np.random.Generator
    ) -> None:
        super().__init__(rate_hz, if_hz, settings)
        searchers = [
            ModelSearcher(search.doppler_step_hz, waves, rate_hz, rng)
            for search in (settings.search, settings.near_search)
        ]
        self.searcher, self.near_searcher = searchers  # type: ignore[assignment]

    def look(self, state: ReceiverState, begin: int, rows_shape: tuple[int, int]) -> ReceiverState:
        """Look for signals as in a search of samples."""
        for searcher in (self.searcher, self.near_searcher):
            searcher.begin = begin  # type: ignore[attr-defined]
        return super().look(state, begin, rows_shape)


class ModelSearcher:
    """Finds signals above `FIND_DBHZ` near the Dopplers asked for, `FIND_CHIPS` from known and from stronger ones."""

    def __init__(self, step_hz: float, waves: Waves, rate_hz: float, rng: np.random.Generator) -> None:
        self.step_hz, self.waves, self.rate_hz, self.rng = step_hz, waves, rate_hz, rng
        self.begin, self.n_samples = 0, round(0.02 * rate_hz)

    def search(
        self, samples: Floats, if_hz: float, dopplers: Mapping[str, Reals], known: Mapping[str, Sequence[KnownSignal]]
    ) -> list[Peak]:
        """Search as `Searcher.search`."""
        w, step = self.waves, min(int(self.begin / self.rate_hz / STEP_S), self.waves.amplitude.shape[0] - 1)
        at_s = self.begin / self.rate_hz
        u = at_s / STEP_S - step
        powers = np.array([1.0, u, u * u])
        with np.errstate(divide="ignore"):
            dbhz = 10.0 * np.log10(0.5 * w.amplitude[step] ** 2 / w.white[step] * self.rate_hz)
        found = []
        for sat, grid in dopplers.items():
            taken = [signal.delay_s for signal in known.get(sat, ())]
            for wave in sorted(w.of(sat).tolist(), key=lambda k: -dbhz[k]):
                doppler_hz = float(w.turns_cyc[step, wave, 1] + 2.0 * u * w.turns_cyc[step, wave, 2]) / STEP_S - if_hz
                sent_s = at_s + float(w.code_s[step, wave] @ powers)
                delay_s = -sent_s % SIGNAL.period_s
                if dbhz[wave] < FIND_DBHZ or np.abs(grid - doppler_hz).min() > 0.6 * self.step_hz:
                    continue
                if any(abs(_apart_s(delay_s, other_s)) * SIGNAL.chip_rate_hz < FIND_CHIPS for other_s in taken):
                    continue
                taken.append(delay_s)
                off_chips, off_hz = self.rng.standard_normal(2) * (FOUND_CHIPS, FOUND_HZ)
                found.append(
                    Peak(
                        sat=sat,
                        delay_s=(delay_s + off_chips / SIGNAL.chip_rate_hz) % SIGNAL.period_s,
                        doppler_hz=doppler_hz + off_hz,
                        cn0_dbhz=float(dbhz[wave]),
                        power=100.0,
                        p_value=1e-9,
                    )
                )
        return found


def _apart_s(one_s: float, other_s: float) -> float:
    return (one_s - other_s + 0.5 * SIGNAL.period_s) % SIGNAL.period_s - 0.5 * SIGNAL.period_s
