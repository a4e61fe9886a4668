"""One receiver's measurements in the place of another's: what both have under one transmit antenna."""

from dataclasses import replace

import numpy as np

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.navigation.rates import fill_dopplers
from skyproof.records import CellStatus, Observations

CLOCK_S, DRIFT, NOISE_M = 3.1e-5, 2e-7, 0.3
TOGETHER_S = 0.02


def capture_receiver(own: Observations, other: Observations, row: int, *, rng: np.random.Generator) -> Observations:
    """Replace what `own` measured from epoch `row` on by what `other` did, with its clock and noise.

    Signals that `other` does not have are lost. Each measurement is moved to the instant at which `own` measures:
    its label minus its clock.
    """
    other, _ = fill_dopplers(other)
    nearest = np.clip(np.searchsorted(other.gpst, own.gpst - np.timedelta64(20, "ms")), 0, other.gpst.size - 1)
    apart_s = (own.gpst - other.gpst[nearest]) / np.timedelta64(1, "ns") * 1e-9
    together = np.abs(apart_s) < TOGETHER_S
    after = np.arange(own.gpst.size) >= row
    clock_s = CLOCK_S + DRIFT * (own.elapsed_s - own.elapsed_s[row])
    names = ("pseudorange_m", "carrier_cyc", "doppler_hz", "cn0_dbhz")
    cells = {name: np.where(after[:, None], np.nan, getattr(own, name)) for name in names}
    status = np.where(after[:, None], CellStatus.NOT_TRACKED, own.status).astype(np.uint8)
    for k, signal in enumerate(own.signals):
        if signal not in other.signals:
            continue
        j = other.signals.index(signal)
        rows = np.flatnonzero(after & together & np.isfinite(other.pseudorange_m[nearest, j]))
        theirs, hz = nearest[rows], own.carrier_hz[k]
        cycles = -other.doppler_hz[theirs, j] * (apart_s[rows] - clock_s[rows])
        cells["pseudorange_m"][rows, k] = (
            other.pseudorange_m[theirs, j]
            + SPEED_OF_LIGHT_M_S * (clock_s[rows] + cycles / hz)
            + NOISE_M * rng.normal(size=rows.size)
        )
        cells["carrier_cyc"][rows, k] = other.carrier_cyc[theirs, j] + clock_s[rows] * hz + cycles
        cells["doppler_hz"][rows, k] = other.doppler_hz[theirs, j] - DRIFT * hz
        cells["cn0_dbhz"][rows, k] = other.cn0_dbhz[theirs, j]
        status[rows, k] = other.status[theirs, j]
        status[rows[:1], k] = CellStatus.SLIP
    return replace(own, status=status, **cells)
