"""Check the keys of SigMF 1.2.6 that say how to read samples, and describe their faults.

Specification: SigMF, version 1.2.6, sections Global Object, Captures Array and Extensions; the keys of the namespace
skyproof are those of `skyproof.formats.sigmf`.
"""

import difflib
import json
import re
from collections.abc import Iterable
from typing import Annotated, Any, Final

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from skyproof.errors import InputError, shorten
from skyproof.formats.bounds import CAPTURES, describe_first
from skyproof.formats.documents import parse_json
from skyproof.formats.layout import BitOrder, Encoding

__all__ = [
    "DATATYPE",
    "LARGEST",
    "Capture",
    "Global",
    "Meta",
    "check_keys",
    "describe_expected",
    "format_value",
    "join_some",
    "parse_meta",
]

DATATYPE: Final = re.compile(r"([cr])(f32|f64|i32|i16|i8|u32|u16|u8)(?:_([lb])e)?")
LARGEST: Final = 2**63 - 1  # that a count of samples or bytes may be
_MOST_CHANNELS: Final = 1024
_DATATYPES: Final = "one of f32, f64, i32, i16, i8, u32, u16, u8 after c or r, such as ci8 or cf32_le"
_KNOWN_CORE: Final = {
    "global": {
        "author",
        "collection",
        "data_doi",
        "description",
        "geolocation",
        "hw",
        "license",
        "meta_doi",
        "recorder",
        "uuid",
    },
    "captures": {"geolocation", "comment", "description"},
}
"""Keys of the specification that do not affect how to read the samples."""


def _make_whole(value: object) -> object:
    """Convert whole floats to int: writers whose numbers are all floats write 4096.0."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


_Count = Annotated[int, BeforeValidator(_make_whole), Field(ge=0, le=LARGEST)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="allow", frozen=True, strict=True, allow_inf_nan=False)

    if_hz: float | None = Field(None, alias="skyproof:if_hz", description="where core:frequency lies, in hertz")
    conjugate: bool | None = Field(None, alias="skyproof:conjugate", description="true if the spectrum is inverted")
    swap_iq: bool | None = Field(None, alias="skyproof:swap_iq", description="true if Q comes before I, else false")


class _Extension(BaseModel):
    model_config = ConfigDict(frozen=True, strict=True)

    name: str = Field(description="the name of the extension")
    optional: bool = Field(description="true or false")


class Global(_Part):
    """What holds for all samples."""

    datatype: str = Field(alias="core:datatype", pattern=f"^(?:{DATATYPE.pattern})$", description=_DATATYPES)
    sample_rate: float = Field(
        alias="core:sample_rate", ge=1e5, le=1e11, description="samples a second, in hertz: 2.6 million is 2600000.0"
    )
    num_channels: _Count = Field(
        1, alias="core:num_channels", ge=1, le=_MOST_CHANNELS, description=f"a count from 1 to {_MOST_CHANNELS}"
    )
    offset: _Count = Field(0, alias="core:offset", description="the number of the first sample, zero or more")
    trailing_bytes: _Count = Field(0, alias="core:trailing_bytes", description="a number of bytes, zero or more")
    dataset: str | None = Field(None, alias="core:dataset", description="the name of a file in the same folder")
    metadata_only: bool = Field(False, alias="core:metadata_only", description="true or false")
    sha512: str | None = Field(
        None, alias="core:sha512", pattern="^[0-9a-fA-F]{128}$", description="128 hexadecimal digits"
    )
    version: str = Field("", alias="core:version", description='the version of SigMF, as "1.2.0"')
    # before version 1 of SigMF it was an object of names and versions, and nothing was required
    extensions: list[_Extension] | dict[str, Any] = Field(
        [], alias="core:extensions", description="a list of extensions with name, version and optional"
    )
    encoding: Encoding | None = Field(
        None, alias="skyproof:encoding", description='"int", "float", "sign", "sign-magnitude" or "offset-binary"'
    )
    bits: _Count | None = Field(None, alias="skyproof:bits", description="the bits of one number")
    bit_order: BitOrder = Field("msb-first", alias="skyproof:bit_order", description='"msb-first" or "lsb-first"')
    antenna: str = Field("1", alias="skyproof:antenna", min_length=1, description="the antenna's name")


class Capture(_Part):
    """What holds from one sample on."""

    sample_start: _Count = Field(alias="core:sample_start", description="the number of a sample, zero or more")
    global_index: _Count | None = Field(None, alias="core:global_index", description="the number of a sample")
    header_bytes: _Count = Field(0, alias="core:header_bytes", description="a number of bytes, zero or more")
    frequency: float | None = Field(
        None,
        alias="core:frequency",
        ge=1e8,
        le=1e11,
        description="the radio frequency at the centre, in hertz: 1575420000.0 is L1",
    )
    datetime: str | None = Field(None, alias="core:datetime", description="UTC, as 2022-01-01T21:45:40.000Z")


class Meta(BaseModel):
    """A file NAME.sigmf-meta."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    general: Global = Field(alias="global", description="an object with core:datatype and core:sample_rate")
    captures: list[Capture] = Field(description="a list of captures, each with core:sample_start")
    annotations: list[Any] = Field([], description="a list of annotations")


_DESCRIPTIONS: Final = {
    str(field.alias or name): str(field.description)
    for model in (Meta, Global, Capture, _Extension)
    for name, field in model.model_fields.items()
}


def describe_expected(key: str) -> str:
    """Describe what a key should hold."""
    return _DESCRIPTIONS[key]


def parse_meta(text: bytes, where: str) -> Meta:
    """Parse the metadata in `text`.

    Raises InputError, which names the faults: key, what came, what was expected.
    """
    content = parse_json(text, where, "the file is damaged or is not SigMF metadata: fetch it again")
    captures = content.get("captures") if isinstance(content, dict) else None
    if isinstance(captures, list) and len(captures) > CAPTURES:
        raise InputError(
            f"{where}: {len(captures)} captures, expected at most {CAPTURES}; cut out those that are wanted"
        )
    try:
        return Meta.model_validate(content)
    except ValidationError as error:
        faults = error.errors(include_url=False)
        raise InputError(f"{where}: " + "; ".join(dict.fromkeys(describe_first(faults, _describe_fault)))) from error


def _describe_fault(fault: Any) -> str:
    """Describe one fault that Pydantic found, in the words of the metadata's writer."""
    known = [part for part in fault["loc"] if isinstance(part, int) or part in _DESCRIPTIONS]
    path = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in known).lstrip(".")
    if fault["type"] == "extra_forbidden":
        key = str(fault["loc"][-1])
        return f"{format_value(key)} is not part of SigMF metadata" + _suggest_near(
            key, ("global", "captures", "annotations")
        )
    if not known:
        return f"{format_value(fault['input'])}, expected an object with global, captures and annotations"
    right = describe_expected(next((part for part in reversed(known) if isinstance(part, str)), "global"))
    if fault["type"] == "missing":
        return f"{path} is missing; expected {right}"
    return f"{path} = {format_value(fault['input'])}, expected {right}"


def _suggest_near(key: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(key[:60], known, n=1, cutoff=0.6)
    return f"; did you mean {near[0]}?" if near else ""


def format_value(value: object) -> str:
    """Format a value as it stands in the metadata, shortened."""
    text = json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= 80 else text[:77] + "..."


def check_keys(meta: Meta, where: str) -> tuple[str, ...]:
    """Raise InputError for keys that cannot be followed; return remarks on keys without a meaning here."""
    extensions = meta.general.extensions if isinstance(meta.general.extensions, list) else []
    needed = [e.name for e in extensions if not e.optional and e.name != "skyproof"]
    if needed:
        raise InputError(
            f"{where}: its samples cannot be read without the extension {', '.join(needed)} of SigMF, which is not "
            "known here; convert the recording, or set optional to true in core:extensions if that is not so"
        )
    declared = {"skyproof", *(e.name for e in extensions)}
    parts: list[tuple[str, str, _Part]] = [("global", "global", meta.general)]
    parts += [("captures", f"captures[{number}]", capture) for number, capture in enumerate(meta.captures)]
    strange: list[tuple[str, str, _Part]] = []
    foreign: dict[str, None] = {}
    for scope, place, part in parts:
        for key in part.model_extra or {}:
            namespace, _, name = key.partition(":")
            if namespace not in ("core", "skyproof"):
                foreign |= {} if namespace in declared else {key: None}
            elif namespace == "skyproof" or name not in _KNOWN_CORE[scope]:
                strange.append((place, key, part))
    if wrong := [found for found in strange if found[1].startswith("skyproof:")]:
        raise InputError(f"{where}: " + "; ".join(describe_first(wrong, _describe_unknown)))
    remarks = ["; ".join(describe_first(strange, _describe_unknown))] if strange else []
    if foreign and not isinstance(meta.general.extensions, dict):
        remarks.append(
            "keys that SigMF does not have and core:extensions does not declare were ignored: "
            + ", ".join(join_some(foreign, ", "))
        )
    return tuple(remarks)


def _describe_unknown(key: tuple[str, str, _Part]) -> str:
    place, name, part = key
    known = [str(field.alias) for field in type(part).model_fields.values()]
    return f"{place}.{shorten(name)} is not a known key{_suggest_near(name, known)}"


def join_some(texts: Iterable[str], between: str) -> list[str]:
    """Join a few of the texts to one; an empty list if there are none."""
    all_of_them = list(texts)
    return [between.join(describe_first(all_of_them, shorten))] if all_of_them else []
