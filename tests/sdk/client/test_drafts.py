"""Campaigns checked, cloned and created many at once through the client."""

import pytest

from eigenfail.errors import IdempotencyMismatch, UnknownName
from eigenfail.values.campaign_spec import CampaignSpec


def test_a_check_fills_in_defaults_and_launches_nothing(client, fields, store):
    found = client.campaigns.check(**fields)
    assert found.problems == ()
    assert found.spec.settings == {"round_size": 100}
    assert client.campaigns.check(CampaignSpec(**fields)) == found
    assert store.campaigns.page(1).items == ()


def test_a_clone_has_the_changes(client, fields):
    first = client.campaigns.create(**fields, settings={"round_size": 5})
    clone = client.campaigns.clone(first.id, episodes=20, name="again")
    assert clone.id != first.id
    assert (clone.spec.name, clone.spec.episodes) == ("again", 20)
    assert clone.spec.settings == {"round_size": 5}
    assert client.campaigns.clone(first.id).spec == first.spec


def test_many_are_created_or_none(client, fields, store):
    made = client.campaigns.create_many([CampaignSpec(**fields), {**fields, "seed": 1}])
    assert [each.spec.seed for each in made] == [0, 1]
    with pytest.raises(UnknownName) as refused:
        client.campaigns.create_many([fields, {**fields, "planner": "nobody"}])
    assert refused.value.field == "[1].planner"
    assert len(store.campaigns.page(10).items) == 2


def test_many_are_created_once_for_a_key(client, fields):
    items = [{**fields, "seed": seed} for seed in range(3)]
    first = client.campaigns.create_many(items, "nightly")
    assert client.campaigns.create_many(items, "nightly") == first
    with pytest.raises(IdempotencyMismatch):
        client.campaigns.create_many([{**fields, "seed": 7}], "nightly")
