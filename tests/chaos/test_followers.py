"""Who follows events behind a bad line sees each of them once, and goes on where it was cut."""

from collections.abc import Callable, Iterator
from contextlib import closing

import deadlines
import pytest
from proxy import Line, Proxy
from stage import Stage

from eigenfail.client import Client
from eigenfail.errors import ServiceUnreachable
from eigenfail_services.store.store import open_store

pytestmark = [pytest.mark.service, pytest.mark.timeout(deadlines.TEST_S)]

SEED = 20261122
EVENTS = 250
SAID = "Said. " * 100


@pytest.fixture
def proxy(stage: Stage) -> Iterator[Proxy]:
    with closing(Proxy(stage.controller().url, SEED)) as line:
        yield line


@pytest.fixture
def tell(stage: Stage) -> Iterator[Callable[[int], list[int]]]:
    """Logs so many events, and returns their ids."""
    with closing(open_store(stage.url)) as store:
        yield lambda n: [store.events.append("test", SAID).id for _ in range(n)]


@pytest.mark.fault(
    "event stream cut",
    group="messages",
    outcome="The browser resumes after the last event that it received; every event arrives once.",
)
def test_every_event_comes_once_through_all_cuts(tell, proxy: Proxy) -> None:
    told = tell(EVENTS)
    proxy.line = Line(cut=0.05)
    with Client(proxy.address) as client:
        events = client.events.follow(after=told[0] - 1)
        assert [next(events).id for _ in told] == told
    assert proxy.befell["cut"] > 1


@pytest.mark.fault("event stream cut")
def test_what_happens_while_one_is_cut_off_is_not_missed(tell, proxy: Proxy) -> None:
    with Client(proxy.address) as client:
        (before,) = tell(1)
        events = client.events.follow(after=before - 1)
        assert next(events).id == before
        with proxy.severed():
            told = tell(EVENTS)
            with pytest.raises(ServiceUnreachable):
                next(events)
        again = client.events.follow(after=before)
        assert [next(again).id for _ in told] == told
