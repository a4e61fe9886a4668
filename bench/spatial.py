"""An array's true signals under a stronger attacker, with and without the spatial filter, beside one antenna.

    python bench/spatial.py          all powers

The scene is `ins-array-2` (three antennas a wavelength apart; the attacker's elevation and azimuth 30 and 150 degrees)
with all eight satellites imitated. Channels begin on the true signals, so that what is measured is tracking, not the
search. The attacker's signature comes from the phases of its own signals, tracked on the raw antennas.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from skyproof.arrays import Complexes, Indices, Reals
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import measurement as m
from skyproof.receiver.acquisition import Peak
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.settings import ReceiverSettings
from skyproof.receiver.tracking import Receiver, ReceiverState
from skyproof.records import Samples
from skyproof.simulator import make_navigation, make_scene, read_ready_made, render_samples
from skyproof.simulator.received import Scene
from skyproof.simulator.scenario import FrontEnd
from skyproof.statistics.directions import direction_cosines
from skyproof.studies.spatial import filter_of, filtered, signature_of, sinr_share

RATE_HZ, DURATION_S, SETTLED_S = 2.6e6, 6.0, 2.0
POWERS_DB = (3.0, 10.0, 20.0, 30.0, 40.0)
KEPT_M = 50.0  # a channel whose code is farther off the true one follows something else


@dataclass(frozen=True)
class Tracked:
    """Of each true signal (n,), NaN where it was lost: C/N0, mean error of the code beside what all share, scatter of
    code and carrier around their means."""

    cn0_dbhz: Reals
    code_m: Reals
    code_rms_m: Reals
    carrier_rms_mm: Reals

    @property
    def kept(self) -> int:
        return int(np.isfinite(self.cn0_dbhz).sum())


def report() -> Iterator[str]:
    """Rows of the table."""
    yield f"spatial filter, three antennas, {DURATION_S:g} s at {RATE_HZ / 1e6:g} Msps, eight signals true and false"
    for power_db in POWERS_DB:
        yield from _rows(power_db)


def _rows(power_db: float) -> Iterator[str]:
    scene, samples = scene_and_samples(power_db)
    true, false = (columns_of(scene, label) for label in ("authentic", "spoofed"))
    alone_dbhz = scene.skies[0].cn0_dbhz(np.array([0.5 * DURATION_S]))[0, true]
    signature = _measured_signature(track(samples, scene, false))
    held, noise = _first_filter(samples, signature)
    null_db = -10.0 * np.log10(np.sum(np.abs(held @ _steering(scene, false[0])) ** 2) * noise / 3.0)
    steerings = [_steering(scene, column) for column in true]
    theory = 3.0 * np.array([sinr_share(held, steering, noise * np.eye(3)) for steering in steerings])
    yield f"  attacker {power_db:+.0f} dB, attenuated by {null_db:.0f} dB"
    yield f"    C/N0 by theory beside one antenna, clean   {_listed(10.0 * np.log10(theory))} dB"
    for name, recording in (
        ("one antenna", replace(samples, others=())),
        ("three, summed", samples),
        ("three, filtered", filtered(samples, lambda _: signature[:, None])),
    ):
        got = _errors(track(recording, scene, true), scene, true)
        yield f"    {name:<16} {got.kept} of {true.size} kept {_listed(got.cn0_dbhz - alone_dbhz)} dB"
        yield (
            f"    {'':<16} code {_rms(got.code_rms_m):.2f} m, carrier {_rms(got.carrier_rms_mm):.1f} mm rms; position "
            f"{_position_error_m(got, scene, true):.2f} m off"
        )


def scene_and_samples(power_db: float) -> tuple[Scene, Samples]:
    """The scene with all satellites imitated at this power, and the array's recording."""
    scenario = read_ready_made("ins-array-2")
    attack = scenario.attacks[0].model_copy(update={"sats": None, "power_db": power_db})
    front_end = FrontEnd(rate_hz=RATE_HZ, bandwidth_hz=0.8 * RATE_HZ, encoding="int", bits=16, agc=True)
    scenario = scenario.model_copy(update={"attacks": (attack,), "duration_s": DURATION_S, "front_end": front_end})
    navigation = make_navigation(scenario)
    first, *others = render_samples(scenario, navigation)
    return make_scene(scenario, navigation), replace(first, others=tuple(others))


def columns_of(scene: Scene, label: str) -> Indices:
    """Of the scene's signals."""
    return np.flatnonzero([signal.label == label for signal in scene.skies[0].signals])


def _late_s(scene: Scene, elapsed_s: Reals, antenna: int = 0, *, carrier: bool = False) -> Reals:
    """(n, n_signals) by how much less each signal shows than the sampling clock."""
    sky = scene.skies[antenna]
    late_s = sky.true_minus_elapsed_s(elapsed_s)
    delay_s = (sky.carrier_delay_s if carrier else sky.code_delay_s)(elapsed_s + late_s)
    return np.asarray(delay_s - late_s[:, None])


def _steering(scene: Scene, column: int) -> Complexes:
    """(n_antennas,) of a signal, by its true delays."""
    at_s = np.array([0.5 * DURATION_S])
    antennas = range(len(scene.skies))
    late_s = np.array([_late_s(scene, at_s, antenna, carrier=True)[0, column] for antenna in antennas])
    return np.asarray(np.exp(-2j * np.pi * L1_HZ * (late_s - late_s[0])))


def _measured_signature(of_attacker: Measurements) -> Complexes:
    own = of_attacker.own.reshape(-1, of_attacker.own.shape[2])
    shape = (-1, of_attacker.own.shape[1])
    phases, sigmas = (own[:, column].reshape(shape) for column in (m.OWN_PHASE_CYC, m.OWN_PHASE_SIGMA_CYC))
    return signature_of(phases, sigmas, np.ones(shape[1]))


def _first_filter(samples: Samples, signature: Complexes) -> tuple[Complexes, float]:
    """That of the first block, and the power of the antennas' noise, which is the least of any combination."""
    planes = samples.read_all(0, round(0.1 * samples.rate_hz)).astype(np.float64)
    waves = planes[:, 0] + 1j * planes[:, 1]
    covariance = waves @ waves.conj().T / waves.shape[1]
    return filter_of(covariance, signature[:, None]), float(np.linalg.eigvalsh(covariance)[0])


def track(samples: Samples, scene: Scene, columns: Indices) -> Measurements:
    """What channels measure that begin on these signals, and look for no others; arcs are numbered in their order."""
    receiver = Receiver(RATE_HZ, samples.if_hz, ReceiverSettings(sats=()))
    state = ReceiverState(tail=samples.read_all(0, 0))
    begin_s = np.array([0.0, 0.01])
    code_s, carrier_s = _late_s(scene, begin_s), _late_s(scene, begin_s, carrier=True)
    for column in columns:
        peak = Peak(
            sat=scene.skies[0].signals[column].id.sat,
            delay_s=float(code_s[0, column] % GPS_L1_CA.period_s),
            doppler_hz=float(-np.diff(carrier_s[:, column])[0] / 0.01 * L1_HZ),
            cn0_dbhz=45.0,
            power=100.0,
            p_value=0.0,
        )
        state = receiver.start_channel(state, peak)
    parts, step = [], round(0.5 * RATE_HZ)
    for start in range(0, samples.n_samples, step):
        output, state = receiver.step(state, samples.read_all(start, step))
        parts.append(output.measurements)
    return Measurements.join(parts)


def _errors(found: Measurements, scene: Scene, columns: Indices) -> Tracked:
    code_m, rms_m, carrier_m, cn0 = np.full((4, columns.size), np.nan)
    for number, column in enumerate(columns):
        part = found.select((found.arc == number) & (found.elapsed_s > SETTLED_S))
        if len(part) < 5 or part.elapsed_s[-1] < DURATION_S - 0.5:
            continue
        at_s = part.elapsed_s
        shown_s = at_s - part.column(m.PERIODS) * GPS_L1_CA.period_s - part.column(m.FRACTION_S)
        code_s = shown_s - _late_s(scene, at_s)[:, column]
        code = SPEED_OF_LIGHT_M_S * (code_s - GPS_L1_CA.period_s * np.rint(code_s / GPS_L1_CA.period_s))
        carrier_s = _late_s(scene, at_s, carrier=True)[:, column]
        carrier = part.column(m.CARRIER_CYC) * SPEED_OF_LIGHT_M_S / L1_HZ - SPEED_OF_LIGHT_M_S * carrier_s
        code_m[number], rms_m[number] = np.mean(code), np.std(code)
        carrier_m[number] = np.std(carrier)
        cn0[number] = np.median(part.column(m.CN0_DBHZ))
    lost = ~(np.abs(code_m) < KEPT_M)
    for values in (code_m, rms_m, carrier_m, cn0):
        values[lost] = np.nan
    return Tracked(cn0, code_m, rms_m, 1e3 * carrier_m)


def _position_error_m(got: Tracked, scene: Scene, columns: Indices) -> float:
    """Of the position that the mean errors of the codes that were kept give, by least squares; NaN of fewer than 4."""
    kept = np.isfinite(got.code_m)
    if kept.sum() < 4:
        return np.nan
    sky = scene.skies[0]
    towards = direction_cosines(sky.az_rad[0, columns[kept]], sky.el_rad[0, columns[kept]])
    design = np.column_stack([-towards, np.ones(kept.sum())])
    return float(np.linalg.norm(np.linalg.lstsq(design, got.code_m[kept])[0][:3]))


def _rms(values: Reals) -> float:
    return float(np.sqrt(np.nanmean(values**2))) if np.isfinite(values).any() else np.nan


def _listed(values: Reals) -> str:
    return " ".join(" lost" if np.isnan(value) else f"{value:+5.1f}" for value in values)


if __name__ == "__main__":
    for row in report():
        print(row, flush=True)
