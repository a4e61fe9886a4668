"""Which functions a study measures, and which of them a command reaches: read out of the code, name by name.

A study may measure what no user runs: a paper's own method, a bound, an idea that was left. Its page says which.
"""

import ast
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache, partial
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Final, NamedTuple

__all__ = ["MeasuredCode", "list_methods_called", "list_unreached"]

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


def list_methods_called(run: Callable[..., Any]) -> MeasuredCode:
    """Return what a study's `run` calls of the methods, by whether a command other than `study` reaches it too."""
    while isinstance(run, partial):
        run = run.func
    graph, module = _build_graph(), run.__module__
    begin = [name for name in graph if name.module == module and run.__name__ in ("<lambda>", name.name)]
    inside = _compute_closure(begin, lambda name: name.module.startswith(f"{_PACKAGE}.studies"))
    found = {target for name in inside for target in graph.get(name, ()) if _is_method(target)}
    reached = _collect_reached()
    return MeasuredCode(
        tuple(sorted(str(name) for name in found if name in reached)),
        tuple(sorted(str(name) for name in found if name not in reached)),
    )


def list_unreached() -> dict[str, tuple[str, ...]]:
    """Return public functions of the methods' rooms that no command but `study` reaches, by module."""
    names = sorted(
        name
        for name in _build_graph().keys() - _collect_reached()
        if _is_method(name) and not name.name.startswith("_")
    )
    modules = dict.fromkeys(name.module for name in names)
    return {
        module.removeprefix(f"{_PACKAGE}."): tuple(name.name for name in names if name.module == module)
        for module in modules
    }


def _is_method(one: _Name) -> bool:
    parts = one.module.split(".")
    return len(parts) > 1 and parts[1] in _METHODS and one.name[0].islower()


@cache
def _collect_reached() -> frozenset[_Name]:
    """All that the commands reach, the installed detectors among it."""
    graph = _build_graph()
    rooms = (f"{_PACKAGE}.cli.", f"{_PACKAGE}.app.")
    roots = [name for name in graph if name.module.startswith(rooms) and name.module not in _NOT_RUN]
    for point in entry_points(group="skyproof.detectors"):
        roots += [name for name in graph if name == _Name(point.module, point.attr)]
    return frozenset(_compute_closure(roots, lambda name: not name.module.startswith(f"{_PACKAGE}.studies")))


def _compute_closure(begin: Iterable[_Name], within: Callable[[_Name], bool]) -> set[_Name]:
    graph, found, waiting = _build_graph(), set[_Name](), list(begin)
    while waiting:
        name = waiting.pop()
        if name not in found and within(name):
            found.add(name)
            waiting += graph.get(name, ())
    return found


@cache
def _build_graph() -> Mapping[_Name, frozenset[_Name]]:
    """Every name at the top of a module, and the names that it mentions."""
    root = Path(__file__).resolve().parents[1]
    trees = {_module_of(path, root): ast.parse(path.read_text(encoding="utf-8")) for path in sorted(root.rglob("*.py"))}
    known = {module: {_Name(module, name) for name, _ in _list_top_names(tree)} for module, tree in trees.items()}
    imported = {module: dict(_imports(tree, trees)) for module, tree in trees.items()}
    graph: dict[_Name, frozenset[_Name]] = {}
    for module, tree in trees.items():
        for name, node in _list_top_names(tree):
            full_name = _Name(module, name)
            graph[full_name] = frozenset(
                target
                for mention in _list_mentions(node, imported[module], module)
                if (target := _resolve(mention, known, imported)) is not None and target != full_name
            )
    return graph


def _module_of(path: Path, root: Path) -> str:
    parts = [_PACKAGE, *path.relative_to(root).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _list_top_names(tree: ast.Module) -> Iterator[tuple[str, ast.stmt]]:
    """Names that a module makes, and how."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name, node
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            yield from (
                (name.id, node) for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)
            )


def _imports(tree: ast.Module, trees: Mapping[str, ast.Module]) -> Iterator[tuple[str, tuple[str, str]]]:
    """Names that a module takes from others of the package: to (module, name), or (module, "") for a whole one."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(_PACKAGE):
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                target = (whole, "") if whole in trees else (node.module or "", alias.name)
                yield alias.asname or alias.name, target


def _list_mentions(node: ast.AST, imported: Mapping[str, tuple[str, str]], module: str) -> Iterator[_Name]:
    for child in ast.walk(node):
        if isinstance(child, ast.Name):
            target = imported.get(child.id, (module, child.id))
            if target[1]:
                yield _Name(*target)
        elif isinstance(child, ast.Attribute) and isinstance(child.value, ast.Name):
            target = imported.get(child.value.id, ("", "?"))
            if not target[1]:
                yield _Name(target[0], child.attr)


def _resolve(
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
