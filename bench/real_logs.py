"""Logs and observation files of real receivers, of the folder that SKYPROOF_DATA names."""

import os
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from skyproof.app.receive.logged import holds_log, open_log
from skyproof.app.receive.observed import ObservedFile, open_observations
from skyproof.arrays import Indices
from skyproof.formats.rinex_nav import read_nav
from skyproof.records import OBSERVABLES, NavigationData, ObservationLog, Observations

_M1, _KM5, _VAR, _GSI = "rinex-mosaic-1m", "rinex-mosaic-5km", "rinex-variety", "rinex-gsi-3km"


@dataclass(frozen=True)
class RealLog:
    """A file of one receiver. nav : of its day, None where the log has its own. stands : the antenna does not move.
    ecef_m : where it stands, of the two 0.99 m apart to millimetres between them."""

    path: str
    nav: str | None = None
    stands: bool = False
    ecef_m: tuple[float, float, float] | None = None


LOGS: Final[dict[str, RealLog]] = {
    "walk": RealLog("imu-gnss-walk/gnss_1730.ubx"),
    "base": RealLog(f"{_M1}/base.obs", f"{_M1}/base.nav", stands=True, ecef_m=(-3817681.121, 3562839.431, 3650159.159)),
    "rover": RealLog(
        f"{_M1}/rover.obs", f"{_M1}/base.nav", stands=True, ecef_m=(-3817681.381, 3562839.979, 3650158.376)
    ),
    "reference": RealLog(
        f"{_KM5}/3034265G.21O", f"{_KM5}/SEPT2650.21P", stands=True, ecef_m=(-3959400.631, 3385704.533, 3667523.111)
    ),
    "car": RealLog(f"{_KM5}/SEPT265G.21O", f"{_KM5}/SEPT2650.21P"),
    "phone_1107": RealLog(
        "phone-orientation/gnss_log_2019_12_12_11_07_38.txt", "phone-orientation/hour3460.19n", stands=True
    ),
    "phone_1125": RealLog(
        "phone-orientation/gnss_log_2019_12_12_11_25_30.txt", "phone-orientation/hour3460.19n", stands=True
    ),
    "gsi_0759": RealLog(f"{_GSI}/07590920.05o", f"{_GSI}/07590920.05n", stands=True),
    "gsi_3040": RealLog(f"{_GSI}/30400920.05o", f"{_GSI}/07590920.05n", stands=True),
    "kms3": RealLog(
        f"{_VAR}/KMS300DNK_R_20221591000_01H_30S_MO.crx", f"{_VAR}/KMS300DNK_R_20221591000_01H_MN.rnx.gz", stands=True
    ),
    "osnma_fgi": RealLog("osnma-sbf/fgi_galrawinav-270923.sbf"),
    "osnma_wt5": RealLog("osnma-sbf/change_wt5.sbf"),
    "osnma_metrics": RealLog("osnma-sbf/custom_metrics.sbf"),
    "osnma_old_town": RealLog("osnma-sbf/old_town_inav.sbf"),
    "osnma_config": RealLog("osnma-sbf/osnma_new_config.sbf"),
    "osnma_park": RealLog("osnma-sbf/park_and_eu_inav.sbf"),
    "osnma_tag_error": RealLog("osnma-sbf/tag_error_12.sbf"),
    "osnma_atomium": RealLog("osnma-sbf/walk_atomium_inav.sbf"),
}


def folder() -> Path:
    """Return where the files are."""
    return Path(os.environ.get("SKYPROOF_DATA", Path(__file__).resolve().parents[2] / "shared" / "data")) / "real"


@cache
def open_real(name: str) -> tuple[ObservedFile, NavigationData]:
    """Return a log, and the orbits of its day."""
    log = LOGS[name]
    path = folder() / log.path
    source = open_log(path) if holds_log(path) else open_observations(path)
    return source, source.decoded if log.nav is None else read_nav(folder() / log.nav)


def cut_log(log: ObservationLog, begin_s: float, end_s: float) -> Observations:
    """Return the epochs with begin <= elapsed time < end; their time counts from the first one."""
    first, stop = (int(row) for row in np.searchsorted(log.elapsed_s, [begin_s, end_s]))
    return take_rows(log.read(first, stop), np.arange(stop - first))


def take_rows(o: Observations, rows: Indices) -> Observations:
    """Return some epochs, as a log of their own: time counts from the first one, where their signals are found."""
    cells: dict[str, Any] = {name: getattr(o, name)[rows] for name in (*OBSERVABLES, "gpst", "elapsed_s", "status")}
    cells["elapsed_s"] = cells["elapsed_s"] - cells["elapsed_s"][0]
    present = np.isfinite(cells["pseudorange_m"])
    seen = present.any(axis=0)
    first = np.where(seen, present.argmax(axis=0), 0)
    signals = np.flatnonzero(seen)
    channels: dict[str, Any] = {
        "found_elapsed_s": cells["elapsed_s"][first][signals],
        "missed_elapsed_s": np.where(first > 0, cells["elapsed_s"][np.maximum(first - 1, 0)], np.nan)[signals],
        "carrier_hz": o.carrier_hz[signals],
        "half_cycle_open": o.half_cycle_open[rows][:, signals],
        "quadrature_m": o.quadrature_m[rows][:, signals],
    }
    kept = {name: values[:, signals] if values.ndim == 2 else values for name, values in cells.items()}
    return replace(o, signals=tuple(o.signals[k] for k in signals), **kept, **channels)
