"""Records under the hypothesis that each detector's alarms reject, and under attacks of the same make."""

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from skyproof.decomposition.correlation import correlation
from skyproof.detectors.array.arm_phases import arm_columns
from skyproof.detectors.array.array_model import predict_directions
from skyproof.detectors.array.ins_array import InsArraySettings
from skyproof.detectors.correlators.correlator_laws import triangle
from skyproof.detectors.second_signals.detector import SecondSignalsSettings, elevation_rad
from skyproof.gnss.codes import generate_ca_code
from skyproof.gnss.constants import CA_CHIP_RATE_HZ, L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.orbits import compute_satellite_state_s
from skyproof.gnss.signals import GPS_L1_CA, prn_of
from skyproof.gnss.sky import compute_azimuth_elevation
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.sets import find_consistent_sets
from skyproof.records import ArrayPhases, Ccaf, NavState, Observations, Records, SignalId, SpinArm, Taps
from skyproof.statistics.directions import direction_cosines, hemisphere
from skyproof.studies.arm_angles import arm_angles
from skyproof.studies.array_geometry import equilateral_triangle
from skyproof.studies.decomposition_laws import noise_variance
from skyproof.studies.discriminator_laws import prompt_amplitude
from skyproof.studies.quality_metrics import tap_covariance
from skyproof.studies.uniformity_echoes import drawn_seconds
from skyproof.studies.vector_loops import draw_taps
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

START = np.datetime64("2022-01-01T20:00:00", "ns")
ONE = {"rx1": (0.0, 0.0, 0.0)}
SIGMA_CYC = 0.01
CHIP_M = SPEED_OF_LIGHT_M_S / CA_CHIP_RATE_HZ


# Pseudoranges ---------------------------------------------------------------------------------------------------------

ECHOES = MeasuredScene(
    antennas_enu_m=ONE, epochs=3, false=(FalseSky(shows_enu_m=(0.0, 0.0, 0.0)),), errors=TrackErrors(1.0, 0.0, 1.0)
)
ECHOING = len(ECHOES.records(np.random.default_rng(0)).observations[0].signals) // 2


def draw_second_signals(rng, kept, delay_m=None, *, scene=ECHOES):
    """Draw a clean sky in which the satellites `kept` have a second signal, `delay_m` later if given."""
    records = scene.records(rng)
    (o,) = records.observations
    n = len(o.signals) // 2
    silent = np.concatenate([np.zeros(n, bool), ~kept])
    pseudorange_m = o.pseudorange_m.copy()
    if delay_m is not None:
        pseudorange_m[:, n:] = pseudorange_m[:, :n] + delay_m
    changed = replace(
        o, cn0_dbhz=np.where(silent, np.nan, o.cn0_dbhz), pseudorange_m=np.where(silent, np.nan, pseudorange_m)
    )
    return replace(records, observations=(changed,), sets=records.sets[:1])


def draw_echoes(rng, scene=ECHOES):
    """Draw echoes as between towers, at most one per satellite and receiver."""
    records = scene.records(rng)
    sets = tuple(s for s in records.sets if s.signals[0].copy == "a")
    heard = tuple(
        _draw_receiver_echoes(rng, o, records, [s for s in sets if s.receiver == o.receiver])
        for o in records.observations
    )
    return replace(records, observations=heard, sets=sets)


def _draw_receiver_echoes(rng, o, records, sets):
    n = len(o.signals) // 2
    level_dbhz = np.median(o.cn0_dbhz[:, :n], axis=0)
    elevation_deg = np.degrees([elevation_rad(records.navigation, sets, s.sat) for s in o.signals[:n]])
    cells = {name: getattr(o, name).copy() for name in ("pseudorange_m", "cn0_dbhz", "doppler_hz")}
    for values in cells.values():
        values[:, n:] = np.nan
    for k, second in drawn_seconds(rng, SecondSignalsSettings().echoes, level_dbhz.max() - level_dbhz, elevation_deg):
        cells["pseudorange_m"][:, n + k] = o.pseudorange_m[:, k] + second.late_m
        cells["cn0_dbhz"][:, n + k] = o.cn0_dbhz[:, k] + second.over_db
        cells["doppler_hz"][:, n + k] = o.doppler_hz[:, k] + second.apart_hz
    return replace(o, **cells)


UNRELATED = MeasuredScene(antennas_enu_m=ONE, epochs=3, false=ECHOES.false, errors=ECHOES.errors, max_satellites=8)


def draw_unrelated(rng, spread_m=60.0):
    """Draw a second signal at a delay of its own for every satellite, with the sets that are found."""
    n = UNRELATED.max_satellites
    records = draw_second_signals(rng, np.ones(n, bool), rng.uniform(-0.5, 0.5, n) * spread_m, scene=UNRELATED)
    return replace(records, sets=find_consistent_sets(records.observations[0], records.navigation))


# Correlators ----------------------------------------------------------------------------------------------------------

TAPS_SCENE = MeasuredScene(antennas_enu_m=ONE, epochs=3, step_s=0.02, max_satellites=8, cn0_dbhz=45.0)


def track(records):
    """Return the records as of receivers of ours: with correlators, all of which are one."""
    taps = [
        Taps(
            receiver=o.receiver,
            signals=o.signals,
            elapsed_s=np.zeros(1),
            delays_chips=np.zeros(1),
            dopplers_hz=np.zeros(1),
            value=np.ones((1, len(o.signals), 1, 1), np.complex64),
        )
        for o in records.observations
    ]
    return replace(records, taps=tuple(taps))


def draw_vector_taps(rng, code_chips=0.0, phase_rad=0.0, n=200):
    """Draw `n` snapshots of the taps of a vector receiver's channels at the offsets."""
    records = TAPS_SCENE.records(rng)
    (o,) = records.observations
    amplitude = prompt_amplitude(TAPS_SCENE.cn0_dbhz, coherent_s=LOOKED_S)
    value = draw_taps(rng, (n, len(o.signals)), amplitude, code_chips, phase_rad) / amplitude
    taps = Taps(
        receiver=o.receiver,
        signals=o.signals,
        elapsed_s=LOOK_S * np.arange(n),
        delays_chips=np.array([0.5, 0.0, -0.5]),
        dopplers_hz=np.zeros(1),
        value=(0.07 * value[:, :, None, :]).astype(np.complex64),
    )
    return replace(records, vector_taps=(taps,))


DELAYS_CHIPS = np.array([0.125, 0.0, -0.125, 0.5, -0.5, 1.0, -1.0])
LOOK_S, LOOKED_S = 0.02, 0.004
TAPS_SIGNALS = tuple(SignalId(f"G{k + 1:02d}") for k in range(10))


def draw_looks(rng, cn0_dbhz=45.0, n=500, *, second=0.0, lag_chips=0.0, beat_hz=0.0, delays=DELAYS_CHIPS):
    """Draw one signal's taps (n, n_taps) with a second one `lag_chips` later; in the amplitude's unit."""
    sigma = 1.0 / prompt_amplitude(cn0_dbhz, coherent_s=LOOKED_S)
    root = np.linalg.cholesky(tap_covariance(delays) + 1e-9 * np.eye(delays.size))
    noise = (rng.standard_normal((n, delays.size, 2)) @ [1.0, 1j]) @ root.T
    turn = np.exp(2j * np.pi * (beat_hz * LOOK_S * np.arange(n) + rng.random()))
    other = second * turn[:, None] * triangle(delays + lag_chips)
    return (triangle(delays) + other + sigma * noise).astype(np.complex64)


def take_looks(rng, cn0_dbhz=(35.0, 50.0), n=500, seconds=None):
    """Draw snapshots of ten signals' taps; `seconds` maps a signal's number to keywords of `draw_looks`."""
    levels = rng.uniform(*cn0_dbhz, len(TAPS_SIGNALS))
    value = [draw_looks(rng, level, n, **(seconds or {}).get(k, {})) for k, level in enumerate(levels)]
    taps = Taps(
        receiver="rx1",
        signals=TAPS_SIGNALS,
        elapsed_s=LOOK_S * np.arange(n),
        delays_chips=DELAYS_CHIPS,
        dopplers_hz=np.zeros(1),
        value=np.stack(value, axis=1)[:, :, None, :],
    )
    end = START + np.timedelta64(round(n * LOOK_S * 1e9), "ns")
    return Records(start_gpst=START, end_gpst=end, taps=(taps,))


def reflect(rng, probability):
    """Give each signal a strong reflection with this probability, late and at any beat."""
    hit = np.flatnonzero(rng.random(len(TAPS_SIGNALS)) < probability)
    ray = [{"second": 0.5, "lag_chips": rng.uniform(0.2, 1.2), "beat_hz": rng.uniform(-20.0, 20.0)} for _ in hit]
    return take_looks(rng, seconds=dict(zip(hit.tolist(), ray, strict=True)), n=150)


CCAF_RATE_HZ = 10e6
CCAF_SCENE = {"antennas_enu_m": ONE, "epochs": 3, "errors": TrackErrors(0.3)}
CLEAN_CCAF = MeasuredScene(**CCAF_SCENE)
OVERLAPPED_CCAF = MeasuredScene(
    false=(FalseSky(antenna_enu_m=(0.0, 0.0, 0.0), shows_enu_m=(150.0, 0.0, 150.0), delay_m=20.0),), **CCAF_SCENE
)


CCAF_POINTS = np.arange(-16, 17) * 0.1
INTERVALS = 4


def correlate_code(prn, lag_chips, band_hz=CCAF_RATE_HZ):
    """Correlate a code with itself in a band: single chips, as often as the code's chips are alike."""
    return sum(
        like * correlation(lag_chips - k, band_hz, GPS_L1_CA)
        for k, like in zip(range(-6, 7), find_side_lobes(prn), strict=True)
    )


@cache
def find_side_lobes(prn):
    """Correlate a code with itself at whole chips from -6 to 6."""
    code = generate_ca_code(prn).astype(int)
    return tuple(int(code @ np.roll(code, k)) / 1023.0 for k in range(-6, 7))


@cache
def find_noise_root(prn):
    """Return the root of the covariance of the taps' noise."""
    values, vectors = np.linalg.eigh(correlate_code(prn, CCAF_POINTS[:, None] - CCAF_POINTS))
    return vectors * np.sqrt(np.maximum(values, 0.0))


def draw_burst(prn, delay_chips, amplitude, variance, rng, intervals=INTERVALS):
    """Draw taps (intervals, m) of signals (n,) of one satellite, with new phases in each interval."""
    clean = correlate_code(prn, CCAF_POINTS - np.asarray(delay_chips)[:, None])  # (n, m)
    turn = np.asarray(amplitude) * np.exp(2j * np.pi * rng.random((intervals, len(clean))))
    white = rng.standard_normal((2, intervals, CCAF_POINTS.size)) * np.sqrt(0.5 * variance)
    return turn @ clean + (white[0] + 1j * white[1]) @ find_noise_root(prn).T


def draw_ccaf(records, rng, second_db=-1.2):
    """Draw a burst of grids that ends with the last epoch.

    Copy a is at the reference; copy b, where there is one, is beside it and stronger by `second_db`, one for all or
    one each.
    """
    (o,) = records.observations
    firsts = [k for k, signal in enumerate(o.signals) if signal.copy == "a"]
    where = {signal: k for k, signal in enumerate(o.signals)}
    range_m = o.pseudorange_m[-1]
    variance = float(noise_variance(45.0, 0.02, CCAF_RATE_HZ))
    value = []
    for k, over_db in zip(firsts, np.broadcast_to(second_db, len(firsts)), strict=True):
        delays, sizes = [0.0], [1.0]
        other = where.get(replace(o.signals[k], copy="b"))
        if other is not None and np.isfinite(range_m[other]):
            delays.append((range_m[other] - range_m[k]) / CHIP_M)
            sizes.append(10.0 ** (0.05 * over_db))
        value.append(draw_burst(prn_of(o.signals[k].sat), delays, sizes, variance, rng))
    n, back_s = len(firsts), 0.02 * np.arange(INTERVALS - 1, -1, -1)
    grid = Ccaf(
        receiver=o.receiver,
        signals=tuple(o.signals[k] for k in firsts),
        gpst=o.gpst[-1] - (back_s * 1e9).astype("timedelta64[ns]"),
        elapsed_s=o.elapsed_s[-1] - back_s,
        coherent_s=0.02,
        band_hz=CCAF_RATE_HZ,
        delays_chips=CCAF_POINTS,
        dopplers_hz=np.zeros(1),
        reference_m=np.tile(range_m[firsts], (INTERVALS, 1)),
        reference_hz=np.zeros((INTERVALS, n)),
        value=np.array(value).transpose(1, 0, 2)[:, :, None, :],
        noise_variance=np.full((INTERVALS, n), variance),
    )
    return replace(records, ccaf=(grid,))


def draw_near_reflections(rng, no_reflection_probability=0.1):
    """Draw grids of a clean sky in which every satellite has a reflection within a chip, 6 dB weaker.

    With the given probability it has instead what no reflection is: a signal before it, or nearly as strong.
    """
    n = UNRELATED.max_satellites
    odd = rng.random(n) < no_reflection_probability
    delay = np.where(odd, rng.uniform(-1.0, 1.0, n), rng.uniform(0.0, 1.0, n))
    records = draw_second_signals(rng, np.ones(n, bool), delay * CHIP_M, scene=UNRELATED)
    return draw_ccaf(records, rng, np.where(odd, -1.2, -6.0))


# Arrays ---------------------------------------------------------------------------------------------------------------


def draw_array_phases(rng, direction, *, side=1.0, epochs=4, sigma_cyc=SIGMA_CYC, elements=None):
    """Draw phases of a triangle of `side` wavelengths under signals from `direction` (n, 3).

    Cycles and clocks are any; an antenna is 5 mm off its place and a line is late, both the same for all signals.
    """
    elements = equilateral_triangle(side) if elements is None else elements
    wrong = elements + 0.026 * rng.standard_normal(elements.shape)
    phase = direction @ wrong.T + rng.random(len(elements)) + rng.integers(-5, 5, (epochs, len(direction), 1))
    phase = phase + rng.random((epochs, len(direction), 1)) + sigma_cyc * rng.standard_normal(phase.shape)
    return ArrayPhases(
        receiver="rx1",
        signals=tuple(SignalId(f"G{k + 1:02d}") for k in range(len(direction))),
        gpst=START + np.arange(epochs) * np.timedelta64(1, "s"),
        elapsed_s=np.arange(epochs, dtype=float),
        elements_m=elements * SPEED_OF_LIGHT_M_S / L1_HZ,
        phase_cyc=phase - np.floor(phase),
        sigma_cyc=np.full(phase.shape, sigma_cyc),
    )


def make_window(phases, **more):
    """Make a window of array phases."""
    return Records(start_gpst=START, end_gpst=START + np.timedelta64(10, "s"), array_phases=(phases,), **more)


def draw_one_direction(rng, count):
    """Draw one direction and repeat it (count, 3)."""
    return np.repeat(hemisphere(500)[rng.integers(500)][None], count, axis=0)


def draw_directions(rng, count):
    """Draw directions (count, 3) over the whole hemisphere."""
    return direction_cosines(2.0 * np.pi * rng.random(count), np.arcsin(rng.random(count)))


# An array on a body whose attitude is known ---------------------------------------------------------------------------

NAVIGATION = make_nominal_constellation(START)
PLACE = np.radians(59.0), np.radians(17.0), 100.0
PLACE_M = ecef_from_geodetic(*PLACE)
ELEMENTS_M = equilateral_triangle(1.0) * SPEED_OF_LIGHT_M_S / L1_HZ
INS_SETTINGS = InsArraySettings(false_alarm_probability=0.05, pattern_sigma_m=0.0)


def list_in_view():
    week, tow_s = week_and_tow(START)
    found = []
    for orbit in NAVIGATION.ephemerides:
        el_rad = compute_azimuth_elevation(PLACE_M, compute_satellite_state_s(orbit, week, tow_s).position_ecef_m)[1]
        if el_rad > np.radians(10.0):
            found.append(SignalId(orbit.sat))
    return tuple(sorted(found))[:8]


SIGNALS = list_in_view()


def make_attitude(epochs):
    """Make the attitude of a level body that turns by a degree an epoch."""
    time_s = np.arange(-1.0, epochs + 1.0)
    body = Rotation.from_euler("z", time_s[:, None], degrees=True).as_matrix()
    forward_right_down = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    attitude = rot_enu_ecef(*PLACE[:2]).T @ forward_right_down @ body
    return NavState(
        gpst=START + np.rint(time_s * 1e9).astype("timedelta64[ns]"),
        position_ecef_m=np.tile(PLACE_M, (time_s.size, 1)),
        velocity_ecef_m_s=np.zeros((time_s.size, 3)),
        attitude=attitude,
    )


STATE = make_attitude(4)


def make_empty_phases(epochs=4):
    shape = (epochs, len(SIGNALS), 3)
    return ArrayPhases(
        receiver="rx1",
        signals=SIGNALS,
        gpst=START + np.arange(epochs) * np.timedelta64(1, "s"),
        elapsed_s=np.arange(epochs, dtype=float),
        elements_m=ELEMENTS_M,
        phase_cyc=np.zeros(shape),
        sigma_cyc=np.full(shape, SIGMA_CYC),
    )


TRUE = predict_directions(make_empty_phases(), STATE, NAVIGATION)


def draw_array_records(rng, direction=TRUE):
    """Draw signals from `direction` (epochs, n, 3) with all the errors that `INS_SETTINGS` state."""
    elements = ELEMENTS_M + INS_SETTINGS.position_sigma_m * rng.standard_normal(ELEMENTS_M.shape)
    rot = Rotation.from_rotvec(np.radians(INS_SETTINGS.attitude_sigma_deg) * rng.standard_normal(3)).as_matrix()
    phase = direction @ rot.T @ elements.T * L1_HZ / SPEED_OF_LIGHT_M_S
    phase = phase + INS_SETTINGS.bias_sigma_cyc * rng.standard_normal(3) + rng.random((*phase.shape[:2], 1))
    phase = phase + SIGMA_CYC * rng.standard_normal(phase.shape)
    made = replace(make_empty_phases(), phase_cyc=phase - np.floor(phase))
    return Records(
        start_gpst=START,
        end_gpst=START + np.timedelta64(4, "s"),
        navigation=NAVIGATION,
        array_phases=(made,),
        nav_state={"rx1": STATE},
    )


# A spinning antenna ---------------------------------------------------------------------------------------------------

TURN_RAD = 0.05 * np.pi  # from sample to sample
ARM = SpinArm(receiver="rx1", radius_m=0.5 * SPEED_OF_LIGHT_M_S / L1_HZ, rate_rad_s=10.0 * TURN_RAD)


def draw_spin_phases(rng, directions, n, *, trials=(), rate=TURN_RAD, start=0.0, sigma=SIGMA_CYC):
    """Draw phases of signals with any cycles and a receiver clock that is new at each sample."""
    phase = directions @ arm_columns(arm_angles(n, rate, start_rad=start), 0.5).T
    shape = (*trials, *phase.shape)
    phase = phase + sigma * rng.standard_normal(shape) + rng.integers(-50, 50, (*shape[:-1], 1))
    return phase + 10.0 * rng.standard_normal((*trials, 1, n))


def draw_spin_records(rng, directions, *, n=150, arm=ARM, rate=TURN_RAD, slip=None, sigma=SIGMA_CYC):
    """Draw signals from level `directions` (count, 2) on an arm, each with its own drift and curvature."""
    count = len(directions)
    t = np.arange(n) / 10.0
    phase = draw_spin_phases(rng, directions, n, rate=rate, start=2.0, sigma=sigma)
    phase = phase + rng.normal(0, 500, (count, 1)) * t + 0.3 * rng.standard_normal((count, 1)) * t**2
    if slip is not None:
        phase[slip, 70:] += 0.5
    ones = np.ones((n, count))
    observations = Observations(
        receiver="rx1",
        signals=tuple(SignalId(f"G{k + 1:02d}") for k in range(count)),
        gpst=START + np.rint(t * 1e9).astype("timedelta64[ns]"),
        elapsed_s=t,
        pseudorange_m=2.2e7 * ones,
        carrier_cyc=-phase.T,
        doppler_hz=0 * ones,
        cn0_dbhz=45 * ones,
        pseudorange_sigma_m=ones,
        carrier_sigma_cyc=sigma * ones,
        doppler_sigma_hz=ones,
        status=np.zeros((n, count), np.uint8),
        found_elapsed_s=np.zeros(count),
        missed_elapsed_s=np.full(count, np.nan),
    )
    return Records(
        start_gpst=START,
        end_gpst=START + np.timedelta64(15, "s"),
        observations=(observations,),
        spin_arms=(arm,),
    )
