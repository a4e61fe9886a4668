"""The types of arrays, by what stands in them; shapes and units are in the docstrings."""

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Booleans",
    "ComplexFloats",
    "Complexes",
    "Floats",
    "Indices",
    "Instants",
    "Integers",
    "Octets",
    "Reals",
]

Reals = NDArray[np.float64]
Floats = NDArray[np.float32]
Complexes = NDArray[np.complex128]
ComplexFloats = NDArray[np.complex64]
Integers = NDArray[np.int64]
Indices = NDArray[np.intp]
Booleans = NDArray[np.bool_]
Octets = NDArray[np.uint8]
Instants = NDArray[np.datetime64]
