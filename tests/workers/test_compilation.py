"""The compiled episode loop: the same results to the last bit, never older than its sources."""

import ast
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from eigenfail_workers.compilation import (
    COPIES,
    INTERPRETED_VARIABLE,
    MODULES,
    find_copy,
    find_package,
)

WORKERS = find_package("eigenfail_workers")


def run(*words: str, **environment: str) -> str:
    """What a Python process prints that uses compiled modules, if there are any."""
    compiled = {name: value for name, value in os.environ.items() if name != INTERPRETED_VARIABLE}
    command = [sys.executable, *words]
    done = subprocess.run(command, env=compiled | environment, capture_output=True, check=True)
    return done.stdout.decode()


def locate(module: str, **environment: str) -> str:
    """The file that a module is imported from."""
    code = f"from eigenfail_workers import {module}; print({module}.__file__)"
    return run("-c", code, **environment).strip()


@pytest.fixture
def compiled_copy() -> Path:
    copy = find_copy()
    if not copy.is_dir():
        pytest.skip("the episode loop is not compiled: python -m eigenfail_workers.compiler")
    return copy


def test_compiled_episodes_have_the_same_results_to_the_last_bit(compiled_copy: Path) -> None:
    assert locate("episode") != locate("episode", **{INTERPRETED_VARIABLE: "1"})
    compiled = json.loads(run("-m", "recorded_episodes"))
    interpreted = json.loads(run("-m", "recorded_episodes", **{INTERPRETED_VARIABLE: "1"}))
    assert compiled == interpreted


@pytest.fixture
def installation(compiled_copy: Path, tmp_path: Path) -> Path:
    """Workers of another folder, whose modules are imported from the compiled copy."""
    place = tmp_path / "eigenfail_workers"
    shutil.copytree(WORKERS, place, ignore=shutil.ignore_patterns("__pycache__"))
    assert Path(locate("motion", PYTHONPATH=str(tmp_path))).is_relative_to(place / COPIES.name)
    return place


@pytest.mark.parametrize("module", ["motion", "values", "planners/rulebook/settings"])
def test_a_change_of_any_source_ends_the_use_of_the_copy(installation: Path, module: str) -> None:
    source = installation / f"{module}.py"
    text = source.read_text("utf-8")
    source.write_text(f"{text}\nCHANGED = True\n", "utf-8")
    path = str(installation.parent)
    assert locate("motion", PYTHONPATH=path) == str(installation / "motion.py")
    source.write_text(text, "utf-8")
    assert locate("motion", PYTHONPATH=path) != str(installation / "motion.py")


def test_whoever_wants_it_interpreted_gets_that(installation: Path) -> None:
    asked = {"PYTHONPATH": str(installation.parent), INTERPRETED_VARIABLE: "1"}
    assert locate("motion", **asked) == str(installation / "motion.py")


def test_without_a_compiler_it_stays_interpreted_and_that_is_told(tmp_path: Path) -> None:
    ignored = shutil.ignore_patterns("__pycache__", COPIES.name)
    shutil.copytree(WORKERS, tmp_path / "eigenfail_workers", ignore=ignored)
    bare = {"PYTHONPATH": str(tmp_path), "PATH": str(tmp_path)}
    told = run("-m", "eigenfail_workers.compiler", **bare)
    assert "stays interpreted: there is no C compiler" in told
    assert "Results are the same" in told
    assert locate("motion", **bare) == str(tmp_path / "eigenfail_workers" / "motion.py")


@pytest.mark.parametrize("module", MODULES)
def test_what_is_compiled_has_no_classes_of_msgspec(module: str) -> None:
    source = WORKERS.joinpath(*module.split(".")).with_suffix(".py").read_text("utf-8")
    classes = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ClassDef)]
    bases = {ast.unparse(base) for one in classes for base in one.bases}
    assert not {base for base in bases if "Struct" in base}


NUMBERS = """
import numpy as np
from eigenfail.values.scene import Control, Observation, VehicleState
from eigenfail_workers.closed_loop import validate_control
from eigenfail_workers.measures.recorder import Recorder
for number in (1, True, 0.1, np.float64(0.1), np.float32(0.1), np.int64(2), np.nan, None, "1.5"):
    ego = VehicleState(number, 0.0, 0.0, 20.0, 16.0, 2.5)
    seen = Observation(0, ego, (VehicleState(50.0, 0.0, 0.0, 10.0, 5.0, 2.0),))
    check = lambda: validate_control(Control(number, 0.0))
    observe = lambda: Recorder().observe(seen, 0.1).step
    for call in (check, observe):
        try:
            print(call())
        except Exception as error:
            print(type(error).__name__)
"""


def test_numbers_of_other_types_mean_the_same(compiled_copy: Path) -> None:
    compiled, interpreted = run("-c", NUMBERS), run("-c", NUMBERS, **{INTERPRETED_VARIABLE: "1"})
    assert compiled == interpreted
    assert compiled.count("Control(") == 6
    assert compiled.count("0\n") == 5
