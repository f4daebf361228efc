"""A store with small real campaigns, and reports on them."""

from collections.abc import Callable
from functools import partial
from html.parser import HTMLParser
from typing import Any

import pytest
from accepted import accept_spec
from campaigns_here import run_here

from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail_reports.report import Made, make
from eigenfail_services.campaigns.analysis_jobs import run_analysis
from eigenfail_services.store.store import Store, open_store

EPISODES = 24
NOW_MS = 1_760_000_000_000
WORLD = {"planner": "idm", "simulator": "point_mass"}
VOID = {"meta", "link", "br", "hr", "img", "input"}


class Page(HTMLParser):
    """What an HTML page has: texts by element, attributes, and whether its elements close."""

    def __init__(self, html: bytes) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[str, str]] = []
        self.feed(html.decode())
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append((self.open[-1] if self.open else "", data))

    def all(self, tag: str) -> list[dict[str, str | None]]:
        """The attributes of every element of a kind."""
        return [attributes for name, attributes in self.elements if name == tag]

    @property
    def text(self) -> str:
        """All that is read."""
        return " ".join("".join(text for _, text in self.texts).split())


@pytest.fixture(scope="session")
def finish() -> Callable[..., int]:
    """Runs a campaign, or so many episodes of it, as the service does; its id."""
    return partial(run_here, active_s=36.0, because="The budget was spent.")


@pytest.fixture(scope="session")
def run(finish: Callable[..., int]) -> Callable[..., int]:
    """Makes a campaign and runs it, or so many episodes of it; its id."""

    def start(store: Store, first: int | None = None, **changes: Any) -> int:
        fields: dict[str, Any] = {"method": "monte_carlo", "episodes": EPISODES, "seed": 1}
        spec = CampaignSpec(**fields | WORLD | changes)
        return finish(store, store.campaigns.create(accept_spec(spec)).id, first)

    return start


@pytest.fixture(scope="session")
def store(run: Callable[..., int]) -> Store:
    """Campaign 1 fails and is analysed, 2 never fails, 3 still runs, 4 has not begun."""
    store = open_store("memory://")
    run(store, name="=A $b$ <script>alert(1)</script> & c")
    run(store, name="Safe", disturbance=DisturbanceModel(scale=0.01), seed=2)
    run(store, name="Running", first=10, seed=3)
    run(store, name="Queued", first=0, seed=4)
    run_analysis(store, store.analyses.create(1, AnalysisSettings(clusters=2, bootstrap=0)).id)
    return store


@pytest.fixture(scope="session")
def made(store: Store) -> Made:
    return make(store, (1, 2, 3, 4), NOW_MS)


@pytest.fixture(scope="session")
def html(made: Made) -> bytes:
    return made.html()


@pytest.fixture(scope="session")
def parse() -> Callable[[bytes], Page]:
    """Reads an HTML page."""
    return Page


@pytest.fixture(scope="session")
def page(html: bytes) -> Page:
    return Page(html)
