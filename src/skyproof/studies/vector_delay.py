"""How long after its onset an attack is found, the paper's rule and ours at the same false-alarm rate.

Offsets are settled from the onset on, at an instant that has nothing to do with the blocks. Everything is drawn from
taps; nothing is taken as normal. The block methods get the block length that is best for each attack, which no receiver
could choose; the bank of cumulative sums is one for all.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import brentq

from skyproof.arrays import Booleans, Complexes, Reals
from skyproof.detectors.correlators import correlator_laws as law
from skyproof.detectors.correlators import vector_parity as parity
from skyproof.studies import discriminator_laws as laws
from skyproof.studies import vector_parity_tests as parity_tests
from skyproof.studies import vector_rules as rules
from skyproof.studies.base import Row, StudySettings
from skyproof.studies.vector_loops import mean_taps, tap_noise
from skyproof.studies.vector_sky import SKY, attack_on

__all__ = ["ATTACKS", "RATE_PER_S", "bank_delays", "block_delay", "delay_rows", "tests_of"]

RATE_PER_S: Final = 1e-3
CN0_DBHZ: Final = 40.0
ATTACKS: Final = ((0.4, 200.0), (0.2, 100.0), (0.1, 50.0), (0.05, 25.0), (0.02, 10.0), (0.1, 0.0), (0.0, 50.0))
BLOCKS: Final = (5, 7, 10, 15, 20, 30, 50, 75, 100, 150, 200, 300, 500, 750, 1000, 1500, 2000)
BLOCKS_QUICK: Final = (7, 20, 50, 100, 200, 500, 1000, 2000)
_MARGIN: Final = 1.25  # the branch of 1 ms has 0.90 +- 0.05 of the mean time that it is designed for (333 alarms)
_WARM_UP_MS: Final = 400
_CHUNK_MS: Final = 200
_LONGEST_MS: Final = 30_000

Test = Callable[[Reals, Reals], Booleans]


class Delay(NamedTuple):
    """mean_ms : from the onset to the end of the alarming block; sums : its length."""

    mean_ms: float
    sums: int


def tests_of(sums: int) -> dict[str, Test]:
    """The block methods at `RATE_PER_S`, by name: discriminators (..., 6) to alarms (...).

    The paper's limits scaled by one factor, or balanced: code and phase alarm equally often.
    """
    amplitude = float(laws.prompt_amplitude(CN0_DBHZ, sums))
    probability = float(rules.block_rate(RATE_PER_S, sums))
    scale = rules.limit_scale(amplitude, 6, probability)
    share = -np.expm1(np.log1p(-probability) / 12)
    code_limit = _limit(lambda x: float(laws.code_tail(x, amplitude)), share, 0.5)
    phase_limit = _limit(lambda x: float(laws.phase_tail(x, amplitude)), share, law.HALF_PI)
    white = parity_tests.whitener(SKY.parity, amplitude)
    threshold = parity_tests.parity_threshold(probability, 6)

    def two_step(code_limit_chips: float, phase_limit_rad: float) -> Test:
        return lambda u, q: (
            rules.two_step(u, q, code_limit_chips=code_limit_chips, phase_limit_rad=phase_limit_rad).alarm
        )

    return {
        "paper, limits scaled": two_step(scale * rules.CODE_LIMIT_CHIPS, scale * rules.PHASE_LIMIT_RAD),
        "paper, limits balanced": two_step(code_limit, phase_limit),
        "parity of blocks": lambda u, q: parity.parity_test(parity.parity_vector(u, q, white)).statistic > threshold,
    }


def _limit(tail: Callable[[float], float], probability: float, largest: float) -> float:
    return float(brentq(lambda x: np.log(max(tail(x), 1e-300) / probability), 1e-6, largest * (1.0 - 1e-9)))


def block_delay(
    rng: np.random.Generator, offsets: rules.Equilibrium, sums: int, tests: Mapping[str, Test], trials: int
) -> dict[str, float]:
    """Mean delay in milliseconds of each of `tests` on blocks of `sums` integrations.

    The block with the onset has the attack in part of it only; those after it alarm with probability P_D each. So the
    mean is the rest of the first block, plus the chance that it misses times sums / P_D.
    """
    amplitude = laws.prompt_amplitude(CN0_DBHZ, sums)
    rest = rng.integers(1, sums + 1, trials)  # integrations from the onset to the end of its block
    share = (rest / sums)[:, None, None]
    attacked = mean_taps(amplitude, offsets.code_chips, offsets.phase_rad)
    quiet = mean_taps(amplitude, np.zeros(6), np.zeros(6))
    first = _discriminators(tap_noise(rng, (trials, 6)) + share * attacked + (1.0 - share) * quiet)
    later = _discriminators(tap_noise(rng, (trials, 6)) + attacked)
    found = {}
    for name, alarms in tests.items():
        missed, power = 1.0 - float(np.mean(alarms(*first))), float(np.mean(alarms(*later)))
        found[name] = float(np.mean(rest)) + missed * sums / power if power > 0.0 else np.inf
    return found


def _discriminators(taps: Complexes) -> tuple[Reals, Reals]:
    return laws.code_discriminator(taps[..., 0], taps[..., 2]), law.phase_discriminator(taps[..., 1])


def bank_delays(
    rng: np.random.Generator, offsets: rules.Equilibrium, bank: tuple[parity.Branch, ...], trials: int
) -> Reals:
    """Delay of the bank in milliseconds, (trials,), after 400 ms without an attack; NaN beyond 30 s."""
    amplitude = float(laws.prompt_amplitude(CN0_DBHZ))
    means = np.stack(
        (mean_taps(amplitude, np.zeros(6), np.zeros(6)), mean_taps(amplitude, offsets.code_chips, offsets.phase_rad))
    )
    whites = [parity_tests.whitener(SKY.parity, float(laws.prompt_amplitude(CN0_DBHZ, b.sums))) for b in bank]
    delay_ms, onset_ms = np.full(trials, np.nan), _WARM_UP_MS + rng.integers(0, 10, trials)
    running = np.arange(trials)
    states: list[Reals] = [np.zeros((trials, 4)) for _ in bank]
    for start_ms in range(0, _LONGEST_MS, _CHUNK_MS):
        at_ms = start_ms + np.arange(_CHUNK_MS)
        on = (at_ms >= onset_ms[running, None]).astype(int)
        taps = tap_noise(rng, (running.size, _CHUNK_MS, 6)) + means[on]
        first_ms = np.full(running.size, np.inf)
        for i, (branch, white) in enumerate(zip(bank, whites, strict=True)):
            path = parity_tests.run_branch(taps, branch, white, states[i])
            states[i] = path.state
            end_ms = start_ms + branch.sums * (1 + np.arange(path.size.shape[1]))
            alarm = (path.size > branch.threshold) & (end_ms > onset_ms[running, None])
            first_ms = np.minimum(first_ms, np.where(alarm, end_ms, np.inf).min(axis=1))
        found = np.isfinite(first_ms)
        delay_ms[running[found]] = first_ms[found] - onset_ms[running[found]]
        running, states = running[~found], [state[~found] for state in states]
        if running.size == 0:
            break
    return delay_ms


def delay_rows(settings: StudySettings) -> Iterator[Row]:
    """One row for each attack on PRN 2 and method; the block methods at their best block length."""
    bank = parity_tests.cusum_bank(6, _MARGIN / RATE_PER_S)
    lengths = BLOCKS_QUICK if settings.quick else BLOCKS
    tests = {sums: tests_of(sums) for sums in lengths}
    trials = settings.count(2000, 150)
    for stream, (code, doppler) in enumerate(ATTACKS):
        rng = settings.rng(stream)
        offsets = rules.equilibrium(SKY, attack_on(2, size=code), attack_on(2, size=doppler), CN0_DBHZ)
        by_length = {sums: block_delay(rng, offsets, sums, tests[sums], 10 * trials) for sums in lengths}
        on = "code and Doppler" if code and doppler else "code" if code else "Doppler"
        common = {
            "attack": on,
            "code_chips": code,
            "doppler_hz": doppler,
            "cn0_dbhz": CN0_DBHZ,
            "p_fa_per_s": RATE_PER_S,
        }
        papers = np.inf
        for name in next(iter(by_length.values())):
            best = min(Delay(by_length[sums][name], sums) for sums in lengths)
            if name.startswith("paper"):
                papers = min(papers, best.mean_ms)
            yield common | {
                "method": name,
                "k": best.sums,
                "mean_delay_ms": best.mean_ms,
                "p95_delay_ms": None,
                "of_paper": best.mean_ms / papers,
                "trials": 10 * trials,
            }
        delay_ms = bank_delays(rng, offsets, bank, trials)
        mean_ms = float(np.mean(delay_ms)) if np.all(np.isfinite(delay_ms)) else None
        yield common | {
            "method": "bank of cumulative sums",
            "k": None,
            "mean_delay_ms": mean_ms,
            "p95_delay_ms": float(np.nanpercentile(delay_ms, 95)),
            "of_paper": None if mean_ms is None else mean_ms / papers,
            "trials": trials,
        }
