"""The numbers that decide stand in one record a room, each with its unit and its reason."""

import ast
import dataclasses
import importlib
import pkgutil
from pathlib import Path

import numpy as np
import pytest

import skyproof
from skyproof import detectors, fusion
from skyproof.app import inspect, receive
from skyproof.records.policy import numbers_of

SRC = Path(skyproof.__file__).parent
ROOMS = ("detectors", "fusion", "app/common", "app/inspect", "app/protect", "app/receive")
SUFFIX = {
    "m": "_m",
    "s": "_s",
    "s/s": "_drift",
    "m/s": "_m_s",
    "Hz": "_hz",
    "dB": "_db",
    "dB/m": "_db_m",
    "dB-Hz": "_dbhz",
    "dBW/Hz": "_dbw_hz",
    "deg": "_deg",
    "rad": "_rad",
    "rad/s": "_rad_s",
    "cycle": "_cyc",
    "ppm": "_ppm",
    "chip": "_chips",
    "sigma": "_sigmas",
    "sigma^2": "_squared_sigmas",
    "looks, sigma": "_branches",
    "1": "",
    "1/h": "_per_hour",
    "1/s^2": "_per_s2",
}
"""By which a name shows its unit."""
COMPUTING = {
    "app/common/body": {"_EQUATOR", "_PIECE_S"},
    "app/common/packed_log": {"HELD_BYTES", "PACKED"},
    "app/common/platform_tables": {"AXES", "Metres", "ROTATION_ERROR", "SigmaDeg"},
    "app/common/settings": {"_Latitude", "_Longitude", "_Metres"},
    "app/common/windows": {"STRETCH_EPOCHS"},
    "app/inspect/guess": {
        "USUAL_IFS_HZ",
        "USUAL_RATES_HZ",
        "_FIRST_LENGTH",
        "_LOOKED_AGAIN",
        "_MOST_READINGS",
        "_MOST_WIDE",
        "_NICE_HZ",
        "_PERIODS",
        "_SECOND_LENGTH",
        "_STATISTICS_BYTES",
        "_STEP_HZ",
        "_TRIED_BLIND",
    },
    "app/inspect/inspection": {"_LEVELS_LISTED"},
    "app/inspect/signal_pictures": {"_CORRELATED_S"},
    "app/protect/bearings": {"_EDGE_SIGMAS", "_FAR_M", "_RADIUS_95", "_RING"},
    "app/protect/duplicates": {"_MARGIN", "_PLACES", "_PLACE_EPOCHS"},
    "app/protect/explanation": {"MOST_CURES"},
    "app/protect/orbits": {"_MOST_REMARKS"},
    "app/protect/outcome": {"DIGITS"},
    "app/protect/outputs": {"_TABLE_CELLS", "_TABLE_EVIDENCE"},
    "app/protect/own_words": {"_MOST_STATES"},
    "app/protect/pictures": {
        "COMPARED_WINDOWS",
        "PAIRS",
        "PERIOD_NS",
        "PROFILES",
        "PROFILE_REACH_CHIPS",
        "SERIES_POINTS",
    },
    "app/protect/behind_null": {"_LOOK_S"},
    "app/protect/positions": {"STRETCH_EPOCHS"},
    "app/protect/preview": {"_FIRST_WINDOWS", "_SOON_S"},
    "app/protect/summary": {"MOST_NOTED"},
    "app/protect/takeover_pictures": {"_CLOCK", "_NS_A_M", "_PLACE", "_RECEIVERS", "_SATELLITES", "_STEP_CHIPS"},
    "app/receive/assembled": {"STRETCH_EPOCHS"},
    "app/receive/diagnosis": {"_MOST_GAPS", "_REACH_STEP_HZ"},
    "app/receive/inputs": {"LONGEST_NAME", "SAME_SAMPLES"},
    "app/receive/logged": {"_NAMED"},
    "app/receive/measured": {"PIECE_S"},
    "app/receive/observed": {"MOST_TIMES_TOLD", "STRETCH_EPOCHS"},
    "app/receive/run": {"DIGITS", "HEADER_FIXES"},
    "app/receive/short_signals": {"_BLOCK_S", "_MOST_BLOCKS", "_NOTHING_NEW"},
    "app/receive/snapshot": {"_DOPPLER_STEP_HZ"},
    "app/receive/tracker": {"BLOCK_S", "BLOCK_SAMPLES", "_READER"},
    "app/receive/vector": {"AHEAD_EPOCHS", "DECODE_S"},
    "array/agreement": {"_CANDIDATES", "_CELL_RAD", "_MOST_ROTATIONS"},
    "array/arrivals": {"_CELL_RAD", "_MOST_CELLS", "_ROUNDS", "_STARTS", "_STEP_LEAST_RAD", "_STEP_MOST_RAD"},
    "array/failing": {"_MEDIAN_OF_SQUARE"},
    "array/noticed": {"_DIRECTIONS"},
    "bands/detector": {"_TESTS"},
    "code_motion/detector": {"_DOF_LEFT", "_TAIL", "_TESTS"},
    "common_change/detector": {"_SHARES"},
    "continuity/causes": {"_HOUR_S", "_UNKNOWNS"},
    "continuity/detector": {"_SHARES"},
    "continuity/code_drag": {"_QUARTERS"},
    "continuity/standing": {"_FAR_M"},
    "correlators/correlator_laws": {"CODE_SPACING_CHIPS", "HALF_PI", "REACH", "_LAST_SCORE"},
    "correlators/second_component": {"EARLY_CHIPS", "OTHER_CHIPS", "TWO_REFLECTIONS"},
    "correlators/beats": {"_UNKNOWNS"},
    "correlators/vector_sqm_detector": {"MOST_NAMED"},
    "dccaf/bursts": {
        "_CLOSEST_CHIPS",
        "_CODE_NULLS",
        "_LAST_STEP_CHIPS",
        "_N_OUT",
        "_POINTS",
        "_SHIFTS",
        "_STEP_CHIPS",
    },
    "dccaf/detector": {"GRIDS"},
    "dccaf/inverse_raim": {"_UNKNOWNS"},
    "dccaf/skies_fit": {
        "_CLIMBED",
        "_DRAWN",
        "_FEWEST_M2",
        "_MOST_M2",
        "_PAIRINGS",
        "_RIDGE",
        "_SMALL_M",
        "_STARTED_FROM",
        "_STEPS",
        "_TAIL_DEGREES",
        "_UNKNOWNS",
        "_UNLIKE_CHIPS",
    },
    "fusion/labels": {"SILENT"},
    "levels/laws": {"DIP_PARTS"},
    "levels/parts": {"STEP_SHARE"},
    "messages/detector": {"_TESTS"},
    "messages/last_day": {"_TESTS"},
    "messages/laws": {"_EARTH_M"},
    "multi_receiver/carriers": {"_MOST_WAYS", "_NEVER", "_UNKNOWN"},
    "multi_receiver/known_geometry": {"_LEAST_M", "_ROUNDS"},
    "multi_receiver/one_antenna": {"WHITE"},
    "multi_receiver/along_baselines": {"_LEAST_SINE"},
    "multi_receiver/pairing": {"_THINNER", "_TRAVEL_S"},
    "multi_receiver/runs": {"_BEGINS", "_ENDS", "_IN", "_OUT"},
    "own_fixes/detector": {"_TAIL"},
    "prediction/choice": {"_IN_SIGMAS", "_SIDES"},
    "prediction/course": {"_CLOCK"},
    "prediction/place": {"_ALL_BUT_PLACE"},
    "prediction/walk": {"_CLOCK"},
    "registry": {"_LONGEST"},
    "residual_causes": {"_ROUNDS"},
    "second_signals/echoes": {"_BLOCKED_DB", "_NEVER_LOG", "_OVER_DB"},
    "torn/detector": {"_OPEN_M_S"},
}
"""Constants that stand elsewhere, by module: steps, bounds and laws of a computation, limits of what is
read, and what is only shown."""


def list_policies() -> list[object]:
    rooms = (detectors, fusion, inspect, receive)
    found = [package for room in rooms for package in pkgutil.walk_packages(room.__path__, f"{room.__name__}.")]
    records = [(module, vars(module).get("POLICY")) for module in map(importlib.import_module, (m.name for m in found))]
    return [record for module, record in records if type(record).__module__ == module.__name__]


@pytest.mark.parametrize("policy", list_policies(), ids=lambda policy: type(policy).__name__)
def test_every_number_says_its_unit_and_its_reason(policy):
    for number in numbers_of(policy):
        assert number.name.endswith(SUFFIX[number.unit]), number
        assert number.reason[0].isupper(), number
        assert number.reason.endswith("."), number
        assert len(number.reason.split()) <= 25, number
        assert np.all(np.isfinite(np.ravel(np.array(number.value, np.float64)))), number


@pytest.mark.parametrize("policy", list_policies(), ids=lambda policy: type(policy).__name__)
def test_a_policy_is_frozen(policy):
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(policy, dataclasses.fields(policy)[0].name, 0.0)


def test_no_number_that_decides_stands_elsewhere():
    found = {}
    for path in sorted(path for room in ROOMS for path in (SRC / room).rglob("*.py")):
        if constants := list_constants(path):
            found[path.relative_to(SRC).with_suffix("").as_posix().removeprefix("detectors/")] = constants
    assert found == COMPUTING


def list_constants(path: Path) -> set[str]:
    """Names of a module that are bound to an expression with a number in it."""
    found = set()
    for statement in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(statement, ast.Assign | ast.AnnAssign) and statement.value is not None:
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            numbers = [node for node in ast.walk(statement.value) if isinstance(node, ast.Constant)]
            if any(type(node.value) in (int, float) for node in numbers):
                found |= {name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)}
    return found
