"""Directions that the phases of an array allow."""

import numpy as np
import pytest

from skyproof.detectors.array.agreement import Agreement, ArrayFrame, MeanPhases
from skyproof.detectors.array.array_model import array_design, white_covariance
from skyproof.detectors.array.arrivals import across, find_arrivals
from skyproof.statistics.directions import direction_cosines
from skyproof.studies.array_geometry import equilateral_triangle


def find_from(direction, elements, sigma_cyc=0.01):
    """Find arrivals of a signal by a calibrated array, no other signal being known."""
    frame = ArrayFrame(
        turn=np.eye(3),
        bias_cyc=np.zeros(len(elements) - 1),
        attitude_covariance_rad2=np.zeros((3, 3)),
        bias_sigma_cyc=1e-6,
    )
    none = np.zeros(0, np.intp)
    agreed = Agreement(
        frame=frame, members=none, residual_cyc=np.zeros((0, len(elements) - 1)), p_value=1.0, p_values=none, cost=0.0
    )
    measured = MeanPhases(
        cycles=np.zeros((0, len(elements) - 1)),
        direction=np.zeros((0, 3)),
        sigma_cyc=np.zeros((0, len(elements))),
        elements_cyc=elements,
        ratio=np.zeros(0),
        position_sigma_cyc=1e-6,
    )
    cycles = array_design(elements) @ direction
    return find_arrivals(measured, agreed, cycles - np.rint(cycles), white_covariance([sigma_cyc] * len(elements)))


@pytest.mark.parametrize("el_deg", [3.0, 25.0, 60.0, 85.0])
@pytest.mark.parametrize("side", [0.5, 1.0, 2.0])
def test_the_true_direction_is_one_of_a_few(side, el_deg):
    direction = direction_cosines(np.radians(150.0), np.radians(el_deg))
    found = find_from(direction, equilateral_triangle(side))
    near = [result for result in found if result.direction @ direction > 0.9]
    off = [across(result.direction) @ (direction - result.direction) for result in near]
    assert min(a @ np.linalg.solve(result.covariance_rad2, a) for a, result in zip(off, near, strict=True)) < 9.0
    # Those that whole cycles leave open within the circle of level directions, above and below the plane.
    assert len(found) <= 2 * (3.7 * side**2 + 3.0)


def test_a_direction_known_better_than_the_grid_is_found():
    elements = np.array([(k // 3, k % 3, 0.0) for k in range(7)]) * 0.7
    for az_deg in range(0, 360, 30):
        direction = direction_cosines(np.radians(az_deg), np.radians(40.0))
        found = find_from(direction, elements, sigma_cyc=1e-4)
        assert min(float(np.linalg.norm(result.direction - direction)) for result in found) < 1e-4


def test_antennas_out_of_the_plane_leave_one_direction():
    direction = direction_cosines(np.radians(150.0), np.radians(-25.0))
    elements = np.vstack([equilateral_triangle(0.5), [[0.25, 0.14, 0.4]]])
    (only,) = find_from(direction, elements)
    np.testing.assert_allclose(only.direction, direction, atol=1e-4)


@pytest.mark.parametrize("el_deg", [9.0, 15.0, 40.0])
@pytest.mark.parametrize("sigmas", [-3.0, 3.0])
def test_three_phase_sigmas_bound_the_ellipse_near_the_plane(el_deg, sigmas):
    side, sigma_cyc = 0.5, 0.0006
    seen = direction_cosines(0.0, np.radians(el_deg))
    true_rad = np.arccos(np.cos(np.radians(el_deg)) + sigmas * np.sqrt(2.0) * sigma_cyc / side)
    true = direction_cosines(0.0, true_rad)
    found = find_from(seen, equilateral_triangle(side), sigma_cyc)
    (near,) = [result for result in found if result.direction @ seen > 0.99 and result.direction[2] > 0.0]
    off = across(near.direction) @ (true - near.direction)
    assert 2.4 < np.sqrt(off @ np.linalg.solve(near.covariance_rad2, off)) < 3.05
