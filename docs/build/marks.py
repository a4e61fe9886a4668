"""The marks of a page, and what stands between a mark and its end: committed, so that a page can be read unbuilt."""

import re
from collections.abc import Callable

__all__ = ["MARK", "filled", "replaced"]

MARK = re.compile(
    r"<!-- (chart|commands|keys|figure|output|notebook|policies|root|scenes|studies)(?:: *(.*?))? -->"
    r"(?:\n((?:(?!<!-- ).)*?)<!-- end -->)?",
    re.DOTALL,
)
"""The word, what it is of, and what stands there until the mark's end; the last two may be absent."""


def replaced(page: str, made: Callable[[str, str, str], str]) -> str:
    """A page with every mark, and what stands there, replaced by what `made` gives for word, what and text so far."""
    return MARK.sub(lambda mark: made(mark[1], mark[2] or "", (mark[3] or "").strip("\n")), page)


def filled(page: str, made: Callable[[str, str, str], str]) -> str:
    """A page with its marks kept, and between each and its end what `made` gives; nothing where that is empty."""

    def fill(word: str, what: str, so_far: str) -> str:
        mark, text = f"<!-- {word}{': ' if what else ''}{what} -->", made(word, what, so_far).strip("\n")
        return f"{mark}\n\n{text}\n\n<!-- end -->" if text else mark

    return replaced(page, fill)
