"""The page in a real browser: no network, no complaints, nothing too wide for a telephone, nothing that is hard to see.

Skipped where no Chromium is installed.
"""

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import axe_core_python
import pytest
from tests.report.sample import EMPTY, SAMPLE, VERDICT, make_pictures

from skyproof.report.page import write_report_html
from skyproof.verdict import Verdict

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
QUIET = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-sync",
    "--disable-background-networking",
    "--disable-component-update",
    "--hide-scrollbars",
)
OFFLINE = "--host-resolver-rules=MAP * ~NOTFOUND"
AXE = Path(axe_core_python.__file__).with_name("axe.min.js")
CSP = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')
DARK = "@media (prefers-color-scheme: dark)"

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")


def browse(folder: Path, page: str, *options: str) -> tuple[str, str]:
    """Open the page; return its final state, and the browser's messages."""
    path = folder / "page.html"
    path.write_text(page, encoding="utf-8")
    assert CHROMIUM is not None
    command = [
        CHROMIUM,
        *QUIET,
        OFFLINE,
        f"--user-data-dir={folder / 'profile'}",
        "--enable-logging=stderr",
        "--virtual-time-budget=20000",
        *options,
        "--dump-dom",
        path.as_uri(),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    return done.stdout, "\n".join(line for line in done.stderr.splitlines() if "CONSOLE" in line)


def add_script(page: str, script: str) -> str:
    """Copy the page with a script that leaves its result in an element of its own."""
    leave = "function leave(x) { const e = document.createElement('pre'); e.id = 'result'; "
    leave += "e.textContent = JSON.stringify(x); document.documentElement.append(e); }"
    return CSP.sub("", page).replace("</body>", f"<script>{leave}\n{script}</script></body>")


def read_result(dom: str) -> Any:
    (found,) = re.findall(r'<pre id="result">(.*?)</pre>', dom, re.DOTALL)
    return json.loads(html.unescape(found))


def measure_width(folder: Path, page: str, width: int) -> int:
    """Measure how wide the page wants to be in a window so wide."""
    frame = f'<iframe style="width:{width}px;height:800px;border:0" srcdoc="{html.escape(page)}"></iframe>'
    script = "onload = () => leave(document.querySelector('iframe').contentDocument.documentElement.scrollWidth)"
    dom, _ = browse(folder, add_script(f"<!DOCTYPE html><html><body>{frame}</body></html>", script))
    return int(read_result(dom))


def list_violations(folder: Path, page: str) -> list[str]:
    """List what axe finds wrong, with the place of each."""
    script = f"{AXE.read_text(encoding='utf-8')}\naxe.run(document).then(r => leave(r.violations))"
    dom, _ = browse(folder, add_script(page, script))
    return [f"{v['id']}: {node['html']}" for v in read_result(dom) for node in v["nodes"]]


WHY = {"reason": "one antenna", "may_also_be": [], "not_excluded": [], "remedy": "a longer recording"}
SUSPECT = WHY | {"may_also_be": ["reflections", "fault"]}
PASSED = WHY | {"not_excluded": ["a false sky from the start"]}


def make_empty() -> str:
    """Make a page that has next to nothing to show."""
    return write_report_html(
        Verdict.model_validate(
            SAMPLE
            | {
                "verdict": "no_attack_seen",
                **PASSED,
                "since_gpst": None,
                "since_sigma_s": None,
                "receivers": [SAMPLE["receivers"][1]],
                "signals": [],
                "sources": [],
                "methods": [],
            }
        ),
        EMPTY,
    )


def test_the_page_opens_without_network_and_without_a_complaint(tmp_path: Path) -> None:
    dom, complaints = browse(tmp_path, write_report_html(VERDICT, make_pictures()))
    assert "Receivers compared" in dom
    assert complaints == ""


@pytest.mark.long
def test_the_browser_would_complain(tmp_path: Path) -> None:
    _, complaints = browse(tmp_path, add_script(write_report_html(VERDICT, make_pictures()), "nothing.there"))
    assert "ReferenceError" in complaints


@pytest.mark.long
@pytest.mark.parametrize("width", [320, 360, 820, 1200])
def test_nothing_is_wider_than_the_window(tmp_path: Path, width: int) -> None:
    assert measure_width(tmp_path, write_report_html(VERDICT, make_pictures()), width) == width


@pytest.mark.long
def test_a_wide_thing_would_be_seen(tmp_path: Path) -> None:
    page = write_report_html(VERDICT, make_pictures()).replace("<main>", '<main><p style="width:500px">wide</p>', 1)
    assert measure_width(tmp_path, CSP.sub("", page), 360) > 360


@pytest.mark.long
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("which", ["spoofed", "authentic", "suspect", "no_attack_seen", "nothing"])
def test_a_reader_who_sees_badly_misses_nothing(tmp_path: Path, which: str, dark: bool) -> None:
    more = {"suspect": SUSPECT, "no_attack_seen": PASSED}.get(which, {})
    verdict = Verdict.model_validate(SAMPLE | {"verdict": which} | more) if which != "nothing" else None
    page = make_empty() if verdict is None else write_report_html(verdict, make_pictures())
    assert list_violations(tmp_path, page.replace(DARK, "@media all") if dark else page) == []


def count_pages(folder: Path, page: str) -> int:
    path, pdf = folder / "page.html", folder / "page.pdf"
    path.write_text(page, encoding="utf-8")
    assert CHROMIUM is not None
    profile = f"--user-data-dir={folder / 'profile'}"
    command = [CHROMIUM, *QUIET, OFFLINE, profile, f"--print-to-pdf={pdf}", path.as_uri()]
    subprocess.run(command, capture_output=True, timeout=120, check=True)
    return len(re.findall(rb"/Type */Page\b", pdf.read_bytes()))


@pytest.mark.long
def test_what_is_folded_is_printed(tmp_path: Path) -> None:
    filler = "".join(f"<p>line {i}</p>" for i in range(400))
    folded = write_report_html(VERDICT, make_pictures()).replace("</summary>", f"</summary>{filler}", 1)
    folded = folded.replace("<details open>", "<details>")
    opened = folded.replace("<details>", "<details open>")
    bare = folded.replace(filler, "")
    assert count_pages(tmp_path, folded) == count_pages(tmp_path, opened) > count_pages(tmp_path, bare) + 3


@pytest.mark.long
def test_the_checker_would_see_a_fault(tmp_path: Path) -> None:
    page = write_report_html(VERDICT, make_pictures()).replace("--soft: #55616f", "--soft: #c5c9cf", 1)
    assert any(fault.startswith("color-contrast") for fault in list_violations(tmp_path, page))
