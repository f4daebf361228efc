"""Events over HTTP: in order, resumed where they were cut, at the price of one feed."""

import time
from functools import partial
from threading import Thread

import anyio
import fastapi.routing
import msgspec
import pytest

from eigenfail.values.operations import Event
from eigenfail_api.routes import events as feed_module
from eigenfail_api.routes.events import BATCH, EventFeed

URL = "/api/v1/events"


@pytest.fixture
def told(store):
    """Logs events about campaigns and returns their ids."""

    def append(*campaigns):
        return [store.events.append("test", "Said.", campaign).id for campaign in campaigns]

    return append


@pytest.fixture
def follow(http):
    """The first n events of a stream."""

    def take(n, headers=None, **params):
        taken = []
        with http.sse(URL, params=params, headers=headers or {}) as source:
            assert source.response.status_code == 200
            for event in source:
                if event.data:
                    taken.append(event)
                if len(taken) == n:
                    return taken
        return taken

    return take


def test_an_event_is_json_and_its_id_is_the_place(follow, told):
    told(None)
    (event,) = follow(1, after=0)
    read = msgspec.json.decode(event.data, type=Event)
    assert (read.kind, read.message, read.campaign) == ("test", "Said.", None)
    assert event.id == str(read.id)


def test_a_stream_begins_behind_the_id_it_is_given(follow, told):
    ids = told(*[None] * 5)
    assert [int(event.id) for event in follow(2, after=ids[2])] == ids[3:]


def test_last_event_id_goes_before_after(follow, told):
    ids = told(*[None] * 5)
    seen = follow(1, headers={"Last-Event-ID": str(ids[3])}, after=0)
    assert [int(event.id) for event in seen] == ids[4:]


def test_a_stream_may_be_of_one_campaign(follow, campaign, told):
    ids = told(None, campaign, None, campaign)
    seen = follow(2, after=ids[0] - 1, campaign=campaign)
    assert [int(event.id) for event in seen] == [ids[1], ids[3]]


def test_without_a_place_a_stream_begins_now_and_says_where(http, told):
    *_, last = told(None, None)
    with http.sse(URL) as source:
        events = iter(source)
        place = next(events)
        assert (place.id, place.data) == (str(last), "")
        (new,) = told(None)
        assert next(events).id == str(new)


def test_what_happens_while_one_listens_arrives(http, told):
    with http.sse(URL, params={"after": 0}) as source:
        events = iter(source)
        next(events)
        for _ in range(3):
            (new,) = told(None)
            assert next(events).id == str(new)


def test_silence_is_broken_for_proxies(http, monkeypatch):
    monkeypatch.setattr(fastapi.routing, "_PING_INTERVAL", 0.05)
    with http.stream("GET", URL) as response:
        assert any(part.startswith(": ping") for part in response.iter_text())


def test_a_stopping_server_lets_followers_go(http, app):
    Thread(target=lambda: (time.sleep(0.1), app.state.feed.close())).start()
    began = time.monotonic()
    with http.stream("GET", URL) as response:
        response.read()
    assert time.monotonic() - began < 2.0


def test_the_campaign_must_be_there_before_the_stream_begins(http, problem):
    problem(http.get(URL, params={"campaign": 9}), 404)


def test_a_place_is_a_number(http, problem):
    told = problem(http.get(URL, headers={"Last-Event-ID": "yesterday"}), 422)
    assert told["field"] == "Last-Event-ID"


def test_more_than_a_batch_comes_whole_and_in_order(store, told):
    ids = told(*[None] * (2 * BATCH + 7))

    async def take():
        async with anyio.create_task_group():
            feed = EventFeed(store, poll_s=0.01)
            seen = []
            async for event in feed.follow(0, None):
                seen.append(event.id)
                if len(seen) == len(ids):
                    feed.close()
            return seen

    assert anyio.run(take) == ids


def test_an_event_that_comes_during_a_look_comes_once(store, told, monkeypatch):
    ids = told(*[None] * 6)
    late = iter(ids)
    monkeypatch.setattr(store.events, "last", lambda: next(late, ids[-1]))

    async def take():
        feed = EventFeed(store, poll_s=0.001)
        async with anyio.create_task_group() as group:
            group.start_soon(close_soon, feed)
            return [event.id async for event in feed.follow(0, None)]

    assert anyio.run(take) == ids


async def close_soon(feed):
    await anyio.sleep(0.2)
    feed.close()


@pytest.fixture
def questions(store, monkeypatch):
    """The names of the questions that the event log was asked."""
    asked = []
    for name in ("last", "after"):
        verb = getattr(store.events, name)

        def ask(*given, name=name, verb=verb):
            asked.append(name)
            return verb(*given)

        monkeypatch.setattr(store.events, name, ask)
    return asked


@pytest.fixture
def clock(monkeypatch):
    """The seconds that the feed believes in; a list of one."""
    seconds = [0.0]
    monkeypatch.setattr(feed_module, "monotonic", lambda: seconds[0])
    monkeypatch.setattr(feed_module, "sleep", lambda _s: anyio.sleep(0.001))
    return seconds


FOLLOWERS = 50
LOOKS = 4


@pytest.mark.fault("two hundred clients at once")
def test_fifty_followers_ask_the_log_as_often_as_one(store, told, questions, clock):
    seen = [[] for _ in range(FOLLOWERS)]

    async def listen(feed, place):
        async for event in feed.follow(0, None):
            seen[place].append(event.id)

    async def all_have(count):
        with anyio.fail_after(30):
            while any(len(each) < count for each in seen):
                await anyio.sleep(0.001)

    async def crowd():
        feed = EventFeed(store, poll_s=1.0)
        await feed.newest()
        async with anyio.create_task_group() as group:
            for place in range(FOLLOWERS):
                group.start_soon(partial(listen, feed, place))
            for look in range(LOOKS):
                clock[0] += 1.0
                await anyio.sleep(0.01)
                told(None, None)
                clock[0] += 1.0
                await all_have(2 * look + 2)
            feed.close()

    anyio.run(crowd)
    assert all(each == [*range(1, 2 * LOOKS + 1)] for each in seen)
    assert questions.count("last") == 1
    assert questions.count("after") <= 2 * LOOKS


def test_who_was_away_for_long_is_brought_up_to_the_others(store, told, monkeypatch, clock):
    monkeypatch.setattr(feed_module, "MOST_KEPT", 3)
    ids = told(*[None] * 5)

    async def take(feed, after, count):
        found = []
        async for event in feed.follow(after, None):
            found.append(event.id)
            if len(found) == count:
                break
        return found

    async def visits():
        feed = EventFeed(store, poll_s=1.0)
        first = await take(feed, 0, 5)
        late = told(*[None] * 5)
        clock[0] += 1.0
        return first, late, await take(feed, 0, 10), await take(feed, late[2], 2)

    first, late, everything, behind = anyio.run(visits)
    assert first == ids
    assert everything == [*ids, *late]
    assert behind == late[3:]
