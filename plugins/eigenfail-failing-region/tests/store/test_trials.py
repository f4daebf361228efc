"""Seeds and outcomes of episodes, from stores of every kind."""

import pytest
from msgspec.structs import replace
from store_checks.examples import BEYOND, deliver, running
from store_checks.safety import driven

from eigenfail.testing.examples import collision, result
from eigenfail.values.episode import MAX_SEED
from eigenfail_failing_region.trials import read_trials


@pytest.fixture
def read(store):
    """Reads pairs of seed and outcome of a campaign."""

    def pair(campaign, most=100):
        found = read_trials(store.database, campaign, most)
        return list(zip(found.seeds.tolist(), found.failed.tolist(), strict=True))

    return pair


def test_completed_episodes_come_in_index_order_all_or_every_kth(store, read):
    campaign, other = running(store, episodes=20), running(store)
    assert read(campaign.id) == []
    large = replace(collision(11), seed=MAX_SEED)
    deliver(store, campaign, large, *reversed(driven()))
    deliver(store, other, result(0))
    wanted = [(100 + n, n % 2 == 1) for n in range(10)] + [(MAX_SEED, True)]
    assert read(campaign.id) == wanted
    for most, every in ((10, 2), (11, 1), (3, 4), (1, 11)):
        assert read(campaign.id, most) == wanted[::every]
    for who in BEYOND:
        assert read(who) == []
