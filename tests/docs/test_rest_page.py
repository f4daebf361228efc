"""docs/rest.md: its table is the app's routes, and its commands work."""

import json
import re
import shlex
from itertools import pairwise

import pytest
from starlette.testclient import TestClient

from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.store.store import open_store

ADDRESS = "http://127.0.0.1:8440"
ROW = re.compile(
    r"^\| `(?P<path>/[^`]*)` \| (?P<verbs>[A-Z, ]+) \| (?P<scopes>[^|]+) \| (?P<words>.+) \|$",
    re.MULTILINE,
)
UPDATE = "Run `python tests/docs/rest_table.py`."


@pytest.fixture
def page(root):
    return (root / "docs" / "rest.md").read_text()


@pytest.fixture
def browser():
    store = open_store("memory://")
    with TestClient(create_app(store, ApiSettings(), extensions=()), base_url=ADDRESS) as client:
        yield client
    store.close()


def test_the_table_has_every_route_and_no_other(page, browser):
    paths = browser.get("/openapi.json").json()["paths"]
    rows = [match.groups() for match in ROW.finditer(page)]
    told = {path: set(verbs.split(", ")) for path, verbs, *_ in rows}
    assert told == {path: {verb.upper() for verb in item} for path, item in paths.items()}, UPDATE
    assert len(rows) == len(told)
    for path, _, _, words in rows:
        for operation in paths[path].values():
            assert operation["description"] in words, UPDATE


def commands(page):
    (*blocks,) = re.findall(r"^```sh\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    lines = "".join(blocks).replace("\\\n", "").splitlines()
    return [shlex.split(line) for line in lines]


def test_every_curl_is_answered(page, browser):
    lines = [line for line in commands(page) if "--no-buffer" not in line]
    assert len(lines) >= 4
    for line in lines:
        (url,) = [word for word in line if word.startswith(ADDRESS)]
        after = dict(pairwise(line))
        headers = dict(each.split(": ") for word, each in pairwise(line) if word == "-H")
        response = browser.request(
            after.get("-X", "GET"), url, content=after.get("-d"), headers=headers
        )
        assert response.status_code in {200, 201}, response.text


def test_there_is_a_stream_where_the_page_says(page, browser):
    (line,) = [line for line in commands(page) if "--no-buffer" in line]
    head = browser.head(line[-1])
    assert head.headers["content-type"].startswith("text/event-stream")


def test_what_is_said_to_be_absent_is(browser):
    paths = browser.get("/openapi.json").json()["paths"]
    assert {verb for item in paths.values() for verb in item} == {"get", "post", "put", "delete"}
    assert [path for path, item in paths.items() if "put" in item] == [
        "/api/v1/analyses/{analysis}/modes/{mode}/name",
    ]
    assert [path for path, item in paths.items() if "delete" in item] == ["/api/v1/keys/{key}"]


@pytest.mark.usefixtures("without_plugins")
def test_the_problem_of_troubleshooting_is_as_shown(root, browser):
    text = (root / "docs" / "troubleshooting.md").read_text()
    (shown,) = re.findall(r"^```json\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    body = {"name": "n", "method": "monte_karlo", "episodes": 1}
    assert browser.post("/api/v1/campaigns", json=body).json() == json.loads(shown)
