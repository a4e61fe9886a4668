"""Which functions a study measures, and which of them a command reaches: read out of the code, name by name.

A study may measure what no user runs: a paper's own method, a bound, an idea that was left. Its page says so.
"""

import ast
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache, partial
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Final, NamedTuple

__all__ = ["MeasuredCode", "measured_by", "unreached"]

_PACKAGE: Final = "skyproof"
_METHODS: Final = ("decomposition", "detectors", "fusion", "navigation", "receiver", "recording")
"""Rooms whose functions are what a study is about; the others serve."""
_NOT_RUN: Final = ("skyproof.cli.study", "skyproof.app.warm")
"""What is no command's work on a user's data."""


class _Name(NamedTuple):
    """A function, class or constant at the top of a module."""

    module: str
    name: str

    def __str__(self) -> str:
        return f"{self.module.removeprefix(f'{_PACKAGE}.')}.{self.name}"


class MeasuredCode(NamedTuple):
    """Functions and classes of the methods' rooms that a study calls, `room.module.name`, in order."""

    reached: tuple[str, ...]
    not_reached: tuple[str, ...]


def measured_by(run: Callable[..., Any]) -> MeasuredCode:
    """Return what a study's `run` calls of the methods, by whether a command other than `study` reaches it too."""
    while isinstance(run, partial):
        run = run.func
    graph, module = _graph(), run.__module__
    begin = [one for one in graph if one.module == module and run.__name__ in ("<lambda>", one.name)]
    inside = _closure(begin, lambda one: one.module.startswith(f"{_PACKAGE}.studies"))
    found = {target for one in inside for target in graph.get(one, ()) if _is_method(target)}
    reached = _reached()
    return MeasuredCode(
        tuple(sorted(str(one) for one in found if one in reached)),
        tuple(sorted(str(one) for one in found if one not in reached)),
    )


def unreached() -> dict[str, tuple[str, ...]]:
    """Return public functions of the methods' rooms that no command but `study` reaches, by module."""
    names = sorted(one for one in _graph().keys() - _reached() if _is_method(one) and not one.name.startswith("_"))
    modules = dict.fromkeys(one.module for one in names)
    return {
        module.removeprefix(f"{_PACKAGE}."): tuple(one.name for one in names if one.module == module)
        for module in modules
    }


def _is_method(one: _Name) -> bool:
    parts = one.module.split(".")
    return len(parts) > 1 and parts[1] in _METHODS and one.name[0].islower()


@cache
def _reached() -> frozenset[_Name]:
    """All that the commands reach, the installed detectors among it."""
    graph = _graph()
    rooms = (f"{_PACKAGE}.cli.", f"{_PACKAGE}.app.")
    roots = [one for one in graph if one.module.startswith(rooms) and one.module not in _NOT_RUN]
    for point in entry_points(group="skyproof.detectors"):
        roots += [one for one in graph if one == _Name(point.module, point.attr)]
    return frozenset(_closure(roots, lambda one: not one.module.startswith(f"{_PACKAGE}.studies")))


def _closure(begin: Iterable[_Name], within: Callable[[_Name], bool]) -> set[_Name]:
    graph, found, waiting = _graph(), set[_Name](), list(begin)
    while waiting:
        one = waiting.pop()
        if one not in found and within(one):
            found.add(one)
            waiting += graph.get(one, ())
    return found


@cache
def _graph() -> Mapping[_Name, frozenset[_Name]]:
    """Every name at the top of a module, and the names that it mentions."""
    root = Path(__file__).resolve().parents[1]
    trees = {_module_of(path, root): ast.parse(path.read_text(encoding="utf-8")) for path in sorted(root.rglob("*.py"))}
    known = {module: {_Name(module, name) for name, _ in _tops(tree)} for module, tree in trees.items()}
    imported = {module: dict(_imports(tree, trees)) for module, tree in trees.items()}
    graph: dict[_Name, frozenset[_Name]] = {}
    for module, tree in trees.items():
        for name, node in _tops(tree):
            own = _Name(module, name)
            graph[own] = frozenset(
                target
                for mention in _mentions(node, imported[module], module)
                if (target := _resolved(mention, known, imported)) is not None and target != own
            )
    return graph


def _module_of(path: Path, root: Path) -> str:
    parts = [_PACKAGE, *path.relative_to(root).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _tops(tree: ast.Module) -> Iterator[tuple[str, ast.stmt]]:
    """Names that a module makes, and how."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name, node
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            yield from ((one.id, node) for target in targets for one in ast.walk(target) if isinstance(one, ast.Name))


def _imports(tree: ast.Module, trees: Mapping[str, ast.Module]) -> Iterator[tuple[str, tuple[str, str]]]:
    """Names that a module takes from others of the package: to (module, name), or (module, "") for a whole one."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(_PACKAGE):
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                target = (whole, "") if whole in trees else (node.module or "", alias.name)
                yield alias.asname or alias.name, target


def _mentions(node: ast.AST, imported: Mapping[str, tuple[str, str]], module: str) -> Iterator[_Name]:
    for one in ast.walk(node):
        if isinstance(one, ast.Name):
            target = imported.get(one.id, (module, one.id))
            if target[1]:
                yield _Name(*target)
        elif isinstance(one, ast.Attribute) and isinstance(one.value, ast.Name):
            target = imported.get(one.value.id, ("", "?"))
            if not target[1]:
                yield _Name(target[0], one.attr)


def _resolved(
    mention: _Name, known: Mapping[str, set[_Name]], imported: Mapping[str, Mapping[str, tuple[str, str]]]
) -> _Name | None:
    """Where a name is made, through packages that pass it on."""
    for _ in range(5):
        if mention in known.get(mention.module, ()):
            return mention
        further = imported.get(mention.module, {}).get(mention.name)
        if further is None or not further[1]:
            return None
        mention = _Name(*further)
    return None
