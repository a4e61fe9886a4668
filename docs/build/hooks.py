"""MkDocs' hooks: every mark of the form `<!-- word: what -->` in a page becomes what `tables` and `runs` make of it.

With SKYPROOF_FIGURES=no nothing is run, which takes seconds: figures and outputs stay as the page has them.
"""

import base64
import html
import logging
import os
import posixpath
import re
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import charts
import marks
import runs
import tables
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from skyproof.studies import studies

log = logging.getLogger("mkdocs.hooks.skyproof")
FIGURES = os.environ.get("SKYPROOF_FIGURES", "yes") != "no"
ROOT_PAGES = {"contributing.md": "CONTRIBUTING.md", "changelog.md": "CHANGELOG.md"}
VALIDATION = "# Validation\n\n`skyproof study --validation docs/validation.md` makes this page; it was not made yet.\n"
LEFT_OUT = "<!doctype html><title>left out</title><p>This manual was built without what commands make."


def on_files(files: Files, config: MkDocsConfig, **_: Any) -> Files:
    """Add pages of the root and of the notebook, and all that commands draw."""
    for page, name in ROOT_PAGES.items():
        files.append(File.generated(config, page, content=f"<!-- root: {name} -->\n"))
    if files.get_file_from_path("validation.md") is None:
        files.append(File.generated(config, "validation.md", content=VALIDATION))
    files.append(File.generated(config, "tutorial.md", content="<!-- notebook: tutorial.ipynb -->\n"))
    texts = [file.content_string for file in files.documentation_pages()]
    found = {mark.group(1, 2) for text in texts for mark in marks.MARK.finditer(text)}
    pages = [f"scenes/{name}.html" for name in tables.scene_names()]
    if not FIGURES:
        for uri in ("report.html", *pages):
            files.append(File.generated(config, uri, content=LEFT_OUT))
        return files
    names = sorted({what for word, what in found if word == "figure"})
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # each is a command of its own
        drawn = list(pool.map(_figure, names))
    for path in drawn:
        if path is not None:
            files.append(File.generated(config, f"figures/{path.name}", abs_src_path=str(path)))
    files.append(File.generated(config, "report.html", abs_src_path=str(runs.demo() / "report.html")))
    for path in runs.scene_pages():
        files.append(File.generated(config, f"scenes/{path.name}", abs_src_path=str(path)))
    return files


def _figure(name: str) -> Any:
    try:
        return runs.figure(name)
    except RuntimeError as error:
        log.warning("figure %s: %s", name, error)
        return None


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files, **_: Any) -> str:
    """Replace the marks of a page. Those of a page of the root are text about marks and stay."""
    drawn = {what: charts.chart_of(what, table) for what, table in charts.charts_in(markdown)}

    def made(word: str, what: str, so_far: str) -> str:
        return _chart(what, drawn[what]) if word == "chart" else _made(word, what, so_far, page)

    return marks.replaced(markdown, made)


def _chart(what: str, svg: str) -> str:
    title, octets = html.escape(what.partition("|")[0].strip()), base64.b64encode(svg.encode("utf-8")).decode("ascii")
    return f'<img class="figure" alt="{title}" src="data:image/svg+xml;base64,{octets}">'


def on_post_page(output: str, page: Page, **_: Any) -> str:
    """Pages fetch nothing from a network."""
    return _with_our_worker(output, page.file.dest_uri)


def on_post_template(output_content: str, template_name: str, **_: Any) -> str:
    """Nor does the page for what is not found."""
    return _with_our_worker(output_content, template_name)


def _with_our_worker(page: str, uri: str) -> str:
    """What stands in for a worker where pages are opened from a disk is ours: the theme would fetch one."""
    ours = posixpath.relpath("worker.js", posixpath.dirname(uri))
    return re.sub(r'src="?[^"> ]+/iframe-worker/shim"?', f'src="{ours}"', page)


def _made(word: str, what: str, so_far: str, page: Page) -> str:
    table = tables.table_of(word, what, "scenes/{}.html")
    if table is not None:
        return table
    match word:
        case "root":
            return tables.page_of_root(what)
        case "notebook":
            return runs.notebook(runs.ROOT / "docs" / what)
        case "output":
            return f"```text\n{runs.output(what).rstrip()}\n```" if FIGURES else so_far
    name, *options = runs.figure_words(what)
    one, command = studies()[name], f"`skyproof study {' '.join([name, *options])} --plot`"
    if not FIGURES:
        return so_far
    path = posixpath.relpath(f"figures/{name}.svg", posixpath.dirname(page.file.src_uri))
    return f"![{one.title}]({path}){{ .figure }}\n\n*{one.title}: {command}*"
