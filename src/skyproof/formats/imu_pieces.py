"""Inertial readings of a long run on a disk in pieces, read back by window: only their times stay in memory."""

from typing import Final

import numpy as np

from skyproof.arrays import Instants, Reals
from skyproof.formats.imu import ImuFile
from skyproof.formats.pieces import ArrayPieces, Workspace
from skyproof.records import ImuSeries

__all__ = ["StoredImuFile", "StoredReadings", "store_readings"]

HELD_READINGS: Final = 1 << 16
"""As many stay in memory, of 48 bytes each: eleven minutes at 100 Hz."""
PIECE_READINGS: Final = 1 << 14
_VALUES: Final = ("specific_force_m_s2", "angular_rate_rad_s")


class StoredReadings:
    """`InertialReadings` whose values are on a disk."""

    def __init__(self, gpst: Instants, interval_s: float, pieces: ArrayPieces) -> None:
        """Join pieces of `PIECE_READINGS` readings each, the last one with fewer. `gpst` (n,) holds all times."""
        self.gpst, self.interval_s, self._pieces = gpst, interval_s, pieces
        self._each = len(pieces.read_one(0, "specific_force_m_s2"))

    def select(self, rows: slice) -> ImuSeries:
        """Return the readings in a slice without a step, read back. Raises OSError if they cannot be."""
        first, stop, _ = rows.indices(self.gpst.size)
        stop = max(first, stop)
        parts: dict[str, list[Reals]] = {name: [np.empty((0, 3))] for name in _VALUES}
        for number in range(first // self._each, -(-stop // self._each)):
            begin = number * self._each
            piece = self._pieces.read(number)
            for name in _VALUES:
                parts[name].append(piece[name][max(first - begin, 0) : stop - begin])
        values: dict[str, Reals] = {name: np.concatenate(arrays) for name, arrays in parts.items()}
        return ImuSeries(gpst=self.gpst[first:stop], interval_s=self.interval_s, **values)


class StoredImuFile:
    """An `ImuFile` whose values are on a disk; it gives the same series."""

    def __init__(self, imu: ImuFile, workspace: Workspace) -> None:
        """Write the values of a file with readings."""
        self.source, self.remarks, self.interval_s = imu.source, imu.remarks, imu.interval_s
        self._time_ns, self._dated = imu.time_ns, imu.dated
        self._zero: np.datetime64 | None = None
        self._gpst: Instants = imu.time_ns.view("datetime64[ns]")
        self._pieces = ArrayPieces(workspace, "inertial")
        for first in range(0, imu.time_ns.size, PIECE_READINGS):
            rows = slice(first, first + PIECE_READINGS)
            self._pieces.append(
                {
                    "time_ns": imu.time_ns[rows],
                    "specific_force_m_s2": imu.specific_force_m_s2[rows],
                    "angular_rate_rad_s": imu.angular_rate_rad_s[rows],
                }
            )

    def series(self, zero_gpst: np.datetime64) -> StoredReadings:
        """Return the readings in GPS time, as `ImuFile.series` does."""
        zero: np.datetime64 = zero_gpst.astype("datetime64[ns]")
        if not self._dated and zero != self._zero:
            self._zero = zero
            self._gpst = np.asarray(zero + self._time_ns.astype("timedelta64[ns]"))
        return StoredReadings(self._gpst, self.interval_s, self._pieces)


def store_readings(imu: ImuFile, workspace: Workspace) -> ImuFile | StoredImuFile:
    """Keep few readings in memory, and more on the disk of the workspace, in a folder "inertial"."""
    return imu if imu.time_ns.size <= HELD_READINGS else StoredImuFile(imu, workspace)
