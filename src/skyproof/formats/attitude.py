"""Read a body's attitude over time from CSV or Parquet, as a compass or an inertial system logs it.

Columns: `gpst` or `time_s` (see `skyproof.formats.timed_rows`), `heading_deg` (from true north to the right),
`pitch_deg` (forward up), `roll_deg` (right side down). A row that lacks an angle is left out.
"""

import os
from dataclasses import dataclass
from typing import Final

import numpy as np

from skyproof.arrays import Indices, Instants, Integers, Reals
from skyproof.errors import InputError
from skyproof.formats.timed_rows import TimedRows, read_timed_rows
from skyproof.records import Attitude
from skyproof.remarks import Remark, RemarkKind

__all__ = ["COLUMNS", "AttitudeFile", "read_attitude"]

COLUMNS: Final = "heading_deg", "pitch_deg", "roll_deg"
_MOST_DEG: Final = np.array([360.0, 90.0, 360.0])  # either way
_CIRCLE_RAD: Final = 6.0, 7.0  # what headings in radians fill, and stay below


@dataclass(frozen=True, eq=False, kw_only=True)
class AttitudeFile:
    """Angles over time, but for the instant of `time_s` = 0, which the file does not state.

    time_ns : (n,) of `datetime64[ns]` if `dated`, else since `time_s` = 0. angles_rad : (n, 3) heading, pitch, roll.
    """

    source: str
    time_ns: Integers
    dated: bool
    angles_rad: Reals
    remarks: tuple[str, ...] = ()

    def attitude(self, zero_gpst: np.datetime64, sigma_rad: float) -> Attitude:
        """Convert the angles to GPS time.

        zero_gpst : instant of `time_s` = 0, unused where the file has `gpst`.
        """
        zero: np.datetime64 = np.datetime64(0, "ns") if self.dated else zero_gpst.astype("datetime64[ns]")
        gpst: Instants = zero + self.time_ns.astype("timedelta64[ns]")
        return Attitude(gpst=gpst, angles_rad=self.angles_rad, sigma_rad=sigma_rad)


def read_attitude(path: str | os.PathLike[str]) -> AttitudeFile:
    """Read the angles in a file that ends in .csv or .parquet.

    Raises
    ------
    InputError : as `read_timed_rows`; fewer than two whole rows, or angles that are none in degrees.
    """
    rows = read_timed_rows(path, COLUMNS, "the attitude")
    whole = np.flatnonzero(np.isfinite(rows.values).all(axis=1))
    if whole.size < 2:
        raise InputError(
            f"{rows.source}: {whole.size} rows have all three angles, expected two or more; give angles that stay as "
            "numbers in [attitude] of the platform file"
        )
    angles_deg = rows.values[whole]
    _require_degrees(rows, angles_deg, whole)
    return AttitudeFile(
        source=rows.source,
        time_ns=rows.time_ns[whole],
        dated=rows.dated,
        angles_rad=np.radians(angles_deg),
        remarks=(*rows.remarks, *_make_remarks(angles_deg, len(rows.values) - whole.size)),
    )


def _require_degrees(rows: TimedRows, angles_deg: Reals, whole: Indices) -> None:
    """Raise InputError for an angle that is none in degrees."""
    beyond = np.argwhere(np.abs(angles_deg) > _MOST_DEG)
    if beyond.size:
        row, column = (int(k) for k in beyond[0])
        raise InputError(
            f"{rows.where(int(whole[row]))}, {COLUMNS[column]}: {angles_deg[row, column]:g}, expected "
            f"{_MOST_DEG[column]:g} degrees or less either way; fix the angle or leave the row out"
        )


def _make_remarks(angles_deg: Reals, left_out: int) -> tuple[str, ...]:
    headings = angles_deg[:, 0]
    circle = np.abs(headings).max() < _CIRCLE_RAD[1] and np.ptp(headings) > _CIRCLE_RAD[0]
    return (
        *([Remark(f"{left_out} rows without all three angles are left out", RemarkKind.BEARS)] if left_out else []),
        *(
            [
                f"the headings fill {headings.min():.2f} to {headings.max():.2f} degrees, as a full circle does in "
                "radians: multiply all angles by 180 / pi if they are that"
            ]
            if circle
            else []
        ),
    )
