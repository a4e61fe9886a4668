"""Model how signals that do not fit together displace the correlators of a vector tracking receiver.

A vector receiver steers all its channels by one solution. Signals that do not fit one position and clock cannot all be
followed; the loops settle with constant offsets of code and phase on every channel. They show inconsistency between
satellites, not spoofing: an attack in which all signals agree with one false place and time shows nothing.

Source: X. Zhang, H. Li, C. Yang and M. Lu, IET Radar, Sonar & Navigation, 2020, doi 10.1049/iet-rsn.2020.0021; numbers
in brackets are its equations. Its rule looks at the satellite with the largest parameter; its false-alarm probability
(30) is that of a satellite chosen beforehand. `rule_alarm_probability` is the true one. What is better stands
in `vector_parity`.

Offsets are received minus local, in chips and radians; satellites along the last axis, leading axes free.
"""

from typing import NamedTuple

import numpy as np

from skyproof.arrays import Reals

__all__ = ["SatelliteGeometry", "satellite_geometry"]


# Geometry -------------------------------------------------------------------------------------------------------------


class SatelliteGeometry(NamedTuple):
    """Matrices that follow from the directions of n satellites.

    Design G (..., n, 4); projector S = I - G (G^T G)^-1 G^T (..., n, n); parity basis B (..., n - 4, n) with
    orthonormal rows and B G = 0; a basis Q (..., n, 4) of the columns of G."""

    design: Reals
    projector: Reals
    parity: Reals
    span: Reals


def satellite_geometry(design: Reals) -> SatelliteGeometry:
    """Compute projector and bases of a design matrix (..., n, 4).

    With n <= 4 the parity basis is empty and nothing is detected.
    """
    rotation, _, _ = np.linalg.svd(design, full_matrices=True)
    span, parity = rotation[..., :4], np.swapaxes(rotation[..., 4:], -1, -2)
    return SatelliteGeometry(design, np.asarray(np.swapaxes(parity, -1, -2) @ parity), parity, span)


# Equilibrium ----------------------------------------------------------------------------------------------------------


# The rule of the paper ------------------------------------------------------------------------------------------------
