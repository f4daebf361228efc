"""Campaigns that are made once for each key, and what their settings may be."""

from collections.abc import Mapping
from contextlib import closing
from typing import Any

import msgspec
import pytest
from accepted import accept_spec
from hypothesis import example, given
from hypothesis import strategies as st
from msgspec.structs import replace

from eigenfail.contracts import MethodTraits, Reference
from eigenfail.errors import InvalidValue
from eigenfail.methods import UNDECLARED, MethodDescription
from eigenfail.settings import read_settings
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


class Renamed(Undeclared):
    """A user's method whose settings have the names of a replay's and another meaning."""

    class Settings(msgspec.Struct, frozen=True):
        analysis: int | None = None
        campaign: int = 0
        data_from: str = "runs.csv"
        mode: str = "fast"
        episodes: str = "all"


class Fast(Undeclared):
    """A user's method that injects a campaign's failures, and has modes of its own."""

    class Settings(msgspec.Struct, frozen=True):
        campaign: int
        mode: str = "fast"
        what: int = 3


LIKE_REPLAY = {
    "analysis": Reference.NOISE,
    "campaign": Reference.NOISE,
    "data_from": Reference.EPISODES,
}


def references_of(
    settings: dict,
    declared: Mapping[str, Reference] | None = None,
    kind: type[Undeclared] = Undeclared,
) -> resolution.CampaignReferences:
    traits = UNDECLARED if declared is None else MethodTraits(references=declared)
    description = MethodDescription("mine", kind, traits, False, False, False, 1)
    read = read_settings(kind.Settings, settings, "settings")
    return resolution.find_references(
        resolution.ResolvedMethod(description, read, settings, "settings")
    )


@given(st.dictionaries(st.sampled_from(Undeclared.Settings.__struct_fields__), ANYTHING))
@example({"campaign": 2**63, "episode": 1, "episodes": [1]})
@example({"analysis": 1, "data_from": [2, 3]})
def test_settings_may_be_called_as_those_of_a_replay_and_be_anything(settings: dict) -> None:
    """What is no reference is passed over; whatever is stored can be read."""
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
        references_of(settings, LIKE_REPLAY)
    assert refused.value.field == field


def test_defaults_of_a_method_that_declares_nothing_are_no_references() -> None:
    nothing = resolution.CampaignReferences()
    assert references_of({}, kind=Renamed) == nothing
    assert references_of({"data_from": "a.csv", "mode": "slow"}, kind=Renamed) == nothing
    assert references_of({"campaign": 3, "episodes": "odd"}, kind=Renamed) == nothing
    found = references_of({"campaign": 3, "data_from": "a.csv"}, kind=Renamed)
    assert found == resolution.CampaignReferences(resolution.NamedNoise(campaign=3))


def test_only_what_goes_with_a_declared_reference_is_read() -> None:
    from_campaign = {"campaign": Reference.NOISE}
    asked = {"campaign": 2, "episodes": (1, 4), "analysis": 5}
    found = references_of(asked, from_campaign).noise
    assert found == resolution.NamedNoise(campaign=2, episodes=(1, 4))
    of_analysis = {"analysis": Reference.NOISE}
    found = references_of({"analysis": 5, "campaign": 2, "episodes": "x"}, of_analysis).noise
    assert found == resolution.NamedNoise(analysis=5)
    found = references_of({"campaign": 2}, from_campaign, Fast).noise
    assert found == resolution.NamedNoise(campaign=2)


@pytest.mark.parametrize("settings", [{}, {"source": 3}])
def test_noise_under_another_name_is_refused_and_the_method_is_told(settings: dict) -> None:
    class Sourced(Undeclared):
        class Settings(msgspec.Struct, frozen=True):
            source: int | None = None

    with pytest.raises(InvalidValue, match=r"mine declares that 'source'.*analysis or campaign"):
        references_of(settings, {"source": Reference.NOISE}, Sourced)


def test_a_learners_campaign_is_not_taken_for_noise() -> None:
    declared = {"analysis": Reference.NOISE, "campaign": Reference.LEARNER}
    found = references_of({"analysis": 4, "campaign": 3, "episodes": [1]}, declared)
    noise = resolution.NamedNoise(analysis=4)
    assert found == resolution.CampaignReferences(noise, {"settings.campaign": 3})
    assert found.noise_sources == frozenset()


@pytest.mark.parametrize("url", ["sqlite_url", "prepared_postgres_url"])
def test_a_campaign_with_such_settings_is_queued(url: str, request) -> None:
    wild = {"campaign": "a", "episode": {"of": 1}, "episodes": 3.5, "data_from": 2**80}
    with closing(open_store(request.getfixturevalue(url))) as store:
        for settings in (wild, {"campaign": 2**64, "episodes": "ab"}):
            assert store.campaigns.create(accept_spec(spec(settings=settings))).state == "queued"


@pytest.mark.parametrize("url", ["sqlite_url", "prepared_postgres_url"])
def test_what_a_check_found_is_stored_with_the_campaign(url: str, request) -> None:
    asked = spec(method="difs", settings={"data_from": [2]})
    form = EpisodeForm(7, 0.5, ("there",))
    noise = resolution.NamedNoise(analysis=4, mode=1, what=(ReplayKind.MEDOID,))
    references = resolution.CampaignReferences(noise, {"settings.a": 1}, {"settings.b": (2, 3)})
    with closing(open_store(request.getfixturevalue(url))) as store:
        checked = resolution.CheckedCampaign(asked, form, references)
        several = [checked, accept_spec(asked)]
        made = (store.campaigns.create(checked), *store.campaigns.create_many(several))
        assert [each.spec for each in made] == [asked] * 3
        assert [each.form for each in made[:2]] == [form] * 2
        found = [store.campaigns.read_references(each.id) for each in made]
    assert found[:2] == [references] * 2
    assert (found[2].data, found[2].noise_sources) == ({"settings.data_from": (2,)}, {2})
