"""Whether a campaign waited longer than it was billed: its curve is then cut to the time billed."""

import pytest

from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_services.analysis.campaign_figures import SLACK_S, has_unbilled_time

STARTED_MS = 1_790_000_000_000


@pytest.mark.parametrize(
    ("active_s", "last_s", "cut"),
    [
        (5.0, 5.0, False),
        (5.0, 5.0 + SLACK_S, False),
        (5.0, 5.1 + SLACK_S, True),
        (5.0, 500.0, True),
    ],
)
def test_time_beyond_that_billed_is_counted_from_the_start(
    active_s: float, last_s: float, cut: bool
) -> None:
    campaign = Campaign(
        id=1,
        spec=CampaignSpec(name="n", method="monte_carlo", episodes=10),
        state=CampaignState.DONE,
        counts=Counts(10, 10),
        created_ms=STARTED_MS - 1,
        started_ms=STARTED_MS,
        active_s=active_s,
    )
    assert has_unbilled_time(campaign, [STARTED_MS + 1, STARTED_MS + round(1_000 * last_s)]) is cut
    assert not has_unbilled_time(campaign, [])
