"""verdict.json: exactly the document of the design, whatever goes in comes out, and a schema that says the same."""

import copy
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyproof.errors import InputError, OutputError
from skyproof.formats.verdict import SCHEMA_PATH, make_verdict_schema, read_verdict, write_verdict, write_verdict_json
from skyproof.verdict import Verdict

SAMPLE_PATH = Path(__file__).with_name("verdict-sample.json")
SAMPLE = json.loads(SAMPLE_PATH.read_text(encoding="utf-8"))

# The keys of the documented format, in order; what reads these files elsewhere relies on them.
FIX = (
    "gpst lat_deg lon_deg height_m sigma_east_m sigma_north_m sigma_up_m horizontal_protection_m vertical_protection_m "
    "hidden_m"
)
KEYS = {
    "": "format verdict summary reason may_also_be not_excluded remedy "
    "since_gpst since_sigma_s since_earliest_gpst since_latest_gpst until_gpst "
    "false_alarm_probability_per_hour wrong_statements interference windows noticed assumed receivers signals sources "
    "methods inputs settings versions",
    "interference": "state spells weak_starts",
    "interference.weak_starts": "receiver carrier since_gpst cn0_dbhz open_sky_dbhz",
    "interference.spells": "receiver carriers since_gpst until_gpst fall_db fall_sigma_db level_db "
    "jammer_to_noise_db jammer_to_noise_low_db jammer_to_noise_high_db lost_signals signs may_also_be",
    "windows": "receiver word from_gpst to_gpst may_also_be",
    "noticed": "receiver kind size unit detector share_of_windows",
    "receivers": "name word input start_gpst duration_s trusted_fix consistent_fix inertial_fix held_fix "
    "behind_null false_fix unprotected_fix own_fix own_states",
    "receivers.behind_null": "source_to_noise_db word from_gpst to_gpst seconds cn0_cost_db",
    "receivers.own_fix": "gpst lat_deg lon_deg height_m horizontal_sigma_m from_trusted_m most_from_trusted_m "
    "most_from_trusted_gpst",
    "receivers.own_states": "subject state alarm since_gpst until_gpst",
    "receivers.trusted_fix": FIX,
    "receivers.false_fix": FIX,
    "signals": "receiver sat band code copy label source from_gpst to_gpst cn0_dbhz doppler_hz delay_to_authentic_m "
    "because",
    "signals.because": "detector p_value",
    "sources": "name kind sats azimuth_deg elevation_deg direction_sigma_deg body_azimuth_deg body_elevation_deg "
    "directions stands shows shows_gpst time_offset_s",
    "sources.directions": "frame azimuth_deg elevation_deg along_sigma_deg up_sigma_deg correlation",
    "sources.shows": "lat_deg lon_deg height_m",
    "methods": "detector ran why_not would_need decision tests from_gpst to_gpst statistic threshold p_value "
    "false_alarm_probability",
    "inputs": "path format sha256 cut left_out remarks",
}


def list_objects(value: Any, path: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(value, list):
        for item in value:
            yield from list_objects(item, path)
    elif isinstance(value, dict) and path not in ("settings", "versions"):
        yield path, " ".join(value)
        for key, item in value.items():
            yield from list_objects(item, f"{path}.{key}".strip("."))


def test_the_keys_are_those_of_the_format_in_its_order() -> None:
    found = set(list_objects(json.loads(write_verdict_json(Verdict.model_validate(SAMPLE)))))
    assert found == set(KEYS.items())


def test_what_was_written_reads_back_the_same(tmp_path: Path) -> None:
    verdict = read_verdict(SAMPLE_PATH)
    write_verdict(tmp_path / "verdict.json", verdict)
    text = (tmp_path / "verdict.json").read_text(encoding="utf-8")
    assert text == write_verdict_json(verdict)
    assert text.endswith("}\n")
    assert text.startswith('{\n "format": "skyproof-verdict/2",\n "verdict"')
    assert json.loads(text) == SAMPLE
    assert read_verdict(tmp_path / "verdict.json") == verdict


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_are_not_rounded(value: float) -> None:
    document = copy.deepcopy(SAMPLE)
    document["signals"][0]["doppler_hz"] = value
    text = write_verdict_json(Verdict.model_validate(document))
    assert json.loads(text)["signals"][0]["doppler_hz"] == value


def test_text_stays_text() -> None:
    document = copy.deepcopy(SAMPLE)
    document["inputs"][0]["path"] = 'Ø "båt".bin'
    assert 'Ø \\"båt\\".bin' in write_verdict_json(Verdict.model_validate(document))


# The schema


def find_faults(value: Any, schema: dict[str, Any], root: dict[str, Any]) -> Iterator[str]:
    """Find faults of a value by the keywords of JSON Schema 2020-12 that the published schema uses."""
    kinds = {
        "object": dict,
        "array": list,
        "string": str,
        "boolean": bool,
        "integer": int,
        "number": (int, float),
        "null": type(None),
    }
    known = {
        "$schema",
        "$defs",
        "$ref",
        "title",
        "description",
        "default",
        "type",
        "const",
        "anyOf",
        "enum",
        "pattern",
        "minimum",
        "maximum",
        "items",
        "properties",
        "required",
        "additionalProperties",
    }
    assert set(schema) <= known
    if "$ref" in schema:
        yield from find_faults(value, root["$defs"][schema["$ref"].removeprefix("#/$defs/")], root)
    if "anyOf" in schema and all(list(find_faults(value, choice, root)) for choice in schema["anyOf"]):
        yield f"{value!r} fits no choice"
    if "type" in schema:
        kind = kinds[schema["type"]]
        if not isinstance(value, kind) or (isinstance(value, bool) and schema["type"] != "boolean"):
            yield f"{value!r} is no {schema['type']}"
            return
    if "const" in schema and value != schema["const"]:
        yield f"{value!r} is not {schema['const']!r}"
    if "enum" in schema and value not in schema["enum"]:
        yield f"{value!r} is not one of {schema['enum']}"
    if "pattern" in schema and not re.search(schema["pattern"], value):
        yield f"{value!r} does not match"
    if ("minimum" in schema and value < schema["minimum"]) or ("maximum" in schema and value > schema["maximum"]):
        yield f"{value!r} is out of bounds"
    for item in value if "items" in schema else ():
        yield from find_faults(item, schema["items"], root)
    if schema.get("type") == "object":
        properties, extra = schema.get("properties", {}), schema.get("additionalProperties", True)
        yield from (f"{key} is missing" for key in schema.get("required", ()) if key not in value)
        for key, item in value.items():
            if key in properties:
                yield from find_faults(item, properties[key], root)
            elif extra is False:
                yield f"{key} is unknown"
            elif isinstance(extra, dict):
                yield from find_faults(item, extra, root)


def test_the_published_schema_is_the_one_of_the_models() -> None:
    published = json.loads(SCHEMA_PATH.read_text(encoding="utf-8"))
    assert published == make_verdict_schema(), (
        "write it anew: python -c 'import json; from skyproof.formats.verdict import *; "
        'SCHEMA_PATH.write_text(json.dumps(verdict_schema(), indent=1) + "\\n")\''
    )


def test_the_published_schema_takes_the_sample() -> None:
    schema = json.loads(SCHEMA_PATH.read_text(encoding="utf-8"))
    assert list(find_faults(SAMPLE, schema, schema)) == []


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d.pop("reason"),
        lambda d: d.update(comment="hello"),
        lambda d: d.update(format="skyproof-verdict/1"),
        lambda d: d["signals"][0].update(label="false"),
        lambda d: d["methods"][0].update(p_value=2.0),
        lambda d: d["receivers"][0]["trusted_fix"].update(gpst="2022-01-01T10:00:00+01:00"),
        lambda d: d["signals"][0]["because"][0].pop("p_value"),
    ],
)
def test_the_published_schema_refuses_what_the_models_refuse(change: Callable[[dict[str, Any]], object]) -> None:
    document, schema = copy.deepcopy(SAMPLE), json.loads(SCHEMA_PATH.read_text(encoding="utf-8"))
    change(document)
    assert list(find_faults(document, schema, schema))
    with pytest.raises(ValueError, match="validation error"):
        Verdict.model_validate(document)


def list_descriptions(schema: dict[str, Any]) -> Iterator[tuple[str, str]]:
    for model in (schema, *schema["$defs"].values()):
        for name, field in model.get("properties", {}).items():
            yield name, field.get("description", "")


def test_every_number_has_its_unit_in_the_schema() -> None:
    units = {"_m": "metres", "_s": "seconds", "_hz": "hertz", "_deg": "degrees", "_dbhz": "dB-Hz", "_gpst": "GPS time"}
    for name, description in list_descriptions(make_verdict_schema()):
        for suffix, unit in units.items():
            assert not name.endswith(suffix) or unit in description, name


# Faults of files


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "skyproof-verdict/2 .*JSON"),
        ("[1]", "skyproof-verdict/2 "),
        ("{}", r"\bformat .*\bverdict .* 11 more"),
        (
            json.dumps(SAMPLE | {"format": "skyproof-verdict/1"}),
            "format = .skyproof-verdict/1., expected 'skyproof-verdict/2'",
        ),
        (
            json.dumps(SAMPLE).replace('"label": "spoofed"', '"label": 1'),
            r"signals\[1\].label = 1, expected .authentic., ",
        ),
        (json.dumps(SAMPLE).replace("44.1", "NaN"), r"signals\[0\].cn0_dbhz"),
        (json.dumps(SAMPLE).replace("44.1", '"44.1"'), r"signals\[0\].cn0_dbhz"),
    ],
)
def test_a_file_that_is_no_verdict_says_what_is_wrong_and_where(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "verdict.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=words) as caught:
        read_verdict(path)
    assert str(caught.value).startswith(str(path))


def test_a_file_that_is_not_there_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"verdict\.json.*exist"):
        read_verdict(tmp_path / "verdict.json")


def test_a_place_that_cannot_be_written_is_an_output_error(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"nowhere/verdict\.json"):
        write_verdict(tmp_path / "nowhere" / "verdict.json", Verdict.model_validate(SAMPLE))
