"""Campaigns that are made once for each key, and what their settings may be."""

from contextlib import closing, suppress
from typing import Any

import msgspec
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from msgspec.structs import replace

from eigenfail.errors import InvalidValue
from eigenfail.methods import UNDECLARED, MethodDescription
from eigenfail.testing.examples import spec
from eigenfail.values.campaign import EpisodeForm
from eigenfail.values.campaign_spec import CampaignSpec, Priority
from eigenfail.values.proof import ReplayKind
from eigenfail_services import resolution
from eigenfail_services.store.campaign_creation import derive_key, hash_specs
from eigenfail_services.store.codec import spec_text, to_json, to_references
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


class Undeclared:
    """A user's method that does not say what its settings name."""

    class Settings(msgspec.Struct, frozen=True):
        analysis: Any = None
        campaign: Any = None
        data_from: Any = None
        episode: Any = None
        episodes: Any = ()


def references_of(settings: dict) -> resolution.CampaignReferences:
    description = MethodDescription("x", Undeclared, UNDECLARED, False, False, False, 1)
    method = resolution.ResolvedMethod(description, Undeclared.Settings(**settings), "settings")
    return resolution.find_references(method)


@given(st.dictionaries(st.sampled_from(Undeclared.Settings.__struct_fields__), ANYTHING))
@example({"campaign": 2**63, "episode": 1, "episodes": [1]})
@example({"analysis": 1, "data_from": [2, 3]})
def test_settings_may_be_called_as_those_of_a_replay_and_be_anything(settings: dict) -> None:
    """What is no reference is refused; whatever is stored can be read."""
    with suppress(InvalidValue):
        found = references_of(settings)
        assert to_references(to_json(found)) == found
        assert all(type(each) is int for each in found.noise_sources)


@pytest.mark.parametrize(
    ("settings", "field"),
    [
        ({"campaign": "a", "episode": {"of": 1}}, "settings.campaign"),
        ({"campaign": True}, "settings.campaign"),
        ({"campaign": 1, "episodes": 3}, "settings.episodes"),
        ({"data_from": 2.5}, "settings.data_from"),
    ],
)
def test_a_setting_that_names_nothing_is_refused_by_its_name(settings: dict, field: str) -> None:
    with pytest.raises(InvalidValue) as refused:
        references_of(settings)
    assert refused.value.field == field


@pytest.mark.parametrize("url", ["sqlite_url", "prepared_postgres_url"])
def test_a_campaign_with_such_settings_is_queued(url: str, request) -> None:
    wild = {"campaign": "a", "episode": {"of": 1}, "episodes": 3.5, "data_from": 2**80}
    with closing(open_store(request.getfixturevalue(url))) as store:
        for settings in (wild, {"campaign": 2**64, "episodes": "ab"}):
            assert store.campaigns.create(spec(settings=settings)).state == "queued"


@pytest.mark.parametrize("url", ["sqlite_url", "prepared_postgres_url"])
def test_what_a_check_found_is_stored_with_the_campaign(url: str, request) -> None:
    asked = spec(method="difs", settings={"data_from": [2]})
    form = EpisodeForm(7, 0.5, ("there",))
    noise = resolution.NamedNoise(analysis=4, mode=1, what=(ReplayKind.MEDOID,))
    references = resolution.CampaignReferences(noise, {"settings.a": 1}, {"settings.b": (2, 3)})
    with closing(open_store(request.getfixturevalue(url))) as store:
        checked = resolution.CheckedCampaign(asked, form, references)
        made = (store.campaigns.create(checked), *store.campaigns.create_many([checked, asked]))
        assert [each.spec for each in made] == [asked] * 3
        assert [each.form for each in made[:2]] == [form] * 2
        found = [store.campaigns.read_references(each.id) for each in made]
    assert found[:2] == [references] * 2
    assert (found[2].data, found[2].noise_sources) == ({"settings.data_from": (2,)}, {2})
