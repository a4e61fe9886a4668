"""The package's docstrings as Markdown: `name : text` becomes an item of a list, a ruled heading a line in bold."""

import re
from typing import Any

import griffe

ITEM = re.compile(r"(?:^|(?<=\. ))(\w+(?:, \w+)*) : ", re.MULTILINE)


def items_of(docstring: str) -> list[tuple[list[str], str]]:
    """What a docstring tells of arguments or keys: names, and the text about them."""
    found = []
    for paragraph in re.split(r"\n\s*\n", "\n".join(line.strip() for line in docstring.splitlines())):
        parts = ITEM.split(paragraph)
        if parts[0].strip() == "" or len(parts) > 1:
            found += [
                (names.split(", "), " ".join(text.split()))
                for names, text in zip(parts[1::2], parts[2::2], strict=True)
            ]
    return found


def markdown_of(docstring: str) -> str:
    """The docstring as Markdown."""
    lines = docstring.splitlines()
    made: list[str] = []
    for number, line in enumerate(lines):
        following = lines[number + 1] if number + 1 < len(lines) else ""
        if following and re.fullmatch(r"-{3,}", following):
            made += ["", f"**{line}**", ""]
        elif re.fullmatch(r"-{3,}", line):
            continue
        elif item := re.match(r"(\w+(?:, \w+)*) : (.*)", line):
            if made and made[-1] and not made[-1].startswith(("- ", "  ")):
                made.append("")
            made.append(f"- {', '.join(f'`{name}`' for name in item[1].split(', '))}: {item[2]}")
        elif made and made[-1].startswith(("- ", "  ")) and line.startswith("    "):
            made.append(f"  {line.strip()}")
        else:
            made.append(line)
    return "\n".join(line if line.startswith("    ") else line.replace("](", "]\\(") for line in made)  # no link


class Docstrings(griffe.Extension):
    """Rewrites every docstring before it is rendered."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        if obj.docstring:
            obj.docstring.value = markdown_of(obj.docstring.value)
