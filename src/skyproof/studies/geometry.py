"""What an array or a turning arm misses, for the user's own: which baseline, how many elements, which arm and rate.

A single false signal among true ones is the hardest case: it is missed where the directions that it comes from and
should come from look alike. Signals of several satellites from one place are found where each alone would be missed.
"""

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.array.array_model import array_design, white_covariance
from skyproof.detectors.array.policy import POLICY as ARRAY
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.records import AntennaArray, SpinArm
from skyproof.report.chart import Axes
from skyproof.statistics.directions import direction_cosines, hemisphere
from skyproof.studies.arm_angles import arm_angles, full_information
from skyproof.studies.array_geometry import equilateral_triangle, regular_tetrahedron
from skyproof.studies.base import Row, Study, StudySettings
from skyproof.studies.direction_tests import measure_dead_zone

__all__ = ["STUDIES"]

WAVE_M: Final = SPEED_OF_LIGHT_M_S / L1_HZ
SIGMA_CYC: Final = 0.01
POSITION_SIGMA_M: Final = 0.003
"""Where the array does not state it."""
LASTING_CYC: Final = 0.01
"""What reflections write into a phase in step with an arm, as `SpinSettings` has it."""
RATE_HZ: Final = 10.0
ARM_ELEVATION_DEG: Final = 30.0

ARRAYS: Final = {
    "triangle, half a wavelength": AntennaArray(
        elements_m=equilateral_triangle(0.5 * WAVE_M), sigma_m=POSITION_SIGMA_M
    ),
    "triangle, one wavelength": AntennaArray(elements_m=equilateral_triangle(WAVE_M), sigma_m=POSITION_SIGMA_M),
    "triangle, two wavelengths": AntennaArray(elements_m=equilateral_triangle(2.0 * WAVE_M), sigma_m=POSITION_SIGMA_M),
    "tetrahedron, one wavelength": AntennaArray(
        elements_m=regular_tetrahedron(WAVE_M) * [1.0, 1.0, -1.0], sigma_m=POSITION_SIGMA_M
    ),
}
ARMS: Final = tuple(
    SpinArm(
        receiver=f"{100 * radius_m:g} cm, a turn in {turn_s:g} s", radius_m=radius_m, rate_rad_s=2.0 * np.pi / turn_s
    )
    for radius_m, turn_s in ((0.05, 4.0), (0.1, 4.0), (0.2, 4.0), (0.1, 2.0))
)


def array(settings: StudySettings) -> Iterator[Row]:
    """Share of the sky from where a false signal is found with less than 0.99 at a false-alarm probability of 0.01, by
    the elevation of its satellite, mean over azimuths; whole cycles unknown, attitude and lines known, body level."""
    azimuths = np.arange(8 if settings.quick else 24) * 2.0 * np.pi / (8 if settings.quick else 24)
    received = hemisphere(4000 if settings.quick else 20_000)
    arrays: Mapping[str, AntennaArray] = settings.arrays or ARRAYS
    for name, antennas in arrays.items():
        elements_cyc = np.asarray(antennas.elements_m) * [1.0, 1.0, -1.0] / WAVE_M  # up, as directions count
        known_m = POSITION_SIGMA_M if antennas.sigma_m is None else antennas.sigma_m
        sigma_cyc = np.full(len(elements_cyc), np.hypot(SIGMA_CYC, known_m / WAVE_M))
        for elevation_deg in range(5, 90, 5):
            predicted = direction_cosines(azimuths, np.radians(elevation_deg))
            missed = _miss_percent(
                predicted, received, array_design(elements_cyc), white_covariance(sigma_cyc), wrapped=True
            )
            yield {
                "array": name,
                "antennas": len(elements_cyc),
                "elevation_deg": elevation_deg,
                "missed_percent": missed,
            }


def arm(settings: StudySettings) -> Iterator[Row]:
    """Compute the missed share for a satellite at 30 degrees, by the seconds of ten measurements a second."""
    azimuths = np.arange(8) * 2.0 * np.pi / 8
    predicted = direction_cosines(azimuths, np.radians(ARM_ELEVATION_DEG))
    received = hemisphere(4000 if settings.quick else 20_000)
    for turning_arm in settings.arms or ARMS:
        for seconds in range(2, 31):
            degree = 2 if seconds <= ARRAY.quadratic_lasts_s else 3
            angle = arm_angles(round(seconds * RATE_HZ), turning_arm.rate_rad_s / RATE_HZ)
            sigma_cyc = SIGMA_CYC * np.sqrt(2.0)
            radius_cyc = turning_arm.radius_m / WAVE_M
            information = full_information(angle, radius_cyc=radius_cyc, sigma_cyc=sigma_cyc, degree=degree)
            covariance = np.linalg.inv(information) + 2.0 * (LASTING_CYC / radius_cyc) ** 2 * np.eye(2)
            missed = _miss_percent(predicted, received, np.eye(3)[:2], np.asarray(covariance, np.float64))
            yield {
                "arm": turning_arm.receiver,
                "turns": float(abs(turning_arm.rate_rad_s) * seconds / (2.0 * np.pi)),
                "seconds": seconds,
                "missed_percent": missed,
            }


def _miss_percent(
    predicted: Reals, received: Reals, design: Reals, covariance: Reals, *, wrapped: bool = False
) -> float:
    """Return the missed share in percent of the directions received."""
    counts = measure_dead_zone(predicted, received, design, covariance, wrapped=wrapped)
    return float(100.0 * np.mean(counts) / len(received))


_OWN: Final = "no paper: an array or an arm of your own, with --platform"

STUDIES = (
    Study(
        name="geometry.array",
        title="From how much of the sky a single false signal is missed by an array",
        paper=_OWN,
        figure="none",
        run=array,
        platform="antennas_m",
        charts=(
            Axes(
                title="A single false signal, missed with 1 % or more",
                x="elevation_deg",
                y="missed_percent",
                x_label="elevation of its satellite, deg",
                y_label="missed from, % of the sky",
                by=("array",),
                y_log=True,
            ),
        ),
    ),
    Study(
        name="geometry.arm",
        title="From how much of the sky a single false signal is missed by a turning arm",
        paper=_OWN,
        figure="none",
        run=arm,
        platform="spin",
        charts=(
            Axes(
                title="A single false signal, missed with 1 % or more",
                x="seconds",
                y="missed_percent",
                x_label="window, s",
                y_label="missed from, % of the sky",
                by=("arm",),
                y_log=True,
            ),
        ),
    ),
)
