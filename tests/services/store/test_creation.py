"""Campaigns that are made once for each key, and what their settings may be."""

from contextlib import closing

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from msgspec.structs import replace

from eigenfail.testing.examples import spec
from eigenfail.values.campaign_spec import CampaignSpec, Priority
from eigenfail_services.store.campaign_creation import derive_key, hash_specs
from eigenfail_services.store.codec import spec_text
from eigenfail_services.store.references import find_named_campaigns, find_named_episodes
from eigenfail_services.store.store import open_store


def test_keys_of_places_are_different_and_short() -> None:
    keys = {derive_key(key, place) for key in ("a", "b", "x" * 200) for place in range(20)}
    assert len(keys) == 60
    assert max(map(len, keys)) <= 200


def test_a_list_is_recognised_by_what_is_in_it_and_by_its_order() -> None:
    one, other = spec(seed=1), spec(seed=2)
    lists = [(), (one,), (other,), (one, other), (other, one), (one, one)]
    assert len({hash_specs(each) for each in lists}) == len(lists)
    assert hash_specs([spec(seed=1)]) == hash_specs((one,))


TOLD = (
    '{"name":"x","method":"ast","episodes":4,"seed":3,"settings":{"a":{"y":2,"z":1},"b":1},'
    '"scenario":"cut_in","scenario_parameters":{"c":{"high":2,"low":1},"q":1.0},'
    '"planner":"rulebook","planner_settings":{},"simulator":"highway",'
    '"disturbance":{"longitudinal_slope":0.02,"longitudinal_base_m":1.0,"lateral_slope":0.00625,'
    '"lateral_base_m":0.2,"scale":1.0,"shape":{"kind":"white"}},"stop":{"failures":null,'
    '"half_width":null,"cv":null,"wall_s":null,"cost_usd":null},"price_usd_per_hour":1.2,'
    '"instances":1,"scene_every":50}'
)


def test_a_specs_text_is_that_of_earlier_releases_at_whatever_priority() -> None:
    """Keys and suites of theirs are recognised by it, and digests hold a part of it."""
    fields = {"settings": {"b": 1, "a": {"z": 1, "y": 2}}, "seed": 3}
    fields["scenario_parameters"] = {"q": 1.0, "c": {"low": 1, "high": 2}}
    asked = CampaignSpec(name="x", method="ast", episodes=4, **fields)
    assert {spec_text(replace(asked, priority=each)) for each in Priority} == {TOLD}
    assert '"parallel":100,' in spec_text(replace(asked, parallel=100))


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=5,
)


@given(st.dictionaries(st.sampled_from(["campaign", "data_from", "episode", "episodes"]), ANYTHING))
@example({"campaign": "a", "episode": {"of": 1}, "episodes": 3})
@example({"campaign": 2**63, "episode": [1, 2], "episodes": [[1]]})
def test_settings_may_be_called_as_those_of_a_replay_and_be_anything(settings: dict) -> None:
    campaign, episodes = find_named_episodes(settings)
    for found in ({campaign} - {None}, episodes, {*find_named_campaigns(settings)}):
        assert all(type(each) is int and 0 <= each < 2**63 for each in found)


@pytest.mark.parametrize("url", ["sqlite_url", "prepared_postgres_url"])
def test_a_campaign_with_such_settings_is_queued(url: str, request) -> None:
    wild = {"campaign": "a", "episode": {"of": 1}, "episodes": 3.5, "data_from": 2**80}
    with closing(open_store(request.getfixturevalue(url))) as store:
        for settings in (wild, {"campaign": 2**64, "episodes": "ab"}):
            assert store.campaigns.create(spec(settings=settings)).state == "queued"
