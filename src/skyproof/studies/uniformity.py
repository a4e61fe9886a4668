"""Are p-values uniform under the null? Every test of `detectors` and `statistics`, counted.

A p-value is uniform if it comes at or below p with probability p, whatever p. Then a threshold is right at any rate
asked for, and p-values can be put together with others. Kolmogorov's test covers the whole distribution, the counts
below 1 % and 0.1 % of the tail, which decides. A test that is only approximate says how far it is off.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final
from zlib import crc32

import numpy as np
from scipy import special

from skyproof.arrays import Reals
from skyproof.detectors.multi_receiver.one_antenna import WHITE, TrackNoise
from skyproof.report.chart import Axes
from skyproof.studies import uniformity_draws as draws
from skyproof.studies import uniformity_echoes as echoes
from skyproof.studies import uniformity_one_antenna as one_antenna
from skyproof.studies.base import Claim, Row, Study, StudySettings
from skyproof.studies.double_difference import Tested
from skyproof.studies.uniformity_draws import ASKED, Draw

__all__ = ["CASES", "STUDIES", "Case", "p_values"]

_CONFIDENCE: Final = 0.999


@dataclass(frozen=True, kw_only=True)
class Case:
    """One test under its null.

    group : where it is drawn. method : the module. usual, quick : p-values to draw. at_once : of them, for the memory.
    why : why it is not exact; none if it is.
    """

    group: str
    method: str
    test: str
    draw: Draw
    usual: int = 200_000
    quick: int = 10_000
    at_once: int = 20_000
    why: str = ""

    @property
    def exact(self) -> bool:
        return not self.why


_PAIRS, _RECEIVERS = "several receivers: pairs of satellites", "several receivers: groups"
_POSITION, _TIME = "one receiver's positions", "sums over time"
_QUALITY, _VECTOR = "signal quality", "vector receiver"
_ARRAY, _ARM, _GENERIC = "antenna arrays", "a spinning antenna", "generic tests"
_PAPERS: Final[tuple[tuple[str, Tested, float | None], ...]] = (
    ("1a", "line", 1.0), ("1b", "line", None), ("2a", "slope", 1.0), ("2b", "slope", None),
)  # fmt: skip
_UNION = "a union bound over all pairs"

CASES: Final = (
    *(Case(group=_PAIRS, method="double_difference", test=name, draw=draws.different(tested, sigma_m))
      for name, tested, sigma_m in _PAPERS),
    *(Case(group=_PAIRS, method="double_difference", test=f"1b, AR(1) {phi:g} estimated", draw=draws.cured(phi),
           usual=100_000, quick=3000, at_once=5000,
           why="the coefficient is estimated, and what a line leaves of slow noise is little")
      for phi in (0.5, 0.9)),
    Case(group=_PAIRS, method="double_difference", test="1b, constant errors of 1 m", draw=draws.cured(0.0, 1.0),
         usual=100_000, quick=3000, at_once=5000,
         why="the level's share of constant errors is known, its share of noise estimated"),
    Case(group=_RECEIVERS, method="one_antenna", test="one antenna, white noise", draw=draws.one_antenna(WHITE),
         quick=5000),
    *(Case(group=_RECEIVERS, method="one_antenna", test=f"one antenna, any noise; {words}", usual=20_000, quick=1000,
           at_once=1000, draw=draws.one_antenna(TrackNoise(), epochs=30, **noise),
           why="the largest p-value over all noise that the window allows")
      for words, noise in (("it is white, 1 m", {}),
                           ("it is AR(1) 0.9, 3 m", {"sigma_m": 3.0, "phi": 0.9, "constant_m": 1.0}))),
    Case(group=_RECEIVERS, method="one_antenna", test="ratio of two pairings", draw=draws.ratio, quick=5000),
    Case(group=_RECEIVERS, method="one_antenna", test="at most 5 m apart", draw=draws.distance, quick=2000,
         usual=50_000, at_once=2000,
         why="the nearest distance allowed, in place of the true one: a disc is no point"),
    *(Case(group=_RECEIVERS, method="along_baselines", test=f"along baselines, alone, {r} receivers",
           draw=draws.span("alone", receivers=r))
      for r in (2, 3)),
    *(Case(group=_RECEIVERS, method="along_baselines", test=f"along baselines by {part}, no baseline",
           draw=draws.span(part, apart=False))
      for part in ("fixes", "differences")),
    *(Case(group=_RECEIVERS, method="along_baselines", test=f"along baselines, all three, {words}",
           draw=draws.span("p_value", apart=apart),
           why=f"the smallest of three p-values over their shares, which have much in common{more}")
      for words, apart, more in (("no baseline", False, ""),
                                 ("20 m", True, "; the baseline's square is taken for noise"))),
    Case(group=_RECEIVERS, method="group_choice", test="known baseline", draw=draws.known_baseline,
         why="the smallest of three p-values over their shares, which have much in common"),
    Case(group=_RECEIVERS, method="group_choice", test="known sky", draw=draws.known_sky),
    Case(group=_RECEIVERS, method="group_choice", test="carrier fractions, 0.01 cycles", draw=draws.fractions(0.01)),
    Case(group=_RECEIVERS, method="group_choice", test="carrier fractions, 0.1 cycles", draw=draws.fractions(0.1),
         why="whole cycles are chosen that make the statistic smaller than it is"),
    Case(group=_POSITION, method="raim, residual", test="one position", draw=draws.raim),
    Case(group=_POSITION, method="chance, residual", test="a second set of unrelated signals",
         draw=draws.unrelated_sets,
         why="the volume of noise at the worst geometry; p-values near 1 are cut off there"),
    Case(group=_POSITION, method="second_signals", test="second signals by echoes", draw=echoes.echoes_of_ten,
         usual=100_000, quick=2000, at_once=5000,
         why="most satellites have none, which is less than a p-value of 1 says; two at least make an alarm"),
    Case(group=_GENERIC, method="many_small", test="some of ten small", draw=draws.many_of_ten,
         usual=20_000, quick=1000),
    Case(group=_POSITION, method="inverse_raim", test="the true set", draw=draws.true_set),
    Case(group=_POSITION, method="exclusion", test="the true fix", draw=draws.exclusion, at_once=200_000),
    Case(group=_POSITION, method="decomposition", test="one signal, not two", draw=draws.count_of_signals,
         usual=30_000, quick=2000, at_once=30_000, why="the law is simulated, and its tail fitted"),
    Case(group=_POSITION, method="dccaf, bursts", test="one signal, not two, over a burst", usual=20_000, quick=300,
         draw=one_antenna.burst_of_one_signal,
         why="an upper bound by level crossings, with a degree of freedom for the first signal's delay"),
    Case(group=_POSITION, method="common_change, laws", test="code against carrier, alike",
         draw=one_antenna.rates_alike,
         why="1 where not three of four have one sign, which is likelier than 0.29 of eight"),
    Case(group=_POSITION, method="common_change, laws", test="turn of all carriers", draw=one_antenna.turns),
    *(Case(group=_QUALITY, method="sqm", test=f"{metric}, A = {amplitude:g}",
           draw=draws.taps_metric(metric, amplitude))
      for metric, amplitude in (("delta", 14.14), ("ratio", 14.14), ("ratio", 4.47))),
    *(Case(group=_QUALITY, method="sqm", test=f"magnitudes, A = {amplitude:g}",
           draw=draws.taps_metric("magnitudes", amplitude),
           why="the law of delta, which magnitudes follow to first order in 1 / A")
      for amplitude in (14.14, 4.47)),
    Case(group=_QUALITY, method="sqm", test="slow and fast, in phase", draw=draws.slow_and_fast(magnitudes=False)),
    Case(group=_QUALITY, method="sqm", test="slow and fast, magnitudes", draw=draws.slow_and_fast(magnitudes=True),
         why="the law of parts in phase, which magnitudes follow to first order in 1 / A"),
    Case(group=_QUALITY, method="sqm", test="variance of 50", draw=draws.variance_of_window),
    *(Case(group=_VECTOR, method="vector_parity", test=f"parity, {sums} ms, A = {amplitude:g}",
           draw=draws.parity_of(sums), why=why)
      for sums, amplitude, why in ((10, 14.14, ""), (1, 4.47, "code and phase of one satellite are not independent"))),
    Case(group=_VECTOR, method="vector_parity", test="parity, 5 ms, plain discriminators",
         draw=draws.parity_of(5, scores=False), why="discriminators have heavier tails than normal; scores correct it"),
    Case(group=_VECTOR, method="vector_parity", test="what the attacked satellite leaves",
         draw=draws.suspect_left,
         why="discriminators are linear in lock only, and the attack takes them off it"),
    *(Case(group=_VECTOR, method="vector_sqm", test=f"the paper's two-step rule, {sums} ms",
           draw=draws.two_step_rule(sums), quick=5000,
           why="its false-alarm probability is that of a satellite chosen beforehand, and the rule takes the largest "
           "of six")
      for sums in (1, 10)),
    Case(group=_TIME, method="cusum", test="time to a false alarm, Crosier's sum", draw=draws.cusum_runs,
         usual=100_000, quick=5000,
         why="the mean is exact and the tail exponential, but a sum that starts at zero takes a while"),
    Case(group=_TIME, method="cusum", test="time to a false alarm, Page's sum", draw=draws.page_runs, usual=100_000,
         quick=5000, why="the mean is exact and the tail exponential, but a sum that starts at zero takes a while"),
    Case(group=_ARRAY, method="ins_array", test="the paper's, no errors",
         draw=draws.satellites_in_place("paper", errors=False), quick=5000),
    Case(group=_ARRAY, method="ins_array", test="the paper's, antennas 3 mm off", quick=5000,
         draw=draws.satellites_in_place("paper"), why="errors of position and attitude are taken for the signal's"),
    *(Case(group=_ARRAY, method="ins_array", test=f"calibrated, {test}", draw=draws.satellites_in_place(test),
           quick=5000)
      for test in ("single", "conditional", "joint")),
    Case(group=_ARRAY, method="ins_array", test="calibrated, joint and conditional",
         draw=draws.satellites_in_place("both"), quick=5000,
         why="a union bound over the joint test and those of the signals, which share alarms"),
    Case(group=_ARRAY, method="array_common", test="all of one source, any cycles",
         draw=draws.equal_vectors(wrapped=True), quick=5000),
    Case(group=_ARRAY, method="array_common", test="clusters among random directions", usual=50_000, quick=2000,
         draw=draws.clusters_of_random_directions,
         why="a union bound over all choices of signals, at the worst direction; sizes are whole"),
    Case(group=_ARM, method="spin", test="the paper's differences", draw=draws.pair_of_spinning("paper")),
    Case(group=_ARM, method="spin", test="the whole series, drifting", draw=draws.pair_of_spinning("full")),
    Case(group=_ARM, method="spin", test="five signals under any clock", draw=draws.signals_of_one_antenna(),
         quick=3000, at_once=5000),
    Case(group=_ARM, method="spin", test="five signals, rate estimated", usual=10_000, quick=300, at_once=1000,
         draw=draws.signals_of_one_antenna(rate_known=False),
         why="the rate is fitted to the same phases, which hardly differ in what they say of it"),
    Case(group=_ARM, method="spin", test="predicted directions", draw=draws.predicted(start_known=True)),
    Case(group=_ARM, method="spin", test="predicted directions, start angle estimated",
         draw=draws.predicted(start_known=False), why="linear about the estimated angle"),
    Case(group=_ARM, method="spin", test="the paper's rule, direction known", quick=3000, usual=50_000,
         draw=draws.spinning(direction_known=True)),
    Case(group=_ARM, method="spin", test="the paper's rule, direction estimated", quick=3000, usual=50_000,
         draw=draws.spinning(direction_known=False),
         why="the threshold moves with the statistic that it is for"),
    Case(group=_GENERIC, method="linear_tests", test="variance known: chi-square", draw=draws.gaussian_model(2.0)),
    Case(group=_GENERIC, method="linear_tests", test="variance unknown: F", draw=draws.gaussian_model(None)),
    Case(group=_GENERIC, method="directions", test="equal vectors", draw=draws.equal_vectors(wrapped=False)),
    Case(group=_GENERIC, method="directions", test="one more of a group", draw=draws.outsider),
    Case(group=_GENERIC, method="directions", test="a group that is divided", draw=draws.divided, why=_UNION),
    Case(group=_GENERIC, method="clusters", test="values of three means, 30 sigma apart", draw=draws.line_parts(30.0)),
    Case(group=_GENERIC, method="clusters", test="values of three means, 3 sigma apart", quick=3000, usual=50_000,
         draw=draws.too_many_parts(3.0),
         why="the best parting fits better than the true one, and fewer means may do"),
    Case(group=_GENERIC, method="autoregression", test="support of a coefficient", draw=draws.lag_one,
         why="a Beta law of the right mean and variance"),
)  # fmt: skip


def p_values(case: Case, settings: StudySettings) -> Reals:
    """(n,) drawn by a stream of the test's own."""
    rng = settings.rng(crc32(f"{case.method}: {case.test}".encode()))
    count = settings.count(case.usual, case.quick)
    return np.concatenate([case.draw(rng, min(case.at_once, count - begin)) for begin in range(0, count, case.at_once)])


def every_test(settings: StudySettings) -> Iterator[Row]:
    """One row a test.

    ks, ks_p : Kolmogorov's distance and its p-value. tail_01, tail_001 : shares at or below 0.01 and 0.001.
    tail_01_low, tail_01_high : what tail_01 may be, with a confidence of 0.999.
    """
    for case in CASES:
        p = p_values(case, settings)
        distance, chance = _kolmogorov(p)
        below = int(np.sum(p <= 0.01))
        low, high = _limits(below, p.size)
        why = case.why and f"{case.why}; at 0.01 {100.0 * below / p.size:.3g} times as often"
        yield {
            "test": case.test,
            "method": case.method,
            "trials": p.size,
            "ks": distance,
            "ks_p": chance,
            "tail_01": below / p.size,
            "tail_001": float(np.mean(p <= 0.001)),
            "tail_01_low": low,
            "tail_01_high": high,
            "exact": case.exact,
            "why": why,
        }


def distribution(settings: StudySettings) -> Iterator[Row]:
    """The share of p-values at or below each p, and beside the tests of each group the line that is right."""
    for group in dict.fromkeys(case.group for case in CASES):
        for p in ASKED:
            yield {"group": group, "method": "", "test": "uniform", "p": p, "share": p, "trials": None}
        for case in CASES:
            if case.group == group:
                drawn = np.sort(p_values(case, settings))
                for p in ASKED:
                    share = float(np.searchsorted(drawn, p, side="right")) / drawn.size
                    yield {
                        "group": group,
                        "method": case.method,
                        "test": case.test,
                        "p": p,
                        "share": share,
                        "trials": drawn.size,
                    }


def _kolmogorov(p: Reals) -> tuple[float, float]:
    """Distance from the uniform distribution and its p-value by the limit law, corrected for the number (M. A.
    Stephens, JRSS B 32(1), 1970)."""
    n, ordered = p.size, np.sort(p)
    above = np.max(np.arange(1, n + 1) / n - ordered)
    under = np.max(ordered - np.arange(n) / n)
    distance, root = float(max(above, under)), np.sqrt(n)
    return distance, float(special.kolmogorov((root + 0.12 + 0.11 / root) * distance))


def _limits(count: int, trials: int) -> tuple[float, float]:
    """Of a share (C. J. Clopper, E. S. Pearson, Biometrika 26(4), 1934)."""
    outside = 0.5 * (1.0 - _CONFIDENCE)
    low = float(special.betaincinv(count, trials - count + 1, outside)) if count else 0.0
    high = float(special.betaincinv(count + 1, trials - count, 1.0 - outside)) if count < trials else 1.0
    return low, high


def _not_uniform(rows: Sequence[Row]) -> float:
    return float(sum(row["exact"] and row["ks_p"] < 1e-4 for row in rows))


def _off_at_one_percent(rows: Sequence[Row]) -> float:
    return float(sum(row["exact"] and not row["tail_01_low"] <= 0.01 <= row["tail_01_high"] for row in rows))


_OURS: Final = "none: every test of this package"

STUDIES = (
    Study(
        name="uniformity.tests", title="p-values under the null, a row for each test", paper=_OURS, figure="none",
        run=every_test,
        claims=(
            Claim(what=f"of {sum(case.exact for case in CASES)} exact tests, not uniform: Kolmogorov's p below 1e-4",
                  paper="none", reference=0.0, same=_not_uniform, tolerance=0.0),
            Claim(what="of these, with another share than 0.01 at or below 0.01, confidence 0.999 each", paper="none",
                  reference=0.0, same=_off_at_one_percent, tolerance=1.0),
        ),
    ),
    Study(
        name="uniformity.distribution", title="Share of p-values at or below p", paper=_OURS, figure="none",
        run=distribution,
        charts=tuple(
            Axes(title=group.capitalize(), x="p", y="share", x_label="p", y_label="share of p-values at or below p",
                  by=("test",), where={"group": group}, x_log=True, y_log=True)
            for group in dict.fromkeys(case.group for case in CASES)
        ),
    ),
)  # fmt: skip
