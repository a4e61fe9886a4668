"""The truth of a scene as series: where each receiver is, what each antenna's signals are, what an inertial unit reads.

Tables are columns of one length by name, units in the names. Each is made in blocks, so that memory does not grow with
the duration; the functions without `blocks` in their names put them together.

    gpst          GPS time of the row, to the nanosecond
    true_s        the same since the scenario's start, with all its digits
    elapsed_s     what the sampling clock has counted since the first sample: sample number over rate
"""

from collections.abc import Iterable, Iterator
from functools import partial
from math import ceil, floor
from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import NDArray

from skyproof.arrays import Integers, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import geodetic_from_ecef, heading_pitch_roll_rad, rot_enu_ecef
from skyproof.gnss.time import GPS_EPOCH, seconds_between, timedelta_from_s
from skyproof.simulator.inertial import ImuReadings, simulate_inertial
from skyproof.simulator.platforms import compute_motion
from skyproof.simulator.received import ReceiverSky, Scene

__all__ = [
    "SIGNALS_HZ",
    "TRAJECTORY_HZ",
    "Table",
    "compute_dopplers_hz",
    "compute_signal_truth",
    "compute_trajectory_truth",
    "convert_to_gpst",
    "find_sky",
    "iterate_imu_blocks",
    "iterate_signal_blocks",
    "iterate_trajectory_blocks",
    "simulate_imus",
]

Table = dict[str, NDArray[Any]]

TRAJECTORY_HZ: Final = 10.0
SIGNALS_HZ: Final = 1.0
_ROWS: Final = 4096  # at most, in a block
_EPOCHS: Final = 256  # of signals in a block
_SHORT_S: Final = 0.01


def find_sky(scene: Scene, antenna: str) -> ReceiverSky:
    """Find an antenna's sky. Raises KeyError with the names that there are."""
    for sky in scene.skies:
        if sky.name == antenna:
            return sky
    raise KeyError(f"no antenna {antenna!r}; there are {', '.join(sky.name for sky in scene.skies)}")


def convert_to_gpst(scene: Scene, true_s: Any) -> Any:
    """Convert true times of any shape to GPS time, to the nanosecond."""
    return scene.scenario.start_gpst + timedelta_from_s(np.asarray(true_s))


# --- receivers


def compute_trajectory_truth(scene: Scene, receiver: str, rate_hz: float = TRAJECTORY_HZ) -> Table:
    """Compute a receiver's place and clock, at whole multiples of 1 / rate since the scenario's start.

    The place is the receiver's own, from which its antennas are counted. Heading is clockwise from north, pitch
    positive with the nose up, roll with the right side down. `clock_offset_s` is what its clock shows minus GPS time,
    `clock_drift` its rate. Raises KeyError for a receiver that the scene does not have.
    """
    return _join(iterate_trajectory_blocks(scene, receiver, rate_hz))


def iterate_trajectory_blocks(scene: Scene, receiver: str, rate_hz: float = TRAJECTORY_HZ) -> Iterator[Table]:
    """Compute `compute_trajectory_truth` in blocks."""
    skies = [sky for sky in scene.skies if sky.receiver.name == receiver]
    if not skies:
        raise KeyError(f"no receiver {receiver!r}; there are {', '.join(scene.trajectories)}")
    sky, duration_s = skies[0], scene.scenario.duration_s
    first = ceil(sky.receiver.start_offset_s * rate_hz)
    last = floor((duration_s + float(sky.true_minus_elapsed_s(duration_s))) * rate_hz)
    for number in range(first, max(last, first) + 1, _ROWS):
        yield _make_trajectory_table(scene, sky, np.arange(number, min(number + _ROWS, last + 1)) / rate_hz)


def _make_trajectory_table(scene: Scene, sky: ReceiverSky, true_s: Reals) -> Table:
    receiver = sky.receiver
    elapsed_s = sky.elapsed_at(true_s)
    motion = compute_motion(scene.trajectories[receiver.name], true_s)
    lat_rad, lon_rad, height_m = geodetic_from_ecef(motion.position_ecef_m)
    velocity_enu_m_s = np.einsum("nij,nj->ni", rot_enu_ecef(lat_rad, lon_rad), motion.velocity_ecef_m_s)
    angles_rad = heading_pitch_roll_rad(motion.position_ecef_m, motion.attitude)
    table: Table = {"gpst": convert_to_gpst(scene, true_s), "true_s": true_s, "elapsed_s": elapsed_s}
    table |= {"lat_deg": np.degrees(lat_rad), "lon_deg": np.degrees(lon_rad), "height_m": np.asarray(height_m)}
    table |= dict(zip(("x_m", "y_m", "z_m"), motion.position_ecef_m.T, strict=True))
    table |= dict(zip(("vx_m_s", "vy_m_s", "vz_m_s"), motion.velocity_ecef_m_s.T, strict=True))
    table |= dict(zip(("v_east_m_s", "v_north_m_s", "v_up_m_s"), velocity_enu_m_s.T, strict=True))
    heading_deg, pitch_deg, roll_deg = map(np.degrees, angles_rad)
    table |= {"heading_deg": heading_deg % 360.0, "pitch_deg": pitch_deg, "roll_deg": roll_deg}
    shown_at_start_s = receiver.start_offset_s + receiver.clock_offset_s
    drift = np.full(true_s.shape, receiver.lo_ppm * 1e-6)
    if sky.clock is not None:
        drift = sky.clock.drift(np.clip(true_s - receiver.start_offset_s, -1.0, sky.clock.duration_s))
    clock_offset_s = shown_at_start_s - sky.true_minus_elapsed_s(elapsed_s)
    return table | {"clock_offset_s": clock_offset_s, "clock_drift": drift}


# --- signals


def compute_signal_truth(scene: Scene, antenna: str, rate_hz: float = SIGNALS_HZ) -> Table:
    """Compute every signal at an antenna while it is received, one row per epoch and signal.

    Epochs are the moments when the receiver's clock shows a whole multiple of 1 / rate, as in its observations; what
    it shows is `receiver_gpst`. Raises KeyError for an antenna that the scene does not have.

    sat, copy, label, source : as in `HeardSignal`.
    pseudorange_m : c times (what the receiver's clock shows minus the time of transmission that the code shows).
    carrier_cyc : the same by the carrier's phase, with its sign; whole cycles are true, none is unknown.
    doppler_hz : apparent frequency minus nominal, by the receiver's own clock.
    azimuth_deg, elevation_deg : of the satellite, as seen from where it is received: for false signals a meaconer's
        receive antenna or the place that they show.
    amplitude_to_authentic, delay_to_authentic_m, phase_to_authentic_cyc, doppler_to_authentic_hz : of the satellite's
        true signal: ratio of amplitudes; code later by; carrier ahead by, whole cycles included; carrier higher by. NaN
        while that is not there.
    """
    return _join(iterate_signal_blocks(scene, antenna, rate_hz))


def iterate_signal_blocks(scene: Scene, antenna: str, rate_hz: float = SIGNALS_HZ) -> Iterator[Table]:
    """Compute `compute_signal_truth` in blocks."""
    sky, interval_s = find_sky(scene, antenna), 1.0 / rate_hz
    shown_at_start_s = sky.receiver.start_offset_s + sky.receiver.clock_offset_s
    start_ns = (scene.scenario.start_gpst - GPS_EPOCH).astype(np.int64)
    off_grid_s = float(start_ns % round(interval_s * 1e9)) * 1e-9
    first = ceil((off_grid_s + shown_at_start_s) / interval_s)
    last = floor((off_grid_s + shown_at_start_s + scene.scenario.duration_s) / interval_s)
    for number in range(first, max(last, first) + 1, _EPOCHS):
        epochs = np.arange(number, min(number + _EPOCHS, last + 1), dtype=np.float64)
        yield _make_signal_table(scene, sky, interval_s * epochs - off_grid_s, shown_at_start_s)


def _make_signal_table(scene: Scene, sky: ReceiverSky, shown_s: Reals, shown_at_start_s: float) -> Table:
    """Compute the table at times that the receiver's clock shows, since the scenario's start."""
    elapsed_s = shown_s - shown_at_start_s
    late_s = sky.true_minus_elapsed_s(elapsed_s)
    true_s = elapsed_s + late_s
    code_s, carrier_s = sky.delays_s(true_s)
    clock_s = (shown_at_start_s - late_s)[:, np.newaxis]
    present = np.zeros(code_s.shape, bool)
    for column, received in enumerate(sky.signals):
        for begin_s, end_s in received.windows_s:
            present[:, column] |= (begin_s <= true_s) & (true_s <= end_s)
    epoch, of = np.nonzero(present)
    level_dbhz, doppler = sky.cn0_dbhz(true_s), compute_dopplers_hz(sky, elapsed_s)
    true_of = _find_authentic(sky)
    beside = (true_of >= 0) & present[:, true_of]

    def to_authentic(values: Reals) -> Reals:
        return np.where(beside, values - values[:, true_of], np.nan)[present]

    def directions_deg(knots_rad: Reals) -> Reals:
        angles = [np.interp(true_s, sky.knots_s, angle_rad) for angle_rad in knots_rad.T]
        return np.asarray(np.degrees(np.stack(angles, axis=1))[present])

    return {
        "receiver_gpst": convert_to_gpst(scene, shown_s)[epoch],
        "gpst": convert_to_gpst(scene, true_s)[epoch],
        "true_s": true_s[epoch],
        "elapsed_s": elapsed_s[epoch],
        "sat": np.array([received.id.sat for received in sky.signals])[of],
        "copy": np.array([received.id.copy for received in sky.signals])[of],
        "label": np.array([received.label for received in sky.signals])[of],
        "source": np.array([received.source for received in sky.signals])[of],
        "pseudorange_m": (SPEED_OF_LIGHT_M_S * (clock_s + code_s))[present],
        "carrier_cyc": (sky.signal.carrier_hz * (clock_s + carrier_s))[present],
        "doppler_hz": doppler[present],
        "cn0_dbhz": level_dbhz[present],
        "azimuth_deg": directions_deg(np.unwrap(sky.az_rad, axis=0)) % 360.0,
        "elevation_deg": directions_deg(sky.el_rad),
        "amplitude_to_authentic": 10.0 ** (to_authentic(level_dbhz) / 20.0),
        "delay_to_authentic_m": SPEED_OF_LIGHT_M_S * to_authentic(code_s),
        "phase_to_authentic_cyc": -sky.signal.carrier_hz * to_authentic(carrier_s),
        "doppler_to_authentic_hz": to_authentic(doppler),
    }


def _find_authentic(sky: ReceiverSky) -> Integers:
    """Find the column of each signal's satellite's true signal, (n_signals,); -1 where there is none."""
    columns = {received.id.sat: column for column, received in enumerate(sky.signals) if received.label == "authentic"}
    return np.array([columns.get(received.id.sat, -1) for received in sky.signals], np.int64)


def compute_dopplers_hz(sky: ReceiverSky, elapsed_s: Reals) -> Reals:
    """Compute Dopplers (n, n_signals) against the receiver's own oscillator, at times (n,) of its clock.

    A central difference over 20 ms: the jerk of a satellite's range leaves nothing, an oscillator's noise is averaged.
    """
    ends_s = elapsed_s + _SHORT_S * np.array([[-1.0], [1.0]])
    late_s = sky.true_minus_elapsed_s(ends_s)
    delay_s = sky.carrier_delay_s(ends_s + late_s) - late_s[..., np.newaxis]
    return np.asarray(-sky.signal.carrier_hz * (delay_s[1] - delay_s[0]) / (2.0 * _SHORT_S))


# --- inertial units


def simulate_imus(scene: Scene) -> dict[str, ImuReadings]:
    """Simulate the inertial unit of each receiver that has one, by the receiver's name.

    Its axes are the body's, turned by `mounting_deg`; it reads from the receiver's first sample on, by true time.
    """
    return {
        receiver.name: simulate_inertial(
            partial(compute_motion, scene.trajectories[receiver.name]),
            rate_hz=receiver.imu.rate_hz,
            duration_s=scene.scenario.duration_s,
            grade=receiver.imu.grade,
            mounting=_compute_mounting(receiver.imu.mounting_deg),
            lever_body_m=receiver.imu.body_m,
            seed=scene.scenario.seed,
            stream=index,
            start_s=receiver.start_offset_s,
            zero_gpst=scene.scenario.start_gpst,
        )
        for index, receiver in enumerate(scene.scenario.receivers)
        if receiver.imu is not None
    }


def iterate_imu_blocks(scene: Scene, imu: ImuReadings) -> Iterator[Table]:
    """Write readings as a table, in blocks, in the unit's axes.

    Rows are means over the intervals that end at their time.

    Columns are those that `skyproof.formats.imu` reads.
    """
    empty = imu.read(0, 0)
    for series in imu.blocks() if imu.n_samples else (empty,):
        table: Table = {"gpst": series.gpst, "true_s": seconds_between(series.gpst, scene.scenario.start_gpst)}
        for kind, unit, values in (
            ("accel", "m_s2", series.specific_force_m_s2),
            ("gyro", "rad_s", series.angular_rate_rad_s),
        ):
            table |= {f"{kind}_{axis}_{unit}": column for axis, column in zip("xyz", values.T, strict=True)}
        yield table


def _compute_mounting(mounting_deg: tuple[float, float, float]) -> Reals:
    """Compute the rotation from body to unit: the body's axes turned by heading, then pitch, then roll."""
    roll_deg, pitch_deg, heading_deg = mounting_deg
    angles_deg = [heading_deg, pitch_deg, roll_deg]
    return np.asarray(scipy.spatial.transform.Rotation.from_euler("ZYX", angles_deg, degrees=True).as_matrix().T)


def _join(blocks: Iterable[Table]) -> Table:
    parts = list(blocks)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
