"""PostgreSQL broken off in the middle of the work, alone and together with the services; and
services that stand still while they hold a lock there.
"""

import random
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from postgresql import Server, server
from sqlalchemy import text
from stage import Stage
from started import Services, wait_until

from eigenfail.values import CampaignState

pytestmark = [pytest.mark.service, pytest.mark.timeout(900)]

PAUSES = random.Random(20261122)

LOCKING = text(
    "SELECT count(*) FROM pg_locks JOIN pg_stat_activity USING (pid) "
    "WHERE application_name = 'eigenfail' AND state = 'idle in transaction' "
    "AND mode = 'RowShareLock' AND query LIKE 'SELECT campaigns.%'"
)
MOVING = text(
    "SELECT count(*) FROM pg_stat_activity WHERE application_name = 'eigenfail' "
    "AND state_change > clock_timestamp() - interval '200 ms'"
)
BUSY = text(
    "SELECT count(*) FROM pg_stat_activity WHERE application_name = 'eigenfail' "
    "AND state = 'active'"
)


@pytest.fixture
def postgres_server() -> Iterator[Server]:
    with server() as running:
        yield running


@pytest.fixture
def stage(postgres_server: Server, tmp_path: Path) -> Iterator[Stage]:
    stage = Stage(postgres_server.url, tmp_path)
    yield stage
    stage.end()


def test_a_database_that_is_broken_off_costs_no_episode(
    stage: Stage, postgres_server: Server, undisturbed: dict[str, str]
) -> None:
    services, worker = stage.services(), stage.worker()
    campaigns = stage.launch("monte_carlo", "ast")
    stage.wait_for_more_from(worker, 20)
    postgres_server.break_off()
    wait_until(lambda: "store unavailable" in services.said(), "the services miss it")
    postgres_server.start()
    stage.wait_for_more_from(worker, 20)
    postgres_server.break_off()
    services.kill()
    postgres_server.start()
    assert not stage.are_over(campaigns)
    services = stage.services()
    stage.unchanged(campaigns, undisturbed)
    assert [process.end() for process in (services, worker)] == [0, 0]


def test_services_that_stand_still_in_a_transaction_hold_nobody_up(stage: Stage) -> None:
    services, _worker = stage.services(), stage.worker()
    campaign = stage.create(method="monte_carlo", episodes=100_000)
    stage.wait_for(campaign, 20)
    wait_until(lambda: holds_a_lock(stage, services), "the services are in a transaction")
    stage.move(campaign, CampaignState.PAUSING)
    services.go_on()
    wait_until(
        lambda: stage.campaign(campaign).state is CampaignState.PAUSED, "it is paused as asked"
    )
    assert services.end() == 0
    stage.wait_for_rest()
    stage.read()


def holds_a_lock(stage: Stage, services: Services) -> bool:
    """Stop the services where they have locked a campaign, but not written: if they are there."""
    services.halt()
    # Statements may still be on their way from a process that stands still already.
    wait_until(lambda: not stage.ask(MOVING), "what was said is done")
    if stage.ask(LOCKING) and not stage.ask(BUSY):
        return True
    services.go_on()
    time.sleep(PAUSES.uniform(0.02, 0.1))  # or they are met at the same place again
    return False
