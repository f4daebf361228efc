"""A wait goes on while the service is away for a while, and not for ever; time is played."""

import logging

import httpx2
import pytest

from eigenfail.client import link
from eigenfail.client.link import AWAY_S, check_during_waits, rest
from eigenfail.errors import ServiceError, ServiceUnreachable, StoreUnavailable
from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.wire import http
from eigenfail.wire.http import make_problem

SPEC = CampaignSpec(name="first", method="monte_carlo", episodes=1)


def campaign(state: CampaignState) -> httpx2.Response:
    told = Campaign(id=1, spec=SPEC, state=state, counts=Counts(1), created_ms=0)
    return httpx2.Response(200, content=http.encode(told))


def unreachable() -> httpx2.Response:
    raise httpx2.ConnectError("refused")


def store_away() -> httpx2.Response:
    told = make_problem(StoreUnavailable("The database does not answer.", "Start it."))
    return httpx2.Response(503, content=http.encode(told))


class Played:
    """Time passes while somebody rests."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def rest(self, seconds: float) -> None:
        self.now_s += seconds


@pytest.fixture
def time(monkeypatch):
    """The clock of whoever waits; every pause counts, also those between two tries."""
    played = Played()
    monkeypatch.setattr(link, "monotonic", lambda: played.now_s)
    monkeypatch.setattr("eigenfail.client.link.find_pause", lambda _error, _tried: 0.1)
    token = rest.set(played.rest)
    yield played
    rest.reset(token)


@pytest.mark.fault("restart of the controller while a client waits for a campaign")
@pytest.mark.parametrize("absence", [unreachable, store_away])
def test_who_is_there_again_is_waited_for(scripted, time, caplog, absence):
    def service(_request, asked):
        if asked == 1:
            return campaign(CampaignState.RUNNING)
        return absence() if time.now_s < 20.0 else campaign(CampaignState.DONE)

    client, _ = scripted(service)
    assert client.campaigns.wait(1).state is CampaignState.DONE
    assert time.now_s < 21.0
    told = [record for record in caplog.records if record.levelno == logging.WARNING]
    assert len(told) == 1
    assert "waiting" in told[0].getMessage()


@pytest.mark.fault("restart of the controller while a client waits for a campaign")
@pytest.mark.parametrize(("timeout_s", "ends_s"), [(None, AWAY_S), (10.0, 10.0), (1e9, AWAY_S)])
def test_who_stays_away_is_given_up(scripted, time, timeout_s, ends_s):
    client, _ = scripted(
        lambda _request, asked: campaign(CampaignState.RUNNING) if asked == 1 else unreachable()
    )
    with pytest.raises(ServiceUnreachable, match="eigenfail up"):
        client.campaigns.wait(1, timeout_s=timeout_s)
    assert ends_s <= time.now_s < ends_s + 2.0


def test_a_minute_is_there_for_each_absence(scripted, time):
    def service(_request, _asked):
        if time.now_s > 300.0:
            return campaign(CampaignState.DONE)
        return unreachable() if time.now_s % 60.0 > 10.0 else campaign(CampaignState.RUNNING)

    client, _ = scripted(service)
    assert client.campaigns.wait(1).state is CampaignState.DONE


def test_who_was_never_there_is_not_waited_for(scripted, time):
    client, _ = scripted(lambda _request, _asked: unreachable())
    with pytest.raises(ServiceUnreachable):
        client.campaigns.wait(1)
    assert time.now_s < 1.0


def test_who_waits_hears_of_trouble_meanwhile(scripted):
    client, asked = scripted(lambda _request, _asked: campaign(CampaignState.RUNNING))
    with pytest.raises(ServiceError, match="gone"), check_during_waits(gone):
        client.campaigns.wait(1)
    assert len(asked) == 1


def gone() -> None:
    raise ServiceError("The services process is gone.")
