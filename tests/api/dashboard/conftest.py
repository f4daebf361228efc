"""The dashboard's pages, asked for as a browser asks."""

import time
from html.parser import HTMLParser

import pytest

from eigenfail_api.dashboard import campaign_page
from eigenfail_services.store import clock

HTML = {"Accept": "text/html,application/xhtml+xml"}


class Text(HTMLParser):
    """What is left of a page without its markup."""

    def __init__(self):
        super().__init__()
        self.words = []

    def handle_data(self, data):
        self.words += data.split()


class StandingClock:
    """The wall clock of stores and pages. It stands, so that pages do not depend on the machine."""

    monotonic_ns = staticmethod(time.monotonic_ns)

    def __init__(self):
        self.now_ms = 1_767_323_045_000

    def time_ns(self):
        return 1_000_000 * self.now_ms


@pytest.fixture(autouse=True)
def standing_clock(monkeypatch):
    """The clock; a test may set it forward."""
    standing = StandingClock()
    monkeypatch.setattr(clock, "time", standing)
    return standing


@pytest.fixture
def text_of():
    """The text of a page, single spaces between words."""

    def read(response):
        parser = Text()
        parser.feed(response.text)
        return " ".join(parser.words)

    return read


@pytest.fixture
def look(http, text_of):
    """The text of the page at an address, which must have the status."""

    def get(address, status=200):
        response = http.get(address, headers=HTML)
        assert response.status_code == status, response.text
        assert response.headers["content-type"].startswith("text/html")
        return text_of(response)

    return get


@pytest.fixture
def check_page(without_plugins, http, golden, monkeypatch):
    """Compares the page at an address, or the part of it that has an id, with a golden file."""
    # Whether a page waits for its later part is a matter of milliseconds.
    monkeypatch.setattr(campaign_page.costs, "is_prefetched", lambda begun: False)

    def check(name, address, part=None, status=200):
        response = http.get(address, headers=HTML)
        assert response.status_code == status, response.text
        golden.check_page(name, response.text, part)

    return check
