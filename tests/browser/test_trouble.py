"""Trouble that people have with pages: cuts, clocks, tabs, restarts, no mouse."""

import threading

import deadlines
import pytest
from accepted import accept_spec
from playwright.sync_api import expect

from eigenfail_api.__main__ import Server, listen
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.store.store import open_store

pytestmark = pytest.mark.browser

TABS = 8
LIVE = '[data-feed="live"]'


class Service:
    """A server that can be stopped and started again on the same port."""

    def __init__(self, store):
        self._store = store
        self._port = 0

    def start(self):
        listener = listen("127.0.0.1", self._port)
        self._port = listener.getsockname()[1]
        self._server = Server(create_app(self._store, ApiSettings(port=0, poll_s=0.05)))
        self._thread = threading.Thread(target=self._server.run, kwargs={"sockets": [listener]})
        self._thread.start()
        return f"http://127.0.0.1:{self._port}"

    def stop(self):
        self._server.handle_exit(0, None)
        self._thread.join(timeout=deadlines.PROCESS_S)
        assert not self._thread.is_alive()


@pytest.fixture
def service(tmp_path):
    store = open_store(f"sqlite:///{tmp_path / 'restarted.db'}")
    running = Service(store)
    yield running, store
    running.stop()
    store.close()


@pytest.mark.fault("SIGKILL of the controller")
def test_a_page_takes_up_its_stream_after_a_restart(service, visit, new_campaign):
    running, store = service
    address = running.start()
    visit.tolerate("ERR_")
    page = visit("/", address)
    expect(page.locator(LIVE)).to_be_visible()
    running.stop()
    expect(page.locator('[data-feed="lost"]')).to_be_visible()
    new_campaign(store, "made while nobody listened")
    assert running.start() == address
    expect(page.locator(LIVE)).to_be_visible()
    expect(page.get_by_role("link", name="made while nobody listened")).to_be_visible()


@pytest.fixture
def new_campaign():
    from eigenfail.values.campaign_spec import CampaignSpec

    return lambda store, name: store.campaigns.create(
        accept_spec(CampaignSpec(name=name, method="monte_carlo", episodes=5))
    )


def test_a_stream_that_was_cut_for_a_while_misses_nothing(visit, queue):
    # A request may be under way when the line is cut.
    visit.tolerate("htmx:error: Failed to fetch")
    page = visit("/")
    expect(page.locator(LIVE)).to_be_visible()
    page.context.set_offline(True)
    name = "queued while the line was cut"
    queue(name)
    page.context.set_offline(False)
    expect(page.get_by_role("link", name=name)).to_be_visible()


def test_eight_tabs_at_once_are_all_alive(visit, address, queue):
    """A browser lends six connections to a host: who is not looked at must give its own back."""
    first = visit("/")
    tabs = [first, *(first.context.new_page() for _ in range(TABS - 1))]
    for tab in tabs[1:]:
        look(tabs[tabs.index(tab) - 1], away=True)
        tab.goto(address + "/")
        expect(tab.locator(LIVE)).to_be_visible()
    queue("seen in every tab")
    look(tabs[-1], away=True)
    for tab in tabs:
        look(tab, away=False)
        expect(tab.get_by_role("link", name="seen in every tab")).to_be_visible()
        look(tab, away=True)


def look(tab, *, away):
    """Tell a tab what a browser tells it when another one is in front; headless ones never do."""
    hidden = "true" if away else "false"
    tab.evaluate(
        f"Object.defineProperty(document, 'hidden', {{ configurable: true, value: {hidden} }});"
        "document.dispatchEvent(new Event('visibilitychange'))"
    )
