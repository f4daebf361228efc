"""Suites on a service: found, completed, never doubled."""

import pytest

from eigenfail.errors import WaitTimeout
from eigenfail.suites import Suite, SuiteMember
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec


@pytest.fixture
def suite(fields):
    """Makes a suite with a member for each seed."""

    def make(*seeds):
        shared = {name: value for name, value in fields.items() if name != "name"}
        specs = [CampaignSpec(**shared, name=f"trio: seed={seed}", seed=seed) for seed in seeds]
        return Suite("trio", tuple(SuiteMember(spec.name, spec) for spec in specs))

    return make


def ids(campaigns):
    return [campaign and campaign.id for campaign in campaigns]


def test_nothing_is_created_by_looking(client, suite):
    assert client.suites.find(suite(1, 2)) == (None, None)
    assert client.suites.summaries(suite(1, 2)) == (None, None)
    assert list(client.campaigns.list()) == []


def test_what_is_missing_is_created_and_nothing_twice(client, suite):
    assert ids(client.suites.create(suite(1))) == [1]
    assert ids(client.suites.create(suite(2, 1, 3))) == [2, 1, 3]
    assert ids(client.suites.create(suite(1, 2, 3))) == [1, 2, 3]
    assert len(list(client.campaigns.list())) == 3


def test_a_changed_member_is_another_campaign(client, suite):
    client.suites.create(suite(1))
    (member,) = suite(2).members
    renamed = SuiteMember("x", CampaignSpec(**{**asdict(member.spec), "name": "trio: seed=1"}))
    assert client.suites.find(Suite("trio", (renamed,))) == (None,)


def asdict(spec):
    return {name: getattr(spec, name) for name in spec.__struct_fields__}


def test_two_commands_at_once_create_each_member_once(client, suite, monkeypatch):
    # Both have looked before either has created.
    monkeypatch.setattr(client.campaigns, "list", lambda **_asked: iter(()))
    assert ids(client.suites.create(suite(1, 2))) == ids(client.suites.create(suite(1, 2)))


def test_members_are_found_over_pages(client, suite, fields, monkeypatch):
    monkeypatch.setattr("eigenfail.client.link.PAGE", 2)
    client.suites.create(suite(1, 2, 3))
    for _ in range(5):
        client.campaigns.create(**fields)
    assert ids(client.suites.find(suite(3, 4, 1))) == [3, None, 1]


@pytest.fixture
def chain(fields):
    """A replay of a replay of the first of its members, written down the other way round."""
    shared = {**fields, "method": "replay"}
    given = {
        "last": {**shared, "settings": {"campaign": "middle"}},
        "middle": {**shared, "settings": {"campaign": "first"}},
        "first": fields,
    }
    members = [
        SuiteMember(name, CampaignSpec(**{**each, "name": f"chain: {name}"}))
        for name, each in given.items()
    ]
    return Suite("chain", tuple(members))


def end(store, campaign, state="done"):
    between = "cancelling" if state == "cancelled" else "running"
    for step in ("running", between, state):
        if store.campaigns.get(campaign).state != step:
            store.campaigns.move(campaign, step)


def test_a_member_is_created_once_what_it_builds_upon_is_done(client, chain, store):
    assert ids(client.suites.create(chain)) == [None, None, 1]
    assert ids(client.suites.create(chain)) == [None, None, 1]
    end(store, 1)
    assert ids(client.suites.start(chain)) == [None, 2, 1]
    assert client.campaigns.get(2).spec.settings == {"campaign": 1}
    end(store, 2)
    assert ids(client.suites.start(chain)) == [3, 2, 1]
    assert client.campaigns.get(3).spec.settings == {"campaign": 2}
    assert ids(client.suites.find(chain)) == [3, 2, 1]
    assert ids(client.suites.create(chain)) == [3, 2, 1]


def test_run_creates_each_in_its_turn_and_tells_of_it(client, chain, store):
    seen = []

    def watch(campaigns):
        seen.append(ids(campaigns))
        for campaign in campaigns:
            if campaign is not None and campaign.state is CampaignState.QUEUED:
                end(store, campaign.id)

    ended = client.suites.run(chain, watch, poll_s=0.0)
    assert [campaign.state for campaign in ended] == ["done"] * 3
    assert seen[0] == [None, None, 1]
    assert seen[-1] == [3, 2, 1]
    assert [None, 2, 1] in seen
    assert len(list(client.campaigns.list())) == 3


@pytest.mark.parametrize("state", ["cancelled", "dead"])
def test_what_builds_upon_a_campaign_that_came_to_nothing_is_held_back(client, chain, store, state):
    client.suites.create(chain)
    end(store, 1, state)
    ended = client.suites.run(chain, poll_s=0.0, timeout_s=1.0)
    assert ids(ended) == [None, None, 1]


def test_another_campaign_below_makes_another_one_above(client, chain, store):
    client.suites.create(chain)
    end(store, 1)
    client.suites.create(chain)
    *others, first = chain.members
    changed = CampaignSpec(**{**asdict(first.spec), "seed": 5})
    later = Suite("chain", (*others, SuiteMember("first", changed)))
    assert ids(client.suites.find(later)) == [None, None, None]
    assert ids(client.suites.create(later)) == [None, None, 3]
    end(store, 3)
    assert ids(client.suites.create(later)) == [None, 4, 3]
    assert ids(client.suites.find(chain)) == [None, 2, 1]


def test_paused_members_go_on(client, suite, store):
    client.suites.create(suite(1, 2, 3))
    store.campaigns.move(2, CampaignState.RUNNING)
    store.campaigns.move(3, CampaignState.CANCELLED)
    paused = client.suites.pause(suite(1, 2, 3))
    assert [campaign.state for campaign in paused] == ["paused", "pausing", "cancelled"]
    store.campaigns.move(2, CampaignState.PAUSED)
    assert client.suites.wait(suite(1, 2, 3)) == client.suites.find(suite(1, 2, 3))
    started = client.suites.start(suite(1, 2, 3, 4))
    assert [campaign.state for campaign in started] == ["queued", "queued", "cancelled", "queued"]


def test_a_member_that_is_still_pausing_is_awaited(client, suite, store, monkeypatch):
    client.suites.create(suite(1))
    store.campaigns.move(1, CampaignState.RUNNING)
    client.campaigns.pause(1)
    monkeypatch.setattr(
        "eigenfail.client.link.sleep",
        lambda seconds: store.campaigns.move(1, CampaignState.PAUSED),
    )
    assert [campaign.state for campaign in client.suites.start(suite(1))] == ["queued"]


def test_waiting_tells_of_progress_and_ends_with_the_last(client, suite, store):
    client.suites.create(suite(1, 2))
    path = iter([(1, "running"), (1, "done"), (2, "running"), (2, "done")])
    seen = []

    def watch(campaigns):
        seen.append([campaign.state.value for campaign in campaigns])
        if seen[-1] != ["done", "done"]:
            store.campaigns.move(*next(path))

    ended = client.suites.wait(suite(1, 2), watch, poll_s=0.0)
    assert [campaign.state for campaign in ended] == ["done", "done"]
    assert seen[0] == ["queued", "queued"]
    assert seen[-2:] == [["done", "running"], ["done", "done"]]


def test_waiting_ends_after_the_time_that_was_given(client, suite):
    client.suites.create(suite(1))
    with pytest.raises(WaitTimeout, match=r"0 of 1 campaigns .* is still running after 0 s"):
        client.suites.wait(suite(1), poll_s=0.0, timeout_s=0.0)


def test_summaries_come_in_the_order_of_the_members(client, suite):
    client.suites.create(suite(1, 2))
    found = client.suites.summaries(suite(2, 5, 1))
    assert [summary and summary.campaign for summary in found] == [2, None, 1]


def test_only_campaigns_of_the_suite_are_asked_for(client, suite, fields, store, monkeypatch):
    client.suites.create(suite(1, 2))
    client.campaigns.create(**fields)
    asked = []
    page = store.campaigns.page

    def note(*arguments):
        found = page(*arguments)
        asked.append([campaign.id for campaign in found.items])
        return found

    monkeypatch.setattr(store.campaigns, "page", note)
    assert ids(client.suites.find(suite(1, 2, 3))) == [1, 2, None]
    assert asked == [[2, 1]]


def test_a_suite_whose_name_has_a_colon_is_found(client, suite):
    (member,) = suite(1).members
    spec = CampaignSpec(**{**asdict(member.spec), "name": "mine: trio: seed=1"})
    colons = Suite("mine: trio", (SuiteMember("seed=1", spec),))
    assert ids(client.suites.create(colons)) == ids(client.suites.find(colons)) == [1]


@pytest.mark.parametrize("name", ["feature/a @ v1", "50 % #?&", "σ ✓"])
def test_any_name_can_be_asked_for(client, fields, name):
    client.campaigns.create(**{**fields, "name": f"{name}: one"})
    assert client.suites.table(name).suite == name
