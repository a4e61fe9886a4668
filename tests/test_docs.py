"""What the documentation says can be done, can be done; no text of the repository names the place it was made at."""

import ast
import importlib
import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import skyproof
from skyproof.app.common.platform import Platform, read_platform
from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import instantiate_detectors
from skyproof.cli import app, main
from skyproof.formats.raw import SampleLayout, read_sidecar
from skyproof.formats.sigmf import open_sigmf
from skyproof.formats.tables import FIXES_COLUMNS
from skyproof.formats.verdict import read_verdict
from skyproof.records import Records
from skyproof.records.policy import numbers_of
from skyproof.simulator import load_ready_made, parse_scenario
from skyproof.studies import studies
from skyproof.testing import MeasuredScene

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
MADE_BY_MAKE = DOCS / "pages"
GUIDE = (
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    *(page for page in sorted(DOCS.rglob("*.md")) if MADE_BY_MAKE not in page.parents),
)
COMMANDS = [name for name in app if not name.startswith("-")]
MADE_BY_HOOKS = {
    DOCS / name for name in ("tutorial.md", "contributing.md", "changelog.md", "validation.md", "report.html")
}
LICENCES_STANDARDS_DOIS = (
    "www.apache.org/licenses",
    "doi.org",
    "www.w3.org",
    "www.opengis.net",
    "json-schema.org",
    "www.google.com/kml/ext",
)


def test_what_is_cited_is_what_is_installed() -> None:
    project = tomllib.loads(read_text(ROOT / "pyproject.toml"))["project"]
    cited = read_text(ROOT / "CITATION.cff").splitlines()
    for line in (f"title: {project['name']}", f"version: {project['version']}", f"license: {project['license']}"):
        assert line in cited
    (author,) = project["authors"]
    assert f"  - name: {author['name']}" in cited
    versions = [item.rpartition(" :: ")[2] for item in project["classifiers"] if ":: Python :: 3." in item]
    assert f">={versions[0]}" == project["requires-python"]
    assert sys.version_info[:2] in [tuple(map(int, item.split("."))) for item in versions]


@pytest.mark.parametrize("page", [ROOT / "README.md", DOCS / "start.md"], ids=lambda page: page.name)
def test_both_ways_to_install_are_given(page: Path) -> None:
    commands = "\n".join(list_blocks(page, "sh"))
    assert "make setup" in commands
    assert "pip install .\n" in commands


def read_text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def list_blocks(path: Path, language: str) -> list[str]:
    """List the fenced blocks of a page that are in `language`."""
    return re.findall(rf"^```{language}(?: [^\n]*)?\n(.*?)^```", read_text(path), re.MULTILINE | re.DOTALL)


def list_code_spans(path: Path) -> list[str]:
    """List what stands between single backticks, outside of fenced blocks and of generated parts."""
    written = re.sub(
        r"^<!-- (?!end)[^\n]* -->\n(?:(?!<!-- ).)*?<!-- end -->", "", read_text(path), flags=re.MULTILINE | re.DOTALL
    )
    return re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", written, flags=re.MULTILINE | re.DOTALL))


def list_options(command: str) -> list[str]:
    arguments = app[command].assemble_argument_collection(parse_docstring=False)
    return [argument.names[0] for argument in arguments if argument.names[0].startswith("--")]


def list_shell_lines(path: Path) -> list[str]:
    """List arguments of every line of a page's shell blocks that calls skyproof with something."""
    lines = [line for block in list_blocks(path, "sh") for line in block.replace("\\\n", " ").splitlines()]
    return list_arguments(lines)


def list_arguments(texts: list[str]) -> list[str]:
    calls = (re.match(r"(?:\$ )?(?:\.venv/bin/)?skyproof (.+)", text.strip()) for text in texts)
    return [call[1].partition("  #")[0].strip() for call in calls if call]


@pytest.fixture(scope="module")
def tables() -> ModuleType:
    """Import the module that makes the manual's tables."""
    sys.path.insert(0, str(DOCS / "build"))
    try:
        return importlib.import_module("tables")
    finally:
        sys.path.remove(str(DOCS / "build"))


@pytest.fixture(scope="module")
def fill(tables: ModuleType) -> ModuleType:
    """Import the module that writes generated parts into the pages."""
    sys.path.insert(0, str(DOCS / "build"))
    try:
        return importlib.import_module("fill")
    finally:
        sys.path.remove(str(DOCS / "build"))


# Commands


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_and_option_is_in_the_manual(command: str, tables: ModuleType) -> None:
    page = tables.commands()
    section = page.partition(f"## `skyproof {command}`\n")[2].partition("\n## ")[0]
    assert "<!-- commands -->" in read_text(DOCS / "commands.md")
    assert [option for option in list_options(command) if f"`{option}" not in section] == []
    assert f"\nskyproof {command}" in section.partition("```sh")[2]  # an example


def test_the_built_page_of_policies_holds_every_number(tables: ModuleType) -> None:
    lines = tables.policies().splitlines()
    numbers = [number for _, _, policy in tables._policies() for number in numbers_of(policy)]
    assert len(numbers) > 100
    for number in numbers:
        assert any(f"`{number.name}`" in line and number.reason in line for line in lines), number


def test_every_option_that_is_named_is_one() -> None:
    known = {option for command in COMMANDS for option in list_options(command)} | {
        name for name in app if "--" in name
    }
    pages = [page for page in GUIDE if page.parent.name != "design"]  # which name options of other programs
    spans = [span for page in pages for span in list_code_spans(page) if span.startswith(("--", "skyproof "))]
    reported = {option for span in spans for option in re.findall(r"(?<!\S)--[a-z][a-z-]+", span)}
    assert reported - known == set()


def list_command_lines() -> list[str]:
    return [line for page in GUIDE for line in [*list_shell_lines(page), *list_arguments(list_code_spans(page))]]


@pytest.mark.parametrize("line", sorted(set(list_command_lines())))
def test_every_command_line_parses(line: str) -> None:
    tokens = shlex.split(line)
    if tokens[0] == "COMMAND":
        tokens[0] = COMMANDS[0]
    if tokens not in [[command] for command in COMMANDS]:  # its name alone speaks of it and does not call it
        app.parse_args(tokens, exit_on_error=False, print_error=False)


@pytest.mark.long
def test_every_command_line_of_the_first_pages_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # Those of a newcomer, in order, in an empty folder; what both pages tell is done once.
    monkeypatch.chdir(tmp_path)
    for line in dict.fromkeys([*list_shell_lines(ROOT / "README.md"), *list_shell_lines(DOCS / "start.md")]):
        if not line.startswith("--"):  # what changes the shell of who runs this
            assert main(shlex.split(line)) == 0, f"{line}: {capsys.readouterr().err}"
    assert (tmp_path / "result" / "report.html").is_file()


def test_every_make_target_that_is_named_exists_and_is_described() -> None:
    made_by_make = set(re.findall(r"^([a-z-]+):.*?## ", read_text(ROOT / "Makefile"), re.MULTILINE))
    pattern = r"(?:^|`)make ([a-z][a-z-]*)"
    reported = {name for page in GUIDE for name in re.findall(pattern, read_text(page), re.MULTILINE)}
    assert reported <= made_by_make
    assert made_by_make - {"help"} <= reported


# Files


def test_every_setting_and_key_is_in_the_manual_with_its_default(tables: ModuleType) -> None:
    settings = tables.keys("skyproof.app.common.settings:Settings")
    assert [name for name in Settings.model_fields if f"| `{name}` |" not in settings] == []
    assert "| `false_alarm_probability_per_hour` | `0.001` |" in settings
    layout = tables.keys("skyproof.formats.raw:SampleLayout")
    assert [name for name in SampleLayout.model_fields if f"| `{name}` |" not in layout] == []
    assert "| `rate_hz` | needed |" in layout


def test_every_mark_of_a_page_names_what_there_is(tables: ModuleType) -> None:
    pages = [page for page in GUIDE if page.is_relative_to(DOCS)]
    marks = [mark for page in pages for mark in re.findall(r"<!-- (\w+): (.*?) -->", read_text(page))]
    untold = []
    for word, kind in marks:
        if word == "keys":
            lines = tables.keys(kind).splitlines()[2:]
            untold += [f"{kind}: {line}" for line in lines if line.endswith(("|  |", "| . |"))]
        elif word == "figure":
            assert studies()[kind.split()[0]].charts, f"{kind} draws nothing"
        elif word == "chart":
            assert len(kind.split("|")) >= 3, kind
    assert {word for word, _ in marks} <= {"chart", "keys", "figure", "output", "root", "notebook"}
    assert untold == []


def test_every_page_holds_what_the_code_says_now(fill: ModuleType) -> None:
    # So that it can be read where nothing is built: `make fill` writes it.
    assert len(fill.pages()) > 10
    texts = {page.name: read_text(page) for page in fill.pages()}
    assert [name for name, text in texts.items() if fill.marks.filled(text, fill.unbuilt) != text] == []
    empty = [name for name, text in texts.items() for mark in fill.marks.MARK.finditer(text) if not mark[3]]
    assert empty == []


def test_a_page_filled_twice_is_the_same(fill: ModuleType) -> None:
    page = "one\n\n<!-- studies -->\n\ntwo <!-- keys: a:B -->\n\nold\n\n<!-- end -->\nthree\n"
    once = fill.marks.filled(page, lambda word, what, so_far: f"{word} {what}")
    assert once.count("<!-- end -->") == 2
    assert "old" not in once
    assert fill.marks.filled(once, lambda word, what, so_far: f"{word} {what}") == once
    assert fill.marks.filled(once, lambda word, what, so_far: so_far) == once
    assert "<!--" not in fill.marks.replaced(once, lambda word, what, so_far: so_far)


def test_a_table_is_drawn_with_a_line_for_each_row(fill: ModuleType) -> None:
    page = "| of | 2 s | 5 s | end |\n|---|---|---|---|\n| one | 1.5, 3 | 20 (1) | 7 |\n| two | | 4 | |\n\n"
    ((kind, table),) = fill.charts.charts_in(page + "<!-- chart: Growth | s | m | log -->\n")
    svg = fill.charts.chart_of(kind, table)
    assert [name for name in ("one", "two", "Growth") if svg.count(f">{name}<") != 1] == []
    points = sum(path.count("z") for path in re.findall(r'class="point.*?/>', svg))
    assert points == 3 + 2 * 2  # and two a line in the legend
    for path in fill.pages():
        text = read_text(path)
        asked = re.findall(r"<!-- chart: (.*?) -->", text)
        assert [kind for kind, _ in fill.charts.charts_in(text)] == asked, path.name


def test_the_files_that_the_manual_shows_are_read(tmp_path: Path) -> None:
    sidecar, _, scenario = list_blocks(DOCS / "formats.md", "toml")
    (tmp_path / "rx1.toml").write_text(sidecar, encoding="utf-8")
    read_sidecar(tmp_path / "rx1.toml")
    for page in ("commands.md", "platform.md"):
        (platform,) = list_blocks(DOCS / page, "toml")
        (tmp_path / "platform.toml").write_text(platform, encoding="utf-8")
        assert read_platform(tmp_path / "platform.toml") != Platform()
    assert [attack.kind for attack in parse_scenario(tomllib.loads(scenario)).attacks] == ["meaconer"]
    (meta,) = list_blocks(DOCS / "formats.md", "json")
    (tmp_path / "one.sigmf-meta").write_text(meta, encoding="utf-8")
    np.arange(8000).astype(np.int8).tofile(tmp_path / "one.sigmf-data")
    (samples,) = open_sigmf(tmp_path / "one.sigmf-meta")
    assert (samples.rate_hz, samples.n_samples) == (4e6, 4000)


def test_every_fix_column_and_sigmf_key_is_described() -> None:
    page = read_text(DOCS / "formats.md")
    assert [name for name in FIXES_COLUMNS if f"`{name}`" not in page] == []
    keys = set(re.findall(r"skyproof:\w+", read_text(ROOT / "src" / "skyproof" / "formats" / "sigmf.py")))
    assert {key for key in keys if f"`{key}`" not in page} == set()


def test_every_ready_made_scene_is_described() -> None:
    page = read_text(DOCS / "scenarios.md")
    assert [name for name in load_ready_made() if f"\n| [`{name}`]" not in page] == []
    assert f"{len(load_ready_made())} ready-made scenes" in read_text(ROOT / "README.md")


# Pages and code


def test_every_file_and_test_that_is_named_exists() -> None:
    missing = []
    for page in GUIDE:
        for target in re.findall(r"\]\((?!https?:)([^)#\s]+)", read_text(page)):
            target_path = (page.parent / target).resolve()
            missing += [] if target_path.exists() or target_path in MADE_BY_HOOKS else [f"{page.name}: {target}"]
        for path, name in re.findall(r"\b((?:tests|bench|docs|src)/[\w/.-]*\w)(?:::(\w+))?", read_text(page)):
            found = (ROOT / path).exists() and (not name or f"def {name}(" in read_text(ROOT / path))
            found = found or (ROOT / path).is_relative_to(MADE_BY_MAKE)
            missing += [] if found else [f"{page.name}: {path} {name}"]
    assert missing == []


def test_the_words_of_the_glossary_are_in_order_and_used() -> None:
    words = re.findall(r"^(\S.*)\n:  ", read_text(DOCS / "glossary.md"), re.MULTILINE)
    assert len(words) > 40
    assert words == sorted(words, key=lambda word: re.sub(r"[^a-z0-9]", "", word.lower()))
    pages = " ".join(read_text(page) for page in GUIDE if page.name != "glossary.md").replace("\n", " ").lower()
    rooms = " ".join(read_text(page) for page in sorted((ROOT / "src").rglob("*.py"))).lower()
    assert [word for word in words if word.strip("`").lower() not in pages + rooms] == []


@pytest.mark.parametrize(
    "page",
    [page for page in GUIDE if list_blocks(page, "python") and page.name != "detector.md"],
    ids=lambda page: page.name,
)
def test_the_python_of_every_page_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # With a verdict and observations that are at hand, in place of an hour of recordings.
    verdict = read_verdict(ROOT / "tests" / "formats" / "verdict-sample.json")
    observations = MeasuredScene().records(np.random.default_rng(1)).observations[0]
    monkeypatch.setattr(skyproof, "protect", lambda *_, **__: verdict)
    monkeypatch.setattr(skyproof, "receive", lambda *_, **__: SimpleNamespace(observations=observations))
    inspection = SimpleNamespace(summary="10 satellites", satellites=())
    monkeypatch.setattr(skyproof, "inspect", lambda *_, **__: (inspection,), raising=False)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in list_blocks(page, "python"):
        exec(compile(block, page.name, "exec"), names)


def test_the_python_page_uses_every_name_that_is_promised() -> None:
    code = "\n".join(list_blocks(DOCS / "python" / "index.md", "python"))
    used = {
        node.attr
        for node in ast.walk(ast.parse(code))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "sp"
    }
    assert used == set(skyproof.__all__)


def test_the_manuals_detector_meets_the_contract(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The page's files as they stand there; what an installer would write about the package is written by hand.
    page = read_text(DOCS / "extend" / "detector.md")
    files = dict(re.findall(r'^```\w+ title="(.*?)"\n(.*?)^```', page, re.MULTILINE | re.DOTALL))
    assert sorted(files) == ["pyproject.toml", "restless.py", "test_restless.py"]
    for name, content in files.items():
        (tmp_path / name).write_text(content, encoding="utf-8")
    project = tomllib.loads(files["pyproject.toml"])["project"]
    folder = tmp_path / f"{project['name']}-{project['version']}.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    lines = [
        f"[{group}]\n" + "".join(f"{name} = {at}\n" for name, at in points.items())
        for group, points in project["entry-points"].items()
    ]
    (folder / "entry_points.txt").write_text("\n".join(lines))
    monkeypatch.syspath_prepend(str(tmp_path))
    names: dict[str, object] = {}
    exec(compile(files["test_restless.py"], "test_restless.py", "exec"), names)
    tests = [value for name, value in names.items() if name.startswith("test_")]
    assert len(tests) == 1
    for test in tests:
        test()  # type: ignore[operator]
    nothing = Records(start_gpst=np.datetime64("NaT"), end_gpst=np.datetime64("NaT"))
    assert "restless" in {detector.name for detector in instantiate_detectors(Settings(), nothing)}
    body = files["restless.py"].partition("    def _test_receiver")[2]
    assert len(body.splitlines()) <= 20


@pytest.mark.long
def test_the_manual_builds_offline_without_a_warning(tmp_path: Path) -> None:
    # Figures left out: those are commands of their own, which other tests run.
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    env = os.environ | {"SKYPROOF_FIGURES": "no", "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    pages = sorted((tmp_path / "site").rglob("*.html"))
    assert len(pages) > 40
    fetched = re.compile(r"<(?:script|img|link|iframe)[^>]+(?:src|href)=\"?(https?:)?//")
    assert [page.name for page in pages if fetched.search(read_text(page))] == []
    assert "<!--" not in re.sub(
        r"<code>.*?</code>|<pre.*?</pre>", "", read_text(tmp_path / "site" / "commands.html"), flags=re.DOTALL
    )


def test_the_notebook_has_the_form_of_one() -> None:
    notebook = json.loads(read_text(DOCS / "tutorial.ipynb"))
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    ids = [cell["id"] for cell in notebook["cells"]]
    assert len(set(ids)) == len(ids)
    for cell in notebook["cells"]:
        needed = {"cell_type", "id", "metadata", "source"}
        assert set(cell) == needed | ({"execution_count", "outputs"} if cell["cell_type"] == "code" else set())
        assert cell["cell_type"] in ("code", "markdown")


# Texts


@pytest.fixture(scope="module")
def texts() -> dict[str, str]:
    """Read every text file that is, or is about to be, in the repository."""
    command = ["git", "-C", str(ROOT), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, capture_output=True, check=False)
    if listed.returncode:
        pytest.skip("not a git checkout")
    found = {}
    for name in listed.stdout.decode().split("\0"):
        content = (ROOT / name).read_bytes() if name and (ROOT / name).is_file() else b"\0"
        if b"\0" not in content:
            found[name] = content.decode("utf-8", errors="replace")
    assert {"README.md", "Makefile", "pyproject.toml"} <= found.keys()
    return found


def test_no_text_names_a_path_of_this_machine(texts: dict[str, str]) -> None:
    places = [place for place in (ROOT, Path.home()) if len(place.parts) > 1]
    pattern = re.compile("|".join(rf"(?<![\w.]){re.escape(str(place))}(?![\w-])" for place in places))
    assert {name: match[0] for name, text in texts.items() if (match := pattern.search(text))} == {}


def test_links_lead_to_licences_standards_and_dois_only(texts: dict[str, str]) -> None:
    links = {(name, link) for name, text in texts.items() for link in re.findall(r"https?://([^\s\"'`)>}]+)", text)}
    assert {(name, link) for name, link in links if not link.startswith(LICENCES_STANDARDS_DOIS)} == set()


def test_the_lock_file_pins_hashes_and_names_no_index(texts: dict[str, str]) -> None:
    lock = texts["requirements.lock"]
    pinned = re.findall(r"^[\w.-]+==", lock, re.MULTILINE)
    assert len(pinned) > 20
    assert len(re.findall(r"^[\w.-]+==[^\n]*\\\n +--hash=sha256:", lock, re.MULTILINE)) == len(pinned)
    assert re.findall(r"^--.*", lock, re.MULTILINE) == []
