"""Measurements from first principles, for the tests of this room: the light-time equation solved per satellite.

Written on its own: it shares orbits and atmosphere with the package, but neither the solver nor the correction of
ranges. Everything is done in an inertial frame that agrees with ECEF at reception.
"""

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skyproof.gnss.atmosphere import compute_klobuchar_s, compute_troposphere_m
from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.orbits import compute_satellite_state_s
from skyproof.gnss.time import gpst as instant
from skyproof.gnss.time import week_and_tow
from skyproof.records import NavigationData, Observations, SignalId

C = 299792458.0
EARTH_RATE = 7.2921151467e-5
WAVELENGTH = C / 1575.42e6
START = np.datetime64("2022-03-04T05:10:00", "ns")


def make_navigation(start: np.datetime64 = START) -> NavigationData:
    return make_nominal_constellation(start)


def place(lat_deg: float, lon_deg: float, height_m: float) -> np.ndarray:
    return ecef_from_geodetic(np.radians(lat_deg), np.radians(lon_deg), height_m)


def move_place(position: np.ndarray, east_m: float, north_m: float, up_m: float) -> np.ndarray:
    lat, lon, _ = geodetic_from_ecef(position)
    return position + rot_enu_ecef(lat, lon).T @ np.array([east_m, north_m, up_m])


def rotate(vector: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
    """Rotate about the Earth's axis by `angle_rad`, in the sense in which the Earth turns."""
    s, c = np.sin(angle_rad), np.cos(angle_rad)
    x, y, z = np.moveaxis(vector, -1, 0)
    return np.stack((c * x - s * y, s * x + c * y, z), axis=-1)


@dataclass(frozen=True)
class Truth:
    """What one satellite's signal measures: arrays (n_epochs,); `airless_m` is without ionosphere and troposphere."""

    pseudorange_m: np.ndarray
    carrier_m: np.ndarray
    airless_m: np.ndarray
    elevation_rad: np.ndarray


def measure(
    nav: NavigationData, sat: str, gpst: np.ndarray, position: np.ndarray, bias_s, *, air: bool = True
) -> Truth:
    """Measure pseudorange and carrier range at clock labels `gpst`, at `position` (3,) or (n, 3).

    `bias_s`: label minus true time. The true time of reception is never formed as a number: times count from the label.
    """
    (ephemeris,) = [e for e in nav.ephemerides if e.sat == sat]
    week, tow = week_and_tow(gpst)
    position = np.broadcast_to(position, (gpst.size, 3))
    bias_s = np.broadcast_to(np.asarray(bias_s, float), gpst.shape)
    travel = np.full(gpst.shape, 0.07)
    for _ in range(5):  # each round is a million times closer
        state = compute_satellite_state_s(ephemeris, week, tow - bias_s - travel)
        # In the inertial frame that is ECEF at reception, a thing fixed to the Earth stood `travel` further west.
        satellite = rotate(state.position_ecef_m, -EARTH_RATE * travel)
        distance = np.linalg.norm(satellite - position, axis=-1)
        travel = distance / C
    lat, lon, height = geodetic_from_ecef(position)
    enu = np.einsum("nij,nj->ni", rot_enu_ecef(lat, lon), satellite - position)
    elevation = np.arcsin(enu[:, 2] / distance)
    azimuth = np.arctan2(enu[:, 0], enu[:, 1])
    troposphere, ionosphere = np.zeros_like(distance), np.zeros_like(distance)
    if air:
        above = np.maximum(elevation, 0.0)
        troposphere = compute_troposphere_m(lat, height, above) * np.exp(-np.clip(height - 11000, 0, 1e6) / 6340)
        ionosphere = C * compute_klobuchar_s(nav.ionosphere, lat, lon, azimuth, above, tow - bias_s)
    airless = distance + C * bias_s - C * (state.clock_s - ephemeris.tgd)
    return Truth(airless + troposphere + ionosphere, airless + troposphere - ionosphere, airless, elevation)


@dataclass(frozen=True)
class Scene:
    """A receiver's observations and, per channel, the index of the sky that it belongs to."""

    observations: Observations
    owners: np.ndarray

    def list_owners(self, signals: tuple[SignalId, ...]) -> list[int]:
        return [int(self.owners[self.observations.signals.index(signal)]) for signal in signals]


def list_visible(
    nav: NavigationData, position: np.ndarray, mask_deg: float = 7.0, at: np.datetime64 = START
) -> list[str]:
    sats = [e.sat for e in nav.ephemerides]
    elevations = [measure(nav, s, np.array([at]), position, 0.0).elevation_rad[0] for s in sats]
    return [s for s, e in zip(sats, elevations, strict=True) if np.degrees(e) > mask_deg]


def make_scene(
    nav: NavigationData,
    skies: list[tuple[list[str], np.ndarray, float]],
    *,
    n: int = 10,
    step_s: float = 1.0,
    noise_m: float = 0.0,
    constant_m: float = 0.0,
    drift: float = 0.0,
    start: np.datetime64 = START,
    air: bool = True,
    rng: np.random.Generator | None = None,
    shuffle: bool = False,
) -> Scene:
    """Make skies (satellites, position, clock bias) as one receiver sees them, channels a, b, c of a satellite.

    noise_m : white, per epoch; constant_m : once per channel; both Gaussian, one sigma. With `shuffle` which sky gets
    which copy letter is random, satellite by satellite.
    """
    rng = rng or np.random.default_rng(0)
    elapsed = np.arange(n) * step_s
    gpst = start + np.rint(elapsed * 1e9).astype("timedelta64[ns]")
    found: dict[str, list[tuple[int, Truth]]] = {}
    for k, (sats, position, bias_s) in enumerate(skies):
        for sat in sats:
            truth = measure(nav, sat, gpst, position, bias_s + drift * elapsed, air=air)
            found.setdefault(sat, []).append((k, truth))
    signals, truths, owners = [], [], []
    for sat in sorted(found):
        order = rng.permutation(len(found[sat])) if shuffle else np.arange(len(found[sat]))
        for letter, k in zip("abcdefgh", order, strict=False):
            owner, truth = found[sat][k]
            signals.append(SignalId(sat, copy=letter))
            truths.append(truth)
            owners.append(owner)
    code, carrier, airless = (
        np.array([getattr(t, name) for t in truths]).T for name in ("pseudorange_m", "carrier_m", "airless_m")
    )
    code = code + noise_m * rng.standard_normal(code.shape) + constant_m * rng.standard_normal(code.shape[1])
    rate = np.gradient(airless, elapsed, axis=0) if n > 1 else np.zeros_like(carrier)
    channels = len(signals)
    observations = Observations(
        receiver="rx",
        signals=tuple(signals),
        gpst=gpst,
        elapsed_s=elapsed,
        pseudorange_m=code,
        carrier_cyc=(carrier - carrier[0] + np.arange(channels) * 1000.0) / WAVELENGTH,
        doppler_hz=-rate / WAVELENGTH,
        cn0_dbhz=np.full(code.shape, 45.0),
        pseudorange_sigma_m=np.full(code.shape, max(noise_m, 1e-3)),
        carrier_sigma_cyc=np.full(code.shape, 1e-6),
        doppler_sigma_hz=np.full(code.shape, 0.1),
        status=np.zeros(code.shape, np.uint8),
        found_elapsed_s=np.zeros(channels),
        missed_elapsed_s=np.full(channels, np.nan),
        averaged_s=step_s,
    )
    return Scene(observations, np.array(owners))


def read_meaconing_pair(shared_data: Path, receiver: str) -> tuple[Observations, np.ndarray, dict]:
    """Read the noise-free measurements of `truth.csv`: copy a is the sky, copy b the meaconer while it is on.

    Also what the clock shows minus true time, (n_epochs,), and the contents of `truth.json`.
    """
    folder = shared_data / "rf" / "meaconing-pair"
    truth = json.loads((folder / "truth.json").read_text())
    with open(folder / "truth.csv", newline="") as lines:
        rows = [r for r in csv.DictReader(lines) if r["receiver"] == receiver]
    tows = sorted({int(r["tow_s"]) for r in rows})
    signals = sorted({SignalId(f"G{int(r['prn']):02d}", copy="ab"[r["source"] == "meaconer"]) for r in rows})
    delay_s, pseudorange_m, doppler_hz = np.full((3, len(tows), len(signals)), np.nan)
    for r in rows:
        if r["on"] == "1":
            signal = SignalId(f"G{int(r['prn']):02d}", copy="ab"[r["source"] == "meaconer"])
            cell = tows.index(int(r["tow_s"])), signals.index(signal)
            delay_s[cell], pseudorange_m[cell] = float(r["code_delay_s"]), float(r["pseudorange_m"])
            doppler_hz[cell] = float(r["doppler_hz"])
    # The clock shows its error beside the whole second; a label holds whole nanoseconds, the measurement the same ones.
    clock_ns = np.rint(1e9 * np.nanmedian(pseudorange_m / C - delay_s, axis=1))
    ones = np.where(np.isfinite(delay_s), 1.0, np.nan)
    observations = Observations(
        receiver=receiver,
        signals=tuple(signals),
        gpst=instant(truth["epoch_gps_week"], np.array(tows, float)) + clock_ns.astype("timedelta64[ns]"),
        elapsed_s=np.arange(len(tows), dtype=float),
        pseudorange_m=C * (delay_s + 1e-9 * clock_ns[:, None]),
        carrier_cyc=np.nan * ones,
        doppler_hz=doppler_hz,
        cn0_dbhz=45.0 * ones,
        pseudorange_sigma_m=ones,
        carrier_sigma_cyc=np.nan * ones,
        doppler_sigma_hz=0.1 * ones,
        status=np.where(np.isfinite(delay_s), 0, 1).astype(np.uint8),
        found_elapsed_s=np.zeros(len(signals)),
        missed_elapsed_s=np.full(len(signals), np.nan),
    )
    return observations, 1e-9 * clock_ns, truth


def find_shown(truth: dict, receiver: str, label: str) -> tuple[np.ndarray, float]:
    """Find the place that a receiver of these signals shows, and how much later its clock seems."""
    if label == "authentic":
        (place,) = (r["position"]["ecef_m"] for r in truth["receivers"] if r["name"] == receiver)
        return np.array(place), 0.0
    meaconer = truth["transmitters"][0]
    place = meaconer["captured_receiver_shows_position"]["ecef_m"]
    return np.array(place), meaconer["captured_clock_extra_s"][receiver]
