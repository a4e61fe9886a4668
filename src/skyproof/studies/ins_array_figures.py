"""What the figures and tables of the paper on an antenna array with an inertial system are computed by.

The paper, and what it prints of each, stand in `ins_array`."""

from collections.abc import Callable, Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from skyproof.arrays import Reals
from skyproof.detectors.array.array_model import (
    array_design,
    conditional_statistics,
    differences,
    joint_statistic,
    residual_covariance,
    white_covariance,
)
from skyproof.statistics.directions import direction_cosines, mahalanobis_squared
from skyproof.statistics.distributions import chi_square_threshold, noncentral_chi_square_survival
from skyproof.studies.array_geometry import blind_directions, equilateral_triangle, single_statistic
from skyproof.studies.base import Row, StudySettings
from skyproof.studies.direction_tests import blocks, measure_dead_zone, noncentrality_for_power

__all__ = [
    "ERRORS",
    "P_FA",
    "SCENARIOS",
    "dead_zones",
    "disc_share",
    "draw_residuals",
    "eight",
    "lattice_share",
    "position_error",
    "roc",
    "scenarios",
    "solid_angle",
    "threshold",
]

SIGMA_CYC: Final = 0.01
WAVELENGTH_M: Final = 0.19029  # as the paper rounds it
ERRORS: Final[dict[str, float]] = {
    "position_sigma_cyc": 0.003 / WAVELENGTH_M,
    "attitude_covariance_rad2": float(np.radians(0.05)) ** 2,
}
WHITE: Final = white_covariance([SIGMA_CYC] * 3)
P_FA: Final = 0.01
THRESHOLD: Final = float(chi_square_threshold(P_FA, 2))
CHUNK: Final = 100_000  # trials at a time, for the memory

Degrees = tuple[float, float]

PREDICTED: Final[dict[str, dict[str, Degrees]]] = {
    "1": {"G03": (276.80, 22.19), "G29": (48.0, 21.0), "G32": (148.04, 30.85)},
    "2": {"G02": (356.0, 67.0), "G20": (233.0, 76.0), "G29": (313.0, 12.0)},
}
SCENARIOS: Final[dict[str, tuple[Degrees, ...]]] = {
    "1": ((276.0, 24.0), (60.0, 30.0), (150.0, 23.0)),
    "2": ((150.0, 30.0), (150.0, 30.0), (150.0, 30.0)),
}


def _directions(pairs_deg: Sequence[Degrees]) -> Reals:
    return direction_cosines(*np.radians(np.array(pairs_deg, float).T))


# Threshold and ROC ----------------------------------------------------------------------------------------------------


def threshold(settings: StudySettings) -> Iterator[Row]:
    """Compute thresholds for some false-alarm probabilities, and count what noise exceeds them."""
    noise = settings.rng().multivariate_normal(np.zeros(2), WHITE, settings.count(1_000_000, 100_000))
    statistic = single_statistic(noise, WHITE)
    for p_fa in (0.1, 0.01, 0.001, 0.0001):
        limit = float(chi_square_threshold(p_fa, 2))
        yield {
            "p_fa": p_fa,
            "threshold": limit,
            "p_fa_simulated": float(np.mean(statistic > limit)),
            "trials": len(statistic),
        }


ROC_CASES: Final = (
    *(("5", float(b), (20.0, 40.0), (21.0, 40.0)) for b in (1, 2, 3, 4, 5)),
    ("6", 5.0, (110.0, 35.0), (110.0, 34.0)),
    ("6", 5.0, (10.0, 10.0), (10.0, 9.0)),
)


def roc(settings: StudySettings) -> Iterator[Row]:
    """Compute figures 5 and 6.

    Received from (121, 40), as the text has it for Figure 5, gives a detection of 1 throughout: (21, 40) is read.
    """
    for figure, side, predicted, received in ROC_CASES:
        apart = array_design(equilateral_triangle(side)) @ (_directions([predicted]) - _directions([received]))[0]
        noncentrality = float(mahalanobis_squared(apart, WHITE))
        for p_fa in np.round(np.geomspace(1e-4, 1.0, 41), 10):
            p_d = float(noncentral_chi_square_survival(chi_square_threshold(p_fa, 2), 2, noncentrality))
            yield {
                "figure": figure,
                "baseline": side,
                "predicted": f"({predicted[0]:g}, {predicted[1]:g})",
                "noncentrality": noncentrality,
                "p_fa": float(p_fa),
                "p_d": p_d,
            }


# Dead zones -----------------------------------------------------------------------------------------------------------


def disc_share(centre: ArrayLike, radius: float) -> Reals:
    """Share of the hemisphere whose level direction cosines lie within `radius` of a point `centre` (...) from the
    zenith's, by the width in azimuth at each elevation."""
    centre = np.asarray(centre, np.float64)
    low, high = np.clip(centre - radius, 0.0, 1.0), np.clip(centre + radius, 0.0, 1.0)
    # Even steps of the elevation between the rings that touch the disc.
    from_rad, to_rad = np.arccos(high), np.arccos(low)
    el_rad = from_rad[..., None] + (to_rad - from_rad)[..., None] * (np.arange(1000) + 0.5) / 1000
    level = np.cos(el_rad)
    cosine = (centre[..., None] ** 2 + level**2 - radius**2) / np.maximum(2.0 * centre[..., None] * level, 1e-300)
    width = 2.0 * np.arccos(np.clip(cosine, -1.0, 1.0))
    return np.asarray(np.sum(width * level, axis=-1) * (to_rad - from_rad) / 1000 / (2.0 * np.pi))


def _radius(side: float) -> float:
    """Compute the radius of the disc in which a power of 0.99 is missed: 0.07405 / b."""
    return float(np.sqrt(2.0 * noncentrality_for_power(0.99, P_FA, 2)) * SIGMA_CYC / side)


def lattice_share(direction: Reals, side: float) -> float:
    """Share of the hemisphere for one predicted direction, with whole cycles: a disc about each blind direction. Those
    just outside the rim reach in as well."""
    radius = _radius(side)
    level = np.asarray(direction, np.float64)[:2]
    reach = np.arange(-np.ceil(3.0 * side), np.ceil(3.0 * side) + 1)
    whole = np.stack(np.meshgrid(reach, reach), axis=-1).reshape(-1, 2)
    shift = np.linalg.solve(array_design(equilateral_triangle(side))[:, :2], whole.T).T
    centre = np.linalg.norm(level + shift, axis=-1)
    return float(disc_share(centre[centre < 1.0 + radius], radius).sum())


def dead_zones(settings: StudySettings) -> Iterator[Row]:
    """Measure dead zones received on whole degrees of azimuth and predicted in the middle of blocks.

    `max_blocks` of the 32400 have P_D < 0.99 at the worst predicted direction; `solid_angle_fraction` is the true share
    of the hemisphere there. Beside it the same where only fractions of cycles are known.
    """
    received = blocks(1.0, azimuth_place=0.0)
    # By the triangle's symmetry, and as the grid is turned by 60 degrees into itself, these azimuths stand for all.
    az_deg, el_deg = np.arange(0.5, 60.0), np.arange(0.5, 90.0)
    predicted = direction_cosines(*np.radians(np.meshgrid(az_deg, el_deg))).reshape(-1, 3)
    for side in (1.0, 5.0):
        design = array_design(equilateral_triangle(side))
        # Without whole cycles the azimuth does not matter at all.
        plain = measure_dead_zone(predicted[:: az_deg.size], received.direction, design, WHITE)
        wrapped = measure_dead_zone(predicted, received.direction, design, WHITE, wrapped=True)
        worst = predicted[plain.argmax() * az_deg.size], predicted[wrapped.argmax()]
        yield {
            "baseline": side,
            "max_blocks": int(plain.max()),
            "fraction": float(plain.max() / 32400),
            "solid_angle_fraction": float(disc_share(np.linalg.norm(worst[0][:2]), _radius(side))),
            "wrapped_max_blocks": int(wrapped.max()),
            "wrapped_fraction": float(wrapped.max() / 32400),
            "wrapped_solid_angle_fraction": lattice_share(worst[1], side),
        }


def solid_angle(settings: StudySettings) -> Iterator[Row]:
    """Compute the true share of the hemisphere with P_D < 0.99 against the predicted elevation."""
    for side in (1.0, 5.0):
        for el_deg in np.arange(0.1, 90.0, 0.2):
            direction = _directions([(17.0, float(el_deg))])[0]
            yield {
                "baseline": side,
                "elevation_deg": float(el_deg),
                "wrapped_share": lattice_share(direction, side),
                "share": float(disc_share(np.linalg.norm(direction[:2]), _radius(side))),
                "blind_directions": len(blind_directions(direction, equilateral_triangle(side))) - 1,
            }


# Scenarios ------------------------------------------------------------------------------------------------------------


def draw_residuals(
    rng: np.random.Generator,
    trials: int,
    predicted: Reals,
    received: Reals,
    *,
    side: float = 1.0,
    position_cyc: Reals | float = 0.0,
    attitude_sigma_rad: float = 0.0,
    epochs: int = 1,
) -> Reals:
    """Draw measured minus predicted differences (trials, n, 2), from exact rotations.

    position_cyc : errors of the antennas (trials, 3, 3) in cycles, the same for all signals. The body is truly level
    and north-bound; the inertial system errs by a small rotation. epochs : that white noise is averaged over.
    """
    elements = equilateral_triangle(side)
    where = elements + np.asarray(position_cyc)
    phase = np.broadcast_to(received @ np.swapaxes(where, -1, -2), (trials, len(received), 3))
    tilt = Rotation.from_rotvec(attitude_sigma_rad * rng.standard_normal((trials, 3))).as_matrix()
    believed = np.swapaxes(tilt @ predicted.T, -1, -2) @ elements.T
    z = phase - believed + SIGMA_CYC / np.sqrt(epochs) * rng.standard_normal((trials, len(received), 3))
    return differences(z)


def _rates(
    settings: StudySettings, stream: int, predicted: Reals, received: Reals, errors: bool, side: float = 1.0
) -> tuple[Reals, Reals, float]:
    """Shares of trials in which the single test of the paper, the calibrated one and the joint one exceed."""
    covariance = residual_covariance(
        equilateral_triangle(side), predicted, sigma_cyc=SIGMA_CYC, **(ERRORS if errors else {})
    )
    covariances = [covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(len(predicted))]
    joint_limit = chi_square_threshold(P_FA, 2 * len(predicted))
    rng, trials = settings.rng(stream), settings.count(50_000, 20_000)
    paper, calibrated, joint = np.zeros(len(predicted)), np.zeros(len(predicted)), 0.0
    for start in range(0, trials, CHUNK):
        count = min(CHUNK, trials - start)
        position = ERRORS["position_sigma_cyc"] * rng.standard_normal((count, 3, 3)) if errors else np.zeros((3, 3))
        tilt = float(np.sqrt(ERRORS["attitude_covariance_rad2"])) if errors else 0.0
        z = draw_residuals(rng, count, predicted, received, side=side, position_cyc=position, attitude_sigma_rad=tilt)
        paper += np.sum(single_statistic(z, WHITE) > THRESHOLD, axis=0)
        calibrated += np.sum(single_statistic(z, np.array(covariances)) > THRESHOLD, axis=0)
        joint += float(np.sum(joint_statistic(z, covariance) > joint_limit))
    return paper / trials, calibrated / trials, joint / trials


def scenarios(settings: StudySettings) -> Iterator[Row]:
    """Compute Tables 1 and 2: two places, each false signal from its own place or all from one.

    Tests: `paper` (white noise only in the covariance) and `calibrated` (the errors of antenna positions and attitude
    in it); `sat` "all" is the joint test of the three. Errors: 3 mm per antenna and axis, 0.05 degrees per axis.
    """
    design = array_design(equilateral_triangle(1.0))
    for stream, location in enumerate(PREDICTED):
        sats, predicted = tuple(PREDICTED[location]), _directions(list(PREDICTED[location].values()))
        for errors in (False, True):
            null = _rates(settings, 10 * stream + errors, predicted, predicted, errors)
            covariance = residual_covariance(
                equilateral_triangle(1.0), predicted, sigma_cyc=SIGMA_CYC, **(ERRORS if errors else {})
            )
            for scenario, places in SCENARIOS.items():
                received = _directions(places)
                found = _rates(settings, 10 * stream + 2 * int(scenario) + errors, predicted, received, errors)
                apart = (received - predicted) @ design.T
                for k, sat in enumerate(sats):
                    covariance_of_sat = covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2]
                    for test, p_d, p_fa in zip(("paper", "calibrated"), found[:2], null[:2], strict=True):
                        yield {
                            "location": location,
                            "scenario": scenario,
                            "sat": sat,
                            "p_d_theory": _power(apart[k], covariance_of_sat, test),
                            "p_d_simulated": float(p_d[k]),
                            "p_fa_simulated": float(p_fa[k]),
                            "errors": errors,
                            "test": test,
                        }
                together = float(mahalanobis_squared(apart.ravel(), covariance))
                limit = chi_square_threshold(P_FA, 6)
                yield {
                    "location": location,
                    "scenario": scenario,
                    "sat": "all",
                    "test": "calibrated",
                    "errors": errors,
                    "p_d_theory": float(noncentral_chi_square_survival(limit, 6, together)),
                    "p_d_simulated": found[2],
                    "p_fa_simulated": null[2],
                }


def _power(apart: Reals, covariance: Reals, test: str) -> float:
    """Compute the power of a test.

    The paper's statistic under errors is chi-square scaled by how much they add, nearly the same in all directions.
    """
    stretch = float(np.trace(np.linalg.solve(WHITE, covariance))) / 2.0 if test == "paper" else 1.0
    return float(noncentral_chi_square_survival(THRESHOLD / stretch, 2, mahalanobis_squared(apart, covariance)))


# What errors of position do -------------------------------------------------------------------------------------------


def _in_plane(rng: np.random.Generator, n: int) -> Reals:
    return rng.standard_normal((n, 3, 3)) * [1.0, 1.0, 0.0]


def _without_first(errors: Reals) -> Reals:
    errors[:, 0] = 0.0
    return errors


def _along(rng: np.random.Generator, n: int) -> Reals:
    unit = equilateral_triangle(1.0)
    return np.asarray(rng.standard_normal((n, 3, 1)) * unit)


def _of_fixed_length(rng: np.random.Generator, n: int) -> Reals:
    errors = rng.standard_normal((n, 3, 3))
    return np.asarray(errors / np.linalg.norm(errors, axis=-1, keepdims=True))


ASSUMPTIONS: Final[dict[str, Callable[[np.random.Generator, int], Reals]]] = {
    "per antenna and axis": lambda rng, n: rng.standard_normal((n, 3, 3)),
    "the same, first antenna without": lambda rng, n: _without_first(rng.standard_normal((n, 3, 3))),
    "three antennas, x and y": _in_plane,
    "two antennas, x and y": lambda rng, n: _without_first(_in_plane(rng, n)),
    "in all, 1/sqrt(3) per axis": lambda rng, n: rng.standard_normal((n, 3, 3)) / np.sqrt(3.0),
    "fixed length, any direction": _of_fixed_length,
    "uniform, at most 3 mm per axis": lambda rng, n: rng.uniform(-1.0, 1.0, (n, 3, 3)),
    "along each baseline": _along,
    "common to all antennas": lambda rng, n: np.repeat(rng.standard_normal((n, 1, 3)), 3, axis=1),
    "none": lambda rng, n: np.zeros((n, 3, 3)),
    "0.003 cycles for 3 mm": lambda rng, n: rng.standard_normal((n, 3, 3)) * WAVELENGTH_M,
}
"""What "3 mm" of position error may mean, in units of it."""


def position_error(settings: StudySettings) -> Iterator[Row]:
    """Count false alarms of the paper's test, nominally 1 %, under each meaning of its 3 mm."""
    trials = settings.count(50_000, 20_000)
    for stream, (assumption, draw) in enumerate(ASSUMPTIONS.items()):
        for side, el_deg in ((1.0, 30.0), (5.0, 30.0), (1.0, 22.0), (1.0, 67.0)):
            rng, count = settings.rng(stream), 0
            predicted = _directions([(148.0, el_deg)])
            for start in range(0, trials, CHUNK):
                n = min(CHUNK, trials - start)
                z = draw_residuals(
                    rng,
                    n,
                    predicted,
                    predicted,
                    side=side,
                    position_cyc=0.003 / WAVELENGTH_M * draw(rng, n),
                    attitude_sigma_rad=float(np.radians(0.05)),
                )
                count += int(np.sum(single_statistic(z[:, 0], WHITE) > THRESHOLD))
            yield {
                "assumption": assumption,
                "baseline": side,
                "elevation_deg": el_deg,
                "p_fa": count / trials,
                "trials": trials,
            }


# Eight satellites -----------------------------------------------------------------------------------------------------


SKY_DEG: Final = ((20, 15), (75, 40), (110, 65), (160, 25), (205, 50), (250, 20), (300, 35), (340, 75))


def eight(settings: StudySettings) -> Iterator[Row]:
    """Compute the mean power for one of eight satellites shifted in elevation, at 1 %.

    Tests: `no errors` (the paper's, if there were none), `alone` (calibrated), `conditional` on the others, `joint`.
    """
    sky = _directions(SKY_DEG)
    for side, shifts_deg in ((1.0, (3.0, 5.0, 10.0)), (5.0, (2.0, 3.0))):
        design = array_design(equilateral_triangle(side))
        covariance = residual_covariance(equilateral_triangle(side), sky, sigma_cyc=SIGMA_CYC, **ERRORS)
        information = np.linalg.inv(covariance)
        blocks_of = [np.ix_((2 * k, 2 * k + 1), (2 * k, 2 * k + 1)) for k in range(8)]
        root = np.linalg.cholesky(covariance)
        trials = settings.count(400_000, 50_000)
        noise = (settings.rng(int(side)).standard_normal((trials, 16)) @ root.T).reshape(trials, 8, 2)
        joint = joint_statistic(noise, covariance)
        conditional = conditional_statistics(noise, covariance)
        counted = {
            "no errors": None,
            "alone": float(
                np.mean([single_statistic(noise[:, k], covariance[blocks_of[k]]) > THRESHOLD for k in range(8)])
            ),
            "conditional": float(np.mean(conditional > THRESHOLD)),
            "joint": float(np.mean(joint > chi_square_threshold(P_FA, 16))),
        }
        for shift_deg in shifts_deg:
            moved = _directions([(az, el + (shift_deg if el < 70 else -shift_deg)) for az, el in SKY_DEG])
            apart = (moved - sky) @ design.T
            far = {
                "no errors": [mahalanobis_squared(apart[k], WHITE) for k in range(8)],
                "alone": [mahalanobis_squared(apart[k], covariance[blocks_of[k]]) for k in range(8)],
                "conditional": [apart[k] @ information[blocks_of[k]] @ apart[k] for k in range(8)],
            }
            far["joint"] = far["conditional"]
            for test, noncentrality in far.items():
                dof = 16 if test == "joint" else 2
                p_d = noncentral_chi_square_survival(chi_square_threshold(P_FA, dof), dof, noncentrality)
                yield {
                    "baseline": side,
                    "shift_deg": shift_deg,
                    "test": test,
                    "p_d": float(np.mean(p_d)),
                    "p_fa_simulated": counted[test],
                }
