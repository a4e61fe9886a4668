"""What the documentation says can be done, can be done; no text of the repository names the place it was made at."""

import ast
import re
import shlex
import subprocess
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import skyproof
from skyproof.app.settings import Settings, resolve_settings
from skyproof.cli import app
from skyproof.formats.raw import SampleLayout, read_sidecar
from skyproof.formats.verdict import read_verdict
from skyproof.testing import MeasuredScene

ROOT = Path(__file__).resolve().parent.parent
GUIDE = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md"))
COMMANDS = [name for name in app if not name.startswith("-")]
LICENCES_STANDARDS_DOIS = ("www.apache.org/licenses", "doi.org", "www.w3.org", "www.opengis.net", "json-schema.org",
                           "www.google.com/kml/ext")  # fmt: skip


def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def blocks(path: Path, language: str) -> list[str]:
    """The fenced blocks of a page that are in `language`."""
    return re.findall(rf"^```{language}\n(.*?)^```", text_of(path), re.MULTILINE | re.DOTALL)


def code_spans(path: Path) -> list[str]:
    """What stands between single backticks, outside of fenced blocks."""
    return re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", text_of(path), flags=re.MULTILINE | re.DOTALL))


def options_of(command: str) -> list[str]:
    arguments = app[command].assemble_argument_collection(parse_docstring=False)
    return [argument.names[0] for argument in arguments if argument.names[0].startswith("--")]


def command_lines() -> list[str]:
    """Every line of a shell block, and every code span, that calls skyproof with something."""
    shell = [line for page in GUIDE for block in blocks(page, "sh") for line in block.replace("\\\n", " ").splitlines()]
    spans = [span for page in GUIDE for span in code_spans(page)]
    calls = (re.match(r"(?:\$ )?(?:\.venv/bin/)?skyproof (.+)", text.strip()) for text in [*shell, *spans])
    return [call[1].partition("  #")[0].strip() for call in calls if call]


# Commands


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_and_option_is_in_the_readme(command: str) -> None:
    readme = text_of(ROOT / "README.md")
    assert f"skyproof {command}" in readme
    assert [option for option in options_of(command) if f"`{option}" not in readme] == []


def test_every_option_in_the_readme_is_one() -> None:
    known = {option for command in COMMANDS for option in options_of(command)} | {"--help", "--version"}
    told = {option for span in code_spans(ROOT / "README.md") for option in re.findall(r"(?<!\S)--[a-z][a-z-]+", span)}
    assert told <= known


def test_every_setting_is_in_the_readme_with_its_default() -> None:
    rows = dict(re.findall(r"^\| `(\w+)` \| ([^|]+?) \|", text_of(ROOT / "README.md"), re.MULTILINE))
    defaults = {name: field.default for name, field in Settings.model_fields.items()}
    assert {name: rows.get(name) for name in defaults} == {
        name: {"duration_s": "the end"}.get(name, "not given") if default is None else f"{default:g}"
        for name, default in defaults.items()
    }


@pytest.mark.parametrize("line", sorted(set(command_lines())))
def test_every_command_line_parses(line: str) -> None:
    tokens = shlex.split(line)
    if tokens[0] == "COMMAND":
        tokens[0] = COMMANDS[0]
    if tokens not in [[command] for command in COMMANDS]:  # its name alone speaks of it and does not call it
        app.parse_args(tokens, exit_on_error=False, print_error=False)


def test_every_make_target_that_is_named_exists_and_is_told() -> None:
    made = set(re.findall(r"^([a-z-]+):.*?## ", text_of(ROOT / "Makefile"), re.MULTILINE))
    pattern = r"(?:^|`)make ([a-z][a-z-]*)"
    told = {name for page in GUIDE for name in re.findall(pattern, text_of(page), re.MULTILINE)}
    assert told <= made
    assert made - {"help"} <= told


# Pages and code


def test_the_sidecar_and_the_platform_file_of_the_readme_are_read(tmp_path: Path) -> None:
    sidecar, platform = blocks(ROOT / "README.md", "toml")
    (tmp_path / "rx1.toml").write_text(sidecar, encoding="utf-8")
    (tmp_path / "platform.toml").write_text(platform, encoding="utf-8")
    read_sidecar(tmp_path / "rx1.toml")
    assert resolve_settings(tmp_path / "platform.toml") != Settings()


def test_every_key_of_a_sidecar_is_in_the_readme() -> None:
    readme = text_of(ROOT / "README.md")
    assert [key for key in SampleLayout.model_fields if f"`{key}`" not in readme and f"\n{key} = " not in readme] == []


def test_every_file_and_test_that_is_named_exists() -> None:
    missing = []
    for page in GUIDE:
        for target in re.findall(r"\]\((?!https?:)([^)#]+)", text_of(page)):
            missing += [] if (page.parent / target).exists() else [f"{page.name}: {target}"]
        for path, name in re.findall(r"\b((?:tests|bench|docs|src)/[\w/.-]*\w)(?:::(\w+))?", text_of(page)):
            found = (ROOT / path).exists() and (not name or f"def {name}(" in text_of(ROOT / path))
            missing += [] if found else [f"{page.name}: {path} {name}"]
    assert missing == []


def test_the_detector_of_the_guide_runs_and_meets_the_contract() -> None:
    names: dict[str, object] = {}
    for block in blocks(ROOT / "CONTRIBUTING.md", "python"):
        exec(compile(block, "CONTRIBUTING.md", "exec"), names)
    tests = [value for name, value in names.items() if name.startswith("test_")]
    assert len(tests) == 1
    for test in tests:
        test()  # type: ignore[operator]


def test_the_python_of_the_readme_runs(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """With a verdict and observations that are at hand, in place of an hour of recordings."""
    verdict = read_verdict(ROOT / "tests" / "formats" / "verdict-sample.json")
    observations = MeasuredScene().records(np.random.default_rng(1)).observations[0]
    monkeypatch.setattr(skyproof, "protect", lambda *_, **__: verdict)
    monkeypatch.setattr(skyproof, "receive", lambda *_, **__: SimpleNamespace(observations=observations))
    code = "\n".join(blocks(ROOT / "README.md", "python"))
    used = {node.attr for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name) and node.value.id == "sp"}  # fmt: skip
    assert used == set(skyproof.__all__)
    exec(compile(code, "README.md", "exec"), {})
    assert capsys.readouterr().out


# Texts


@pytest.fixture(scope="module")
def texts() -> dict[str, str]:
    """Every text file that is, or is about to be, in the repository."""
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
