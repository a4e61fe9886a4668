"""What a user of the package may rely on: its names, in any order of imports, each documented with an example."""

import ast
import importlib.metadata
import inspect
import re
import subprocess
import sys
import typing
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

import skyproof as sp
from skyproof.app.receive import ReceiveResult
from skyproof.app.receive.reception import Reception
from skyproof.errors import InputError, NotEnoughData
from skyproof.records import NavigationData, Samples

NAMES = ("inspect", "protect", "receive", "simulate", "to_dataframe", "to_xarray")


def test_the_promise_is_exactly_these_names() -> None:
    assert tuple(sp.__all__) == NAMES
    with pytest.raises(AttributeError, match=r"'skyproof' .*'triangulate'"):
        _ = sp.triangulate  # type: ignore[attr-defined]


def test_dir_shows_the_names_before_any_is_used() -> None:
    program = "import skyproof as sp; print(*dir(sp))"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    names = run.stdout.split()
    assert {*NAMES, "__version__", "__all__", "__doc__"} <= set(names)
    assert [name for name in names if not name.startswith("_")] == list(NAMES)


def test_the_version_is_that_of_the_metadata() -> None:
    assert sp.__version__ == importlib.metadata.version("skyproof")


@pytest.mark.parametrize("use", [sp.protect, sp.receive])
@pytest.mark.parametrize("inputs", [("a.bin", "b.bin"), (["a.bin", Path("b.bin")],), (Path("a.bin"), ("b.bin",))])
def test_inputs_are_given_one_by_one_or_as_a_list(use, inputs, tmp_path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    module = sys.modules[use.__module__]
    opened: list[Path] = []

    def open_inputs(paths, *_, **__):  # type: ignore[no-untyped-def]
        opened.extend(paths)
        raise InputError("opened")

    monkeypatch.setattr(module, "open_inputs", open_inputs)
    with pytest.raises(InputError, match=r"^opened$"):
        use(*inputs)
    assert opened == [Path("a.bin"), Path("b.bin")]


def test_an_input_that_is_no_path_is_named() -> None:
    with pytest.raises(InputError, match=r"\b7, .*\bint;"):
        sp.protect("a.bin", 7)


def test_observations_that_are_not_there_say_why() -> None:
    reception = Reception(
        source=cast("Samples", SimpleNamespace(name="bow", path="bow.bin")),
        observations=None,
        decoded=NavigationData(ephemerides=()),
        n_signals=4,
        examined_s=2.0,
        left_out="no time of week read",
    )
    result = ReceiveResult(receptions=(reception,), signals=((),))
    with pytest.raises(NotEnoughData, match=r"^bow\.bin: "):
        _ = result.observations
    assert len(repr(result)) < 200


@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_a_function_that_is_documented_whole(name: str) -> None:
    function = getattr(sp, name)
    assert inspect.isfunction(function)
    reported = inspect.getdoc(function) or ""
    for part in ("Parameters\n----", "Returns\n----", "Raises\n----"):
        assert part in reported
    for parameter in inspect.signature(function).parameters:
        assert re.search(rf"^(\w+, )*{parameter}(, \w+)* : ", reported, re.MULTILINE), parameter
    hints = typing.get_type_hints(function)
    assert hints.keys() == {*inspect.signature(function).parameters, "return"}


@pytest.mark.parametrize("name", NAMES)
def test_a_name_has_an_example_that_calls_it_as_it_may_be_called(name: str) -> None:
    code = "\n".join(line.strip() for line in re.findall(r"^    +.*\bsp\.\w+\(.*", sp.__doc__ or "", re.MULTILINE))
    reported = inspect.getdoc(getattr(sp, name)) or ""
    matching = [line.strip() for line in reported.splitlines() if f"sp.{name}(" in line]
    assert matching
    calls = [node for node in ast.walk(ast.parse("\n".join([code, *matching]))) if isinstance(node, ast.Call)]
    mine = [call for call in calls if isinstance(call.func, ast.Attribute) and call.func.attr == name]
    assert len(mine) >= 2
    for call in mine:
        keywords = {keyword.arg: None for keyword in call.keywords if keyword.arg}
        inspect.signature(getattr(sp, name)).bind(*call.args, **keywords)


@pytest.mark.parametrize(
    "first",
    ["import skyproof.simulator", "from skyproof import simulate", "from skyproof.app import demo", "sp.protect"],
)
def test_simulate_is_the_use_case_whatever_came_first(first: str) -> None:
    program = f"import skyproof as sp; {first}; print(sp.simulate.__module__)"
    run = subprocess.run([sys.executable, "-W", "error::ImportWarning", "-c", program], capture_output=True, text=True)
    assert (run.stdout, run.stderr) == ("skyproof.app.scenes.simulate\n", "")


def test_importing_the_package_loads_nothing_that_computes() -> None:
    program = "import sys, skyproof; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert set(run.stdout.split()) & {"numpy", "numba", "pydantic", "skyproof.app", "skyproof.records"} == set()
