"""Episodes that take workers with them: counted beyond the hub, and given up after three."""

import pytest
from store_checks.examples import running

from eigenfail.errors import StoreUnavailable
from eigenfail.values.episode import EpisodeTask, Outcome, PriorSource
from eigenfail.wire.messages import PROTOCOL, Hello
from eigenfail_services.hub.commits import MAX_DEATHS, CommitQueue, WorkerDeaths
from eigenfail_services.hub.leases import Leases
from eigenfail_services.store.store import Store

TASKS = tuple(EpisodeTask(index, 100 + index, PriorSource()) for index in range(2))


class Hub:
    """Leases, commits and deaths of one hub on a store that outlives it."""

    def __init__(self, store: Store, campaign: int) -> None:
        self.campaign = campaign
        self.leases = Leases()
        self.commits = CommitQueue(store.episodes)
        self.deaths = WorkerDeaths(self.leases, self.commits, store.episodes)
        self.leases.offer(campaign, TASKS)

    def lose_a_worker(self) -> None:
        """One that says that it runs the first episode."""
        self.leases.open_session(b"w", Hello(PROTOCOL, "w", 2), 0.0)
        self.leases.assign()
        self.leases.record_heartbeat(b"w", (self.campaign, 0), set(self.leases.sessions[b"w"].held))
        self.leases.end_lost_session(b"w")

    def leased(self) -> list[int]:
        self.leases.open_session(b"w", Hello(PROTOCOL, "w", 2), 0.0)
        return [task.index for a in self.leases.assign() for task in a.tasks]


@pytest.fixture
def campaign(store: Store) -> int:
    return running(store).id


@pytest.mark.fault(
    "episode that kills its worker",
    group="processes",
    outcome="The hub errors the episode after the third lost worker, counted in the database "
    "through restarts. It costs four workers at most.",
)
def test_an_episode_that_takes_three_workers_with_it_is_given_up_by_the_next_hub(
    store: Store, campaign: int
) -> None:
    for _ in range(MAX_DEATHS - 1):
        hub = Hub(store, campaign)
        hub.lose_a_worker()
        hub.deaths.record()
        assert hub.leased() == [0, 1]
    hub = Hub(store, campaign)
    hub.lose_a_worker()
    hub.deaths.record()
    assert hub.leased() == [1]
    hub.commits.flush(now=True)
    given_up = store.episodes.get(campaign, 0)
    assert given_up.outcome is Outcome.ERRORED
    assert given_up.fault is not None
    assert (given_up.fault.kind, given_up.seed) == ("infrastructure", 100)
    assert "3 workers were lost" in given_up.fault.message


@pytest.mark.fault("episode that kills its worker")
def test_while_a_death_cannot_be_written_down_nobody_gets_the_episode(
    store: Store, campaign: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def away(*_: int) -> int:
        raise StoreUnavailable("The disk is full.")

    hub = Hub(store, campaign)
    hub.lose_a_worker()
    with monkeypatch.context() as patch:
        patch.setattr(store.episodes, "add_death", away)
        with pytest.raises(StoreUnavailable):
            hub.deaths.record()
    assert hub.leased() == [1]
    hub.deaths.record()
    assert store.episodes.add_death(campaign, 0) == 2
    assert sorted(hub.leased()) == [0, 1]


def test_a_suspect_of_a_campaign_that_is_no_more_is_nobodys_trouble(store: Store) -> None:
    hub = Hub(store, campaign=999)
    hub.lose_a_worker()
    hub.deaths.record()
    assert hub.leases.list_interrupted() == []
