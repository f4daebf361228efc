"""Safety measures over HTTP."""

import pytest

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
