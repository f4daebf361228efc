"""Safety measures over HTTP."""

import pytest

from eigenfail.values.comparison import Region
from eigenfail.values.episode import Outcome
from eigenfail.values.safety import Safety

URL = "/api/v1/campaigns"


@pytest.fixture
def driven(campaign, deliver, result, failed):
    """A campaign of nine completed episodes, two of them collisions."""
    deliver(campaign, *(result(i) for i in range(7)), failed(9))
    deliver(campaign, *(result(i, Outcome.COLLISION) for i in (7, 8)))
    return campaign


def test_the_safety_of_a_campaign(http, driven, read):
    found = read(http.get(f"{URL}/{driven}/safety"), Safety)
    assert (found.completed, found.collisions.k, found.collisions.n) == (9, 2, 9)
    assert found.severity.mean.value == 25.0
    assert [point.index for point in found.scatter.points] == [7, 8]
    assert read(http.get(f"{URL}/{driven}/safety?level=0.5"), Safety).severity.level == 0.5


@pytest.mark.parametrize("level", ["0", "1", "x", "-1", "nan"])
def test_levels_are_shares(http, driven, problem, level):
    assert problem(http.get(f"{URL}/{driven}/safety?level={level}"), 422)["field"] == "level"


def test_of_a_campaign_that_is_not_there(http, problem):
    problem(http.get(f"{URL}/99/safety"), 404)


def test_the_failing_region_of_campaigns(http, fields, deliver, result, read):
    ids = []
    for metres, outcome in ((52.0, Outcome.COLLISION), (70.0, Outcome.SAFE)):
        varied = {**fields, "episodes": 40, "scenario_parameters": {"distance_m": metres}}
        ids.append(http.post(URL, json=varied).json()["id"])
        deliver(ids[-1], *(result(i, outcome) for i in range(40)))
    asked = ",".join(map(str, ids))
    found = read(http.get(f"{URL}/region?campaigns={asked}"), Region)
    assert found.campaigns == tuple(ids)
    assert [box.words for box in found.boxes] == ["distance at most 52 m"]
    assert (found.episodes, found.failures, found.precision.value) == (80, 40, 1.0)


def test_a_region_that_cannot_be_told_says_why(http, driven, read):
    found = read(http.get(f"{URL}/region?campaigns={driven}"), Region)
    assert "No scenario parameter took more than one value" in found.problem


@pytest.mark.parametrize("query", ["", "?campaigns=", "?campaigns=x", "?campaigns=1,1"])
def test_regions_are_of_different_campaigns(http, driven, problem, query):
    assert problem(http.get(f"{URL}/region{query}"), 422)["field"] == "campaigns"


def test_the_region_of_a_campaign_that_is_not_there(http, problem):
    problem(http.get(f"{URL}/region?campaigns=99"), 404)
