"""The example function, as docs/any_function.md tells people to use it."""

import re
import sys
import tomllib
from importlib import import_module
from io import StringIO
from pathlib import Path

import pytest
from accepted import accept_spec
from msgspec.structs import replace
from rich.console import Console
from starlette.testclient import TestClient

from eigenfail.cli.specs import check_plugins, read_spec
from eigenfail.errors import InputError, InvalidValue
from eigenfail.functions import ALLOWED_VARIABLE
from eigenfail.presentation.campaigns import describe_campaign
from eigenfail.presentation.terminal import render
from eigenfail.replays import explain_episode, make_replay_task, replay_episode
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.records import Delivery
from eigenfail.worlds import world_of
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.campaigns.summary import summarise_campaign
from eigenfail_services.campaigns.validation import check_spec
from eigenfail_services.store.store import open_store
from eigenfail_workers.engines import make_engine

EXAMPLES = Path(__file__).parents[2] / "examples"
PAGE = (EXAMPLES.parent / "docs" / "any_function.md").read_text()


@pytest.fixture
def module(monkeypatch):
    """The module, imported as workers do that were started in its folder."""
    monkeypatch.chdir(EXAMPLES)
    monkeypatch.setenv(ALLOWED_VARIABLE, "any_function,no_such_module,sut_here")
    monkeypatch.setattr(sys, "path", [*sys.path, str(EXAMPLES)])
    monkeypatch.delitem(sys.modules, "any_function", raising=False)
    yield import_module("any_function")
    sys.modules.pop("any_function", None)


@pytest.fixture
def spec(module):
    return read_spec(EXAMPLES / "any_function.toml")


@pytest.fixture
def results(module):
    return module.search()


def test_the_page_shows_the_example():
    (code,) = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    campaign, _ = re.findall(r"^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    assert code in (EXAMPLES / "any_function.py").read_text()
    whole = tomllib.loads((EXAMPLES / "any_function.toml").read_text())
    assert tomllib.loads(campaign).items() <= whole.items()


def test_the_campaign_is_the_same_as_in_this_process(spec, results):
    check_plugins(spec)
    assert check_spec(spec).spec == spec
    assert world_of(spec.simulator).find_form(spec).steps == results[0].steps == 20
    again = make_engine(spec.setup()).run(list(map(make_replay_task, results)))
    assert [result.digest() for result in again] == [result.digest() for result in results]


def test_a_stored_call_is_repeated_and_not_explained(spec, results):
    failure = next(result for result in results if result.is_failure)
    assert replay_episode(spec, failure).same
    with pytest.raises(InvalidValue, match="no planner and no controls"):
        explain_episode(spec, failure)


def test_a_call_is_not_repeated_unless_its_module_is_listed_here(spec, results, monkeypatch):
    monkeypatch.delenv("EIGENFAIL_FUNCTIONS")
    with pytest.raises(InvalidValue) as refused:
        replay_episode(spec, results[0])
    assert "EIGENFAIL_FUNCTIONS=any_function eigenfail episode replay" in refused.value.remedy


def test_what_a_function_has_not_reads_as_a_dash(spec, results):
    store = open_store("memory://")
    campaign = store.campaigns.create(accept_spec(spec)).id
    store.campaigns.move(campaign, "running")
    store.episodes.commit(campaign, [Delivery(result, "by hand") for result in results])
    summary = summarise_campaign(store, store.campaigns.get(campaign))
    assert summary.mean_severity is None
    assert summary.failure_rate.k == summary.conflicts.unclassified > 50
    app = create_app(store, ApiSettings())
    failure = next(result.index for result in results if result.is_failure)
    with TestClient(app, base_url="http://127.0.0.1:8440") as browser:
        overview, whole, one = (
            " ".join(re.sub(r"<[^>]*>", " ", browser.get(path).raise_for_status().text).split())
            for path in ("/", f"/campaigns/{campaign}", f"/campaigns/{campaign}/episodes/{failure}")
        )
    page = printed(render(*describe_campaign(store.campaigns.get(campaign), summary)))
    store.close()
    assert "sigma 1 at every step" in page
    assert "near misses" not in page
    assert "severity – m²/s²" in page
    assert "any function" in overview
    assert "Mean severity" not in whole
    assert "Likelihood and severity" not in whole
    assert "Near misses" not in whole
    assert "sigma 1 at every step" in whole
    assert "|dx|" not in whole
    assert "Robustness 0 log p" in one
    assert "Class" not in one
    assert "Footprints apart" not in one
    assert "Scene from above" not in one


def printed(group):
    screen = Console(width=200, record=True, file=StringIO())
    screen.print(group)
    return " ".join(screen.export_text().split())


WRONG = {
    "scenario": ({"scenario": "cut_in"}, 'scenario = "function"'),
    "planner": ({"planner": "rulebook"}, "module:function"),
    "planner_settings": ({"planner_settings": {"beta": 1}}, "beta"),
    "disturbance": ({"disturbance": DisturbanceModel(lateral_slope=0.1)}, "no distance"),
    "scenario_parameters": ({"scenario_parameters": {"steps": 0}}, "steps"),
}


@pytest.mark.parametrize("field", WRONG)
def test_what_means_nothing_to_a_function_is_refused_before_anything_is_started(field, spec):
    changes, words = WRONG[field]
    for check in (check_spec, check_plugins):
        with pytest.raises(InputError, match=re.escape(words)) as refused:
            check(replace(spec, **changes))
        assert refused.value.field.startswith(field)


def test_a_module_that_is_not_here_is_refused_before_anything_is_started(spec):
    elsewhere = replace(spec, planner="no_such_module:robustness")
    with pytest.raises(InvalidValue, match="PYTHONPATH"):
        check_plugins(elsewhere)
    check_spec(elsewhere)  # it may be where the workers are


def test_the_working_folder_is_among_those_that_are_looked_in(spec, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sut_here.py").write_text("robustness = None")
    check_plugins(replace(spec, planner="sut_here:robustness"))
    assert str(Path.cwd()) in sys.path
