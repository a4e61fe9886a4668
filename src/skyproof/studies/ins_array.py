"""Figures and tables of the paper on an antenna array with an inertial system, and ours beside them.

Zhang, Ding, Xia, Liu and Yao, "INS-Aided Multi-Antenna GNSS Carrier Phase Double Difference Spoofing Detection". The
satellites' directions of its scenarios are printed cut to whole degrees; those used here (G03 and G32 to hundredths)
are inferred from the printed detection probabilities.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

from skyproof.report.chart import Axes
from skyproof.studies.antennas_protect import count_named_by_array
from skyproof.studies.base import Claim, Row, Study, StudySettings, value_of
from skyproof.studies.ins_array_figures import dead_zones, eight, position_error, roc, scenarios, solid_angle, threshold

__all__ = ["STUDIES"]

PAPER: Final = (
    "Zhang, Ding, Xia, Liu, Yao, INS-aided multi-antenna GNSS carrier phase double difference spoofing detection"
)


def _percent(column: str, **where: Any) -> Callable[[Sequence[Row]], float]:
    """Return the largest of a column, in percent."""
    largest = value_of(column, max, **where)
    return lambda rows: 100.0 * largest(rows)


_BY_FORMULA: Final = "figure not in the copy"


def _scenario_claim(location: str, scenario: str, sat: str, paper: float, reference: float, better: float) -> Claim:
    where: dict[str, Any] = {"location": location, "scenario": scenario, "sat": sat}
    return Claim(
        what=f"P_D of {sat}, scenario {scenario}, no errors (better: calibrated, with errors; {better:g} expected)",
        paper=paper,
        reference=reference,
        tolerance=0.005,
        same=value_of("p_d_simulated", **where, errors=False, test="paper"),
        better=value_of("p_d_simulated", **where, errors=True, test="calibrated"),
    )


_NAMED: Final = {  # location, scenario: P_D of the paper for each false signal, one measurement, at 1 %
    ("1", "1"): {"G03": 0.066, "G29": 1.0, "G32": 0.977},
    ("1", "2"): {"G03": 1.0, "G29": 1.0, "G32": 0.244},
    ("2", "1"): {"G02": 1.0, "G20": 1.0, "G29": 1.0},
    ("2", "2"): {"G02": 1.0, "G20": 1.0, "G29": 1.0},
}


def _protect(settings: StudySettings) -> Iterator[Row]:
    """Yield how often `protect` names each false signal of the scenarios, and how often a true one."""
    runs = settings.count(10, 1)
    for stream, (location, scenario) in enumerate(list(_NAMED)[:1] if settings.quick else _NAMED):
        scene = f"ins-array-{scenario}" + ("-location-2" if location == "2" else "")
        for sat, share in count_named_by_array(scene, runs, settings.rng(stream)).items():
            yield {"location": location, "scenario": scenario, "sat": sat, "named_share": share, "runs": runs}


STUDIES = (
    Study(
        name="ins-array.threshold",
        title="Threshold for the false-alarm probability",
        paper=PAPER,
        figure="Equation 41",
        run=threshold,
        claims=(
            Claim(
                what="threshold at P_FA 0.01",
                paper=9.2103,
                reference=9.2103,
                tolerance=5e-5,
                digits=5,
                same=value_of("threshold", p_fa=0.01),
            ),
        ),
    ),
    Study(
        name="ins-array.roc",
        title="Receiver operating characteristics",
        paper=PAPER,
        figure="Figures 5 and 6",
        run=roc,
        charts=(
            Axes(
                title="Figure 5: predicted (20, 40), received (21, 40); baselines in wavelengths",
                x="p_fa",
                y="p_d",
                x_label="false-alarm probability",
                y_label="detection probability",
                by=("baseline",),
                where={"figure": "5"},
                x_log=True,
            ),
            Axes(
                title="Figure 6: five wavelengths, received one degree lower",
                x="p_fa",
                y="p_d",
                x_label="false-alarm probability",
                y_label="detection probability",
                by=("predicted",),
                where={"figure": "6"},
                x_log=True,
            ),
        ),
        claims=tuple(
            Claim(
                what="noncentrality, (20, 40) against (21, 40)",
                across=f"b = {side:g}",
                paper=_BY_FORMULA,
                reference=reference,
                same=value_of("noncentrality", figure="5", baseline=side),
                tolerance=1e-4,
            )
            for side, reference in ((1.0, 0.8938), (2.0, 3.5750), (3.0, 8.0439), (4.0, 14.3002), (5.0, 22.3440))
        ),
    ),
    Study(
        name="ins-array.dead-zone",
        title="Blocks of the sky where detection is below 0.99",
        paper=PAPER,
        figure="Figures 7 and 8",
        run=dead_zones,
        claims=(
            *(
                Claim(
                    what=f"largest number of blocks, b = {side:g}",
                    paper=most,
                    reference=most,
                    tolerance=1.0,
                    same=value_of("max_blocks", baseline=side),
                )
                for side, most in ((1.0, 1554), (5.0, 232))
            ),
            *(
                Claim(
                    what=f"the same share of solid angle, %, b = {side:g}",
                    paper=paper,
                    reference=right,
                    tolerance=0.01 * right,
                    same=_percent("solid_angle_fraction", baseline=side),
                )
                for side, paper, right in ((1.0, 4.8, 0.2745), (5.0, 0.7, 0.0110))
            ),
        ),
    ),
    Study(
        name="ins-array.solid-angle",
        title="Share of the hemisphere where detection is below 0.99",
        paper=PAPER,
        figure="none",
        run=solid_angle,
        charts=(
            Axes(
                title="Whole cycles known; baselines in wavelengths",
                x="elevation_deg",
                y="share",
                x_label="predicted elevation, deg",
                y_label="share of the hemisphere",
                by=("baseline",),
            ),
            Axes(
                title="Fractions of cycles known; baselines in wavelengths",
                x="elevation_deg",
                y="wrapped_share",
                by=("baseline",),
                x_label="predicted elevation, deg",
                y_label="share of the hemisphere",
            ),
        ),
        claims=tuple(
            Claim(
                what=f"worst share, %, b = {side:g} (better: with whole cycles unknown)",
                paper="stated for blocks only",
                reference=right,
                tolerance=0.01 * right,
                same=_percent("share", baseline=side),
                better=_percent("wrapped_share", baseline=side),
            )
            for side, right in ((1.0, 1.008), (5.0, 0.089))
        ),
    ),
    Study(
        name="ins-array.scenarios",
        title="Two places, two scenarios",
        paper=PAPER,
        figure="Tables 1 and 2, Figures 10 to 12",
        run=scenarios,
        claims=(
            _scenario_claim("1", "1", "G03", 0.066, 0.0649, 0.0221),
            _scenario_claim("1", "1", "G32", 0.977, 0.976, 0.4055),
            _scenario_claim("1", "2", "G32", 0.244, 0.247, 0.0534),
            Claim(
                what="P_FA of G03 with errors (better: calibrated)",
                paper="not shown",
                reference=0.2668,
                tolerance=0.005,
                same=value_of("p_fa_simulated", location="1", sat="G03", errors=True, test="paper"),
                better=value_of("p_fa_simulated", location="1", sat="G03", errors=True, test="calibrated"),
            ),
            Claim(
                what="P_D of G03 with errors",
                paper=0.0657,
                reference=0.344,
                tolerance=0.01,
                same=value_of("p_d_simulated", location="1", scenario="1", sat="G03", errors=True, test="paper"),
            ),
            Claim(
                what="P_D of the three together with errors, scenario 2 (better only)",
                paper="no joint test",
                reference=1.0,
                better=value_of("p_d_simulated", location="1", scenario="2", sat="all", errors=True),
            ),
        ),
    ),
    Study(
        name="ins-array.position-error",
        title="What an error of 3 mm in the antenna positions does",
        paper=PAPER,
        figure="Figures 11 and 12, right",
        run=position_error,
        claims=tuple(
            Claim(
                what=f"P_FA at a nominal 0.01, 3 mm {assumption}",
                paper="not shown",
                reference=reference,
                tolerance=0.006,
                same=value_of("p_fa", assumption=assumption, baseline=1.0, elevation_deg=30.0),
            )
            for assumption, reference in (
                ("per antenna and axis", 0.266),
                ("the same, first antenna without", 0.173),
                ("along each baseline", 0.044),
                ("none", 0.010),
            )
        ),
    ),
    Study(
        name="ins-array.eight",
        title="One false signal among eight satellites",
        paper=PAPER,
        figure="none",
        run=eight,
        charts=(
            Axes(
                title="Baselines of one wavelength",
                x="shift_deg",
                y="p_d",
                x_label="shift in elevation, deg",
                y_label="mean detection probability",
                by=("test",),
                where={"baseline": 1.0},
            ),
        ),
        claims=(
            Claim(
                what="mean P_D, 5 deg, b = 1, alone (better: given the others)",
                paper="no joint use",
                reference=0.285,
                tolerance=0.002,
                same=value_of("p_d", baseline=1.0, shift_deg=5.0, test="alone"),
                better=value_of("p_d", baseline=1.0, shift_deg=5.0, test="conditional"),
            ),
        ),
    ),
    Study(
        name="ins-array.protect",
        title="False signals of the scenarios that `protect` names",
        paper=PAPER,
        figure="Tables 1 and 2",
        note="The paper: P_D of one measurement at 1 %, antennas without errors: at location 1 0.066 for G03, 2 "
        "degrees off, and 0.977 for G32, 8 degrees off, in scenario 1, 0.244 for G32, 2 degrees off, in scenario "
        "2, else 1. Through protect: ten runs of 60 s, antennas 3 mm off, the attitude 0.05 degrees, phases of "
        "0.01 cycles of which a bound of 0.01 lasts, and some 2e-8 false alarms a signal and window. A test that "
        "knows all else finds these three in 0, 0.04 and 0 of windows at that rate.",
        run=_protect,
        claims=(
            *(
                Claim(
                    what=f"named, location {location}, scenario {scenario}",
                    across=sat,
                    paper=paper,
                    protect=value_of("named_share", location=location, scenario=scenario, sat=sat),
                )
                for (location, scenario), papers in _NAMED.items()
                for sat, paper in papers.items()
            ),
            Claim(
                what="runs in which a true signal is called spoofed, share",
                paper="0.01 a test",
                protect=value_of("named_share", max, sat="true"),
            ),
        ),
    ),
)
