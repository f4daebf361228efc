"""Extensions of other distributions: routes, pages and links, without a change of the core's."""

import re
import sys
from pathlib import Path

import msgspec
import pytest
from distributions import write_record
from plugin_absence import forget_entry_points
from starlette.testclient import TestClient

from eigenfail.values.access import KeyRequest, Scope
from eigenfail_api.app import create_app
from eigenfail_api.dashboard import rendering
from eigenfail_api.settings import ApiSettings
from eigenfail_services.access import make_key

ADDRESS = "http://127.0.0.1:8440"
MODULE = '''"""Sheep, counted."""

from typing import Annotated

import msgspec
from fastapi import APIRouter, Depends
from fastapi.responses import HTMLResponse

from eigenfail.errors import InvalidValue
from eigenfail.values.access import Scope
from eigenfail_api.dashboard.rendering import CampaignFile, NavigationEntry, page
from eigenfail_api.extensions import Extension
from eigenfail_api.openapi import document_route
from eigenfail_api.parameters import Json, Stored, body_of

router = APIRouter(prefix="/api/v1", tags=["campaigns"])
pages = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


class Flock(msgspec.Struct, frozen=True):
    """Sheep.

    Attributes:
        name: name of the flock.
        sheep: how many there are.
    """

    name: str
    sheep: int = 0


class Fleece(msgspec.Struct, frozen=True):
    """Wool.

    Attributes:
        colour: its colour.
        secret: what nobody may read.
    """

    colour: str
    secret: str = ""


@router.post("/sheep", **document_route(Flock, body=Flock, example={"name": "hill"}))
def count_sheep(store: Stored, flock: Annotated[Flock, Depends(body_of(Flock))]) -> Json:
    """Count the sheep of a flock."""
    if not flock.name:
        raise InvalidValue("name", "is empty.", "Name the flock.")
    return Json(Flock(flock.name, 7 + len(store.campaigns.page(10).items)))


@router.get("/sheep/price", **document_route(Flock))
def price() -> Json:
    """Price the sheep."""
    return Json(Flock("dear"))


@router.post("/sheep/shear", **document_route(Flock, body=Fleece, example={"colour": "white"}))
def shear(fleece: Annotated[Fleece, Depends(body_of(Fleece))]) -> Json:
    """Shear the sheep."""
    return Json(Flock(fleece.colour))


@pages.get("/sheep")
def show_sheep() -> HTMLResponse:
    """Serve the page of the sheep."""
    return page("eigenfail_sheep/flock.html", Flock("<all>", 7))


extension = Extension(
    routers=(router, pages),
    templates="eigenfail_sheep",
    navigation=(NavigationEntry("Sheep", "/sheep"),),
    campaign_files=(
        CampaignFile("Wool", "WOOL", "/api/v1/wool?campaign={campaign}&dyed=1", is_button=True),
        CampaignFile("Fleece & all", "ZIP", "/api/v1/wool?campaign={campaign}"),
    ),
    scopes={
        Scope.VIEWER: ("POST /api/v1/sheep",),
        Scope.RUNNER: ("POST /api/v1/sheep/shear",),
        Scope.ADMIN: ("GET /api/v1/sheep/price",),
    },
    recorded={Fleece: ("colour",)},
)
'''
TEMPLATE = """{% extends "base.html" %}
{% set entry = "main.js" %}
{% block title %}Sheep{% endblock %}
{% block main %}
<h1>{{ view.name }}: {{ view.sheep }}</h1>
{% endblock %}
"""


class Flock(msgspec.Struct, frozen=True):
    name: str
    sheep: int


@pytest.fixture
def bring(tmp_path, monkeypatch):
    """Installs a distribution that brings an extension, as text of its module."""

    def install(text=MODULE, distribution="eigenfail-sheep", template=("flock.html", TEMPLATE)):
        name = distribution.replace("-", "_")
        package = tmp_path / distribution / name
        (package / "templates").mkdir(parents=True)
        (package / "__init__.py").write_text("")
        (package / "routes.py").write_text(text)
        (package / "templates" / template[0]).write_text(template[1])
        points = f"[eigenfail.routes]\n{name.removeprefix('eigenfail_')} = {name}.routes:extension"
        write_record(package.parent, distribution, f"{points}\n")
        monkeypatch.syspath_prepend(package.parent)
        return package

    return install


@pytest.fixture(autouse=True)
def forget():
    """Has entry points and templates read anew, before and after."""

    def clear():
        forget_entry_points()
        rendering.TEMPLATES.cache.clear()
        for name in ("eigenfail_sheep", "eigenfail_goats", "eigenfail_tally"):
            rendering.FOREIGN_TEMPLATES.pop(name, None)
            for module in [each for each in sys.modules if each.startswith(name)]:
                del sys.modules[module]

    clear()
    yield
    clear()


@pytest.fixture
def serve(store):
    """Makes a browser for the service with what is installed."""
    opened = []

    def start():
        app = create_app(store, ApiSettings())
        opened.append(TestClient(app, base_url=ADDRESS, raise_server_exceptions=False))
        return opened[-1]

    yield start
    for client in opened:
        client.close()


def test_a_route_answers_and_refuses_like_those_of_the_core(bring, serve, read, problem):
    bring()
    http = serve()
    assert read(http.post("/api/v1/sheep", json={"name": "hill"}), Flock) == Flock("hill", 7)
    assert problem(http.post("/api/v1/sheep", json={"name": ""}), 422)["field"] == "name"
    assert "nam" in problem(http.post("/api/v1/sheep", json={"nam": ""}), 422)["detail"]
    assert problem(http.post("/api/v1/sheep?colour=black", json={"name": "hill"}), 422)
    assert problem(http.post("/api/v1/sheep", content="<a>", headers={"content-type": "a/b"}), 415)


def test_the_example_of_the_documents_counts_failures(bring, serve, fields):
    text = (Path(__file__).parents[2] / "docs" / "plugins.md").read_text()
    (code,) = re.findall(
        r"^```python\n(# eigenfail-tally/.*?)^```$", text, re.MULTILINE | re.DOTALL
    )
    (html,) = re.findall(r"^```html\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    bring(code, "eigenfail-tally", ("tally.html", html))
    http = serve()
    campaign = http.post("/api/v1/campaigns", json=fields).json()["id"]
    assert http.get(f"/api/v1/tally/{campaign}").json() == {"campaign": campaign, "failures": 0}
    shown = http.get(f"/tally/{campaign}").text
    assert f"<h1>Campaign {campaign}: 0 failures</h1>" in shown
    assert '<a href="/tally/1" aria-current="page">Tally</a>' in shown
    assert http.get("/tally/77").status_code == 404


def test_the_document_describes_it(bring, serve):
    bring()
    document = serve().get("/openapi.json").json()
    operation = document["paths"]["/api/v1/sheep"]["post"]
    assert operation["requestBody"]["content"]["application/json"]["example"] == {"name": "hill"}
    fields = document["components"]["schemas"]["Flock"]["properties"]
    assert fields["sheep"]["description"] == "how many there are."


def test_a_page_has_the_frame_of_the_dashboard_and_a_link_to_it(bring, serve):
    bring()
    http = serve()
    shown = http.get("/sheep").text
    assert "<h1>&lt;all&gt;: 7</h1>" in shown
    assert '<a href="/sheep" aria-current="page">Sheep</a>' in shown
    core = http.get("/workers").text
    assert '<a href="/sheep">Sheep</a>' in core
    missing = http.get("/campaigns/9", headers={"Accept": "text/html"})
    assert (missing.status_code, '<a href="/sheep">' in missing.text) == (404, True)


def test_the_page_of_a_campaign_offers_its_files(bring, serve, campaign):
    bring()
    shown = serve().get(f"/campaigns/{campaign}").text
    address = f"/api/v1/wool?campaign={campaign}"
    assert f'<a class="button" href="{address}&amp;dyed=1" download>Wool</a>' in shown
    listed = f'<a href="{address}" download>Fleece &amp; all</a> <span class="note">ZIP</span>'
    assert listed in shown
    assert shown.count("Wool") == 1


def test_another_application_of_the_process_does_not_have_it(bring, serve, store):
    bring()
    http = serve()
    assert http.get("/sheep").is_success
    with TestClient(create_app(store, ApiSettings(), extensions=()), base_url=ADDRESS) as alone:
        assert "Sheep" not in alone.get("/workers").text
        assert alone.get("/sheep").status_code == 404
        assert "/api/v1/sheep" not in alone.get("/openapi.json").json()["paths"]
    assert "Sheep" in http.get("/workers").text


def test_requests_require_the_scopes_that_the_extension_says(bring, serve, store):
    bring()
    http = serve()
    shown = {
        scope: {"Authorization": f"Bearer {make_key(store, KeyRequest(scope, scope)).token}"}
        for scope in (Scope.ADMIN, Scope.RUNNER, Scope.VIEWER)
    }
    requests = {
        Scope.VIEWER: ("POST", "/api/v1/sheep", {"name": "hill"}),
        Scope.RUNNER: ("POST", "/api/v1/sheep/shear", {"colour": "white", "secret": "hidden"}),
        Scope.ADMIN: ("GET", "/api/v1/sheep/price", None),
    }
    for least, (method, address, body) in requests.items():
        assert http.request(method, address, json=body).status_code == 401
        for scope, headers in shown.items():
            status = http.request(method, address, json=body, headers=headers).status_code
            assert status == (200 if scope.allows(least) else 403)
    changes = [each for each in store.audit.page(10).items if "shear" in each.route]
    details = [each.details for each in changes if each.status == 200]
    assert details == ['colour = "white"'] * 2


@pytest.mark.parametrize(
    "case",
    [
        (MODULE, 'raise RuntimeError("not today")', "not today"),
        (
            "extension = Extension(",
            "extension = dict(",
            "is of the type dict, and must be an Extension",
        ),
        ('"/sheep")\ndef show', '"/workers")\ndef show', "has GET /workers, which exists"),
        ('("POST /api/v1/sheep",)', '("POST /api/v1/keys",)', "the scope of POST /api/v1/keys"),
        ('templates="eigenfail_sheep"', 'templates="eigenfail_goats"', "goats"),
        ('Scope.VIEWER: ("POST', 'None: ("POST', "has a scope None, and must use"),
        ('Scope.VIEWER: ("POST', '"viwer": ("POST', "has a scope 'viwer', and must use"),
        ('("colour",)', '("color",)', "records color, which is no field of Fleece"),
    ],
)
def test_an_extension_that_cannot_be_used_is_logged_by_its_name(bring, serve, caplog, case):
    old, new, said = case
    bring(MODULE.replace(old, new))
    http = serve()
    logged = [each.getMessage() for each in caplog.records if "extension" in each.getMessage()]
    assert logged == ["The extension 'sheep' is left out. All else works."]
    assert said in caplog.text
    assert http.get("/workers").is_success
    assert "/sheep" not in http.get("/workers").text
    assert http.post("/api/v1/sheep", json={"name": "hill"}).status_code == 404


def test_the_second_extension_with_an_address_is_left_out(bring, serve, caplog):
    bring()
    bring(MODULE, "eigenfail-goats")
    http = serve()
    assert http.get("/sheep").is_success
    assert "The extension 'sheep' is left out." in caplog.text
    assert "The extension 'goats' is left out." not in caplog.text
