"""The paper's scenes through `protect`: what the command calls authentic of the signals that receivers near each other
measure, as the study's functions are asked.

Ranges, noise and skies are those of `multi_receiver_scene`, an epoch a second. They go in as measurements of receivers
that track every signal, true and false, from the first epoch on: what `protect` does with a recording once it is
tracked, and with observation files.
"""

from typing import Any, NamedTuple

import numpy as np

from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings
from skyproof.app.protect import judge
from skyproof.app.receive.reception import Reception
from skyproof.arrays import Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_ecef
from skyproof.records import ArrayPhases, NavigationData, Observations, Samples
from skyproof.simulator.attacks import Meaconer
from skyproof.simulator.measurements import NoiseModel, simulate_observations
from skyproof.simulator.scenario import Scenario, ScenePlace, SceneReceiver, Sky
from skyproof.studies.multi_receiver_scene import (
    BASE_GEODETIC,
    CARRIER_PER_CODE,
    DELAY_M,
    MEACONER_ENU_M,
    PLACES,
    WAVELENGTH_M,
    Noise,
    skies,
)

__all__ = ["Judged", "build_reception", "judge_sky"]

_CN0_DBHZ = 45.0
_CLOCKS_S = (1.9e-4, -2.7e-4, 4.2e-4, -1.1e-4)


class Judged(NamedTuple):
    """true, false : of seven true and seven false signals in a receiver, how many are authentic at the end, mean over
    receivers. word : the verdict."""

    true: float
    false: float
    word: str


def judge_sky(
    sky: int,
    names: tuple[str, ...],
    window_s: int,
    noise: Noise,
    rng: np.random.Generator,
    *,
    places_given: bool,
    cn0_dbhz: tuple[float, float] = (_CN0_DBHZ, _CN0_DBHZ),
) -> Judged:
    """Judge one draw of errors in the sky of this number, as `protect` does by default.

    places_given : whether the user states where the antennas stand. cn0_dbhz : of true and of false signals; `noise` is
    that at 45 dB-Hz, and grows as thermal noise does.
    """
    when, orbits = skies()[sky]
    navigation = NavigationData(ephemerides=orbits)
    scenario = _scenario(when, tuple(orbit.sat for orbit in orbits), names, window_s, cn0_dbhz)
    errors = NoiseModel(
        sigma_m=noise.sigma_m,
        reference_cn0_dbhz=_CN0_DBHZ,
        ar1=noise.phi,
        constant_m=noise.constant_m,
        carrier_sigma_cyc=CARRIER_PER_CODE * noise.sigma_m / WAVELENGTH_M,
    )
    observed, truth = simulate_observations(scenario, navigation, rng=rng, noise=errors)
    places: dict[str, Any] = {"antennas_enu_m": {name: tuple(PLACES[name]) for name in names}} if places_given else {}
    outcome, _ = judge([build_reception(item) for item in observed], navigation, Settings(**places), Silent())
    last = {item.receiver: item.gpst.size - 1 for item in observed}
    counts = dict.fromkeys(("authentic", "spoofed"), 0)
    for item in outcome.decision.labels:
        if item.label == "authentic" and item.last_epoch == last[item.ref.receiver]:
            counts[truth[item.ref]] += 1
    return Judged(counts["authentic"] / len(names), counts["spoofed"] / len(names), outcome.decision.verdict)


def _scenario(
    when: np.datetime64,
    sats: tuple[str, ...],
    names: tuple[str, ...],
    window_s: int,
    cn0_dbhz: tuple[float, float],
) -> Scenario:
    true_dbhz, false_dbhz = cn0_dbhz
    meaconer: Any = ScenePlace(**_place(MEACONER_ENU_M))
    return Scenario(
        start_gpst=when,
        duration_s=float(window_s),
        receivers=tuple(
            SceneReceiver(name=name, **_place(PLACES[name]), clock_offset_s=clock_s)
            for name, clock_s in zip(names, _CLOCKS_S, strict=False)
        ),
        sky=Sky(zenith_cn0_dbhz=true_dbhz, horizon_cn0_dbhz=true_dbhz, sats=sats),
        attacks=(
            Meaconer(
                receive=meaconer,
                transmit=meaconer,
                delay_s=DELAY_M / SPEED_OF_LIGHT_M_S,
                power_db=false_dbhz - true_dbhz,
                onset_s=-1.0,
            ),
        ),
    )


def _place(enu_m: Reals) -> dict[str, Any]:
    base_ecef_m, rot = ecef_from_geodetic(*BASE_GEODETIC), rot_enu_ecef(*BASE_GEODETIC[:2])
    lat_rad, lon_rad, height_m = geodetic_from_ecef(base_ecef_m + rot.T @ enu_m)
    return {
        "lat_deg": float(np.degrees(lat_rad)),
        "lon_deg": float(np.degrees(lon_rad)),
        "height_m": float(height_m),
    }


def build_reception(observed: Observations, array_phases: ArrayPhases | None = None) -> Reception:
    """Build the reception of a receiver that measured it, and on its antennas; there are no samples."""
    source = Samples(
        name=observed.receiver, rate_hz=1.0, n_samples=0, read=lambda start, count: np.empty((2, 0), np.float32)
    )
    return Reception(
        source=source,
        observations=observed,
        decoded=NavigationData(ephemerides=()),
        n_signals=len(observed.signals),
        examined_s=float(observed.elapsed_s[-1]),
        array_phases=array_phases,
    )
