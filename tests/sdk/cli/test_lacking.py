"""What is said of a campaign that no connected worker can run."""

import json
from types import SimpleNamespace

import pytest

from eigenfail.cli import render
from eigenfail.cli.doctor import list_troubled_campaigns
from eigenfail.cli.render import PATIENCE_S, _MissingWorkerNotice, find_missing_workers
from eigenfail.client import Client
from eigenfail.errors import NotFound
from eigenfail.hosting.folder import DEFAULT_URL

BRIDGE = "No connected worker has a bridge: start one."


@pytest.fixture
def client(service):
    return Client(DEFAULT_URL, service)


@pytest.fixture
def idle(service, eigenfail, spec_file, store, monkeypatch):
    """A campaign that nobody works on."""
    made = json.loads(eigenfail("campaign", "create", spec_file, "--json").stdout)["id"]
    monkeypatch.setattr(service, "work_on", lambda campaign: None)
    if store.campaigns.get(made).state == "queued":
        store.campaigns.move(made, "running")
    return made


def test_a_campaigns_page_says_what_it_lacks(eigenfail, idle, store):
    assert BRIDGE not in eigenfail("campaign", "show", idle).stdout
    store.events.append("workers.lacking", BRIDGE, idle)
    assert BRIDGE in eigenfail("campaign", "show", idle).stdout
    store.events.append("workers.met", "A worker with a bridge is connected.", idle)
    assert BRIDGE not in eigenfail("campaign", "show", idle).stdout


def test_the_doctor_names_the_campaign_and_finds_it_wrong(eigenfail, client, idle, store):
    assert list(list_troubled_campaigns(client)) == []
    store.events.append("workers.lacking", BRIDGE, idle)
    told = eigenfail("doctor", "--json")
    (found,) = [each for each in json.loads(told.stdout) if each["what"] == f"campaign {idle}"]
    assert told.exit_code == 3
    assert (found["found"], found["wrong"]) == (BRIDGE, True)


def test_whoever_follows_a_campaign_that_does_not_get_on_is_told_once(
    client, idle, store, monkeypatch, capsys
):
    now = SimpleNamespace(s=100.0)
    monkeypatch.setattr(render, "time", SimpleNamespace(monotonic=lambda: now.s))
    store.events.append("workers.lacking", BRIDGE, idle)
    lookout, seen = _MissingWorkerNotice(client), store.campaigns.get(idle)
    lookout(seen)
    assert capsys.readouterr().err == ""
    for _ in range(3):
        now.s += PATIENCE_S
        lookout(seen)
    assert capsys.readouterr().err == f"{BRIDGE}\n"
    store.events.append("workers.met", "A worker with a bridge is connected.", idle)
    now.s += PATIENCE_S
    lookout(seen)
    assert capsys.readouterr().err == ""


def test_a_campaign_is_followed_with_its_lookout(eigenfail, idle, store, service, monkeypatch):
    monkeypatch.setattr(render, "PATIENCE_S", 0.0)
    store.events.append("workers.lacking", BRIDGE, idle)
    handle, looks = service.handle_request, []

    def counted(request):
        looks.append(request.url.path)
        if len(looks) == 9:
            store.campaigns.move(idle, "done")
        return handle(request)

    monkeypatch.setattr(service, "handle_request", counted)
    watched = eigenfail("campaign", "watch", idle)
    assert watched.exit_code == 0, watched.output
    assert watched.stderr.count(BRIDGE) == 1


def test_a_service_that_does_not_know_of_it_says_nothing(store, idle):
    def unknown():
        raise NotFound("No such page.")

    client = SimpleNamespace(staffing=unknown)
    assert find_missing_workers(client, store.campaigns.get(idle)) == ()
    assert list(list_troubled_campaigns(client)) == []
