"""Figures and tables of the paper on one spinning antenna, and ours beside them.

Zhang, Chen, Huang, Zhang and Ou, "Spoofing Detection Technique Based on Carrier Phase Double Difference of
Spin-Antenna", 2016, in Chinese, doi 10.13203/j.whugis20140360. Its settings:
radius 0.5 wavelengths, a turn in 4 s, 10 samples a second, 0.01 cycles of noise.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.array.arm_phases import arm_columns, fit_whole_series
from skyproof.report.chart import Axes
from skyproof.statistics.directions import direction_cosines
from skyproof.statistics.distributions import chi_square_threshold, noncentral_chi_square_survival
from skyproof.studies.antennas_protect import count_named_by_arm
from skyproof.studies.arm_angles import (
    arm_angles,
    authentic_threshold,
    circular_threshold,
    detection_power,
    fit_pairs,
    full_information,
    pair_information,
)
from skyproof.studies.base import Claim, Row, Study, StudySettings, value_of
from skyproof.studies.direction_tests import DirectionBlocks, blocks, measure_dead_zone

__all__ = ["STUDIES"]

PAPER: Final = (
    "Zhang, Chen, Huang, Zhang, Ou, Spoofing detection technique based on carrier phase double difference "
    "of spin-antenna, 2016"
)
RATE: Final = 0.05 * np.pi  # radians a sample
RADIUS_CYC: Final = 0.5
SIGMA_CYC: Final = 0.01
OF_PAIR: Final = {"radius_cyc": RADIUS_CYC, "sigma_cyc": SIGMA_CYC * np.sqrt(2.0)}
P_FA: Final = 0.01
CHUNK: Final = 50_000

Degrees = tuple[float, float]


def _level(pair_deg: Degrees) -> Reals:
    return direction_cosines(*np.radians(pair_deg))[:2]


def _information(test: str, n: int) -> Reals:
    """Of a pair's difference, by the paper's differences or by the whole series less a quadratic."""
    angle = arm_angles(n, RATE)
    return pair_information(angle, **OF_PAIR) if test == "paper" else full_information(angle, **OF_PAIR)


def _noncentrality(test: str, n: int, one: Degrees, other: Degrees) -> float:
    apart = _level(one) - _level(other)
    return float(apart @ _information(test, n) @ apart)


# Receiver operating characteristics -----------------------------------------------------------------------------------


def roc(settings: StudySettings) -> Iterator[Row]:
    """P_D of the pair (155, 50), (160, 55) in the paper's sense: false alarm, an authentic pair at known directions
    taken for spoofed; detection, a pair of one direction so taken. Tests: `paper`; `full`: the whole series."""
    for test in ("paper", "full"):
        for n in (40, 50, 100, 150, 200, 250, 300):
            far = _noncentrality(test, n, (155.0, 50.0), (160.0, 55.0))
            for p_fa in np.round(10.0 ** np.linspace(-4.0, 0.0, 41)[:-1], 10):
                limit = float(authentic_threshold(p_fa, far))
                yield {
                    "test": test,
                    "n": n,
                    "noncentrality": far,
                    "p_fa": float(p_fa),
                    "threshold": limit,
                    "p_d": float(detection_power(limit)),
                }


# Dead zones -----------------------------------------------------------------------------------------------------------

REFERENCES: Final = ((40.0, 35.0), (160.0, 20.0), (240.0, 55.0), (320.0, 70.0))
TABLE_1: Final = {150: (278, 389, 266, 398), 200: (201, 318, 194, 296)}
FULL: Final = {150: (8, 10, 8, 12), 200: (4, 8, 4, 8)}


def _count_missed(test: str, n: int, grid: DirectionBlocks, *, share: bool) -> Reals:
    """Blocks, or share of the hemisphere, with P_D < 0.99 about each reference; the same in the paper's sense and in
    the usual one."""
    covariance = np.asarray(np.linalg.inv(_information(test, n)), np.float64)
    reference = direction_cosines(*np.radians(np.array(REFERENCES).T))
    return measure_dead_zone(reference, grid.direction, np.eye(3)[:2], covariance, weight=grid.share if share else 1.0)


def dead_zones(settings: StudySettings) -> Iterator[Row]:
    """Table 1: the reference as given, the other signal in the middle of blocks of one degree."""
    grid = blocks(1.0)
    for n in (40, 50, 150, 200):
        for test in ("paper", "full"):
            for (az_deg, el_deg), count in zip(REFERENCES, _count_missed(test, n, grid, share=False), strict=True):
                yield {"test": test, "reference": f"({az_deg:g}, {el_deg:g})", "n": n, "blocks": int(count)}


def solid_angle(settings: StudySettings) -> Iterator[Row]:
    """The same as shares of the hemisphere: blocks near the zenith are small."""
    grid = blocks(0.25 if settings.quick else 0.2)
    for n in (40, 50, 150, 200):
        for test in ("paper", "full"):
            for (az_deg, el_deg), share in zip(REFERENCES, _count_missed(test, n, grid, share=True), strict=True):
                yield {"test": test, "reference": f"({az_deg:g}, {el_deg:g})", "n": n, "share": float(share)}


# The scenario of section 5 --------------------------------------------------------------------------------------------

SCENARIO: Final = (("[3,1]", (148.0, 50.0)), ("[4,1]", (158.0, 53.0)), ("[2,1]", (160.0, 55.0)))
SPOOFER: Final = (160.0, 55.0)


def scenario(settings: StudySettings) -> Iterator[Row]:
    """Signal 1 against each of the others, N = 150: threshold for an authentic pair of these directions at P_FA 0.01,
    and the detection of a pair of one direction, by formula and counted. `authentic_p_fa_simulated` counts the
    pairs themselves below the threshold."""
    n, rng = 150, settings.rng()
    trials = settings.count(50_000, 20_000)
    columns = arm_columns(arm_angles(n, RATE), RADIUS_CYC)
    for pair, other in SCENARIO:
        for test, fit in (("paper", fit_pairs), ("full", fit_whole_series)):
            far = _noncentrality(test, n, other, SPOOFER)
            limit = float(authentic_threshold(P_FA, far))
            spin = columns @ (_level(other) - _level(SPOOFER))
            same = apart = 0
            for start in range(0, trials, CHUNK):
                noise = OF_PAIR["sigma_cyc"] * rng.standard_normal((min(CHUNK, trials - start), n))
                same += int(np.sum(fit(noise, arm_angles(n, RATE), **OF_PAIR).statistic < limit))
                apart += int(np.sum(fit(noise + spin, arm_angles(n, RATE), **OF_PAIR).statistic < limit))
            yield {
                "pair": pair,
                "test": test,
                "n": n,
                "noncentrality": far,
                "threshold": limit,
                "p_d_theory": float(detection_power(limit)),
                "p_d_simulated": same / trials,
                "authentic_p_fa_simulated": apart / trials,
            }


# How much data; the rule with its own estimate ------------------------------------------------------------------------


def samples(settings: StudySettings) -> Iterator[Row]:
    """Detection of the pair (155, 50), (160, 55) against the number of samples, in both senses, P_FA 0.01."""
    usual = float(chi_square_threshold(P_FA, 2))
    for test in ("paper", "full"):
        for n in range(20, 401):
            far = _noncentrality(test, n, (155.0, 50.0), (160.0, 55.0))
            yield {
                "test": test,
                "n": n,
                "noncentrality": far,
                "p_d": float(detection_power(authentic_threshold(P_FA, far))),
                "p_d_usual": float(noncentral_chi_square_survival(usual, 2, far)),
            }


def circular(settings: StudySettings) -> Iterator[Row]:
    """The paper's rule with the noncentrality estimated from the same phases: what it comes to, and the count."""
    n, trials = 150, settings.count(50_000, 20_000)
    for p_fa in (0.001, 0.01, 0.1):
        rng, below = settings.rng(), 0
        for start in range(0, trials, CHUNK):
            noise = OF_PAIR["sigma_cyc"] * rng.standard_normal((min(CHUNK, trials - start), n))
            statistic = fit_pairs(noise, arm_angles(n, RATE), **OF_PAIR).statistic
            below += int(np.sum(statistic < authentic_threshold(p_fa, statistic)))
        limit = circular_threshold(p_fa)
        yield {
            "p_fa": p_fa,
            "threshold": limit,
            "p_d_theory": float(detection_power(limit)),
            "p_d_simulated": below / trials,
        }


# Through protect ------------------------------------------------------------------------------------------------------

_NAMED_AT: Final = (40, 50, 150, 300)


def _protect(settings: StudySettings) -> Iterator[Row]:
    """Yield how often `protect` names both false signals of section 5 beside seven true ones, and a true one."""
    runs = settings.count(40, 1)
    for n in _NAMED_AT:
        for sat, share in count_named_by_arm("spin", n, runs, settings.rng(n)).items():
            yield {"n": n, "sat": sat, "named_share": share, "runs": runs}


def _first(column: str, test: str) -> Callable[[Sequence[Row]], float]:
    """The smallest number of samples from which on the detection stays at 0.9999 or more."""

    def value(rows: Sequence[Row]) -> float:
        short = [row["n"] for row in rows if row["test"] == test and row[column] < 0.9999]
        return float(max(short) + 1)

    return value


def _at(n: int, p_fa: float, test: str) -> Callable[[Sequence[Row]], float]:
    return lambda rows: float(
        next(r["p_d"] for r in rows if r["n"] == n and r["test"] == test and abs(r["p_fa"] / p_fa - 1.0) < 1e-9)
    )


_TABLE: Final = tuple(
    (n, f"({az:g}, {el:g})", paper, right)
    for n in (150, 200)
    for (az, el), paper, right in zip(
        REFERENCES, TABLE_1[n], {150: (279, 389, 266, 398), 200: (202, 318, 194, 296)}[n], strict=True
    )
)

STUDIES = (
    Study(
        name="spin.roc",
        title="Receiver operating characteristics of one pair",
        paper=PAPER,
        figure="Figure 3",
        run=roc,
        charts=tuple(
            Axes(
                title=title,
                x="p_fa",
                y="p_d",
                x_label="false-alarm probability",
                y_label="detection probability",
                by=("n",),
                where={"test": test},
                x_log=True,
            )
            for test, title in (("paper", "The paper's differences"), ("full", "The whole series"))
        ),
        claims=tuple(
            Claim(
                what=f"P_D of (155, 50), (160, 55) at P_FA 0.01, N = {n}",
                paper=value,
                reference=value,
                tolerance=1e-4,
                same=_at(n, 0.01, "paper"),
                better=_at(n, 0.01, "full"),
            )
            for n, value in ((50, 0.1143), (300, 0.9989))
        ),
    ),
    Study(
        name="spin.dead-zone",
        title="Blocks of the sky where detection is below 0.99",
        paper=PAPER,
        figure="Table 1",
        run=dead_zones,
        claims=tuple(
            Claim(
                what=f"blocks about {reference}, N = {n}",
                paper=paper,
                reference=right,
                tolerance=1.0,
                same=value_of("blocks", test="paper", reference=reference, n=n),
                better=value_of("blocks", test="full", reference=reference, n=n),
            )
            for n, reference, paper, right in _TABLE
        ),
    ),
    Study(
        name="spin.solid-angle",
        title="Share of the hemisphere where detection is below 0.99",
        paper=PAPER,
        figure="Table 1",
        note="Tolerance 1 %.",
        run=solid_angle,
        claims=tuple(
            Claim(
                what="share, N = 150",
                across=f"about {reference}",
                paper="blocks only",
                reference=right,
                tolerance=0.01 * right,
                same=value_of("share", test="paper", reference=reference, n=150),
                better=value_of("share", test="full", reference=reference, n=150),
            )
            for reference, right in (
                ("(40, 35)", 0.01101),
                ("(160, 20)", 0.01798),
                ("(240, 55)", 0.00746),
                ("(320, 70)", 0.00648),
            )
        ),
    ),
    Study(
        name="spin.scenario",
        title="A spoofer at (160, 55) and three others",
        paper=PAPER,
        figure="Section 5, Figure 6",
        run=scenario,
        claims=(
            *(
                Claim(
                    what=f"threshold of {pair}",
                    paper=value,
                    reference=value,
                    tolerance=5e-5,
                    digits=6,
                    same=value_of("threshold", pair=pair, test="paper"),
                )
                for pair, value in (("[3,1]", 22.0503), ("[4,1]", 0.0760), ("[2,1]", 0.0201))
            ),
            *(
                Claim(
                    what=f"P_D of {pair}",
                    paper=paper,
                    reference=right,
                    tolerance=1e-4,
                    same=value_of("p_d_theory", pair=pair, test="paper"),
                    better=value_of("p_d_theory", pair=pair, test="full"),
                )
                for pair, paper, right in (
                    ("[3,1]", 0.9999, 0.999984),
                    ("[4,1]", 0.0373, 0.0373),
                    ("[2,1]", 0.0104, 0.0100),
                )
            ),
        ),
    ),
    Study(
        name="spin.samples",
        title="How many samples a pair of 5 degrees takes",
        paper=PAPER,
        figure="none",
        run=samples,
        charts=(
            Axes(
                title="Detection of (155, 50), (160, 55)",
                x="n",
                y="p_d",
                x_label="samples, 10 a second",
                y_label="detection probability",
                by=("test",),
            ),
        ),
        claims=(
            Claim(
                what="samples for P_D 0.9999, the paper's sense",
                paper="not given",
                reference=376,
                tolerance=0.0,
                same=_first("p_d", "paper"),
                better=_first("p_d", "full"),
            ),
            Claim(
                what="samples for P_D 0.9999, the usual sense",
                paper="not given",
                reference=380,
                tolerance=0.0,
                same=_first("p_d_usual", "paper"),
                better=_first("p_d_usual", "full"),
            ),
        ),
    ),
    Study(
        name="spin.circular",
        title="The threshold from the estimate itself",
        paper=PAPER,
        figure="Section 4.1",
        run=circular,
        claims=(
            Claim(
                what="P_D of spoofed pairs, P_FA 0.01, directions of the authentic pair not known",
                paper="taken as known",
                reference=0.0101,
                tolerance=0.0022,
                same=value_of("p_d_simulated", p_fa=0.01),
            ),
        ),
    ),
    Study(
        name="spin.protect",
        title="False signals of the scenario that `protect` names",
        paper=PAPER,
        figure="Section 5, Figure 3",
        note="Signals 1 and 2 from (160, 55), true ones 12, 5 and 3 degrees from there and far away. The paper: P_D of "
        "a pair of one direction at 1 %, where an authentic one differs by 5 degrees, 0.1143 at N = 50 and 0.9989 "
        "at 300. Through protect: forty runs of one window, phases of 0.01 cycles of which a bound of 0.01 lasts, "
        "and some 1e-6 false alarms.",
        run=_protect,
        claims=(
            *(
                Claim(
                    what="both false signals named",
                    across=f"N = {n}",
                    paper={50: 0.1143, 300: 0.9989}.get(n, "not given"),
                    protect=value_of("named_share", min, n=n, sat="G02"),
                )
                for n in _NAMED_AT
            ),
            Claim(
                what="windows in which a true signal is called spoofed, share",
                paper="0.01 a pair",
                protect=value_of("named_share", max, sat="true"),
            ),
        ),
    ),
)
