"""Where each number of an orbit stands in the rows that kernels take, and how many numbers a state has."""

from typing import Final

KIND, WEEK, TOE, AHEAD, TOC_WEEK, TOC, AF0, AF1, AF2 = range(9)
"""Of every row: form of the orbit; `AHEAD` is GPS time minus the system's, in seconds."""
MU, ROTATION, RELATIVITY, SQRT_A, E, I0, OMEGA0, OMEGA, M0, DELTA_N, IDOT, OMEGA_DOT = range(9, 21)
CRS, CRC, CUS, CUC, CIS, CIC, A_DOT, DELTA_N_DOT = range(21, 29)
"""Of Kepler's form, after its constants of nature."""
POSITION, VELOCITY, ACCELERATION = 9, 12, 15
"""Of GLONASS's form: where three numbers of each begin."""
N_ORBIT: Final = 29
KEPLER, GEOSTATIONARY, GLONASS = 0.0, 1.0, 2.0
N_STATE: Final = 8
"""Position and velocity, ECEF; clock, s; its drift, s/s."""
