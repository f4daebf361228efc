"""The cost of campaigns over HTTP."""

import pytest

from eigenfail.values.episode import Outcome
from eigenfail.values.summary import CampaignCost

URL = "/api/v1/campaigns"


@pytest.fixture
def crashed(campaign, deliver, result):
    """A campaign of five episodes, one of them a collision."""
    deliver(campaign, *(result(i, Outcome.COLLISION if i == 3 else Outcome.SAFE) for i in range(5)))
    return campaign


def test_what_a_campaign_cost(http, crashed, read, store):
    store.campaigns.add_active(crashed, 3600.0)
    found = read(http.get(f"{URL}/{crashed}/cost"), CampaignCost)
    assert (found.completed, found.failures) == (5, 1)
    assert found.cost.per_failure_usd == pytest.approx(1.2)
    assert (found.curve[0].usd, found.curve[-1].usd) == (0.0, pytest.approx(1.2))
    assert found.curve[-1].failures == 1
    assert found.time.simulation_s == 3600.0
    assert "eigenfail analyze" in found.modes_in_words


def test_modes_are_told_with_why(http, crashed, finished, read):
    analysis = finished(modes=1)
    found = read(http.get(f"{URL}/{crashed}/cost"), CampaignCost)
    assert found.analysis == analysis
    assert found.modes is None  # nobody held these modes against noise
    assert found.modes_in_words.startswith("No distinct modes")


def test_of_a_campaign_that_is_not_there(http, problem):
    problem(http.get(f"{URL}/99/cost"), 404)
