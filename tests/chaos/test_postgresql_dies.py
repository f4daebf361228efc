"""PostgreSQL broken off in the middle of the work, alone and together with the services; and
services that stand still while they hold a lock there.
"""

import random
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import deadlines
import pytest
from postgresql import Server, server
from small_disks import fill, mount_small_disk
from sqlalchemy import text
from sqlalchemy.exc import SQLAlchemyError
from stage import Stage
from started import Services, wait_until

from eigenfail.values.campaign import CampaignState

pytestmark = [pytest.mark.service, pytest.mark.timeout(deadlines.TEST_S)]

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
NEW_LOG = text("SELECT pg_switch_wal()")
HERE = text("SELECT 1")
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
    with staged(postgres_server.url, tmp_path) as stage:
        yield stage


@contextmanager
def staged(url: str, folder: Path) -> Iterator[Stage]:
    stage = Stage(url, folder)
    try:
        yield stage
    finally:
        stage.end()


@pytest.mark.fault("SIGKILL of every process at once")
@pytest.mark.fault(
    "immediate shutdown of PostgreSQL",
    group="storage",
    outcome="Nothing is acknowledged meanwhile, and everything is tried again every second. "
    "With fsync on, nothing that was acknowledged is lost.",
)
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


@pytest.fixture
def strace() -> None:
    """Skips where nobody may look into processes."""
    try:
        subprocess.run(["strace", "-qq", "-o", "/dev/null", "true"], check=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no strace that may look into processes")


@contextmanager
def failing_to_sync(server: Server) -> Iterator[None]:
    """Within the block, each process's fourth try to bring its log to the disk fails."""
    faults = ["-e", "trace=fdatasync", "-e", "inject=fdatasync:error=EIO:when=4"]
    each = [word for pid in server.pids() for word in ("-p", str(pid))]
    with subprocess.Popen(["strace", "-f", "-qq", "-o", "/dev/null", *faults, *each]) as tracer:
        try:
            yield
        finally:
            tracer.terminate()


@pytest.mark.fault("fsync that fails")
def test_what_a_server_could_not_bring_to_disk_is_not_acknowledged(
    strace: None, stage: Stage, postgres_server: Server, undisturbed: dict[str, str]
) -> None:
    """It breaks off by itself then, and begins anew with what was on the disk."""
    services, worker = stage.services(), stage.worker()
    campaigns = stage.launch("monte_carlo", "ast")
    stage.wait_for_more_from(worker, 20)
    with failing_to_sync(postgres_server):
        wait_until(lambda: "store unavailable" in services.said(), "the services miss it")
    wait_until(lambda: is_there(stage), "the server begins anew")
    stage.unchanged(campaigns, undisturbed)
    assert [process.end() for process in (services, worker)] == [0, 0]


def is_there(stage: Stage) -> bool:
    """Whether the server answers."""
    with suppress(SQLAlchemyError):
        return stage.ask(HERE) == 1
    return False


def begins_anew(running: Server, stage: Stage) -> bool:
    """Start it, unless it is there; it may be about to end for want of room."""
    if not is_there(stage):
        running.start()
    return is_there(stage)


@pytest.fixture
def small_folder() -> Iterator[Path]:
    """One with little room, and a short name, as paths of sockets must."""
    folder = Path(tempfile.mkdtemp(prefix="eigenfail-pg-", dir="/tmp"))
    try:
        with mount_small_disk(folder, "256m"):
            below = folder / "s"  # what the server removes at its end
            below.mkdir(0o700)
            yield below
    finally:
        folder.rmdir()


@pytest.mark.fault("disk of a PostgreSQL server full, or server read-only")
def test_a_server_without_room_for_its_log_loses_nothing(
    small_folder: Path, tmp_path: Path, undisturbed: dict[str, str]
) -> None:
    filler = small_folder / "filler"
    with server(str(small_folder)) as running, staged(running.url, tmp_path) as stage:
        services, worker = stage.services(), stage.worker()
        campaigns = stage.launch("monte_carlo", "ast")
        stage.wait_for_more_from(worker, 20)
        fill(filler)
        with suppress(SQLAlchemyError):
            stage.ask(NEW_LOG)  # or there is room in what is begun already
        wait_until(lambda: "store unavailable" in services.said(), "the services miss it")
        filler.unlink()
        wait_until(lambda: begins_anew(running, stage), "the server begins anew")
        stage.unchanged(campaigns, undisturbed)
        assert [process.end() for process in (services, worker)] == [0, 0]


@pytest.mark.fault("SIGSTOP of the services")
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
