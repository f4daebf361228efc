"""The made-up workers of the benchmarks speak with a real hub as real ones do."""

import pytest
from benchmarks.speed.hub import playing, present, run_simulated_workers, wait_until

EPISODES, WORKERS = 120, 5


@pytest.mark.service
def test_a_crowd_sees_a_campaign_through():
    with playing() as stage:
        services = stage.services()
        campaign = stage.create(method="monte_carlo", episodes=EPISODES)
        with run_simulated_workers(services.hub, WORKERS):
            found = stage.finish(campaign)
            wait_until(lambda: present(stage) == WORKERS, "all of them are written down")
        assert (found.repeated, len(found.digests)) == (0, 1)
        assert stage.campaign(campaign).counts.duplicates == 0
