"""What a platform file says of antennas: where those of an array are, and which one turns."""

from collections.abc import Mapping
from math import pi

import numpy as np

from skyproof.app.common.platform_tables import PlatformReceiver
from skyproof.errors import SettingsError
from skyproof.records import AntennaArray, SpinArm

__all__ = ["build_arrays", "build_spin_arms", "is_array"]


def is_array(table: PlatformReceiver) -> bool:
    """Test whether a receiver's table describes several antennas."""
    return max(len(table.inputs), len(table.antennas_m or ())) > 1


def build_arrays(
    tables: Mapping[str, PlatformReceiver], n_antennas: Mapping[str, int], where: str = "the platform file"
) -> dict[str, AntennaArray]:
    """Build the antenna arrays of the receivers whose antenna places are known.

    n_antennas : that each receiver's inputs have.

    Raises
    ------
    SettingsError : a table has more or fewer antennas than the inputs.
    """
    arrays = {}
    for name, table in tables.items():
        count = n_antennas[name]
        for key in ("antennas_m", "line_bias_cyc"):
            values = getattr(table, key)
            if values is not None and len(values) != count:
                raise SettingsError(
                    f"{where}: {key} of receiver {name} has {len(values)} antennas, but its inputs have {count}; give "
                    "one for each antenna: a file each, or one file whose channels they are"
                )
        if count > 1 and table.antennas_m is not None:
            arrays[name] = AntennaArray(
                elements_m=np.array(table.antennas_m, np.float64),
                sigma_m=table.antenna_sigma_m,
                pattern_sigma_m=table.antenna_pattern_sigma_m,
                line_bias_cyc=None if table.line_bias_cyc is None else np.array(table.line_bias_cyc, np.float64),
            )
    return arrays


def build_spin_arms(tables: Mapping[str, PlatformReceiver]) -> tuple[SpinArm, ...]:
    """Build the arms that turn a receiver's antenna."""
    return tuple(
        SpinArm(
            receiver=name,
            radius_m=table.spin.radius_m,
            rate_rad_s=2.0 * pi * table.spin.rate_hz,
            rate_sigma_rad_s=2.0 * pi * table.spin.rate_sigma_hz,
            pattern_sigma_m=table.antenna_pattern_sigma_m,
        )
        for name, table in tables.items()
        if table.spin is not None
    )
