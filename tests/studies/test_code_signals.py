"""One signal per satellite, and that codes, orbits, clocks and delays of every system meet at a place that is known."""

from dataclasses import replace

import numpy as np
import pytest
from tests.gnss.orbit_twin import clock_polynomial_s

from skyproof.formats.rinex_nav import get_glonass_channels, read_nav
from skyproof.formats.rinex_obs_read import parse_obs, read_obs
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import group_delay_s
from skyproof.gnss.orbits import compute_satellite_state_s
from skyproof.gnss.sky import rotate_to_reception
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.ranges import compute_atmosphere
from skyproof.studies.code_signals import select_code_signals

BASE_ECEF_M = np.array([-3817681.121, 3562839.431, 3650159.159])  # the recordings' README


def test_the_better_bands_signal_of_each_satellite_is_chosen():
    def line(text, label):
        return f"{text:60}{label}"

    def cells(*values):
        return "".join(" " * 16 if v is None else f"{v:14.3f}  " for v in values)

    lines = [
        line("     3.04           OBSERVATION DATA    M", "RINEX VERSION / TYPE"),
        line("G    3 C1C C1W C2L", "SYS / # / OBS TYPES"),
        line("E    2 C5Q C1X", "SYS / # / OBS TYPES"),
        line("C    2 C1P C2I", "SYS / # / OBS TYPES"),
        line("R    2 C1P C1C", "SYS / # / OBS TYPES"),
        line("", "END OF HEADER"),
        "> 2024 10 27 15 47 40.0000000  0  6",
        "G05" + cells(2e7, 2e7, 2e7),
        "G06" + cells(None, 2e7, 2e7),
        "E01" + cells(2e7, 2e7),
        "C20" + cells(2e7, 2e7),
        "C21" + cells(2e7, None),
        "R03" + cells(2e7, 2e7),
    ]
    seen = parse_obs("\n".join(lines).encode()).observations
    assert [str(signal) for signal in select_code_signals(seen)] == [
        "C20 B1 2I a",
        "C21 B1C 1P a",
        "E01 E1 X a",
        "G05 L1 CA a",
        "R03 G1 CA a",
    ]
    assert select_code_signals(replace(seen, pseudorange_m=np.full(seen.pseudorange_m.shape, np.nan))) == ()


@pytest.mark.shared_data
def test_codes_of_every_system_fit_a_place_with_their_clock(shared_data):
    # Orbits, clocks, group delays, time scales and names of signals have to be right for all five at once.
    # What is left is multipath and half of the ionosphere: the bound is that of code on one frequency, and GLONASS,
    # with chips twice as long and clocks half as good, has twice as much.
    folder = shared_data / "real" / "rinex-mosaic-1m"
    navigation = read_nav(folder / "base.nav")
    seen = read_obs(folder / "base.obs", glonass_channels=get_glonass_channels(navigation)).observations
    week, tow_s = week_and_tow(seen.gpst)
    residual_m: dict[str, list[float]] = {}
    for signal in select_code_signals(seen):
        eph = navigation.best(signal.sat, seen.gpst[150])
        if eph is None:
            continue
        code_m = seen.pseudorange_m[:, seen.signals.index(signal)]
        sent_s = tow_s - code_m / SPEED_OF_LIGHT_M_S
        state = compute_satellite_state_s(eph, week, sent_s - clock_polynomial_s(eph, week, sent_s))
        travel_s = np.linalg.norm(state.position_ecef_m - BASE_ECEF_M, axis=-1) / SPEED_OF_LIGHT_M_S
        sat_ecef_m = rotate_to_reception(state.position_ecef_m, travel_s)
        air = compute_atmosphere(
            np.tile(BASE_ECEF_M, (tow_s.size, 1)), sat_ecef_m[:, None], tow_s, navigation.ionosphere
        )
        if np.degrees(np.nanmedian(air.elevation_rad)) > 15.0:
            clock_m = SPEED_OF_LIGHT_M_S * (state.clock_s - group_delay_s(eph, signal.band, signal.code))
            model_m = np.linalg.norm(sat_ecef_m - BASE_ECEF_M, axis=-1) + air.delay_m[:, 0] - clock_m
            residual_m.setdefault(signal.sat[0], []).append(float(np.nanmedian(code_m - model_m)))
    assert {system: len(values) for system, values in residual_m.items()} == {"C": 18, "E": 6, "G": 9, "J": 2, "R": 7}
    clocks_m = {system: np.median(values) for system, values in residual_m.items()}
    assert max(abs(clock_m - clocks_m["G"]) for clock_m in clocks_m.values()) < 60.0  # 200 ns between systems
    for system, values in residual_m.items():
        spread_m = np.array(values) - clocks_m[system]
        assert np.sqrt(np.mean(spread_m**2)) < (6.0 if system == "R" else 3.0), (system, spread_m)
