"""The asynchronous client: the verbs of the blocking one, many at once, ended when given up."""

import asyncio
import inspect
import threading
from contextlib import aclosing
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import deadlines
import httpx2
import numpy as np
import pytest

from eigenfail import AsyncClient
from eigenfail.client import asynchronous
from eigenfail.errors import NotFound, UnknownName

FOREVER_S = 3600.0
WITHIN_S = deadlines.PROCESS_S


@pytest.fixture
def asynchronous_client(client):
    """The same service for asynchronous programs."""
    return AsyncClient(client.url, client._link._http._transport)


def test_verbs_are_awaited(asynchronous_client, client, fields):
    async def program():
        async with asynchronous_client as service:
            made = await service.campaigns.create(**fields)
            paused = await service.campaigns.pause(made.id)
            return made, paused, await service.methods(), await service.health()

    made, paused, methods, healthy = asyncio.run(program())
    assert (made.spec.name, paused.state, healthy) == ("first", "paused", True)
    assert "monte_carlo" in {each.name for each in methods}


def test_errors_are_those_of_the_blocking_client(asynchronous_client, fields):
    async def program():
        with pytest.raises(NotFound):
            await asynchronous_client.campaigns.get(9)
        with pytest.raises(UnknownName, match="Did you mean 'idm'"):
            await asynchronous_client.campaigns.create(**fields | {"planner": "idn"})

    asyncio.run(program())


def test_a_plain_loop_is_refused(asynchronous_client):
    for rows in (asynchronous_client.campaigns.list(), asynchronous_client.events.follow()):
        with pytest.raises(TypeError, match="async for"):
            iter(rows)


def test_lists_are_iterated_over_pages(asynchronous_client, client, fields, monkeypatch):
    monkeypatch.setattr("eigenfail.client.link.PAGE", 2)
    monkeypatch.setattr(asynchronous, "PAGE", 2)
    ids = [client.campaigns.create(**fields).id for _ in range(5)]

    async def program():
        rows = asynchronous_client.campaigns.list()
        seen = [campaign.id async for campaign in rows]
        first = [campaign.id for campaign in await rows.first(3)]
        return seen, first, await rows.to_pandas(), await rows.to_numpy()

    seen, first, frame, table = asyncio.run(program())
    assert seen == ids[::-1]
    assert first == ids[:1:-1]
    assert list(frame["id"]) == seen
    assert np.array_equal(table["id"], seen)


def test_twenty_waits_go_on_at_once(asynchronous_client, client, store, fields):
    ids = [client.campaigns.create(**fields).id for _ in range(20)]
    looked, lock = set(), threading.Lock()

    def look(campaign):
        with lock:
            looked.add(campaign.id)
            if looked == set(ids) and campaign.state == "queued":
                for each in ids:
                    if store.campaigns.get(each).state == "queued":
                        store.campaigns.move(each, "cancelled")

    async def program():
        waits = [
            asynchronous_client.campaigns.wait(each, on_progress=look, poll_s=0.01) for each in ids
        ]
        return await asyncio.wait_for(asyncio.gather(*waits), WITHIN_S)

    assert {ended.state for ended in asyncio.run(program())} == {"cancelled"}


def test_a_wait_that_is_given_up_ends_between_two_looks(asynchronous_client, client, fields):
    campaign, threads = client.campaigns.create(**fields), []

    def look(_campaign):
        threads.append(threading.current_thread())

    async def program():
        waiting = asyncio.create_task(
            asynchronous_client.campaigns.wait(campaign.id, look, poll_s=FOREVER_S)
        )
        while not threads:
            await asyncio.sleep(0.01)
        waiting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiting

    asyncio.run(program())
    threads[0].join(WITHIN_S)
    assert not threads[0].is_alive()
    assert len(threads) == 1


def test_a_question_that_is_given_up_is_not_asked_again(scripted, monkeypatch):
    threads = []

    def pause(_error, _tried):
        threads.append(threading.current_thread())
        return FOREVER_S

    monkeypatch.setattr("eigenfail.client.link.find_pause", pause)
    blocking, asked = scripted(lambda _request, _number: httpx2.Response(503))

    async def program():
        client = AsyncClient(blocking.url, blocking._link._http._transport)
        asking = asyncio.create_task(client.campaigns.get(1))
        while not threads:
            await asyncio.sleep(0.01)
        asking.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asking

    asyncio.run(program())
    threads[0].join(WITHIN_S)
    assert not threads[0].is_alive()
    assert len(asked) == 1


def test_a_time_out_ends_a_wait(asynchronous_client, client, fields):
    campaign = client.campaigns.create(**fields)

    async def program():
        async with asyncio.timeout(0.2):
            await asynchronous_client.campaigns.wait(campaign.id, poll_s=FOREVER_S)

    with pytest.raises(TimeoutError):
        asyncio.run(program())


def test_events_are_an_asynchronous_iterator(asynchronous_client, client, fields):
    campaign = client.campaigns.create(**fields)

    async def program():
        async with aclosing(aiter(asynchronous_client.events.follow())) as events:
            first = await anext(events)
            await asynchronous_client.campaigns.pause(campaign.id)
            return first, await anext(events)

    first, second = asyncio.run(program())
    assert first.campaign == campaign.id
    assert second.id > first.id


class Silent(BaseHTTPRequestHandler):
    """Begins a stream of events, and says nothing."""

    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Type", "text/event-stream")
        self.end_headers()
        self.wfile.flush()
        self.server.listening.set()
        self.server.over.wait(WITHIN_S)

    def log_message(self, *_):
        pass


@pytest.fixture
def silent():
    """A service of which no event ever comes."""
    with ThreadingHTTPServer(("127.0.0.1", 0), Silent) as server:
        server.listening, server.over = threading.Event(), threading.Event()
        serving = threading.Thread(target=server.serve_forever)
        serving.start()
        yield server
        server.over.set()
        server.shutdown()
        serving.join()


def test_a_silent_stream_ends_when_nobody_listens_any_more(silent, monkeypatch):
    threads = []
    rest = asynchronous.Ending.rest
    monkeypatch.setattr(
        asynchronous.Ending,
        "rest",
        lambda self, seconds: (threads.append(threading.current_thread()), rest(self, seconds)),
    )

    async def program():
        client = AsyncClient(f"http://127.0.0.1:{silent.server_address[1]}")
        listening = asyncio.create_task(anext(aiter(client.events.follow())))
        await asyncio.to_thread(silent.listening.wait)
        await asyncio.sleep(0.2)
        listening.cancel()
        with pytest.raises(asyncio.CancelledError):
            await listening
        await client.close()

    asyncio.run(program())
    deadline = threading.Event()
    while not threads and not deadline.wait(0.05):
        pass
    threads[0].join(WITHIN_S)
    assert not threads[0].is_alive()
    assert not silent.over.is_set()


def test_it_has_every_verb_of_the_blocking_client_and_no_more(asynchronous_client, client):
    for resource in ("campaigns", "suites", "episodes", "analyses", "events"):
        mine, theirs = getattr(asynchronous_client, resource), getattr(client, resource)
        verbs = [name for name, _ in inspect.getmembers(theirs, inspect.ismethod) if name[0] != "_"]
        assert verbs
        assert set(verbs) <= set(dir(mine))
        assert all(getattr(mine, name).__doc__ == getattr(theirs, name).__doc__ for name in verbs)
    with pytest.raises(AttributeError):
        _ = asynchronous_client.campaigns.fly
