"""The fourth paper's figures 3, 4, 5 and 12 and its tables 2 and 3 through the whole receiver, samples to correlators.

`python bench/vector_figures.py table3` and so on for a part: `bias`, `scalar`, `sizes`, `table3`, `alike`. Six
satellites under the sky of `studies/vector_sky.py`, 5 Msps, correlators of each millisecond once loops have settled.
`alike` is nearer to the paper's receiver: its solution weighs all ranges alike, ours each by its delays on the way.
"""

import sys
from collections.abc import Iterator, Mapping

import numpy as np
from vector import EVERY_MS, _in_memory, _tracked

from skyproof.app.receive.reception import observe
from skyproof.arrays import Complexes, Reals
from skyproof.detectors.correlators.correlator_laws import phase_discriminator
from skyproof.detectors.correlators.vector_sqm_detector import select_pair
from skyproof.navigation.vector_filter import VectorSettings
from skyproof.simulator import scenes
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import FrontEnd
from skyproof.studies.discriminator_laws import code_discriminator, combine_taps, prompt_amplitude
from skyproof.studies.vector_rules import Equilibrium, detection_probability, equilibrium
from skyproof.studies.vector_sky import PRNS, SKY, attack_on

LENGTH_S, SETTLED_S, RATE_HZ, CHIP_M = 15.0, 10.0, 5e6, 293.0523
SATS = tuple(f"G{prn:02d}" for prn in PRNS)
LEVELS_DBHZ = (35.0, 40.0, 45.0, 50.0)
WEAK_DBHZ, WEAK_S = 36.0, 24.0
"""Weaker signals are found later, and settle so much later."""
T1, T2 = 0.1, 0.05 * np.pi
ALIKE = VectorSettings(range_sigma_m=15.0, rate_sigma_m_s=0.3, misfit_probability=0.01)
"""Beside which what a range's delays are known to makes little difference; and a misfit is seen nevertheless."""
Attack = Mapping[int, tuple[float, float]]
"""Chips and hertz by PRN."""


def report(parts: tuple[str, ...] = ("bias", "scalar", "table3", "sizes", "alike")) -> Iterator[str]:
    """Rows of the table."""
    for part in parts:
        yield from PARTS[part]()


def _correlators(
    attack: Attack, level_dbhz: float, tracking: str = "vector", filter_settings: VectorSettings | None = None
) -> Complexes:
    """(looks, 6, 3) early, prompt, late of every millisecond; NaN where a channel is not guided, or not there."""
    scene = scenes.read_ready_made("vector-one-spoofer")
    true = tuple(sat for sat, prn in zip(SATS, PRNS, strict=True) if prn not in attack)
    sky = scene.sky.model_copy(update={"sats": true, "zenith_cn0_dbhz": level_dbhz, "horizon_cn0_dbhz": level_dbhz})
    false = scene.attacks[0].model_copy(
        update={
            "sats": tuple(f"G{prn:02d}" for prn in attack),
            "sat_code_m": {f"G{prn:02d}": CHIP_M * chips for prn, (chips, _) in attack.items()},
            "sat_doppler_hz": {f"G{prn:02d}": hz for prn, (_, hz) in attack.items()},
        }
    )
    front_end = FrontEnd(rate_hz=RATE_HZ, bandwidth_hz=0.96 * RATE_HZ, encoding="int", bits=8)
    later_s = WEAK_S if level_dbhz < WEAK_DBHZ else 0.0
    changes = {
        "sky": sky,
        "attacks": (false,) if attack else (),
        "duration_s": LENGTH_S + later_s,
        "front_end": front_end,
    }
    scene = scene.model_copy(update=changes)
    navigation = make_navigation(scene)
    samples = render_samples(scene, navigation)[0]
    held = _in_memory(samples, samples.read(0, samples.n_samples))
    tracker, _ = _tracked(held, navigation, tracking, EVERY_MS, filter_settings=filter_settings)
    reception = observe(tracker, navigation)
    taken = reception.taps if tracking == "scalar" else reception.vector_taps
    assert taken is not None
    taps = taken.select_between(SETTLED_S + later_s, LENGTH_S + later_s)
    pair = select_pair(taps)
    assert pair is not None
    value = np.full((len(taps.elapsed_s), 6, 3), np.nan, np.complex128)
    for k, signal in enumerate(taps.signals):
        if signal.sat in SATS and signal.copy == "a":
            value[:, SATS.index(signal.sat)] = taps.value[:, k, 0][..., list(pair[1:])]
    return value


def _offsets(value: Complexes) -> tuple[Reals, Reals]:
    """Code in chips, received later than the replica as the paper counts, and phase, of each look and channel."""
    late_chips = -code_discriminator(value[..., 0], value[..., 2])
    return late_chips, phase_discriminator(value[..., 1])


def _mean(value: Complexes) -> tuple[Reals, Reals]:
    """(6,) offsets of the sums over 20 ms, where noise does not bend the discriminators."""
    blocks = value[: len(value) // 20 * 20].reshape(-1, 20, *value.shape[1:])
    found = _offsets(combine_taps(blocks, axis=1))
    return _mean_seen(found[0]), _mean_seen(found[1])


def _mean_seen(values: Reals) -> Reals:
    """(6,) over the windows in which each channel was there; NaN of one that never was."""
    seen = np.isfinite(values)
    return np.asarray(np.sum(values, axis=0, where=seen) / np.where(seen.any(axis=0), seen.sum(axis=0), np.nan))


def _settled(attack: Attack, level_dbhz: float) -> Equilibrium:
    code, doppler = (sum(attack_on(prn, size=one[i]) for prn, one in attack.items()) for i in (0, 1))
    return equilibrium(SKY, np.asarray(code), np.asarray(doppler), level_dbhz)


def _numbers(values: Reals) -> str:
    return " ".join(f"{one:7.3f}" for one in values)


def _bias() -> Iterator[str]:
    yield f"G02 false (figures 3, 4): offsets of {' '.join(SATS)}, and theory; the paper's size, and a smaller one"
    for attack in ({2: (0.5, 250.0)}, {2: (0.3, 150.0)}):
        for level in LEVELS_DBHZ:
            code, phase = _mean(_correlators(attack, level))
            theory, name = _settled(attack, level), f"{attack[2][0]:g} chip, {attack[2][1]:g} Hz, {level:g} dB-Hz"
            yield f"  {name}, chips: {_numbers(code)}   theory {_numbers(theory.code_chips)}"
            yield f"  {name}, rad:   {_numbers(phase)}   theory {_numbers(theory.phase_rad)}"


def _scalar() -> Iterator[str]:
    yield "the same, scalar tracking (figure 5): offsets of code, chips"
    for level in (35.0, 45.0):
        yield f"  {level:g} dB-Hz: {_numbers(_mean(_correlators({2: (0.5, 250.0)}, level, 'scalar'))[0])}"


def _rates(value: Complexes, column: int, sums: int) -> float:
    """Share of windows of so many ms in which one satellite is beyond the paper's thresholds."""
    one = value[:, column]
    one = one[np.isfinite(one).all(axis=1)]
    blocks = one[: len(one) // sums * sums].reshape(-1, sums, 3)
    code, phase = _offsets(combine_taps(blocks, axis=1))
    return float(np.mean((np.abs(code) > T1) | (np.abs(phase) > T2))) if len(blocks) else float("nan")


def _table3() -> Iterator[str]:
    yield "table 3 (G12, G13, G17: 0.5 chip, 250 Hz, 45 dB-Hz), tested on G20; table 2 (G02: 0.4 chip, 200 Hz), on G02"
    for attack, level, tested, cells in (
        ({prn: (0.5, 250.0) for prn in (12, 13, 17)}, 45.0, 20, (1, 10)),
        ({2: (0.4, 200.0)}, 40.0, 2, (1, 10)),
        ({2: (0.4, 200.0)}, 45.0, 2, (1,)),
    ):
        value, theory, column = _correlators(attack, level), _settled(attack, level), PRNS.index(tested)
        code, phase = _mean(value)
        yield f"  {level:g} dB-Hz, chips: {_numbers(code)}   theory {_numbers(theory.code_chips)}"
        yield f"  {level:g} dB-Hz, rad:   {_numbers(phase)}   theory {_numbers(theory.phase_rad)}"
        for sums in cells:
            expected = detection_probability(
                prompt_amplitude(level, sums), theory.code_chips[column], theory.phase_rad[column]
            )
            counted = _rates(value, column, sums)
            yield f"  {level:g} dB-Hz, K = {sums}: beyond thresholds {counted:.4f}, theory {float(expected):.4f}"


def _sizes() -> Iterator[str]:
    yield "figure 12: 45 dB-Hz, K = 1, one satellite of six: 0.4 chip, 200 Hz, both; detected on it, and theory"
    for prn in PRNS:
        cells = []
        for chips, hz in ((0.4, 0.0), (0.0, 200.0), (0.4, 200.0)):
            attack, column = {prn: (chips, hz)}, PRNS.index(prn)
            theory = _settled(attack, 45.0)
            expected = detection_probability(
                prompt_amplitude(45.0, 1), theory.code_chips[column], theory.phase_rad[column]
            )
            cells.append(f"{_rates(_correlators(attack, 45.0), column, 1):.3f} ({float(expected):.3f})")
        yield f"  G{prn:02d}: {', '.join(cells)}"


def _alike() -> Iterator[str]:
    yield "all ranges weighed alike, as the paper has it: figures 3 and 4, table 3"
    for attack, level in (
        ({2: (0.4, 0.0)}, 45.0),
        ({2: (0.5, 250.0)}, 40.0),
        ({2: (0.5, 250.0)}, 45.0),
        ({prn: (0.5, 250.0) for prn in (12, 13, 17)}, 45.0),
    ):
        code, phase = _mean(_correlators(attack, level, filter_settings=ALIKE))
        theory = _settled(attack, level)
        name = f"{' '.join(f'G{prn:02d}' for prn in attack)}, {next(iter(attack.values()))}, {level:g} dB-Hz"
        yield f"  {name}, chips: {_numbers(code)}   theory {_numbers(theory.code_chips)}"
        yield f"  {name}, rad:   {_numbers(phase)}   theory {_numbers(theory.phase_rad)}"


PARTS = {"bias": _bias, "scalar": _scalar, "sizes": _sizes, "table3": _table3, "alike": _alike}

if __name__ == "__main__":
    for text in report(*filter(None, [tuple(sys.argv[1:])])):
        print(text, flush=True)
