"""What the manual shows and commands make: figures, outputs and the notebook's page.

They are kept in .cache/manual until the code that made them changes.
"""

import ast
import base64
import contextlib
import hashlib
import io
import json
import logging
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

log = logging.getLogger("mkdocs.runs")
ROOT = Path(__file__).resolve().parents[2]
CACHE = ROOT / ".cache" / "manual"
BIN = Path(sys.executable).parent
WIDTH = 84
LONGEST = 1500
"""Characters of an object that has no better way to show itself."""
STUDY_ROOMS = ("studies", "detectors", "statistics", "navigation", "simulator", "gnss", "records", "report/chart.py")
"""What the rows and charts of a study depend on; everything else may change without making them anew."""


def fingerprint(rooms: tuple[str, ...] = ("",)) -> str:
    """A hash of the sources in some rooms of the package."""
    package = ROOT / "src" / "skyproof"
    found = sorted(
        {
            path
            for room in rooms
            for path in ([package / room] if (package / room).is_file() else (package / room).rglob("*"))
            if path.suffix in {".py", ".toml", ".html", ".css"}
        }
    )
    digest = hashlib.sha256()
    for path in found:
        digest.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


@contextlib.contextmanager
def kept(name: str, key: str) -> Iterator[bool]:
    """Whether something of this name has to be made; once it was, the key is kept beside it."""
    mark = CACHE / f"{name}.key"
    stale = not mark.is_file() or mark.read_text(encoding="utf-8") != key
    if stale:
        mark.unlink(missing_ok=True)
    yield stale
    if stale:
        mark.parent.mkdir(parents=True, exist_ok=True)
        mark.write_text(key, encoding="utf-8")


def run(*words: str, folder: Path = CACHE) -> str:
    """Standard output of a command of skyproof, run in a folder. Raises RuntimeError with its last line."""
    folder.mkdir(parents=True, exist_ok=True)
    env = os.environ | {"COLUMNS": str(WIDTH), "NO_COLOR": "1", "TERM": "dumb"}
    log.info("skyproof %s", shlex.join(words))
    command = [str(BIN / "skyproof"), *words]
    done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"skyproof {shlex.join(words)}: {done.stderr.strip().splitlines()[-1:]}")
    return done.stdout


def figure(what: str) -> Path:
    """The chart of a study, run quickly, or with the options that follow its name."""
    name, *options = figure_words(what)
    path = CACHE / "figures" / f"{name}.svg"
    with kept(f"figures/{name}", f"{fingerprint(STUDY_ROOMS)} {options}") as stale:
        if stale:
            run("study", name, *options, "--plot", "--out", "figures")
    return path


def figure_words(what: str) -> list[str]:
    """Name of a study and options, as a mark gives them."""
    words = what.split()
    return words if len(words) > 1 else [*words, "--quick"]


def demo() -> Path:
    """The folder of `skyproof demo`, with what it printed in printed.txt."""
    folder = CACHE / "run" / "demo"
    with kept("demo", fingerprint()) as stale:
        if stale:
            printed = run("demo", "--out", "demo", "--overwrite", folder=CACHE / "run")
            (folder / "printed.txt").write_text(printed, encoding="utf-8")
    return folder


def output(line: str) -> str:
    """What a command prints where the demonstration's recordings are in the folder demo."""
    folder = demo().parent
    if line == "skyproof demo --out demo":
        return (folder / "demo" / "printed.txt").read_text(encoding="utf-8")
    name = re.sub(r"\W+", "-", line)
    path = CACHE / "outputs" / f"{name}.txt"
    with kept(f"outputs/{name}", fingerprint()) as stale:
        if stale:
            printed = run(*shlex.split(line)[1:], folder=folder)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(printed, encoding="utf-8")
    return path.read_text(encoding="utf-8")


def scene_pages() -> list[Path]:
    """The pages that draw the ready-made scenes."""
    with kept("pages", fingerprint(("simulator", "gnss", "report", "app/scenes"))) as stale:
        if stale:
            run("simulate", "--pages", "pages")
    return sorted((CACHE / "pages").glob("*.html"))


# The notebook


def notebook(path: Path) -> str:
    """A notebook as Markdown, with the outputs that are kept in it."""
    parts = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        parts.append(source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```")
        parts += [_as_markdown(output) for output in cell.get("outputs", ())]
    return "\n\n".join(parts)


def _as_markdown(output: dict[str, Any]) -> str:
    if output["output_type"] == "stream":
        return f'<div class="output" markdown>\n\n```text\n{"".join(output["text"]).rstrip()}\n```\n\n</div>'
    data = output["data"]
    if "image/svg+xml" in data:
        octets = base64.b64encode("".join(data["image/svg+xml"]).encode()).decode()
        return f'<img class="figure" alt="chart" src="data:image/svg+xml;base64,{octets}">'
    if "text/html" in data:
        return f'<div class="shown">{" ".join("".join(data["text/html"]).split())}</div>'
    return f"```text\n{''.join(data['text/plain'])}\n```"


def executed(cells: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The cells with what each prints and how its last expression shows itself, as a notebook keeps it.

    Run in one namespace, in a folder of its own.
    """
    names: dict[str, Any] = {"__name__": "__main__"}
    before, count = Path.cwd(), 0
    done = []
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            for cell in cells:
                if cell["cell_type"] == "code":
                    count += 1
                    outputs = run_cell("".join(cell["source"]), names, count)
                    cell = cell | {"execution_count": count, "outputs": outputs}
                done.append(cell)
        finally:
            os.chdir(before)
    return done


def run_cell(source: str, names: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """Run one cell in a namespace: what it printed, and its last expression as a notebook would show it."""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, "cell", "exec"), names)
        value = None if last is None else eval(compile(ast.Expression(last.value), "cell", "eval"), names)
    outputs: list[dict[str, Any]] = []
    if printed.getvalue():
        outputs.append({"output_type": "stream", "name": "stdout", "text": _lines(printed.getvalue())})
    if value is not None:
        outputs.append(
            {"output_type": "execute_result", "execution_count": count, "metadata": {}, "data": _shown(value)}
        )
    return outputs


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


def _shown(value: Any) -> dict[str, list[str]]:
    drawn = value._repr_html_() if hasattr(value, "_repr_html_") else ""
    if drawn:
        kind = "image/svg+xml" if drawn.startswith("<svg") else "text/html"
        return {kind: _lines(drawn), "text/plain": [f"<{type(value).__name__}>"]}  # no address: the same every time
    text = repr(value)
    return {"text/plain": _lines(text if len(text) <= LONGEST else f"{text[:LONGEST]} ...")}
