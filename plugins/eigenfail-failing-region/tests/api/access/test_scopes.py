"""The least scope of each route of the extension."""

import re

import pytest

from eigenfail_api.extensions import list_requests
from eigenfail_failing_region.routes import extension

VIEWER = (
    "GET /api/v1/region",
    "GET /campaigns/{campaign}/region",
    "GET /campaigns/{campaign}/region/boxes",
)
"""What a viewer may do: nothing is stored."""


def test_every_route_is_listed_here():
    assert sorted(list_requests(extension.routers)) == sorted(VIEWER)


@pytest.mark.parametrize("request_line", VIEWER)
def test_a_route_lets_a_caller_in_from_its_least_scope_on(http, as_holder, request_line):
    method, path = request_line.format(campaign=1).split(" ")
    assert http.request(method, path).status_code == 401
    for scope in ("viewer", "runner", "admin"):
        assert as_holder(scope, method, path).status_code not in {401, 403}


def test_the_readme_names_the_least_scope(plugin):
    text = (plugin / "README.md").read_text()
    row = re.compile(r"^\| `(/api/\S+)` \| ([A-Z]+) \| (\w+) \|", re.MULTILINE)
    assert row.findall(text) == [("/api/v1/region", "GET", "viewer")]
