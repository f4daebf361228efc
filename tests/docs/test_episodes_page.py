"""docs/episodes.md: its filters are read, its addresses are routes; test_pages.py runs its code."""

import re

import pytest

from eigenfail.errors import UnknownName
from eigenfail.filters import parse_filter
from eigenfail_api.routes import episodes, recordings
from eigenfail_services.store.listing import INDEXED


@pytest.fixture(scope="module")
def page(root):
    return (root / "docs/episodes.md").read_text()


def blocks(page, language):
    return re.findall(rf"^```{language}\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)


def test_its_filters_are_read_and_its_refusal_is_the_one_that_comes(page):
    filters, refusal = blocks(page, "text")
    assert all(parse_filter(line) for line in filters.splitlines())
    with pytest.raises(UnknownName) as refused:
        parse_filter("sevrity > 80")
    assert str(refused.value).startswith(refusal.strip())


def test_what_it_says_of_indices_is_so(page):
    sentence = page.split("The database keeps")[1].split("sorted")[0]
    assert set(re.findall(r"`(\w+)`", sentence)) == INDEXED | {"index"}


def test_its_addresses_are_routes(page):
    told = re.findall(r"^\| `(\w+) (/api/v1/[^`]+)` \|", page, re.MULTILINE)
    there = (*episodes.router.routes, *recordings.router.routes)
    routes = {(method, route.path) for route in there for method in route.methods}
    # Other pages describe a single episode, its explanation and its replay.
    elsewhere = ("/{index}", "/explanation", "/replay", "/steps")
    assert set(told) == {each for each in routes if not each[1].endswith(elsewhere)}
