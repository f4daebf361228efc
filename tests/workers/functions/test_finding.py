"""A function is found by its place, and what stands in the way of that is said."""

import os
import sys

import numpy as np
import pytest

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.functions import (
    ALLOWED_VARIABLE,
    SIMULATOR,
    refuse_unlisted,
)
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import EpisodeSetup, EpisodeTask, PriorSource
from eigenfail_workers.engine import Engine
from eigenfail_workers.engines import make_engine
from eigenfail_workers.explain import explain
from eigenfail_workers.functions import find_function

GOOD = """
from eigenfail.functions import of_trajectory

@of_trajectory
def robustness(z):
    return 1.5

def helper(z):
    return 2.5
"""
STEPS = {"steps": 5}


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Writes a module into the working folder; nothing of it is left."""
    names = []
    monkeypatch.setenv(ALLOWED_VARIABLE, "os,this,sut_nowhere,sut_stranger")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])

    def write(name, text=GOOD):
        (tmp_path / f"{name}.py").write_text(text)
        names.append(name)
        monkeypatch.setenv(ALLOWED_VARIABLE, f"{os.environ[ALLOWED_VARIABLE]},{name}")
        return tmp_path / f"{name}.py"

    yield write
    for name in names:
        sys.modules.pop(name, None)


def setup(planner, parameters=STEPS):
    return EpisodeSetup(SIMULATOR, SIMULATOR, parameters, planner, {}, DisturbanceModel())


def test_the_engine_of_a_setup_calls_the_function_that_it_names(module):
    module("sut_found")
    (result,) = make_engine(setup("sut_found:robustness")).run([EpisodeTask(0, 0, PriorSource())])
    assert (result.measures.robustness_m, result.steps) == (1.5, 5)


def test_what_drives_has_the_engine_that_drives():
    driven = EpisodeSetup("point_mass", "cut_in", {}, "idm", {}, DisturbanceModel())
    assert isinstance(make_engine(driven), Engine)


BROKEN = {
    "raises": ("1 / 0", "cannot be imported: ZeroDivisionError: division by zero"),
    "is not Python": ("def (", "cannot be imported: SyntaxError: invalid syntax"),
    "leaves": ("raise SystemExit(4)", "cannot be imported: SystemExit: 4"),
    "lacks a module": ("import no_such_thing", "No module named 'no_such_thing'"),
    "lacks the function": ("x = 1", "has no 'robustness'"),
    "does not declare it": ("def robustness(z): return 1.0", "@of_trajectory or @of_batch"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_module_that_does_not_give_it_is_refused_in_words(name, module):
    text, words = BROKEN[name]
    module("sut_broken", f"# as eigenfail.functions wants it\n{text}")
    with pytest.raises(InvalidValue, match=words) as refused:
        find_function("sut_broken:robustness")
    assert refused.value.field == "planner"


def test_a_module_that_is_not_there_is_refused_with_where_it_was_looked_for(module, tmp_path):
    with pytest.raises(InvalidValue, match="PYTHONPATH") as refused:
        find_function("sut_nowhere:robustness")
    assert str(tmp_path) in refused.value.remedy
    module("sut_nowhere")  # written now, it is found
    assert find_function("sut_nowhere:robustness")([]) == 1.5


def test_nothing_is_called_that_was_not_declared(module):
    module("sut_open")
    with pytest.raises(InvalidValue, match="not declared"):
        find_function("sut_open:helper")


@pytest.mark.parametrize("place", ["os:system", "this:x", "sut_stranger:robustness"])
def test_a_module_that_is_none_of_functions_is_not_even_imported(place, module):
    module("sut_stranger", "raise SystemExit(4)")
    known = sys.modules.get(place.split(":")[0])
    with pytest.raises(InvalidValue, match="in no module of functions"):
        find_function(place)
    assert sys.modules.get(place.split(":")[0]) is known


def test_a_file_that_was_changed_is_not_run_as_it_was_before(module):
    file = module("sut_changed")
    find_function("sut_changed:robustness")
    find_function("sut_changed:robustness")
    later_s = file.stat().st_mtime + 10.0
    os.utime(file, (later_s, later_s))
    with pytest.raises(InvalidValue, match=r"changed after .* Start the service again"):
        find_function("sut_changed:robustness")


@pytest.mark.parametrize("parameters", [{}, {"steps": 0}, {"steps": 5, "limit_s": 51.0}])
def test_its_parameters_are_bounded(parameters, module):
    module("sut_bounded")
    with pytest.raises(InvalidValue, match="scenario_parameters"):
        make_engine(setup("sut_bounded:robustness", parameters))
    with pytest.raises(UnknownName, match="colour"):
        make_engine(setup("sut_bounded:robustness", {"steps": 5, "colour": 1}))


def test_there_is_nothing_to_explain():
    with pytest.raises(InvalidValue, match="episode replay"):
        explain(setup("sut:robustness"), EpisodeTask(0, 0, PriorSource()))


@pytest.mark.parametrize("listed", ["sut_listed", "other, sut_listed"])
def test_what_is_listed_may_be_run(module, monkeypatch, listed):
    module("sut_listed")
    monkeypatch.setenv(ALLOWED_VARIABLE, listed)
    assert find_function("sut_listed:robustness")(np.zeros((5, 2))) == 1.5


@pytest.mark.parametrize("listed", ["", " ", "sut", "sut_unlisted_2", "other"])
def test_what_is_not_listed_is_not_even_imported(module, monkeypatch, listed):
    module("sut_unlisted", GOOD + "raise SystemExit\n")
    monkeypatch.setenv(ALLOWED_VARIABLE, listed)
    with pytest.raises(InvalidValue, match=ALLOWED_VARIABLE):
        find_function("sut_unlisted:robustness")
    assert "sut_unlisted" not in sys.modules


def test_where_nothing_is_listed_nothing_may_be_run(module, monkeypatch):
    module("sut_default", GOOD + "raise SystemExit\n")
    monkeypatch.delenv(ALLOWED_VARIABLE)
    with pytest.raises(InvalidValue, match="may be run here") as refused:
        find_function("sut_default:robustness")
    assert "eigenfail up --functions sut_default" in refused.value.remedy
    assert "sut_default" not in sys.modules


def test_a_package_is_listed_with_all_that_is_in_it(monkeypatch):
    monkeypatch.setenv(ALLOWED_VARIABLE, "examples")
    refuse_unlisted("examples.deep.inside:robustness")
    with pytest.raises(InvalidValue):
        refuse_unlisted("examples_of_others:robustness")
