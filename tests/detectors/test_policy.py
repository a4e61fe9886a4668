"""The numbers by which detectors decide stand in one record a room, each with its unit and its reason."""

import ast
import dataclasses
import importlib
import pkgutil
from pathlib import Path

import numpy as np
import pytest

from skyproof import detectors
from skyproof.detectors.policy import numbers_of

ROOM = Path(detectors.__file__).parent
SUFFIX = {
    "m": "_m",
    "s": "_s",
    "s/s": "_drift",
    "m/s": "_m_s",
    "Hz": "_hz",
    "dB": "_db",
    "dB/m": "_db_m",
    "dB-Hz": "_dbhz",
    "deg": "_deg",
    "rad": "_rad",
    "rad/s": "_rad_s",
    "cycle": "_cyc",
    "chip": "_chips",
    "sigma": "_sigmas",
    "sigma^2": "_squared_sigmas",
    "looks, sigma": "_branches",
    "1": "",
}
"""By which a name shows its unit."""
COMPUTING = {
    "adapter": {"_UNTESTED"},
    "array/agreement": {"_CANDIDATES", "_CELL_RAD", "_MOST_ROTATIONS"},
    "array/arrivals": {"_CELL_RAD", "_MOST_CELLS", "_ROUNDS", "_STARTS", "_STEP_LEAST_RAD", "_STEP_MOST_RAD"},
    "array/failing": {"_MEDIAN_OF_SQUARE"},
    "base": {"UNTESTED"},
    "code_motion/detector": {"_DOF_LEFT", "_TAIL", "_TESTS"},
    "code_motion/laws": {"_MS_M"},
    "common_change/detector": {"_SHARES"},
    "continuity/detector": {"_SHARES"},
    "continuity/drawn_off": {"_QUARTERS"},
    "continuity/standing": {"_FAR_M"},
    "continuity/steps": {"_STEERED_M"},
    "correlators/correlator_laws": {"CODE_SPACING_CHIPS", "HALF_PI", "REACH", "_LAST_SCORE"},
    "correlators/second_component": {"EARLY_CHIPS", "OTHER_CHIPS", "TWO_REFLECTIONS"},
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
    "levels/laws": {"DIP_PARTS"},
    "messages/detector": {"_EARTH_M"},
    "multi_receiver/carriers": {"_MOST_WAYS", "_NEVER", "_UNKNOWN"},
    "multi_receiver/known_geometry": {"_LEAST_M", "_ROUNDS"},
    "multi_receiver/one_antenna": {"WHITE"},
    "multi_receiver/pairing": {"_THINNER", "_TRAVEL_S"},
    "multi_receiver/runs": {"_BEGINS", "_ENDS", "_IN", "_OUT"},
    "own_fixes/detector": {"_TAIL"},
    "registry": {"_LONGEST"},
    "second_signals/echoes": {"_BLOCKED_DB", "_NEVER_LOG", "_OVER_DB"},
    "torn/detector": {"_OPEN_M_S"},
}
"""Constants that stand elsewhere, by module: steps, bounds and laws of a computation, and what is only shown."""


def policies() -> list[object]:
    found = pkgutil.walk_packages(detectors.__path__, "skyproof.detectors.")
    records = [(module, vars(module).get("POLICY")) for module in map(importlib.import_module, (m.name for m in found))]
    return [record for module, record in records if type(record).__module__ == module.__name__]


@pytest.mark.parametrize("policy", policies(), ids=lambda policy: type(policy).__name__)
def test_every_number_says_its_unit_and_its_reason(policy):
    for number in numbers_of(policy):
        assert number.name.endswith(SUFFIX[number.unit]), number
        assert number.reason[0].isupper(), number
        assert number.reason.endswith("."), number
        assert len(number.reason.split()) <= 25, number
        assert np.all(np.isfinite(np.ravel(np.array(number.value, np.float64)))), number


@pytest.mark.parametrize("policy", policies(), ids=lambda policy: type(policy).__name__)
def test_a_policy_is_frozen(policy):
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(policy, dataclasses.fields(policy)[0].name, 0.0)


def test_no_number_that_decides_stands_elsewhere():
    for path in sorted(ROOM.rglob("*.py")):
        module = path.relative_to(ROOM).with_suffix("").as_posix()
        assert numeric_constants(path) <= COMPUTING.get(module, set()), module


def numeric_constants(path: Path) -> set[str]:
    """Names of a module that are bound to an expression with a number in it."""
    found = set()
    for statement in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(statement, ast.Assign | ast.AnnAssign) and statement.value is not None:
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            numbers = [node for node in ast.walk(statement.value) if isinstance(node, ast.Constant)]
            if any(type(node.value) in (int, float) for node in numbers):
                found |= {name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)}
    return found
