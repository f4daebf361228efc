"""Campaigns before they are launched, cloned, continued, and grouped."""

from typing import Any

import msgspec
import pytest
from accepted import accept_spec

from eigenfail.bridges import BridgeOffer, OfferedPlanner, OfferedScenario
from eigenfail.errors import InvalidValue, NotFound
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import AXES
from eigenfail.values.operations import Arrival
from eigenfail_services.campaigns import drafts
from eigenfail_services.campaigns.validation import fill_defaults
from eigenfail_services.comparison import sides
from eigenfail_services.comparison.comparability import compare_settings
from eigenfail_services.store.store import Store

FIELDS: dict[str, Any] = {
    "name": "n",
    "method": "monte_carlo",
    "episodes": 50,
    "planner": "idm",
    "simulator": "point_mass",
}


def ended(store: Store, **changes: Any) -> Campaign:
    """A campaign that is done."""
    made = store.campaigns.create(accept_spec(CampaignSpec(**FIELDS | changes)))
    store.campaigns.move(made.id, CampaignState.RUNNING)
    return store.campaigns.move(made.id, CampaignState.DONE)


def test_a_draft_in_order_has_no_problems(store: Store) -> None:
    assert drafts.find_problems(FIELDS, store) == ()
    assert drafts.read_draft(FIELDS, store).spec == CampaignSpec(**FIELDS)


def test_looking_for_problems_changes_nothing(store: Store) -> None:
    given = {**FIELDS, "settings": {"round_size": 0}, "stop": {"cv": -1}}
    drafts.find_problems(given, store)
    assert given == {**FIELDS, "settings": {"round_size": 0}, "stop": {"cv": -1}}


@pytest.mark.parametrize("count", [1, 150])
def test_looking_for_problems_comes_to_an_end(store: Store, count: int) -> None:
    given = {**FIELDS, "settings": {f"bogus{place}": 1 for place in range(count)}}
    assert len(drafts.find_problems(given, store)) == min(count, 100)


def test_a_problem_without_a_place_of_its_own_is_told_once(store: Store) -> None:
    deep: Any = 1
    for _ in range(30):
        deep = {"a": deep}
    assert len(drafts.find_problems({**FIELDS, "settings": deep}, store)) >= 1
    assert len(drafts.find_problems({**FIELDS, "settings": 3}, store)) == 1
    assert len(drafts.find_problems({**FIELDS, "disturbance": "x"}, store)) == 1


OFFER = BridgeOffer(
    "theirs",
    "1",
    (OfferedScenario("wet", 0.1, 80, ("gap_m",)),),
    (OfferedPlanner("careful", ("speed_mps",)),),
    ("missed",),
)
ON_BRIDGE: dict[str, Any] = {
    "name": "n",
    "method": "monte_carlo",
    "episodes": 50,
    "simulator": "bridge",
    "scenario": "wet",
    "planner": "careful",
    "scenario_parameters": {"steps": 80, "gap_m": 9.0},
    "planner_settings": {"speed_mps": 9.0},
    "disturbance": {"channels": [{"name": "missed"}]},
}


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({}, []),
        ({"planner": "carefull"}, ["planner"]),
        ({"scenario": "wett"}, ["scenario"]),
        ({"scenario_parameters": {"steps": 80, "gap": 9.0}}, ["scenario_parameters"]),
        ({"scenario_parameters": {"steps": 81}}, ["scenario_parameters.steps"]),
        ({"scenario_parameters": {"steps": 80, "dt_s": 0.2}}, ["scenario_parameters.dt_s"]),
        ({"disturbance": {"channels": [{"name": "ghost"}]}}, ["disturbance.channels"]),
        ({"planner": "carefull", "seed": -1, "stop": {"cv": 11}}, ["seed", "stop.cv"]),
    ],
)
def test_a_misfit_with_a_bridge_is_one_problem(store: Store, change, expected) -> None:
    (worker,) = store.roster.arrived([Arrival(worker="w", host="h", pid=1)])
    store.roster.set_offers({worker: msgspec.json.encode(OFFER).decode()})
    problems = drafts.find_problems(ON_BRIDGE | change, store)
    assert [each.field for each in problems] == expected


@pytest.mark.parametrize("method", ["ast", "cem", "difs", "subset", "monte_carlo"])
def test_what_is_completed_can_be_launched_and_is_complete(store: Store, method: str) -> None:
    spec = CampaignSpec(**{**FIELDS, "method": method, "episodes": 1000})
    whole = fill_defaults(spec)
    assert drafts.read_draft({**FIELDS, "method": method, "episodes": 1000}, store).spec == spec
    assert fill_defaults(whole) == whole
    assert set(whole.settings) > set()


def test_a_function_under_test_is_completed_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EIGENFAIL_FUNCTIONS", "m")
    spec = CampaignSpec(
        **{**FIELDS, "simulator": "function", "scenario": "function", "planner": "m:f"},
        scenario_parameters={"steps": 5},
    )
    filled = {"steps": 5, "limit_s": 30.0, "channels": list(AXES)}
    assert fill_defaults(spec).scenario_parameters == filled


def test_changes_go_over_settings_but_not_over_those_of_another_plug_in() -> None:
    fields = {**FIELDS, "settings": {"a": 1, "b": 2}, "stop": {"cv": None, "failures": 3}}
    assert drafts.change_fields(fields, {"settings": {"b": 3}})["settings"] == {"a": 1, "b": 3}
    assert drafts.change_fields(fields, {"stop": {"cv": 0.1}})["stop"] == {"cv": 0.1, "failures": 3}
    assert drafts.change_fields(fields, {"method": "cem"}).get("settings") is None
    assert drafts.change_fields(fields, {"method": "cem", "settings": {"b": 3}})["settings"] == {
        "b": 3
    }
    assert drafts.change_fields(fields, {"method": "monte_carlo"})["settings"] == {"a": 1, "b": 2}
    assert drafts.change_fields(fields, {"settings": 3})["settings"] == 3


def test_a_clone_is_checked() -> None:
    with pytest.raises(InvalidValue):
        drafts.clone(CampaignSpec(**FIELDS), {"episodes": 0})


def test_only_what_has_ended_and_learns_can_be_built_upon(store: Store) -> None:
    queued = store.campaigns.create(accept_spec(CampaignSpec(**{**FIELDS, "method": "ast"})))
    assert not [*drafts.list_continuations(queued)]
    assert not [*drafts.list_continuations(ended(store))]
    assert not [*drafts.list_continuations(ended(store, method="gone"))]
    ast = ended(store, method="ast")
    found = [each.changes for each in drafts.list_continuations(ast)]
    assert {"settings.warm_start": ast.id} in found
    assert {"method": "evaluate", "settings.campaign": ast.id} in found
    difs = ended(store, method="difs")
    assert {"settings.data_from": difs.id} in [
        each.changes for each in drafts.list_continuations(difs)
    ]


def test_words_on_repeating_are_those_of_the_method() -> None:
    assert "its first 50 episodes are those of the earlier one" in drafts.describe_repetition(
        CampaignSpec(**FIELDS)
    )
    assert "cem plans by its budget" in drafts.describe_repetition(
        CampaignSpec(**{**FIELDS, "method": "cem"})
    )


def test_settings_stand_in_the_order_of_a_spec_with_defaults(store: Store) -> None:
    made = [
        store.campaigns.create(accept_spec(CampaignSpec(**FIELDS))),
        store.campaigns.create(
            accept_spec(CampaignSpec(**{**FIELDS, "method": "gone", "settings": {"x": 1}}))
        ),
    ]
    found = {each.path: each for each in compare_settings(made)}
    assert found["settings.round_size"].values == ("100", "–")
    assert found["settings.x"].values == ("–", "1")
    assert found["method"].differs
    assert not found["planner"].differs
    assert list(found)[:3] == ["name", "method", "episodes"]


def test_what_is_picked_is_there_and_not_too_much(store: Store) -> None:
    made = [
        store.campaigns.create(accept_spec(CampaignSpec(**FIELDS))).id
        for _ in range(sides.MOST + 1)
    ]
    assert [each.id for each in sides.read_distinct_campaigns([2, 1, 2], store)] == [2, 1]
    assert len(sides.read_distinct_campaigns(made[: sides.MOST], store)) == sides.MOST
    with pytest.raises(InvalidValue, match="13 campaigns are named"):
        sides.read_distinct_campaigns(made, store)
    with pytest.raises(NotFound):
        sides.read_distinct_campaigns([1, 99], store)
