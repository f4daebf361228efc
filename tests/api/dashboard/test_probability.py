"""The failure probability on a campaign's page, with what it rests on or why it is not told."""

import pytest
from msgspec.structs import replace

from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.estimates import Estimate, Interval
from eigenfail.values.records import Totals
from eigenfail_api.dashboard.campaign_page import make_tiles
from eigenfail_api.dashboard.rendering import Tile, make_failure_tile
from eigenfail_services.campaigns.summary import summarise

TOLD = Estimate(
    by="subset simulation",
    episodes=9_100,
    probability=3.65e-6,
    cv=0.25,
    interval=Interval(2.2e-6, 5.9e-6),
    note="It knows nothing of the rest.",
)


@pytest.fixture
def campaign() -> Campaign:
    spec = CampaignSpec(name="rare", method="subset", episodes=10_000)
    counts = Counts(10_000, completed=2_000)
    return Campaign(id=1, spec=spec, state=CampaignState.DONE, counts=counts, created_ms=0)


def shown(campaign):
    summary = summarise(campaign, Totals(0, 0.0, 0, 0.0))
    return dict(make_tiles(campaign, summary))


def test_a_probability_has_its_interval_beside_it(campaign):
    figure = shown(replace(campaign, estimate=TOLD))["Failure probability"]
    assert figure.value == "3.65×10⁻⁶"
    assert figure.notes[:2] == ("95 %: [2.20×10⁻⁶, 5.90×10⁻⁶]", "n = 9,100")
    assert figure.notes[2] == "by subset simulation, cv 0.250"
    assert figure.notes[3:] == ("It knows nothing of the rest.",)


def test_a_method_that_tells_none_has_no_tile(campaign):
    assert "Failure probability" not in shown(campaign)


def test_no_failure_is_an_upper_bound(campaign):
    nothing = Totals(0, 0.0, 0, 0.0)
    drawn = replace(campaign, spec=replace(campaign.spec, method="monte_carlo"))
    figure = make_failure_tile(summarise(drawn, nothing))
    assert figure == Tile("0 of 2,000", ("≤ 0.150 %", "95 % upper bound"))
    chosen = make_failure_tile(summarise(campaign, nothing))
    assert chosen == Tile("0 of 2,000", ("0 % of its search",))
