"""Figures and tables of the paper on signal quality monitoring in a vector tracking receiver, and ours beside them.

X. Zhang, H. Li, C. Yang and M. Lu, "Signal quality monitoring-based spoofing detection method for Global Navigation
Satellite System vector tracking structure", IET Radar, Sonar & Navigation, 2020, doi 10.1049/iet-rsn.2020.0021. The sky
is ours (`vector_sky`); where the paper does not state what it drew, the rows say what was taken.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

import numpy as np

from skyproof.detectors.correlators import correlator_laws as law
from skyproof.detectors.correlators import vector_parity as parity
from skyproof.report.chart import Axes
from skyproof.studies import discriminator_laws as laws
from skyproof.studies import vector_parity_tests as parity_tests
from skyproof.studies import vector_rules as rules
from skyproof.studies.base import Claim, Row, Study, StudySettings, value_of
from skyproof.studies.roc import chi_square_power
from skyproof.studies.scenes_protect import judge_scenes
from skyproof.studies.vector_delay import ATTACKS, delay_rows
from skyproof.studies.vector_loops import draw_discriminators, vector_loops
from skyproof.studies.vector_sky import CHIPS, HZ, PRNS, SKY, attack_on, of_prn

__all__ = ["STUDIES"]

PAPER: Final = (
    "Zhang, Li, Yang, Lu, Signal quality monitoring-based spoofing detection method for GNSS vector "
    "tracking structure, IET Radar, Sonar & Navigation, 2020, doi 10.1049/iet-rsn.2020.0021"
)
CASES: Final = ((40, 1), (45, 1), (40, 10))  # C/N0 in dB-Hz and K of Tables 1 to 3
NOBODY: Final = np.zeros(6)
THREE: Final = (12, 13, 17)
METRICS: Final = ("code, chip", "phase, rad")
DENSITIES: Final = ("value", "density", "density_as_printed", "density_simulated")


def _find_settled(prns: Sequence[int], code_chips: float, doppler_hz: float, cn0_dbhz: float) -> rules.Equilibrium:
    return rules.equilibrium(SKY, attack_on(*prns, size=code_chips), attack_on(*prns, size=doppler_hz), cn0_dbhz)


def _number(value: Any) -> float | None:
    """A number, or None where there is none."""
    return float(value) if np.isfinite(value) else None


# Table 1 --------------------------------------------------------------------------------------------------------------


def false_alarm(settings: StudySettings) -> Iterator[Row]:
    """P_FA by formula and counted for a satellite chosen beforehand, and of the rule, which takes the largest."""
    trials = settings.count(1_000_000, 100_000)
    for stream, (cn0_dbhz, k) in enumerate((*CASES, (40, 20))):
        amplitude = float(laws.prompt_amplitude(cn0_dbhz, k))
        u, q = draw_discriminators(settings.rng(stream), trials, amplitude, NOBODY, NOBODY)
        beyond = (np.abs(u) > rules.CODE_LIMIT_CHIPS) | (np.abs(q) > rules.PHASE_LIMIT_RAD)
        yield {
            "cn0_dbhz": cn0_dbhz,
            "k": k,
            "p_fa_theory": float(rules.detection_probability(amplitude)),
            "p_fa_simulated": float(np.mean(beyond)),
            "p_fa_rule": float(np.mean(rules.two_step(u, q).alarm)),
            "trials": trials,
        }


# Figures 3 and 4 ------------------------------------------------------------------------------------------------------


def bias(settings: StudySettings) -> Iterator[Row]:
    """Where the loops settle: PRN 2 with 0.5 chip and 250 Hz. The loops closed beside it at a few C/N0."""
    trials = settings.count(400, 40)
    for cn0_dbhz in range(30, 51):
        settled = _find_settled((2,), 0.5, 250.0, cn0_dbhz)
        simulated = None
        if cn0_dbhz in (40, 45, 50):
            simulated = vector_loops(
                settings.rng(cn0_dbhz), SKY, attack_on(2, size=0.5), attack_on(2, size=250.0), cn0_dbhz, trials=trials
            )
        for i, prn in enumerate(PRNS):
            yield {
                "cn0_dbhz": cn0_dbhz,
                "prn": prn,
                "code_chips": _number(settled.code_chips[i]),
                "phase_rad": _number(settled.phase_rad[i]),
                "code_simulated_chips": None if simulated is None else float(simulated.code_chips[i]),
                "phase_simulated_rad": None if simulated is None else float(simulated.phase_rad[i]),
                "trials": None if simulated is None else trials,
            }


# Figures 10, 11 and 14 ------------------------------------------------------------------------------------------------


def density(settings: StudySettings) -> Iterator[Row]:
    """Densities of eta1 = |code| and eta2 = |phase| of one satellite: computed, counted, and with (17) as printed."""
    trials = settings.count(1_000_000, 100_000)
    cases: list[tuple[str, int, int, float, float]] = [("none", *case, 0.0, 0.0) for case in CASES]
    three = _find_settled(THREE, 0.5, 250.0, 45)
    place = of_prn(20)
    cases += [("PRN 12, 13, 17", 45, k, three.code_chips[place], three.phase_rad[place]) for k in (1, 10)]
    for stream, (attack, cn0_dbhz, k, code, phase) in enumerate(cases):
        amplitude = float(laws.prompt_amplitude(cn0_dbhz, k))
        values = draw_discriminators(settings.rng(stream), trials, amplitude, np.array([code]), np.array([phase]))
        for metric, drawn in zip(METRICS, np.abs(values), strict=True):
            edges = np.linspace(0.0, float(drawn.max()), 51)
            counted = np.histogram(drawn, edges)[0] / (trials * np.diff(edges))
            middles = 0.5 * (edges[1:] + edges[:-1])
            pair = np.stack((middles, -middles))
            if metric == METRICS[0]:
                computed = printed = np.sum(laws.code_density(pair, amplitude, code), axis=0)
            else:
                computed = np.sum(law.phase_density(pair, amplitude, phase, code), axis=0)
                printed = np.sum(law.phase_density(pair, amplitude, phase, code, form="paper"), axis=0)
            for line in zip(middles, computed, printed, counted, strict=True):
                yield {
                    "attack": attack,
                    "cn0_dbhz": cn0_dbhz,
                    "k": k,
                    "metric": metric,
                    **dict(zip(DENSITIES, map(float, line), strict=True)),
                    "trials": trials,
                }


def _mean_of(metric: str, column: str, cn0_dbhz: int, k: int) -> Callable[[Sequence[Row]], float]:
    def mean(rows: Sequence[Row]) -> float:
        some = [r for r in rows if (r["attack"], r["metric"], r["cn0_dbhz"], r["k"]) == ("none", metric, cn0_dbhz, k)]
        weights = np.array([r[column] for r in some])
        return float(np.sum(weights * np.array([r["value"] for r in some])) / np.sum(weights))

    return mean


# Figures 6 and 13 -----------------------------------------------------------------------------------------------------


def parameters(settings: StudySettings) -> Iterator[Row]:
    """The parameter xi of every satellite under two attacks, and how often each has the largest."""
    trials = settings.count(1_000_000, 100_000)
    attacks = [((2,), 40, k) for k in (1, 10, 100)] + [(THREE, 45, k) for k in (1, 10)]
    for stream, (prns, cn0_dbhz, k) in enumerate(attacks):
        settled = _find_settled(prns, 0.5, 250.0, cn0_dbhz)
        amplitude = laws.prompt_amplitude(cn0_dbhz, k)
        xi = rules.parameter(*draw_discriminators(settings.rng(stream), trials, amplitude, *settled))
        largest = np.bincount(np.argmax(xi, axis=-1), minlength=6) / trials
        quiet = rules.parameter(*settled)
        for i, prn in enumerate(PRNS):
            yield {
                "attack": _find_named(prns),
                "cn0_dbhz": cn0_dbhz,
                "k": k,
                "prn": prn,
                "xi_noise_free": float(quiet[i]),
                "xi_mean": float(xi[:, i].mean()),
                "xi_sd": float(xi[:, i].std()),
                "p_largest": float(largest[i]),
                "trials": trials,
            }


def _find_named(prns: Sequence[int]) -> str:
    return "PRN " + ", ".join(map(str, prns))


# Figures 7, 8 and 9 ---------------------------------------------------------------------------------------------------


def cn0_k(settings: StudySettings) -> Iterator[Row]:
    """P_FA and P_D against C/N0, K and the offsets, by formula; `p_fa_rule` is that of the rule with six satellites.

    Figures 7 and 8 do not state their offsets: 0.2 chip and 0.1 pi are taken.
    """
    cases: list[tuple[str, int, int, float, float]] = []
    cases += [("7", cn0_dbhz, k, 0.2, 0.1) for k in (1, 10) for cn0_dbhz in range(30, 51)]
    cases += [("8", 40, k, 0.2, 0.1) for k in range(1, 21)]
    cases += [("9", 40, 10, i * 0.05, j * 0.025) for j in range(5) for i in range(5)]
    whole: dict[float, float] = {}
    for figure, cn0_dbhz, k, code, turn in cases:
        amplitude = float(laws.prompt_amplitude(cn0_dbhz, k))
        if amplitude not in whole:
            whole[amplitude] = rules.rule_alarm_probability(amplitude, NOBODY, NOBODY)
        yield {
            "figure": figure,
            "cn0_dbhz": cn0_dbhz,
            "k": k,
            "code_chips": code,
            "phase_pi": turn,
            "p_fa": float(rules.detection_probability(amplitude)),
            "p_d": float(rules.detection_probability(amplitude, code, np.pi * turn)),
            "p_fa_rule": whole[amplitude],
        }


# Figure 12 ------------------------------------------------------------------------------------------------------------


def one_spoofer(settings: StudySettings) -> Iterator[Row]:
    """One satellite attacked with more and more, 45 dB-Hz, K = 1, by formula; the paper gives no range of sizes.

    `p_d` belongs to the attacked satellite, `p_d_largest` to the one with the largest noise-free parameter, `p_d_rule`
    to the rule, `p_fa_rule` its false alarms; `p_d_parity` of the parity test at the false-alarm probability `p_fa`.
    """
    cn0_dbhz, k = 45, 1
    amplitude = float(laws.prompt_amplitude(cn0_dbhz, k))
    p_fa = float(rules.detection_probability(amplitude))
    p_fa_rule = rules.rule_alarm_probability(amplitude, NOBODY, NOBODY)
    white = parity_tests.whitener(SKY.parity, amplitude)
    steps = np.linspace(0.0, 1.25, 6 if settings.quick else 26)
    for kind, (code, doppler) in {"code": (CHIPS, 0.0), "Doppler": (0.0, HZ), "both": (CHIPS, HZ)}.items():
        for i, prn in enumerate(PRNS):
            for step in steps:
                settled = _find_settled((prn,), step * code, step * doppler, cn0_dbhz)
                tested = int(np.argmax(rules.parameter(*settled)))
                p_d = rules.detection_probability(amplitude, *settled)
                u = white.code @ laws.code_mean(amplitude, settled.code_chips)
                q = white.phase @ laws.phase_mean(amplitude, settled.phase_rad, settled.code_chips)
                yield {
                    "attack": kind,
                    "prn": prn,
                    "code_chips": float(step * code),
                    "doppler_hz": float(step * doppler),
                    "cn0_dbhz": cn0_dbhz,
                    "k": k,
                    "p_fa": p_fa,
                    "p_d": float(p_d[i]),
                    "tested_prn": PRNS[tested],
                    "p_d_largest": float(p_d[tested]),
                    "p_fa_rule": p_fa_rule,
                    "p_d_rule": rules.rule_alarm_probability(amplitude, *settled),
                    "p_d_parity": float(chi_square_power(p_fa, 4, u @ u + q @ q)),
                }


# Tables 2 and 3 -------------------------------------------------------------------------------------------------------


def many(settings: StudySettings) -> Iterator[Row]:
    """Table 2 (PRN 2 attacked alone, 0.4 chip and 200 Hz) and the attack of Table 3 on three satellites at once.

    `p_d_theory` and `p_d_simulated` belong to `tested_prn`, `p_d_rule` to the whole rule. `p_d_parity` belongs to the
    parity test at the false-alarm probability `p_fa` of the paper's Table 1, counted.
    """
    trials = settings.count(1_000_000, 100_000)
    cases = [((2,), CHIPS, HZ, 2, *case) for case in CASES] + [(THREE, 0.5, 250.0, 20, 45, k) for k in (1, 10)]
    for stream, (prns, code, doppler, tested, cn0_dbhz, k) in enumerate(cases):
        settled, i = _find_settled(prns, code, doppler, cn0_dbhz), of_prn(tested)
        amplitude = float(laws.prompt_amplitude(cn0_dbhz, k))
        p_fa = float(rules.detection_probability(amplitude))
        u, q = draw_discriminators(settings.rng(stream), trials, amplitude, *settled)
        beyond = (np.abs(u) > rules.CODE_LIMIT_CHIPS) | (np.abs(q) > rules.PHASE_LIMIT_RAD)
        y = parity.parity_vector(u, q, parity_tests.whitener(SKY.parity, amplitude))
        shift, turn = rules.linear_shift(SKY, attack_on(*prns, size=code), attack_on(*prns, size=doppler))
        yield {
            "attack": _find_named(prns),
            "code_chips": code,
            "doppler_hz": doppler,
            "cn0_dbhz": cn0_dbhz,
            "k": k,
            "tested_prn": tested,
            "p_fa": p_fa,
            "p_d_theory": float(rules.detection_probability(amplitude, settled.code_chips[i], settled.phase_rad[i])),
            "p_d_linear": float(rules.detection_probability(amplitude, shift[i], turn[i])),
            "p_d_simulated": float(np.mean(beyond[:, i])),
            "p_d_rule": float(np.mean(rules.two_step(u, q).alarm)),
            "p_d_parity": float(np.mean(parity.parity_test(y).p_value < p_fa)),
            "trials": trials,
        }


# What is promised -----------------------------------------------------------------------------------------------------

_TABLE_1 = ((40, 1, 0.7264, 0.7265, 0.9985), (45, 1, 0.4076, 0.4077, 0.9185), (40, 10, 0.0719, 0.0721, 0.316))
_TABLE_2 = ((40, 1, 0.9101, 0.9107), (45, 1, 0.9550, 0.9546), (40, 10, 0.9949, 0.9951))
_NOT_STATED = "offsets not stated"
_PICTURE = "picture"


def _delay_claim(code: float, doppler: float) -> Claim:
    def of(method: str, column: str) -> Callable[[Sequence[Row]], float]:
        return value_of(column, code_chips=code, doppler_hz=doppler, method=method)

    def paper(rows: Sequence[Row]) -> float:
        return min(of(f"paper, limits {kind}", "mean_delay_ms")(rows) for kind in ("scaled", "balanced"))

    return Claim(
        what="mean delay, ms",
        across=f"{code:g} chip, {doppler:g} Hz",
        paper="no delays",
        same=paper,
        better=of("bank of cumulative sums", "mean_delay_ms"),
        digits=3,
    )


_CELLS: Final = tuple(
    (scene, equipment)
    for scene in ("vector-one-spoofer", "vector-many")
    for equipment in ("one receiver", "vector tracking")
)


def _protect(settings: StudySettings) -> Iterator[Row]:
    """Yield what `protect` names in the paper's scenes, 30 s of them."""
    return judge_scenes(settings, _CELLS[1:2] if settings.quick else _CELLS, 30.0)


STUDIES: tuple[Study, ...] = (
    Study(
        name="vector-sqm.false-alarm",
        title="False alarms of the rule",
        paper=PAPER,
        figure="Table 1",
        run=false_alarm,
        claims=tuple(
            Claim(
                what=f"P_FA, {cn0} dB-Hz, K = {k}",
                paper=paper,
                reference=reference,
                tolerance=0.0005,
                same=value_of("p_fa_theory", cn0_dbhz=cn0, k=k),
            )
            for cn0, k, paper, reference, _ in _TABLE_1
        )
        + tuple(
            Claim(
                what=f"P_FA of the whole rule, {cn0} dB-Hz, K = {k}",
                paper="selection ignored",
                reference=reference,
                same=value_of("p_fa_rule", cn0_dbhz=cn0, k=k),
                tolerance=0.003,
            )
            for cn0, k, _, _, reference in _TABLE_1
        ),
    ),
    Study(
        name="vector-sqm.bias",
        title="Where the loops settle",
        paper=PAPER,
        figure="Figures 3 and 4",
        run=bias,
        charts=(
            Axes(
                title="Code offset, PRN 2 attacked with 0.5 chip, 250 Hz",
                x="cn0_dbhz",
                y="code_chips",
                x_label="C/N0, dB-Hz",
                y_label="code offset, chip",
                by=("prn",),
            ),
            Axes(
                title="Phase offset, PRN 2 attacked with 0.5 chip, 250 Hz",
                x="cn0_dbhz",
                y="phase_rad",
                x_label="C/N0, dB-Hz",
                y_label="phase offset, rad",
                by=("prn",),
            ),
        ),
        claims=(
            Claim(
                what="code offset of PRN 2 at 40 dB-Hz, chip",
                paper=_PICTURE,
                reference=0.2271,
                tolerance=1e-4,
                same=value_of("code_chips", cn0_dbhz=40, prn=2),
            ),
            Claim(
                what="the same with the loops closed",
                paper=_PICTURE,
                reference=0.2271,
                tolerance=0.002,
                same=value_of("code_simulated_chips", cn0_dbhz=40, prn=2),
            ),
            Claim(
                what="phase offset of PRN 2 at 40 dB-Hz, rad",
                paper=_PICTURE,
                reference=0.1118 * np.pi,
                tolerance=2e-4,
                same=value_of("phase_rad", cn0_dbhz=40, prn=2),
            ),
            Claim(
                what="the same with the loops closed",
                paper=_PICTURE,
                reference=0.1118 * np.pi,
                tolerance=0.003,
                same=value_of("phase_simulated_rad", cn0_dbhz=40, prn=2),
            ),
        ),
    ),
    Study(
        name="vector-sqm.density",
        title="Densities of the metrics",
        paper=PAPER,
        figure="Figures 10, 11 and 14",
        run=density,
        charts=tuple(
            Axes(
                title=f"Density without an attack: {metric}",
                x="value",
                y="density",
                x_label=metric,
                y_label="density",
                by=("cn0_dbhz", "k"),
                where={"metric": metric, "attack": "none"},
            )
            for metric in METRICS
        ),
        claims=tuple(
            Claim(
                what=f"mean of {metric}",
                across=f"{cn0} dB-Hz, K = {k}",
                paper=_PICTURE,
                reference=reference,
                tolerance=0.001,
                same=_mean_of(metric, "density", cn0, k),
            )
            for metric, means in zip(METRICS, ((0.1135, 0.0696, 0.0397), (0.1817, 0.1009, 0.0565)), strict=True)
            for (cn0, k), reference in zip(CASES, means, strict=True)
        ),
    ),
    Study(
        name="vector-sqm.parameters",
        title="The parameter of every satellite",
        paper=PAPER,
        figure="Figures 6 and 13",
        run=parameters,
        charts=(
            Axes(
                title="How often each satellite has the largest parameter",
                x="prn",
                y="p_largest",
                x_label="PRN",
                y_label="probability",
                by=("attack", "k"),
            ),
        ),
        claims=tuple(
            Claim(
                what="PRN 2 has the largest parameter, 40 dB-Hz",
                across=f"K = {k}",
                paper=_PICTURE,
                reference=reference,
                same=value_of("p_largest", attack="PRN 2", k=k, prn=2),
                tolerance=0.01,
                digits=3,
            )
            for k, reference in ((1, 0.39), (10, 0.75), (100, 0.998))
        ),
    ),
    Study(
        name="vector-sqm.cn0-k",
        title="Against C/N0, K and the offsets",
        paper=PAPER,
        figure="Figures 7, 8 and 9",
        run=cn0_k,
        charts=(
            Axes(
                title="P_D against C/N0",
                x="cn0_dbhz",
                y="p_d",
                x_label="C/N0, dB-Hz",
                y_label="detection probability",
                by=("k",),
                where={"figure": "7"},
            ),
            Axes(
                title="False alarms against C/N0",
                x="cn0_dbhz",
                y="p_fa",
                x_label="C/N0, dB-Hz",
                y_label="false-alarm probability",
                by=("k",),
                where={"figure": "7"},
            ),
            Axes(
                title="Detection against K, 40 dB-Hz",
                x="k",
                y="p_d",
                x_label="K",
                y_label="detection probability",
                where={"figure": "8"},
            ),
            Axes(
                title="P_D against the offsets, 40 dB-Hz, K = 10",
                x="code_chips",
                y="p_d",
                x_label="code offset, chip",
                y_label="detection probability",
                by=("phase_pi",),
                where={"figure": "9"},
            ),
        ),
        claims=(
            Claim(
                what="P_D, 0.2 chip and 0.1 pi, 30 dB-Hz, K = 1",
                paper=_NOT_STATED,
                reference=0.9453,
                same=value_of("p_d", figure="7", cn0_dbhz=30, k=1),
                tolerance=1e-4,
            ),
            Claim(
                what="the same at 40 dB-Hz",
                paper=_NOT_STATED,
                reference=0.9286,
                same=value_of("p_d", figure="7", cn0_dbhz=40, k=1),
                tolerance=1e-4,
            ),
            Claim(
                what="P_D, 0.2 chip and 0.1 pi, 40 dB-Hz, K = 5",
                paper=_NOT_STATED,
                reference=0.9900,
                same=value_of("p_d", figure="8", k=5),
                tolerance=1e-4,
            ),
            Claim(
                what="P_D, 0.1 chip and 0.05 pi, 40 dB-Hz, K = 10",
                paper=_PICTURE,
                reference=0.7418,
                same=value_of("p_d", figure="9", code_chips=0.1, phase_pi=0.05),
                tolerance=1e-4,
            ),
        ),
    ),
    Study(
        name="vector-sqm.one-spoofer",
        title="One satellite attacked",
        paper=PAPER,
        figure="Figure 12",
        note=f"{CHIPS:g} chip and {HZ:g} Hz on PRN 2, 45 dB-Hz, K = 1. *Better* is the parity test at the same P_FA.",
        run=one_spoofer,
        charts=tuple(
            Axes(
                title=f"P_D of the attacked satellite, 45 dB-Hz, K = 1: {kind}",
                x=x,
                y="p_d",
                x_label=label,
                y_label="detection probability",
                by=("prn",),
                where={"attack": kind},
            )
            for kind, x, label in (
                ("code", "code_chips", "code, chip"),
                ("Doppler", "doppler_hz", "Doppler, Hz"),
                ("both", "code_chips", "code, chip (and 500 Hz a chip)"),
            )
        ),
        claims=tuple(
            Claim(
                what="P_D",
                across=f"PRN {prn}",
                paper=_PICTURE,
                reference=reference,
                tolerance=1e-4,
                same=value_of("p_d", attack="both", prn=prn, code_chips=CHIPS),
                better=value_of("p_d_parity", attack="both", prn=prn, code_chips=CHIPS),
            )
            for prn, reference in zip(PRNS, (0.9546, 0.7908, 0.4650, 0.8164, 0.9908, 0.8568), strict=True)
        ),
    ),
    Study(
        name="vector-sqm.many",
        title="One and three satellites attacked",
        paper=PAPER,
        figure="Tables 2 and 3, Figure 13",
        note="PRN 2 is attacked with 0.4 chip and 200 Hz. *Better* is the parity test at the same P_FA.",
        run=many,
        claims=tuple(
            Claim(
                what=f"P_D of PRN 2, {cn0} dB-Hz, K = {k}",
                paper=paper,
                reference=reference,
                tolerance=0.002,
                same=value_of("p_d_theory", attack="PRN 2", cn0_dbhz=cn0, k=k),
                better=value_of("p_d_parity", attack="PRN 2", cn0_dbhz=cn0, k=k),
            )
            for cn0, k, paper, reference in _TABLE_2
        )
        + (
            Claim(
                what="P_D of PRN 20, which is authentic, PRN 12, 13, 17 attacked, 45 dB-Hz, K = 1",
                paper=_PICTURE,
                reference=0.9855,
                same=value_of("p_d_theory", attack="PRN 12, 13, 17", k=1),
                tolerance=1e-4,
            ),
        ),
    ),
    Study(
        name="vector-sqm.delay",
        title="Time to detection at equal false alarms",
        paper=PAPER,
        figure="none",
        note="PRN 2 attacked, 0.001 false alarms a second.",
        run=delay_rows,
        charts=(
            Axes(
                title="Mean delay, PRN 2 attacked with code and 500 Hz a chip",
                x="code_chips",
                y="mean_delay_ms",
                x_label="code, chip",
                y_label="mean delay, ms",
                by=("method",),
                where={"attack": "code and Doppler"},
                x_log=True,
                y_log=True,
            ),
        ),
        claims=tuple(_delay_claim(*attack) for attack in ATTACKS),
    ),
    Study(
        name="vector-sqm.protect",
        title="Attacked satellites that `protect` names",
        paper=PAPER,
        figure="Tables 2 and 3, Figure 13",
        note="The paper: P_D of one look of 1 ms at P_FA of 0.73 to 0.41 (table 1), PRN 2 alone and PRN 20, which is "
        "true, beside three. Through protect: 30 s behind drawn correlators, four draws, 1e-3 false words an hour.",
        run=_protect,
        claims=tuple(
            Claim(
                what=what,
                across=f"{scene.removeprefix('vector-')}, {equipment}",
                paper=papers[scene == "vector-many"],
                protect=value_of(column, scene=scene, equipment=equipment),
            )
            for what, column, papers in (
                ("attacked satellites named, share", "named_share", (0.9101, "picture")),
                ("true satellites named, mean", "true_named", ("picture", 0.9855)),
                ("first word after the first sample, s", "delay_s", ("none", "none")),
            )
            for scene, equipment in _CELLS
        ),
    ),
)
