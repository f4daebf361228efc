"""Room that is given back."""

import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest
from store_checks.examples import deliver, running

from eigenfail.errors import Conflict, SchemaMismatch, ServiceError, StoreUnavailable
from eigenfail.testing.examples import result
from eigenfail.values.campaign import CampaignState
from eigenfail.values.operations import Retention
from eigenfail_services.store import schema
from eigenfail_services.store.store import open_store
from eigenfail_services.upkeep.backup import vacuum
from eigenfail_services.upkeep.pruning import PruneSelection, prune
from eigenfail_services.upkeep.verify import verify

COUNT = 1_000


SMALL_DISK = """
import resource, signal, sys
from eigenfail.errors import ServiceError
from eigenfail_services.upkeep.backup import vacuum
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
_, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
try:
    vacuum(sys.argv[1])
except ServiceError as error:
    print(error)
"""


def fill(url: str) -> None:
    with closing(open_store(url)) as store:
        campaign = running(store, episodes=COUNT)
        deliver(store, campaign, *(result(n, steps=200) for n in range(COUNT)))
        store.campaigns.move(campaign.id, CampaignState.DONE)
        assert (job := store.jobs.claim("test", 60.0))
        assert store.jobs.finish(job)
    prune(url, Retention(keep_every=1_000), PruneSelection())


def test_what_was_pruned_is_given_back(sqlite_url) -> None:
    fill(sqlite_url)
    done = vacuum(sqlite_url)
    assert done.bytes_before - done.bytes_after > COUNT * 200 * 2 * 2 * 4 * 0.9
    assert Path(sqlite_url.removeprefix("sqlite:///")).stat().st_size == done.bytes_after
    assert verify(sqlite_url).defects == 0
    with closing(open_store(sqlite_url)) as store:
        assert store.campaigns.get(1).counts.completed == COUNT


def test_a_file_that_somebody_uses_is_left_alone(sqlite_url) -> None:
    with closing(open_store(sqlite_url)) as store:
        store.ping()
        with pytest.raises(ServiceError, match=r"locked.*Stop the service"):
            vacuum(sqlite_url)
        running(store)
    vacuum(sqlite_url)
    with closing(open_store(sqlite_url)) as store:
        assert store.campaigns.get(1)


def test_a_server_is_swept_by_its_own_command(prepared_postgres_url) -> None:
    with pytest.raises(Conflict, match="VACUUM"):
        vacuum(prepared_postgres_url)


def test_without_room_nothing_is_changed(sqlite_url) -> None:
    fill(sqlite_url)
    before = Path(sqlite_url.removeprefix("sqlite:///")).stat().st_size
    done = subprocess.run(
        [sys.executable, "-c", SMALL_DISK, sqlite_url], text=True, capture_output=True, check=False
    )
    assert "was not changed" in done.stdout, done.stderr
    assert "has room" in done.stdout
    assert verify(sqlite_url).defects == 0
    assert vacuum(sqlite_url).bytes_after < before


def test_what_is_not_there_or_of_another_schema_is_refused(sqlite_url, tmp_path) -> None:
    with pytest.raises(StoreUnavailable):
        vacuum(f"sqlite:///{tmp_path / 'none.db'}")
    with closing(sqlite3.connect(sqlite_url.removeprefix("sqlite:///"))) as file, file:
        file.execute(f"UPDATE {schema.VERSION_TABLE} SET version_num = '0999'")
    with pytest.raises(SchemaMismatch):
        vacuum(sqlite_url)
