"""The failures of all campaigns over HTTP."""

import pytest
from accepted import accept_spec
from store_checks.failures import fill

from eigenfail_services.store.failures import MOST_FAILURES

URL = "/api/v1/failures"


@pytest.fixture
def places(store):
    """Severity, campaign and index of all failures, the most severe first."""
    return sorted(fill(store), reverse=True)


def read(http, **params):
    found = http.get(URL, params=params).json()["items"]
    return [(row["severity"], row["campaign"], row["index"]) for row in found]


def test_failures_are_listed_page_by_page(http, places):
    first = http.get(URL, params={"limit": 10}).json()
    rest = read(http, limit=MOST_FAILURES, after=first["next"])
    assert len(first["items"]) == 10
    assert [row["severity"] for row in first["items"]] == [each[0] for each in places[:10]]
    assert rest == places[10:]
    assert read(http, sort="severity") == places[::-1]


def test_failures_are_filtered(http, places):
    assert read(http, planner="idm") == [each for each in places if each[1] in {2, 4}]
    assert read(http, planner_version="v0") == [each for each in places if each[1] == 1]
    assert read(http, project="y") == []


@pytest.mark.parametrize(
    ("params", "field"),
    [
        ({"sort": "steps"}, "sort"),
        ({"limit": MOST_FAILURES + 1}, "limit"),
        ({"after": 1}, "after"),
        ({"filter": "severity > 1"}, "query"),
    ],
    ids=str,
)
def test_what_cannot_be_is_refused(http, problem, places, params, field):
    assert places
    assert problem(http.get(URL, params=params), 422)["field"] == field


def test_failures_of_repeating_methods_are_left_out(http, store, places):
    from msgspec.structs import replace
    from store_checks.examples import deliver

    from eigenfail.testing.examples import collision, spec

    given = {"campaign": 1, "episodes": [0]}
    made = store.campaigns.create(
        accept_spec(replace(spec(episodes=1), method="replay", settings=given))
    )
    deliver(store, store.campaigns.move(made.id, "running"), collision(0))
    assert made.id not in {campaign for _, campaign, _ in read(http)}
    assert {campaign for _, campaign, _ in read(http, method="replay")} == {made.id}
    assert places
