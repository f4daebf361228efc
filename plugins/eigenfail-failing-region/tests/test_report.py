"""The section of a report on the regions of its campaigns."""

import pytest
from accepted import accept_spec
from campaigns_here import run_here

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_failing_region.campaigns import find_region
from eigenfail_failing_region.report import describe_regions
from eigenfail_services.store.store import open_store

NEAR_OR_FAR = {"distance_m": {"choice": [52.0, 70.0]}}


@pytest.fixture
def store():
    return open_store("memory://")


@pytest.fixture
def run(store):
    """Runs a campaign; the campaign."""

    def start(episodes, parameters):
        spec = CampaignSpec(
            name="Driven",
            method="monte_carlo",
            planner="idm",
            simulator="point_mass",
            episodes=episodes,
            scenario_parameters=parameters,
            seed=1,
        )
        return store.campaigns.get(run_here(store, store.campaigns.create(accept_spec(spec)).id))

    return start


def test_the_region_is_the_one_that_was_found(store, run):
    campaign = run(120, NEAR_OR_FAR)
    *sentences, parts, bounds = describe_regions(store, [campaign])
    (box,) = find_region(store, (campaign.id,)).boxes
    inside = (box.coverage, box.coverage.n, box.precision, box.precision.k, box.precision.n)
    assert parts.rows == (("1", 1, "distance at most 52 m", *inside),)
    assert bounds.rows == (("1", 1, "distance_m", None, 52.0, "m"),)
    words = " ".join(sentences)
    assert "distance_m vary" in words
    assert "chance alone would put this many failures there with p = " in words


def test_without_a_region_it_says_why(store, run):
    campaign = run(24, NEAR_OR_FAR)
    found = find_region(store, (campaign.id,))
    assert not found.boxes
    assert found.problem
    *sentences, parts, bounds = describe_regions(store, [campaign])
    assert found.problem in " ".join(sentences)
    assert parts.rows == bounds.rows == ()


def test_nothing_is_said_where_nothing_varies(store, run):
    assert describe_regions(store, [run(3, {})]) == ()
