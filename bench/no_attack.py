"""Two receivers under a true sky, hour by hour: carriers between them, and reflections as between towers.

    python bench/no_attack.py --hours 20            all of it; windows of 10 s, each with errors of its own
    python bench/no_attack.py --hours 1 --only street

`carriers`: 1 to 100 m apart at drawn places and times, positions to 1 cm, errors as the detector assumes them, code and
carrier. Counted are words against the sky, windows that are authentic, and p-values, which a test that is right has
below r in a share r of all windows: of "the sky over these antennas" by carriers; and, of the same receivers behind one
transmit antenna, of "one antenna".

`street`: echoes, blocked signals and their Dopplers as `second_signals.echoes` has them, each receiver with its own,
40 m apart; `walls`: the same, and of three satellites in ten the direct signal is not received at all, but its
strongest echo, if any. What no sign of an attack is there for is counted by test, at the rates that a test may have.
"""

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from time import process_time
from typing import Any

import numpy as np

from skyproof.detectors.multi_receiver.detector import MultiReceiver
from skyproof.detectors.multi_receiver.pairing import evaluate_sky_by_carriers, pair_up
from skyproof.detectors.multi_receiver.settings import MultiReceiverSettings
from skyproof.detectors.second_signals.detector import SecondSignals, SecondSignalsSettings
from skyproof.detectors.second_signals.echoes import EchoModel
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.orbits import compute_satellite_state
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.gnss.sky import compute_azimuth_elevation
from skyproof.navigation.sets import find_consistent_sets
from skyproof.records import Observations, Records
from skyproof.studies.uniformity_echoes import echo_delays_m
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

WINDOW_S = 10.0
EACH = 60
"""Windows of one place and time."""
RATES = (0.1, 0.01, 0.001)
RATE = 1e-3
"""At which words are counted: in `protect` a test has some 1e-7."""
CARRIER_M = 0.005
PLACES_M = 0.01
STREET_M = 40.0
SATELLITES = 12
LOWEST_DBHZ, HELD_DBHZ = 40.0, 28.0
WALLS = 0.3
TAKEN = (
    "pseudorange_sigma_m",
    "carrier_sigma_cyc",
    "doppler_sigma_hz",
    "status",
    "carrier_hz",
    "half_cycle_open",
    "quadrature_m",
)
AGAINST = ("spoofed", "attack")


def scene_of(rng: np.random.Generator, errors: TrackErrors, apart_m: float) -> dict[str, Any]:
    """Keys of a `MeasuredScene` somewhere at some time."""
    az_rad, up_m = rng.uniform(0.0, 2.0 * np.pi), 0.1 * apart_m * rng.uniform(-1.0, 1.0)
    level_m = float(np.sqrt(apart_m**2 - up_m**2))
    return {
        "antennas_enu_m": {"rx1": (0.0, 0.0, 0.0), "rx2": (level_m * np.sin(az_rad), level_m * np.cos(az_rad), up_m)},
        "epochs": int(WINDOW_S),
        "errors": errors,
        "place_deg": (np.degrees(np.arcsin(rng.uniform(-0.94, 0.94))), rng.uniform(-180.0, 180.0), 100.0),
        "start_gpst": np.datetime64("2021-01-01T00:00:00", "ns") + np.timedelta64(int(rng.integers(126_230_400)), "s"),
        "max_satellites": SATELLITES,
    }


def stated(rng: np.random.Generator, keys: dict[str, Any]) -> MultiReceiverSettings:
    """The antennas' places, with an error of their own."""
    places = {name: tuple(place + PLACES_M * rng.standard_normal(3)) for name, place in keys["antennas_enu_m"].items()}
    return MultiReceiverSettings(false_alarm_probability=RATE, antennas_enu_m=places, antennas_sigma_m=PLACES_M)


# ---------------------------------------------------------------------- carriers


def carriers(hours: float) -> Iterator[str]:
    rng, begin = np.random.default_rng(1), process_time()
    words, below, windows = Counter[str](), Counter[tuple[str, float]](), 0
    for _ in range(_scenes(hours)):
        errors = TrackErrors(float(rng.uniform(0.5, 2.0)), float(rng.choice([0.0, 0.5, 0.9])), 1.0)
        keys = scene_of(rng, errors, float(np.exp(rng.uniform(0.0, np.log(100.0)))))
        clean, captured = MeasuredScene(**keys), MeasuredScene(**keys, sky=(), false=(FalseSky(),))
        for _ in range(EACH):
            records, settings = _carriers_off(clean.records(rng), rng), stated(rng, keys)
            windows += 1
            words.update({e.says for e in MultiReceiver(settings).examine(records)[0]})
            pairing = _pairing(records, settings)
            geometry = settings.geometry(pairing.receivers)
            assert geometry is not None
            sky = evaluate_sky_by_carriers([pairing], geometry)
            one = _pairing(_carriers_off(captured.records(rng), rng), settings).one_antenna_carriers
            for name, test in (("sky", sky), ("one antenna", one)):
                below[name, np.inf] += test is not None
                below.update((name, rate) for rate in RATES if test is not None and test.p_value < rate)
    yield f"carriers: {_length(windows)}, at {RATE:g}: {_said(words, windows)}; {process_time() - begin:.0f} s"
    for name in ("sky", "one antenna"):
        n = below[name, np.inf]
        shares = ", ".join(f"{below[name, rate] / max(n, 1):.5f} below {rate:g}" for rate in RATES)
        yield f"  p-values of {name!r} where it is so, of {n} windows: {shares}"


def _carriers_off(records: Records, rng: np.random.Generator) -> Records:
    """With an error of each carrier that stays."""
    off_cyc = CARRIER_M * L1_HZ / SPEED_OF_LIGHT_M_S
    observed = (
        replace(o, carrier_cyc=o.carrier_cyc + off_cyc * rng.standard_normal(len(o.signals)))
        for o in records.observations
    )
    return replace(records, observations=tuple(observed))


def _pairing(records: Records, settings: MultiReceiverSettings) -> Any:
    return pair_up(records, records.sets, settings.noise(1), min_satellites=settings.min_satellites)


# ---------------------------------------------------------------------- a street


def street(hours: float, *, walls: float = 0.0) -> Iterator[str]:
    rng, begin, model = np.random.default_rng(2), process_time(), EchoModel()
    words, by_test, beside, windows = Counter[str](), Counter[tuple[str, float]](), 0, 0
    for _ in range(_scenes(hours)):
        keys = scene_of(rng, TrackErrors(1.0, 0.5, 1.0), STREET_M)
        clean = MeasuredScene(**keys)
        elevation_rad = _elevations(clean)
        for _ in range(EACH):
            records = clean.records(rng)
            observed = tuple(_in_street(o, elevation_rad, rng, model, walls) for o in records.observations)
            sets = tuple(s for o in observed for s in find_consistent_sets(o, clean.navigation))
            records = replace(records, observations=observed, sets=sets)
            windows += 1
            beside += sum(s.copy != "a" for o in observed for s in o.signals)
            evidence = MultiReceiver(stated(rng, keys)).examine(records)[0]
            words.update({e.says for e in evidence})
            seconds = SecondSignals(SecondSignalsSettings(false_alarm_probability=RATE)).examine(records)[0]
            for name, findings in (("multi_receiver", evidence), ("second_signals", seconds)):
                least = min((e.p_value for e in findings if e.says in AGAINST and e.p_value is not None), default=1.0)
                by_test.update((name, rate) for rate in (RATE, 1e-5, 1e-7) if least < rate)
    yield (
        f"{'walls' if walls else 'street'}: {_length(windows)}, {beside / windows / 2.0:.2f} second signals a receiver;"
        f" {_said(words, windows)}; {process_time() - begin:.0f} s"
    )
    for name in ("second_signals", "multi_receiver"):
        yield f"  {name} against the sky: " + ", ".join(
            f"{by_test[name, rate]} windows at {rate:g}" for rate in (RATE, 1e-5, 1e-7)
        )


def _elevations(scene: MeasuredScene) -> dict[str, float]:
    lat_deg, lon_deg, height_m = scene.place_deg
    place = ecef_from_geodetic(np.radians(lat_deg), np.radians(lon_deg), height_m)
    found = {}
    for sat in {signal.sat for o in scene.records(np.random.default_rng(0)).observations for signal in o.signals}:
        orbit = scene.navigation.best(sat, scene.start_gpst)
        assert orbit is not None
        found[sat] = float(
            compute_azimuth_elevation(place, compute_satellite_state(orbit, scene.start_gpst).position_ecef_m)[1]
        )
    return found


def _in_street(
    o: Observations, elevation_rad: dict[str, float], rng: np.random.Generator, model: EchoModel, walls: float
) -> Observations:
    """What a receiver follows there, columns of `o` with their errors: direct signals, and echoes."""
    columns, names, late_m, dbhz, apart_hz = [], [], [], [], []
    for column, signal in enumerate(o.signals):
        el_rad = elevation_rad[signal.sat]
        open_dbhz = LOWEST_DBHZ + 9.0 * np.sin(el_rad)
        blocked_db = max(rng.normal(model.blocked_db, model.blocked_sigma_db), 0.0)
        blocked_db = 40.0 if rng.random() < walls else blocked_db * (rng.random() < model.blocked_share)
        heard = [(0.0, open_dbhz - blocked_db, 0.0)]
        for delay_m in echo_delays_m(rng, model, np.full(rng.poisson(model.echoes_per_satellite), np.degrees(el_rad))):
            smooth = rng.random() < model.smooth_share
            rough_db = -12.35 - 0.0016 * delay_m + 10.0 * np.log10(rng.exponential())
            level_db = rng.uniform(-model.most_weaker_db, model.gain_db) if smooth else rough_db
            hz = rng.uniform(-550.0, 550.0) if rng.random() < 0.05 else rng.normal(0.0, 11.0)
            heard.append((float(delay_m), open_dbhz + level_db, hz))
        followed: list[float] = []
        for delay_m, level_dbhz, hz in sorted(heard, key=lambda one: -one[1]):
            if level_dbhz >= HELD_DBHZ and all(
                abs(delay_m - other) > model.least_delay_chips * GPS_L1_CA.chip_m for other in followed
            ):
                columns.append(column)
                names.append(replace(signal, copy="abcdefgh"[len(followed)]))
                followed.append(delay_m)
                late_m.append(delay_m)
                dbhz.append(level_dbhz)
                apart_hz.append(hz)
    shape = o.gpst.size, len(names)
    taken = {name: getattr(o, name)[..., columns] for name in TAKEN}
    return replace(
        o,
        signals=tuple(names),
        pseudorange_m=o.pseudorange_m[:, columns] + np.array(late_m) + 0.3 * rng.standard_normal(shape),
        carrier_cyc=o.carrier_cyc[:, columns] + rng.random(shape[1]),
        doppler_hz=o.doppler_hz[:, columns] + np.array(apart_hz),
        cn0_dbhz=np.broadcast_to(np.array(dbhz), shape).copy(),
        found_elapsed_s=np.zeros(shape[1]),
        missed_elapsed_s=np.full(shape[1], np.nan),
        **taken,
    )


# ---------------------------------------------------------------------- words


def _scenes(hours: float) -> int:
    return max(1, round(hours * 3600.0 / WINDOW_S / EACH))


def _length(windows: int) -> str:
    return f"{windows} windows of two receivers ({windows * WINDOW_S / 3600.0:.1f} h)"


def _said(words: Counter[str], windows: int) -> str:
    return ", ".join(f"{word} in {count}" for word, count in words.most_common()) + f" of {windows}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=20.0)
    parser.add_argument("--only", choices=("carriers", "street", "walls"))
    chosen = parser.parse_args()
    parts = {
        "carriers": lambda: carriers(chosen.hours),
        "street": lambda: street(chosen.hours),
        "walls": lambda: street(chosen.hours, walls=WALLS),
    }
    for name, part in parts.items():
        if chosen.only in (None, name):
            for words in part():
                print(words, flush=True)


if __name__ == "__main__":
    main()
