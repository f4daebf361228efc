"""Campaigns, episodes, analyses, modes, keys and suites, named by ids or by the objects."""

import inspect
from contextlib import suppress
from pathlib import Path
from typing import get_type_hints

import httpx2
import msgspec
import numpy as np
import pytest
from example_values import make_row
from store_checks.examples import deliver, result, running

from eigenfail.client import Client, references
from eigenfail.client.references import (
    find_campaign_id,
    find_campaign_ids,
    find_episode_id,
    find_event_id,
    find_suite_name,
    locate_analysis,
    locate_episode,
    locate_key,
    locate_mode,
)
from eigenfail.errors import EigenfailError, InvalidValue
from eigenfail.values.access import UNLIMITED, ApiKey, NewKey, Scope
from eigenfail.values.analysis import Mode
from eigenfail.values.operations import Event
from eigenfail.values.records import EpisodeDetail

MODE = Mode(5, 2, 30, "hard braking")
KEY = ApiKey(id=4, name="ci", scope=Scope.VIEWER, created_ms=0, quotas=UNLIMITED)

NAMED = {
    "campaign": {"CampaignLike", "CampaignsLike"},
    "campaigns": {"CampaignsLike"},
    "a": {"CampaignsLike"},
    "b": {"CampaignsLike"},
    "index": {"EpisodeLike"},
    "episode": {"EpisodeLike"},
    "analysis": {"AnalysisLike"},
    "mode": {"ModeLike"},
    "key": {"KeyLike"},
    "after": {"EventLike"},
}
"""Parameters that name a thing of the service, and what they take."""


@pytest.fixture
def campaign(client, store):
    made = running(store, name="sweep: a")
    deliver(store, made, result(0))
    return client.campaigns.get(made.id)


def test_an_object_stands_for_its_id_everywhere(client, campaign):
    row = client.episodes.list(campaign).first(1)[0]
    summary = client.campaigns.summary(campaign)
    assert client.campaigns.get(summary) == campaign
    assert client.campaigns.get(row) == campaign
    assert client.campaigns.digest(campaign) == client.campaigns.digest(campaign.id)
    detail = client.episodes.get(row)
    assert detail.index == row.index
    assert client.episodes.get(campaign, detail).seed == row.seed
    assert detail.campaign == client.campaigns.get(detail).id == campaign.id
    assert client.episodes.get(detail).digest() == detail.digest()
    assert client.episodes.replay(row, scale=0.5).spec.settings["scale"] == 0.5
    other = client.campaigns.clone(campaign)
    assert client.campaigns.compare([campaign], other).a.campaigns == (campaign.id,)
    analysis = client.analyses.create(campaign)
    assert client.analyses.get(analysis).id == analysis.id
    assert [each.id for each in client.analyses.list(row)] == [analysis.id]
    table = client.suites.table(client.suites.list().first(1)[0])
    assert client.campaigns.cost(table.members[0]).campaign == table.members[0].campaign
    assert client.campaigns.cancel(other).id == other.id


def test_lists_and_arrays_of_campaigns_are_named_as_they_are(client, fields):
    ids = [client.campaigns.create(**fields).id for _ in range(3)]
    assert find_campaign_ids(client.campaigns.list()) == (*ids[::-1],)
    assert find_campaign_ids(np.array(ids)) == (*ids,)
    assert find_campaign_ids(np.int64(7)) == (7,)
    with pytest.raises(InvalidValue, match="Name at least one"):
        find_campaign_ids([])


def test_modes_keys_events_and_suites_have_their_paths():
    assert locate_mode(MODE, MODE) == locate_mode(5, 2) == "/analyses/5/modes/2"
    assert locate_analysis(MODE) == "/analyses/5"
    assert locate_key(KEY) == locate_key(NewKey(KEY, "ef_4_x")) == locate_key(4) == "/keys/4"
    assert find_event_id(Event(9, 0, "campaign.state", "It ended.")) == find_event_id(9) == 9
    assert find_suite_name("sweep") == "sweep"


@pytest.mark.parametrize("given", ["7", 7.0, True, None])
def test_what_names_no_campaign_is_refused_with_what_was_given(given):
    with pytest.raises(InvalidValue) as error:
        find_campaign_id(given)
    assert error.value.field == "campaign"
    assert repr(given)[:60] in error.value.problem
    assert "Campaign" in error.value.problem


@pytest.mark.parametrize(("given", "named"), [(MODE, "Mode"), ([7], "list"), ({}, "dict")])
def test_another_object_is_named_by_its_type(given, named):
    with pytest.raises(InvalidValue, match=f"an object of type {named} is neither an id nor"):
        find_campaign_id(given)


def test_an_episode_that_does_not_say_its_campaign_is_refused_with_what_to_give():
    bare = result(3)
    older = EpisodeDetail(**msgspec.structs.asdict(bare))
    for given in (bare, older):
        with pytest.raises(InvalidValue, match=r"does not say its campaign\. Give campaign and"):
            find_episode_id(given, None)
        assert find_episode_id(7, given) == (7, 3)


def test_an_episode_is_never_looked_up_in_another_campaign(client, campaign):
    row = client.episodes.list(campaign).first(1)[0]
    assert locate_episode(campaign, row) == locate_episode(row, None)
    with pytest.raises(InvalidValue, match=f"belongs to campaign {campaign.id}, not to 99"):
        find_episode_id(99, row)
    with pytest.raises(InvalidValue, match=f"belongs to campaign {campaign.id}, not to 99"):
        find_episode_id(99, client.episodes.get(row))
    with pytest.raises(InvalidValue, match="Name the index"):
        find_episode_id(campaign, None)
    with pytest.raises(InvalidValue, match="belongs to analysis 5"):
        locate_mode(6, MODE)


class Listener(httpx2.BaseTransport):
    """Notes what is asked, and has nothing."""

    def __init__(self):
        self.heard = []

    def handle_request(self, request):
        self.heard.append((request.method, request.url.raw_path, request.read()))
        return httpx2.Response(404)


def list_methods(*parameters):
    """The methods of all parts of a client that have one of the parameters."""
    found = Client("http://127.0.0.1:1", Listener())
    return [
        (resource, name)
        for resource, part in vars(found).items()
        if not resource.startswith("_")
        for name, method in inspect.getmembers(part, inspect.ismethod)
        if not name.startswith("_") and {*parameters} & {*inspect.signature(method).parameters}
    ]


BEHIND = {"path": "x.gif", "text": "late", "name": "late"}
"""What methods take behind the thing that they name."""


def ask(resource, name, *things, by_name=False):
    """What a method asks of the service for these things, and what it needs behind them."""
    listener = Listener()
    method = getattr(getattr(Client("http://127.0.0.1:1", listener), resource), name)
    wanted = [each for each in inspect.signature(method).parameters if each in BEHIND]
    named = {each: BEHIND[each] for each in wanted} if by_name else {}
    rest = [] if by_name else [BEHIND[each] for each in wanted]
    with suppress(EigenfailError):
        found = method(*things, *rest, **named)
        list(found)  # rows are asked for once they are read
    return listener.heard


ROW = make_row(3, campaign=7)


@pytest.mark.parametrize("method", list_methods("index", "episode"))
@pytest.mark.parametrize("by_name", [False, True])
def test_an_episode_stands_for_campaign_and_index_in_every_method(method, by_name):
    asked = ask(*method, 7, 3)
    assert len(asked) == 1
    assert b"/campaigns/7/episodes/3" in asked[0][1]
    assert ask(*method, ROW, by_name=by_name) == ask(*method, 7, ROW) == asked


@pytest.mark.parametrize("method", list_methods("mode"))
@pytest.mark.parametrize("by_name", [False, True])
def test_a_mode_stands_for_analysis_and_number_in_every_method(method, by_name):
    asked = ask(*method, 5, 2)
    assert len(asked) == 1
    assert b"/analyses/5/modes/2" in asked[0][1]
    assert ask(*method, MODE, by_name=by_name) == ask(*method, 5, MODE) == asked


def test_every_method_on_one_thing_is_among_those_tried():
    episodes = {name for _, name in list_methods("index", "episode")}
    assert {"export_recording", "get", "replay", "shrink"} <= episodes
    assert {"animate", "rename_mode", "change_mode"} <= {name for _, name in list_methods("mode")}


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda client: client.episodes.export_recording(ROW), "path"),
        (lambda client: client.episodes.export_recording(7, 3), "path"),
        (lambda client: client.episodes.export_recording(7, "x.gif"), "index"),
        (lambda client: client.episodes.export_recording(7, 3, 5), "path"),
        (lambda client: client.analyses.rename_mode(5, "late"), "mode"),
        (lambda client: client.analyses.animate(MODE), "path"),
        (lambda client: client.triage.get_mode(5), "mode"),
    ],
)
def test_what_a_call_lacks_is_named(call, field):
    with pytest.raises(InvalidValue) as error:
        call(Client("http://127.0.0.1:1", Listener()))
    assert error.value.field == field


def test_no_method_takes_ids_alone(client):
    taken = {name: kind for name, kind in vars(references).items() if name.endswith("Like")}
    seen = set()
    for resource in ("campaigns", "episodes", "analyses", "triage", "keys", "events"):
        for name, method in inspect.getmembers(getattr(client, resource), inspect.ismethod):
            if name.startswith("_"):
                continue
            for parameter, kind in get_type_hints(method).items():
                if parameter in NAMED and kind != str | None:  # an idempotency key
                    allowed = [taken[each] for each in NAMED[parameter]]
                    # The text behind it, where an object before it stands for both.
                    shifted = (None, str | None, Path | str | None)
                    kinds = [*allowed, *(each | text for each in allowed for text in shifted)]
                    assert kind in kinds, (name, parameter)
                    seen.add(parameter)
    assert seen == {*NAMED}
