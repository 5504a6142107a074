"""The name of compiled code: what changes it, and what does not."""

from __future__ import annotations

import importlib.util
import pathlib
import sys
from types import ModuleType

import pytest

from simvehicle.code_identity import callees, code_identity
from simvehicle.compiled import _LEAF, cache_directory, compiled, engine_identity
from simvehicle.trials.cell import Cell
from simvehicle.trials.engine import run_locus, run_mobs
from simvehicle.trials.outcome import kernel_of

CALLEE = '''
"""A rule in a module of its own."""
import numpy as np

FACTOR = 2.0
TABLE = np.array([1.0, 2.0])


def inner(x):
    """What it is for."""
    return FACTOR * x + TABLE[0]


def unrelated(x):
    return x
'''
CALLER = """
import callee_module


def outer(x):
    # why
    return callee_module.inner(x) + 1.0
"""


@pytest.fixture(autouse=True)
def _forget() -> object:
    yield
    sys.modules.pop("callee_module", None)


def load(directory: pathlib.Path, callee: str = CALLEE, caller: str = CALLER) -> ModuleType:
    """The caller's module, freshly made from these sources."""
    for name, text in (("callee_module", callee), ("caller_module", caller)):
        path = directory / f"{name}.py"
        path.write_text(text, encoding="utf-8")
        spec = importlib.util.spec_from_loader(name, loader=None)
        assert spec is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        exec(compile(text, str(path), "exec"), module.__dict__)  # noqa: S102
    return sys.modules.pop("caller_module")


def identity(directory: pathlib.Path, callee: str = CALLEE, caller: str = CALLER) -> str:
    return code_identity(load(directory, callee, caller).outer)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("FACTOR * x + TABLE", "FACTOR * x - TABLE"),
        ("FACTOR = 2.0", "FACTOR = 3.0"),
        ("np.array([1.0, 2.0])", "np.array([1.5, 2.0])"),
        ("def inner(x):", "def inner(x, y=1.0):"),
    ],
    ids=["code", "constant", "table", "default"],
)
def test_a_change_in_a_callee_of_another_module_changes_it(
    old: str, new: str, tmp_path: pathlib.Path
) -> None:
    assert identity(tmp_path) == identity(tmp_path)
    assert identity(tmp_path, CALLEE.replace(old, new)) != identity(tmp_path)


@pytest.mark.parametrize(
    ("callee", "caller"),
    [
        (CALLEE.replace("return x\n", "return -x\n"), CALLER),
        (CALLEE.replace("What it is for.", "Why it is so."), CALLER),
        ("# a comment\n\n" + CALLEE, CALLER.replace("# why", "# because")),
    ],
    ids=["unrelated", "docstring", "comments"],
)
def test_what_computes_nothing_of_it_does_not(callee: str, caller: str, tmp_path: pathlib.Path) -> None:
    assert identity(tmp_path, callee, caller) == identity(tmp_path)


def test_a_closure_is_named_by_what_it_closes_over(tmp_path: pathlib.Path) -> None:
    def close(number: float) -> object:
        return lambda x: number * x

    assert code_identity(close(1.0)) == code_identity(close(1.0))  # type: ignore[arg-type]
    assert code_identity(close(1.0)) != code_identity(close(2.0))  # type: ignore[arg-type]


def test_what_is_used_before_it_is_defined_is_an_error(tmp_path: pathlib.Path) -> None:
    module = load(tmp_path, caller="def outer(x):\n    return later(x)\n")
    with pytest.raises(NameError, match="outer uses later, which must be defined before it"):
        code_identity(module.outer)


def test_the_kernels_of_the_trials_are_named_with_the_rules_that_they_call() -> None:
    names = {f"{function.__module__}.{function.__name__}" for function in callees(run_locus)}
    assert {
        "mission.strategies.locus.gradient.plane_gradient",
        "mission.tree.balanced_tree.next_heal",
        "simvehicle.trials.plume.reading",
        "simvehicle.trials.randomness._mixed",
    } <= names
    assert engine_identity(run_locus) != engine_identity(run_mobs)
    assert kernel_of(Cell(strategy="mobs")) is run_mobs


def test_machine_code_of_a_changed_callee_is_not_the_old_one(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    assert cache_directory() == tmp_path / "cache"
    assert compiled(load(tmp_path).outer)(3.0) == 8.0
    kept = {path.parents[1].name for path in cache_directory().rglob("*.nbi")}
    changed = load(tmp_path, CALLEE.replace("FACTOR = 2.0", "FACTOR = 3.0"))
    assert compiled(changed.outer)(3.0) == 11.0
    assert kept < {path.parents[1].name for path in cache_directory().rglob("*.nbi")}


def test_another_way_to_compile_is_another_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    before = engine_identity(run_mobs)
    monkeypatch.setitem(_LEAF, "forceinline", False)
    assert engine_identity(run_mobs) != before
