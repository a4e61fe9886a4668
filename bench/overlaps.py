"""Two skies within a chip: from which distance on `dccaf` says so, and how often it does where there is none.

Grids are drawn as receivers take them: bursts of four intervals, each satellite's own code in the band of a grid, noise
of its covariance whose variance is estimated, phases at random.
"""

from collections.abc import Iterator
from time import process_time

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.dccaf.bursts import autocorrelate_code
from skyproof.detectors.dccaf.delays import DccafSettings
from skyproof.detectors.dccaf.detector import Dccaf
from skyproof.gnss.constants import CA_CHIP_RATE_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import GPS_L1_CA, prn_of
from skyproof.receiver.grids import BAND_SHARE, NOISE_TAPS, TAPS_A_BAND
from skyproof.records import Ccaf, Observations, Records
from skyproof.studies.decomposition_laws import noise_variance
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

OF_A_RUN = 1e-3 * 10.0 / 3600.0 / 6.0
"""What `protect` allows a window of one receiver, by default."""
RATES_HZ = (4e6, 10e6, 25e6)
DISTANCES_M = (10.0, 20.0, 30.0, 45.0, 60.0, 90.0, 120.0)
FALSE_DB, CN0_DBHZ = 1.0, (40.0, 48.0)
WINDOWS, CLEAN = 10, 200
INTERVALS, COHERENT_S, REACH_CHIPS = 4, 0.02, 1.5
CHIP_M = SPEED_OF_LIGHT_M_S / CA_CHIP_RATE_HZ
PLACE = {"antennas_enu_m": {"rx1": (0.0, 0.0, 0.0)}, "epochs": 3, "errors": TrackErrors(0.5), "max_satellites": 10}


def report() -> Iterator[str]:
    """Rows of the table."""
    yield f"share of windows called an attack; 10 satellites, false signals {FALSE_DB:+g} dB, {OF_A_RUN:.1e} a window"
    for rate_hz in RATES_HZ:
        for push in ("position", "clock", "clock back"):
            shares = [_found(rate_hz, push, distance_m) for distance_m in DISTANCES_M]
            found = "; ".join(f"{m:g} m: {share:.1f}" for m, share in zip(DISTANCES_M, shares, strict=True))
            yield f"  {f'{rate_hz / 1e6:g} Msps, {push} pushed by':<42} {found}"
    yield f"false alarms at 0.01 a window and at that of a run, {CLEAN} windows each"
    for rate_hz in RATES_HZ:
        for name, reflected in (("clean", 0.0), ("a third of the satellites reflected", 0.33), ("all reflected", 1.0)):
            yield f"  {f'{rate_hz / 1e6:g} Msps, {name}':<42} {_false(rate_hz, reflected)}"


def _found(rate_hz: float, push: str, distance_m: float) -> float:
    shows = (0.8 * distance_m, 0.0, 0.6 * distance_m) if push == "position" else (0.0, 0.0, 0.0)
    delay_m = {"position": 0.0, "clock": distance_m, "clock back": -distance_m}[push]
    scene = MeasuredScene(false=(FalseSky(antenna_enu_m=(0.0, 0.0, 0.0), shows_enu_m=shows, delay_m=delay_m),), **PLACE)
    rng, detector = np.random.default_rng(5), Dccaf(DccafSettings(false_alarm_probability=OF_A_RUN))
    findings = 0
    for _ in range(WINDOWS):
        records = scene.records(rng)
        (o,) = records.observations
        true = [k for k, signal in enumerate(o.signals) if signal.copy == "a"]
        false = [o.signals.index(type(o.signals[k])(o.signals[k].sat, copy="b")) for k in true]
        late_m = o.pseudorange_m[-1, false] - o.pseudorange_m[-1, true]
        delays = np.stack([np.zeros(len(true)), late_m / CHIP_M], axis=1)
        sizes = np.tile([1.0, 10.0 ** (0.05 * FALSE_DB)], (len(true), 1))
        evidence, _ = detector.examine(_with_grids(records, o, true, delays, sizes, rate_hz, rng))
        findings += evidence[0].says == "attack"
    return findings / WINDOWS


def _false(rate_hz: float, reflected: float) -> str:
    """Reflections 0 to 1 chip later, 3 to 20 dB weaker."""
    scene, rng = MeasuredScene(**PLACE), np.random.default_rng(6)
    p_values, begin = [], process_time()
    for _ in range(CLEAN):
        records = scene.records(rng)
        (o,) = records.observations
        n = len(o.signals)
        delays = np.stack([np.zeros(n), rng.uniform(0.0, 1.0, n)], axis=1)
        seen = (rng.random(n) < reflected) * 10.0 ** (-0.05 * rng.uniform(3.0, 20.0, n))
        sizes = np.stack([np.ones(n), seen], axis=1)
        grids = _with_grids(records, o, list(range(n)), delays, sizes, rate_hz, rng)
        p_values.append(Dccaf().examine(grids)[0][0].p_value or 0.0)
    each_ms = 1e3 * (process_time() - begin) / CLEAN / n
    p = np.array(p_values)
    return f"{int((p < 0.01).sum())} and {int((p < OF_A_RUN).sum())}; {each_ms:.1f} ms a satellite, drawing included"


def _with_grids(
    records: Records,
    o: Observations,
    rows: list[int],
    delays: Reals,
    sizes: Reals,
    rate_hz: float,
    rng: np.random.Generator,
) -> Records:
    band_hz = BAND_SHARE * rate_hz
    apart = CA_CHIP_RATE_HZ / band_hz / TAPS_A_BAND
    side = int(np.ceil(REACH_CHIPS / apart))
    taps = np.arange(-side, side + 1) * apart
    n, value, variances = len(rows), [], []
    for number, k in enumerate(rows):
        prn = prn_of(o.signals[k].sat)
        variance = float(noise_variance(rng.uniform(*CN0_DBHZ), COHERENT_S, band_hz))
        turn = sizes[number] * np.exp(2j * np.pi * rng.random((INTERVALS, 2)))
        clean = turn @ autocorrelate_code(GPS_L1_CA, prn, taps - delays[number][:, None], band_hz)
        values, vectors = np.linalg.eigh(autocorrelate_code(GPS_L1_CA, prn, taps[:, None] - taps, band_hz))
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        white = rng.standard_normal((2, INTERVALS, taps.size)) * np.sqrt(0.5 * variance)
        value.append(clean + (white[0] + 1j * white[1]) @ root.T)
        samples = INTERVALS * NOISE_TAPS
        variances.append(variance * rng.chisquare(2.0 * samples) / (2.0 * samples))
    back_s = COHERENT_S * np.arange(INTERVALS - 1, -1, -1)
    grid = Ccaf(
        receiver=o.receiver,
        signals=tuple(o.signals[k] for k in rows),
        gpst=o.gpst[-1] - (back_s * 1e9).astype("timedelta64[ns]"),
        elapsed_s=o.elapsed_s[-1] - back_s,
        coherent_s=COHERENT_S,
        band_hz=band_hz,
        delays_chips=taps,
        dopplers_hz=np.zeros(1),
        reference_m=np.tile(o.pseudorange_m[-1, rows], (INTERVALS, 1)),
        reference_hz=np.zeros((INTERVALS, n)),
        value=np.array(value).transpose(1, 0, 2)[:, :, None, :],
        noise_variance=np.tile(variances, (INTERVALS, 1)),
        noise_samples=INTERVALS * NOISE_TAPS,
    )
    return Records(
        start_gpst=records.start_gpst,
        end_gpst=records.end_gpst,
        observations=records.observations,
        navigation=records.navigation,
        ccaf=(grid,),
    )
