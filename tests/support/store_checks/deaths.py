"""Checks of how `EpisodeStore` counts the workers that an episode took with it."""

from concurrent.futures import ThreadPoolExecutor

from eigenfail.testing.examples import make_errored_result
from eigenfail_services.store.store import Store
from store_checks.examples import deliver, equal, running

CROWD = 8


def counts_deaths(store: Store) -> None:
    """Each adds one, of that episode of that campaign alone; the counts stay as they were."""
    one, other = running(store), running(store)
    before = store.campaigns.get(one.id)
    equal([store.episodes.add_death(one.id, 3) for _ in range(3)], [1, 2, 3], "Deaths")
    equal(store.episodes.add_death(one.id, 4), 1, "Deaths of another episode")
    equal(store.episodes.add_death(other.id, 3), 1, "Deaths in another campaign")
    equal(store.campaigns.get(one.id), before, "The campaign")
    deliver(store, one, make_errored_result(3))
    equal(store.episodes.add_death(one.id, 3), 4, "Deaths after its end")


def misses_no_death(store: Store) -> None:
    """Two who count at once count two."""
    campaign = running(store).id
    with ThreadPoolExecutor(CROWD) as crowd:
        counted = crowd.map(lambda _: store.episodes.add_death(campaign, 0), range(CROWD))
        equal(sorted(counted), list(range(1, CROWD + 1)), "Deaths, counted at once")
