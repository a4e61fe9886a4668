"""What the manual tells from the code itself: commands from the command line, keys of files from their models."""

import importlib
import itertools
import json
import pkgutil
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from docstrings import items_of
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from skyproof import detectors, fusion
from skyproof.app import inspect, receive
from skyproof.app.common.settings import Settings
from skyproof.app.init.text import write_one_line
from skyproof.cli import app
from skyproof.records.policy import numbers_of
from skyproof.simulator import Site, load_ready_made
from skyproof.studies import studies

ROOT = Path(__file__).resolve().parents[2]
NOT_GIVEN = "–"
WRITTEN = "skyproof.verdict"
"""Documents of this module are read by users and written by the package: their defaults help nobody."""
BESIDES = " besides"
WORDS = {
    "name": "Name in files and other tables.",
    "description": "A description for readers.",
    "seed": "Seed of all random numbers.",
    "start_gpst": "GPS time of second zero.",
    "duration_s": "Duration.",
    "mask_deg": "No signal comes from below this elevation.",
    "lat_deg": "Geodetic latitude, WGS-84.",
    "lon_deg": "Longitude, east positive.",
    "height_m": "Height above the ellipsoid.",
    "path": "The route; without one the site stands still.",
    "speed_m_s": "Speed along the route.",
    "radius_m": "Radius of the circle.",
    "clockwise": "Seen from above.",
    "body_m": "Forward, right, down from the receiver's position.",
    "spin": "A rotating arm that carries it.",
    "multipath": "Reflections.",
    "imu": "An inertial unit.",
    "receivers": "One table each.",
    "signals": "One table each.",
    "sources": "One table each.",
    "methods": "One table per detector.",
    "inputs": "One table per file.",
    "front_end": "How all receivers sample.",
    "sky": "The true signals.",
    "attacks": "One table each.",
    "interference": "One table each.",
    "antennas": "More antennas, one table each.",
    "message_later_s": "Added to the time of week in the message.",
    "receive": "Position or route of the antenna that receives the sky.",
    "delay_s": "Delay between reception and transmission.",
    "shows": "Position or route that the false signals show.",
    "transmit": "Position or route of the transmit antenna.",
    "power_points_db": "(time, additional power): linear in between, constant beyond the ends.",
    "onset_s": "Start of transmission.",
    "until_s": "End of transmission; none if absent.",
    "off_s": "(from, until): pauses.",
    "offset_hz": "Offset of the line from the nominal carrier.",
    "sweep_hz": "Width of a chirp.",
    "period_s": "Period of a chirp.",
    "zenith_cn0_dbhz": "C/N0 of a signal from the zenith.",
    "horizon_cn0_dbhz": "C/N0 of a signal from the horizon.",
    "SceneSpin.rate_hz": "Rotations per second; positive is clockwise seen from above.",
    "SceneImu.rate_hz": "Readings per second.",
    "FrontEnd.rate_hz": "Sample rate, whole hertz.",
    "FrontEnd.if_hz": "Intermediate frequency of the carrier.",
    "FrontEnd.bits": "Bits of one number, I or Q.",
    "Multipath.height_m": "Height of the antenna over a level reflector; the extra path is 2 h sin(elevation).",
    "FromFile.path": "The file: CSV, NMEA or KML.",
}
"""What keys mean that are given nowhere else, by key or by Model.key."""


OPTIONS = {
    argument.names[0]
    for argument in app["protect"].assemble_argument_collection(parse_docstring=False)
    if argument.names
}
"""Those of protect, which say what the settings of the same names mean."""


def commands() -> str:
    """Every command with its arguments, options and examples, as the command line itself tells them."""
    _, *sections = re.split(r"^## skyproof (\S+)\n", app.generate_docs(output_format="markdown"), flags=re.MULTILINE)
    stated: dict[str, str] = {}
    pairs = zip(sections[::2], sections[1::2], strict=True)
    return "\n\n".join(_once(name, _command(name, text), stated) for name, text in pairs)


def _once(name: str, section: str, stated: dict[str, str]) -> str:
    """Name the options that an earlier command states in the same words, in one line for each such command."""
    kept, as_of = [], dict[str, list[str]]()
    for line in section.split("\n"):
        option = re.match(r"\* `(--[\w-]+)", line)
        if option and line in stated:
            as_of.setdefault(stated[line], []).append(f"`{option[1]}`")
        else:
            kept.append(line)
            if option:
                stated[line] = name
    last = max((n for n, line in enumerate(kept) if line.startswith("* `--")), default=len(kept) - 1)
    kept[last + 1 : last + 1] = [f"* {', '.join(names)}: as for `skyproof {other}`." for other, names in as_of.items()]
    return "\n".join(kept)


def _command(name: str, text: str) -> str:
    usage = (app[name].usage or f"skyproof {name}").removeprefix("Usage: ").strip()
    body = re.sub(r"^```console\n.*?```", f"```text\n{usage}\n```", text.strip(), count=1, flags=re.DOTALL)
    body = body.replace("**Parameters**", "**Options**").replace(" **[required]**", " *[needed]*")
    epilogue = f"{app[name].help_epilogue or ''}\n"
    example = re.sub(r"((?:^skyproof .*\n)+)", r"```sh\n\1```\n", epilogue, flags=re.MULTILINE)
    return f"## `skyproof {name}`\n\n{body}\n\n{example.strip()}"


def keys(name: str) -> str:
    """Make a table of the keys of a Pydantic model, `module:Model`; with `besides`, of those that its base lacks."""
    module, _, model_name = name.removesuffix(BESIDES).partition(":")
    model: type[BaseModel] = getattr(importlib.import_module(module), model_name)
    kinds = [kind for kind in reversed(model.__mro__) if issubclass(kind, BaseModel) and kind is not BaseModel]
    documented = {key: text for kind in kinds for names, text in items_of(kind.__doc__ or "") for key in names}
    known = set(model.__mro__[1].model_fields) if name.endswith(BESIDES) else _of_site(model)
    fields = {key: field for key, field in model.model_fields.items() if key not in known}
    rows = []
    for key, field in fields.items():
        default = "needed" if field.is_required() else _toml(field.get_default(call_default_factory=True))
        default = default if default in ("needed", NOT_GIVEN) else f"`{default}`"
        text = field.description or documented.get(key) or WORDS.get(f"{model_name}.{key}") or WORDS.get(key, "")
        choices = _choices(field.annotation)
        if len(choices) == 1 and not field.is_required():
            continue  # the heading of the table names it
        means = text if all(word in text for word in choices) else f"{text} {_listed(choices)}".strip()
        option = f"--{key.replace('_', '-')}"
        if model is Settings and option in OPTIONS:
            means = f"as `{option}`"
        example = write_one_line(field.examples[0]) if field.examples else ""
        if example.startswith(("{", "[")):  # of a plain value the default or the unit is enough
            means = f"{means} `{example}`"
        rows.append((f"`{key}`", default, _cell(means[:1].upper() + means[1:])))
    heads = ["key", "default", "means"]
    if model.__module__ == WRITTEN or all(default == "needed" for _, default, _ in rows):
        heads.remove("default")
    cells_of = []
    for same, group in itertools.groupby(rows, key=lambda row: row[1:]):  # neighbours that mean the same share a row
        names = ", ".join(row[0] for row in group)
        cells_of.append(dict(zip(("key", "default", "means"), (names, *same), strict=True)))
    return _table(heads, [[row[head] for head in heads] for row in cells_of])


def _of_site(model: type[BaseModel]) -> set[str]:
    """Keys of places, which have a table of their own."""
    return set(Site.model_fields) if issubclass(model, Site) and model is not Site else set()


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _toml(value: Any) -> str:
    if value is None or value is PydanticUndefined:
        return NOT_GIVEN
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, BaseModel):
        return "{...}"
    if isinstance(value, tuple | list):
        return f"[{', '.join(_toml(one) for one in value)}]"
    if isinstance(value, str):
        return json.dumps(value)
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def _choices(annotation: Any) -> list[str]:
    """The words that a key may be."""
    return [word for word in getattr(annotation, "__args__", ()) if isinstance(word, str)]


def _listed(words: list[str]) -> str:
    return f"{'One of ' if len(words) > 1 else ''}{', '.join(f'`{word}`' for word in words)}."


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def scene_names() -> list[str]:
    """The ready-made scenes, in alphabetical order."""
    return list(load_ready_made())


def scenes(link: str) -> str:
    """A table of the ready-made scenes, each with a link, in which {} stands for the name."""
    rows = [(f"[`{name}`]({link.format(name)})", _cell(one.title)) for name, one in load_ready_made().items()]
    return _table(("scene", "what happens"), rows)


def study_list() -> str:
    """A table of the studies."""
    return _table(
        ("study", "figure", "what it makes"),
        [(f"`{one.name}`", _cell(one.figure), _cell(one.title)) for one in studies().values()],
    )


def table_of(word: str, what: str, scene_link: str) -> str | None:
    """The table that stands for a mark; None if the mark stands for something else."""
    match word:
        case "commands":
            return commands()
        case "keys":
            return keys(what)
        case "policies":
            return policies()
        case "scenes":
            return scenes(scene_link)
        case "studies":
            return study_list()
    return None


def policies() -> str:
    """Make a table of the numbers that decide, for each room."""
    head = ("number", "value", "unit", "why", "source")
    parts = []
    for room, _, policy in _policies():
        numbers = numbers_of(policy)
        rows = [(f"`{each.name}`", _value(each.value), each.unit, each.reason, each.source) for each in numbers]
        parts.append(f"### {room}\n\n{_table(head, rows)}")
    return "\n\n".join(parts)


def policy_files(link: str) -> str:
    """List the files that hold those numbers, each with a link, in which {} stands for the path."""
    return "\n".join(f"- [`{path}`]({link.format(path)})" for _, path, _ in _policies())


def _policies() -> Iterator[tuple[str, str, Any]]:
    """Yield each room that has a policy, the path of its file below `src/skyproof`, and the policy."""
    for package in (fusion, detectors, receive, inspect):
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            module = importlib.import_module(found.name)
            policy = vars(module).get("POLICY")
            if policy is not None and type(policy).__module__ == module.__name__:
                room = module.__name__.removesuffix(".policy").rpartition(".")[2]
                yield room, f"{module.__name__.partition('.')[2].replace('.', '/')}.py", policy


def _value(value: Any) -> str:
    """Return a number, or several, as they stand in a table."""
    return ", ".join(_value(each) for each in value) if isinstance(value, tuple) else f"{value:.6g}"


def page_of_root(name: str) -> str:
    """A page of the repository's root, with its links as seen from docs/."""
    text = (ROOT / name).read_text(encoding="utf-8")
    for here, there in (("docs/", ""), ("CHANGELOG.md", "changelog.md"), ("CONTRIBUTING.md", "contributing.md")):
        text = text.replace(f"]({here}", f"]({there}")
    return re.sub(r"\[([^\]]+)\]\(LICENSE\)", r"\1", text)
