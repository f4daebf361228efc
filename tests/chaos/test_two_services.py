"""Two services on one database, each with a hub and workers of its own.

They share the campaigns out; where one stands still or dies, the other takes over.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import deadlines
import pytest
import reader
from sqlalchemy import text
from stage import Stage
from started import Services, Worker, free_port, wait_until

pytestmark = [pytest.mark.service, pytest.mark.timeout(deadlines.TEST_S)]

CLAIMS = text("SELECT subject, owner FROM jobs WHERE kind = 'campaign' AND owner IS NOT NULL")
WORKERS = text("SELECT DISTINCT campaign, worker FROM episodes")
METHODS = "monte_carlo", "ast"
ROOM = 2
"""Number of campaigns that each services process runs at a time, which is half of them."""


class Site(NamedTuple):
    """A services process, and the workers of its hub."""

    services: Services
    workers: tuple[Worker, ...]

    def list_claimed(self, url: str) -> set[int]:
        """Return the campaigns in the queue that this services process has claimed last."""
        mark = f":{self.services.process.pid}:"
        with reader.snapshot(url) as connection:
            return {campaign for campaign, owner in connection.execute(CLAIMS) if mark in owner}

    def list_served(self, url: str) -> set[int]:
        """Return the campaigns of which these workers brought results that are kept."""
        names = {worker.name for worker in self.workers}
        with reader.snapshot(url) as connection:
            return {campaign for campaign, name in connection.execute(WORKERS) if name in names}


@pytest.fixture
def shared(postgres_url: str, tmp_path: Path) -> Iterator[Stage]:
    """A PostgreSQL database, and whatever is started on it."""
    stage = Stage(postgres_url, tmp_path)
    yield stage
    stage.end()


class SplitFleet:
    """Two sites on one database, with two campaigns of each of two methods.

    The workers start once each site has claimed half of the campaigns, and all learners have
    proposed episodes: so all campaigns are under way at the same time.

    Attributes:
        sites: the two sites.
        claimed: the campaigns of each of them.
    """

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        hubs = [f"tcp://127.0.0.1:{free_port()}" for _ in range(2)]
        services = [stage.services(hub, "--campaigns", str(ROOM)) for hub in hubs]
        self._campaigns = [stage.launch(*METHODS), stage.launch(*METHODS)]
        unmanned = [Site(each, ()) for each in services]
        wait_until(
            lambda: all(len(site.list_claimed(stage.url)) == ROOM for site in unmanned),
            "each has claimed half of the campaigns",
        )
        self.claimed = [site.list_claimed(stage.url) for site in unmanned]
        for campaign in set.union(*self.claimed):
            stage.wait_for_checkpoint(campaign, 0)
        self.sites = [
            Site(each, (stage.worker(hub), stage.worker(hub)))
            for each, hub in zip(services, hubs, strict=True)
        ]

    def check_unchanged(self, undisturbed: dict[str, str]) -> None:
        """Wait for the end of all campaigns, with the digests that one services process gives."""
        for campaigns in self._campaigns:
            self._stage.unchanged(campaigns, undisturbed)


@pytest.mark.fault("two services on one database")
@pytest.mark.fault("SIGKILL of the services")
def test_two_services_share_campaigns_until_one_is_killed_and_the_other_takes_over(
    shared: Stage, undisturbed: dict[str, str]
) -> None:
    fleet = SplitFleet(shared)
    (killed, left), (orphaned, _) = fleet.sites, fleet.claimed
    for site, claimed in zip(fleet.sites, fleet.claimed, strict=True):
        wait_until(lambda s=site, c=claimed: s.list_served(shared.url) >= c, "each has results")
    # Each serves its own campaigns, and no episode was run for both.
    assert [site.list_served(shared.url) for site in fleet.sites] == fleet.claimed
    assert shared.read().repeated == 0
    killed.services.kill()
    assert not any(map(shared.is_over, orphaned))
    fleet.check_unchanged(undisturbed)
    assert left.list_served(shared.url) == set.union(*fleet.claimed)
    assert left.services.end() == 0
    assert all(worker.alive for worker in killed.workers)  # they wait for services at this address


@pytest.mark.fault(
    "SIGSTOP of the services",
    group="time",
    outcome="After 10 s another service on the same database takes over their campaigns. "
    "PostgreSQL ends a transaction in which they stand still after 10 s, and from "
    "version 17 on a statement that hands over rows after 30 s; SQLite takes no "
    "writes until they continue or are killed. The time that they lost counts against"
    " no worker.",
)
@pytest.mark.fault("two services on one database")
def test_a_service_that_stood_still_is_taken_over_from(
    stage: Stage, undisturbed: dict[str, str]
) -> None:
    first, other_hub = stage.services(), f"tcp://127.0.0.1:{free_port()}"
    first_worker, second_worker = stage.worker(), stage.worker(other_hub)
    campaigns = stage.launch("monte_carlo", "ast")
    stage.wait_for_more_from(first_worker, 20)
    second = stage.services(other_hub)
    stage.halt(first)
    assert not stage.are_over(campaigns)
    stage.wait_for_more_from(second_worker, 20)  # the leases of the first one have run out
    first.go_on()
    wait_until(lambda: "lost to another" in first.said(), "the first one notices")
    stage.unchanged(campaigns, undisturbed)
    assert [services.end() for services in (first, second)] == [0, 0]
