"""Campaigns that a question names."""

import pytest
from msgspec.structs import replace

from eigenfail.errors import InvalidValue, NotFound
from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_assurance.risk.pooling import pick_named

SPEC = CampaignSpec(
    name="cut-in", scenario="cut_in", planner="idm", method="monte_carlo", episodes=20
)
FIRST = Campaign(id=1, spec=SPEC, state=CampaignState.DONE, counts=Counts(20), created_ms=0)


def test_name_of_one_campaign_stands_for_it():
    assert pick_named("cut-in", [FIRST]) == FIRST


def test_later_campaign_of_a_name_does_not_take_the_place_of_the_first():
    with pytest.raises(InvalidValue, match=r"campaigns 37 \(done\), 1 \(done\)"):
        pick_named("cut-in", [replace(FIRST, id=37), FIRST])


def test_name_without_a_campaign_is_refused():
    with pytest.raises(NotFound, match="no campaign 'cut-out'"):
        pick_named("cut-out", [])
