"""Campaigns and episodes as a service tells of them, made by hand."""

import pytest
from example_values import make_row

from eigenfail.suites import Suite, SuiteMember
from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import Outcome


@pytest.fixture
def spec():
    return CampaignSpec(name="trio: a", method="monte_carlo", episodes=10, planner="idm")


@pytest.fixture
def suite(spec):
    return Suite("trio", (SuiteMember("a", spec),))


@pytest.fixture
def campaign(spec):
    """Makes a campaign that is done."""

    def make(number=1, completed=10, failures=0, errored=0, spec=spec, **fields):
        counts = Counts(spec.episodes, completed, failures, errored)
        given = {"state": CampaignState.DONE, "created_ms": 0, **fields}
        return Campaign(id=number, spec=spec, counts=counts, **given)

    return make


@pytest.fixture
def row():
    """Makes an episode in a list."""

    def make(index, outcome=Outcome.COLLISION, campaign=2, log_probability=-1.0, problem=""):
        fields = {"campaign": campaign, "log_probability": log_probability, "problem": problem}
        return make_row(index, outcome, **fields)

    return make
