"""The sky of the vector tracking studies.

The paper shows a picture of its sky and no angles. This one was chosen so that S_22, on which its Table 2 depends
almost alone, is 0.4454, that PRN 2 has the largest parameter when attacked alone and PRN 20 in the attack on three.
Many skies would do; the authors' cannot be recovered.
"""

from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.correlators.vector_sqm import SatelliteGeometry, satellite_geometry
from skyproof.studies.vector_rules import geometry_matrix

__all__ = ["CHIPS", "HZ", "PRNS", "SKY", "attack_on", "of_prn"]

PRNS: Final = (2, 12, 13, 17, 20, 28)
_AZIMUTH_DEG: Final = (274.0, 327.0, 90.0, 239.0, 168.0, 212.0)
_ELEVATION_DEG: Final = (21.0, 24.0, 26.0, 73.0, 57.0, 31.0)
SKY: Final[SatelliteGeometry] = satellite_geometry(
    geometry_matrix(np.radians(_AZIMUTH_DEG), np.radians(_ELEVATION_DEG))
)

CHIPS, HZ = 0.4, 200.0  # the attack of Table 2, on PRN 2


def of_prn(prn: int) -> int:
    """Place of a satellite in the arrays."""
    return PRNS.index(prn)


def attack_on(*prns: int, size: float = 1.0) -> Reals:
    """`size` on each satellite named, zero on the others: (6,)."""
    return np.where(np.isin(PRNS, prns), size, 0.0)
