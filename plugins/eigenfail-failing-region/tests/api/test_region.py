"""The failing region of campaigns over HTTP."""

import pytest

from eigenfail.values.episode import Outcome
from eigenfail_failing_region.values import Region

CAMPAIGNS, URL = "/api/v1/campaigns", "/api/v1/region"


def test_the_failing_region_of_campaigns(http, fields, deliver, result, read):
    ids = []
    for metres, outcome in ((52.0, Outcome.COLLISION), (70.0, Outcome.SAFE)):
        varied = {**fields, "episodes": 40, "scenario_parameters": {"distance_m": metres}}
        ids.append(http.post(CAMPAIGNS, json=varied).json()["id"])
        deliver(ids[-1], *(result(i, outcome) for i in range(40)))
    asked = ",".join(map(str, ids))
    found = read(http.get(f"{URL}?campaigns={asked}"), Region)
    assert found.campaigns == tuple(ids)
    assert [box.words for box in found.boxes] == ["distance at most 52 m"]
    assert (found.episodes, found.failures, found.precision.value) == (80, 40, 1.0)


def test_a_region_that_cannot_be_told_says_why(http, campaign, read):
    found = read(http.get(f"{URL}?campaigns={campaign}"), Region)
    assert "No scenario parameter took more than one value" in found.problem


@pytest.mark.parametrize("query", ["", "?campaigns=", "?campaigns=x", "?campaigns=1,1"])
def test_regions_are_of_different_campaigns(http, problem, query):
    assert problem(http.get(f"{URL}{query}"), 422)["field"] == "campaigns"


def test_the_region_of_a_campaign_that_is_not_there(http, problem):
    problem(http.get(f"{URL}?campaigns=99"), 404)
