"""Asked again where that is safe, once elsewhere; every refusal is the error it was."""

import logging
import socket

import httpx2
import pytest

from eigenfail import errors
from eigenfail.client import Client
from eigenfail.client.link import JITTER_S, LONGEST_PAUSE_S, find_pause, is_worth_retrying
from eigenfail.errors import (
    Conflict,
    InputError,
    NotFound,
    ProtocolError,
    ServiceError,
    ServiceUnreachable,
    StoreUnavailable,
    UnknownName,
)
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.wire import http
from eigenfail.wire.http import list_error_types, make_error, make_problem

SPEC = CampaignSpec(name="first", method="monte_carlo", episodes=1)
CAMPAIGN = Campaign(id=1, spec=SPEC, state=CampaignState.QUEUED, counts=Counts(1), created_ms=0)


def campaign():
    return httpx2.Response(200, content=http.encode(CAMPAIGN))


def busy(status=503):
    told = make_problem(StoreUnavailable("The database does not answer.", "Start it."))
    return httpx2.Response(status, content=http.encode(told), headers={"Retry-After": "1"})


def test_a_question_is_asked_again(scripted):
    client, asked = scripted(lambda request, n: campaign() if n == 3 else busy())
    assert client.campaigns.get(1) == CAMPAIGN
    assert len(asked) == 3


def test_a_question_is_not_asked_for_ever(scripted):
    client, asked = scripted(lambda request, n: busy())
    with pytest.raises(StoreUnavailable, match="Start it"):
        client.campaigns.get(1)
    assert len(asked) == 4


def test_only_the_last_try_is_heard_of(scripted, caplog, capsys):
    client, _ = scripted(lambda request, n: busy())
    with caplog.at_level(logging.DEBUG, "eigenfail"), pytest.raises(StoreUnavailable):
        client.campaigns.get(1)
    assert [record.levelname for record in caplog.records if record.name[:9] == "eigenfail"] == [
        "DEBUG"
    ] * 3
    assert capsys.readouterr() == ("", "")


def test_a_service_that_is_slow_to_refuse_is_not_asked_again(scripted, monkeypatch):
    times = iter((0.0, LONGEST_PAUSE_S + 1.0))
    monkeypatch.setattr("eigenfail.client.link.monotonic", lambda: next(times))
    client, asked = scripted(lambda request, n: busy())
    with pytest.raises(StoreUnavailable):
        client.campaigns.get(1)
    assert len(asked) == 1


def test_what_would_be_done_twice_is_asked_once(scripted):
    client, asked = scripted(lambda request, n: busy())
    for ask in (
        lambda: client.campaigns.cancel(1),
        lambda: client.analyses.create(1, AnalysisSettings()),
    ):
        asked.clear()
        with pytest.raises(StoreUnavailable):
            ask()
        assert len(asked) == 1


def test_what_is_done_once_only_is_asked_again_under_one_key(scripted):
    client, asked = scripted(lambda request, n: campaign() if n % 3 == 0 else busy())
    assert client.campaigns.create(SPEC) == CAMPAIGN
    keys = {request.headers["Idempotency-Key"] for request in asked}
    assert len(asked) == 3
    assert len(keys) == 1
    client.campaigns.create(SPEC)
    assert len({request.headers["Idempotency-Key"] for request in asked}) == 2


def test_a_cut_connection_is_worth_another_try_a_refusal_is_not(scripted):
    def cut(request, n):
        raise httpx2.ReadError("cut")

    client, asked = scripted(cut)
    with pytest.raises(ServiceUnreachable):
        client.campaigns.get(1)
    assert len(asked) == 4
    client, asked = scripted(lambda request, n: httpx2.Response(404))
    with pytest.raises(NotFound):
        client.campaigns.get(1)
    assert len(asked) == 1


def refused(status, pause=None):
    response = httpx2.Response(status, headers={"Retry-After": pause} if pause else {})
    return httpx2.HTTPStatusError("", request=httpx2.Request("GET", "http://x"), response=response)


@pytest.mark.parametrize(("pause", "seconds"), [("7", 7.0), ("0", 0.0), ("99999", LONGEST_PAUSE_S)])
def test_the_service_says_how_long_to_wait(pause, seconds):
    assert find_pause(refused(503, pause), 1) == seconds


@pytest.mark.parametrize("pause", ["Fri, 21 Nov 2026 12:00:00 GMT", None])
def test_a_service_that_does_not_say_is_asked_ever_later(pause):
    pauses = [find_pause(refused(503, pause), tried) for tried in (1, 2, 3)]
    for seconds, least in zip(pauses, (0.1, 0.2, 0.4), strict=True):
        assert least <= seconds <= least + JITTER_S


@pytest.mark.parametrize(
    ("status", "worth"), [(503, True), (429, True), (404, False), (500, False)]
)
def test_only_who_is_busy_is_asked_again(status, worth):
    assert is_worth_retrying(refused(status, "7")) is worth


def test_nobody_at_home_is_told_with_what_to_start():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with Client(f"http://127.0.0.1:{port}") as client:
        with pytest.raises(ServiceUnreachable, match="eigenfail up") as refusal:
            client.campaigns.get(1)
        assert str(port) in refusal.value.problem
        assert not client.health()


def example(kind):
    if issubclass(kind, UnknownName):
        return kind("planner", "rulebok", ["rulebook", "idm"])
    if issubclass(kind, InputError):
        return kind("episodes", "0 is not an integer of at least 1.", "Give more.")
    return kind("It is so.", "Do that.")


@pytest.mark.parametrize(
    "kind", list(list_error_types(errors.EigenfailError)), ids=lambda kind: kind.__name__
)
def test_every_error_comes_back_as_it_was_raised(scripted, kind):
    error = example(kind)
    content = http.encode(make_problem(error))
    client, _ = scripted(lambda request, n: httpx2.Response(kind.http_status, content=content))
    with pytest.raises(kind) as told:
        client.campaigns.pause(1)
    assert type(told.value) is kind
    assert str(told.value) == str(error)
    assert vars(told.value) == vars(error)


@pytest.mark.parametrize(
    ("status", "kind"),
    [(404, NotFound), (409, Conflict), (418, InputError), (500, ServiceError), (599, ServiceError)],
)
def test_refusals_of_strangers_are_told_by_their_status(scripted, status, kind):
    client, _ = scripted(lambda request, n: httpx2.Response(status, html="<h1>No</h1>"))
    with pytest.raises(kind, match=str(status)):
        client.campaigns.pause(1)


def test_problems_of_a_later_version_are_told_by_their_status():
    told = make_problem(NotFound("No such suite."))
    later = make_error(type(told)(type="urn:eigenfail:later", title="", status=404, detail="No."))
    assert type(later) is NotFound


def test_an_answer_of_another_kind_is_a_protocol_error(scripted):
    client, _ = scripted(lambda request, n: httpx2.Response(200, content=b'{"id": "one"}'))
    with pytest.raises(ProtocolError, match="one version"):
        client.campaigns.get(1)


def test_a_broken_stream_is_resumed_behind_the_last_event(scripted, monkeypatch):
    monkeypatch.setattr("eigenfail.client.client.RECONNECT_S", 0.0)

    class Cut(httpx2.SyncByteStream):
        def __init__(self, first):
            self.first = first

        def __iter__(self):
            yield b": ping\n\nid: 0\nretry: 1000\n\n"
            for number in (self.first, self.first + 1):
                event = b'{"id":%d,"at_ms":0,"kind":"k","message":"m"}' % number
                yield b"data: " + event + b"\nid: %d\n\n" % number
            raise httpx2.ReadError("cut")

    def answer(request, n):
        kind = {"Content-Type": "text/event-stream"}
        return httpx2.Response(200, headers=kind, stream=Cut(2 * n - 1))

    client, asked = scripted(answer)
    follower = client.events.follow()
    assert [next(follower).id for _ in range(5)] == [1, 2, 3, 4, 5]
    assert [request.headers["Last-Event-ID"] for request in asked] == ["0", "2", "4"]


def test_a_stream_of_a_service_that_stays_away_ends(scripted, monkeypatch):
    monkeypatch.setattr("eigenfail.client.client.RECONNECT_S", 0.0)

    def away(request, n):
        raise httpx2.ConnectError("refused")

    client, asked = scripted(away)
    with pytest.raises(ServiceUnreachable):
        next(client.events.follow())
    assert len(asked) == 5


def test_the_address_is_that_of_the_environment_unless_one_is_given(monkeypatch):
    monkeypatch.delenv("EIGENFAIL_URL", raising=False)
    assert Client().url == "http://127.0.0.1:8440"
    monkeypatch.setenv("EIGENFAIL_URL", "")
    assert Client().url == "http://127.0.0.1:8440"
    monkeypatch.setenv("EIGENFAIL_URL", "http://lab:9000")
    assert Client().url == "http://lab:9000"
    assert Client("http://127.0.0.1:1").url == "http://127.0.0.1:1"
    with pytest.raises(ServiceUnreachable, match="EIGENFAIL_URL"):
        Client("http://127.0.0.1:1").campaigns.get(1)


def test_a_service_in_this_process_is_not_that_of_the_environment(monkeypatch, scripted):
    monkeypatch.setenv("EIGENFAIL_URL", "http://lab:9000")
    client, _ = scripted(lambda request, asked: None)
    assert client.url == "http://127.0.0.1:8440"
