"""The page of a failing region, in a real browser."""

import numpy as np
import pytest
from accepted import accept_spec
from msgspec.structs import replace
from playwright.sync_api import expect

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.measures import Measures
from eigenfail.values.records import Delivery
from eigenfail.worlds import drawn_for

pytestmark = pytest.mark.browser

NEAR_M = 60.0


@pytest.fixture(scope="module")
def varied(store):
    """A campaign that fails where the distance is small; its id."""
    drawn = {"distance_m": {"uniform": [53.0, 70.0]}}
    spec = CampaignSpec(
        name="Varied", method="monte_carlo", episodes=400, scenario_parameters=drawn
    )
    campaign = store.campaigns.create(accept_spec(spec)).id
    store.campaigns.move(campaign, "running")
    z = np.zeros((1, 2), np.float32)
    safe = EpisodeResult(
        0, 0, Outcome.SAFE, 1, NoiseTrajectory(z, z + 1), "prior", measures=Measures(4.0)
    )
    crash = replace(safe, outcome=Outcome.COLLISION, measures=Measures(0.0, severity=9.0))
    results = [
        replace(crash if drawn_for(spec, seed)["distance_m"] < NEAR_M else safe, index=n, seed=seed)
        for n, seed in enumerate(range(1000, 1400))
    ]
    store.episodes.commit(campaign, [Delivery(result, "w") for result in results])
    return campaign


@pytest.mark.parametrize("width", [1280, 375])
def test_the_failing_region_is_told_in_boxes(visit, varied, width):
    page = visit(f"/campaigns/{varied}/region", viewport={"width": width, "height": 700})
    expect(page.get_by_role("heading", name="Failing region", level=2)).to_be_visible()
    expect(page.get_by_role("rowheader")).to_contain_text("distance at most")
    expect(page.get_by_text("Found on half of the episodes")).to_be_visible()
    expect(page.get_by_text("Computing the failing region")).to_have_count(0)
    over = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    assert page.evaluate(over) <= 0


def test_a_campaign_leads_to_its_region(visit, varied):
    page = visit(f"/campaigns/{varied}")
    page.locator("#files > summary").click()
    page.get_by_role("link", name="Failing region").click()
    expect(page.locator("h1")).to_have_text("Failing region")


def test_a_region_that_cannot_be_told_says_why(visit, made):
    page = visit(f"/campaigns/{made.ast}/region")
    expect(page.get_by_text("No scenario parameter took more than one value")).to_be_visible()
