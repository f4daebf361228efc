"""A whole service whose database is moved away or locked, and one that keeps its files private."""

import os
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import deadlines
import httpx2
import pytest

from eigenfail.client import Client
from eigenfail.hosting.folder import DataFolder
from eigenfail.hosting.service import Launcher, LocalService, Plan, local_service
from eigenfail.values.campaign import CampaignState
from eigenfail_services.hub.keys import KeyFolder
from eigenfail_services.upkeep.backup import backup
from eigenfail_services.upkeep.verify import verify

pytestmark = [pytest.mark.service, pytest.mark.timeout(deadlines.TEST_S)]

PATIENCE_S = deadlines.PROCESS_S
HELD_S = 14.0
"""Longer than a worker may be silent: one that is not answered meanwhile would be lost."""

FIELDS = {"name": "kept", "method": "monte_carlo", "planner": "idm", "episodes": 400, "seed": 5}
CAMPAIGNS = "/api/v1/campaigns"


@pytest.fixture
def folder(tmp_path: Path) -> DataFolder:
    """The data folder of the service; its name has a meaning in URLs."""
    return DataFolder(tmp_path / "run?1%41")


@contextmanager
def serving(folder: DataFolder, key_file: Path | None = None) -> Iterator[LocalService]:
    """A service with one worker."""
    plan = Plan(folder.path, port=0, launcher=Launcher.NONE)
    with local_service(plan) as service:
        key = ["--key-file", str(key_file)] if key_file else []
        words = ["eigenfail_workers", "--connect", service.address.hub, *key]
        worker = subprocess.Popen([sys.executable, "-m", *words], stdout=subprocess.DEVNULL)
        try:
            yield service
        finally:
            worker.terminate()
            assert worker.wait(PATIENCE_S) == 0


def until(done: Callable[[], bool], service: LocalService) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not done():
        service.check()
        assert time.monotonic() < deadline_s
        time.sleep(0.05)


def asked(service: LocalService, method: str, path: str, **more) -> tuple[httpx2.Response, float]:
    """An answer, and how long it took."""
    began_s = time.monotonic()
    answer = httpx2.request(
        method, f"{service.address.url}{path}", timeout=deadlines.PROCESS_S, **more
    )
    return answer, time.monotonic() - began_s


def finished(client: Client, campaign: int) -> int:
    return client.campaigns.get(campaign).counts.completed


def come_to_the_end(service: LocalService, client: Client, campaign: int) -> None:
    """Everything has a result, once, and the database is sound."""
    until(lambda: client.campaigns.get(campaign).state is CampaignState.DONE, service)
    counts = client.campaigns.get(campaign).counts
    assert (counts.completed, counts.errored) == (FIELDS["episodes"], 0)


@pytest.mark.fault("database file moved away while the service runs")
def test_a_service_whose_database_is_moved_waits_until_it_is_back(folder, tmp_path) -> None:
    file, elsewhere = folder.database_file, tmp_path / "elsewhere"
    with serving(folder) as service, Client(service.address.url) as client:
        campaign = client.campaigns.create(**FIELDS).id
        until(lambda: finished(client, campaign) >= 5, service)
        file.rename(elsewhere)
        time.sleep(1.1)  # what was probed before is told again for a second
        for answer, took_s in (
            asked(service, "POST", CAMPAIGNS, json=FIELDS),
            asked(service, "GET", "/readyz"),
            asked(service, "GET", f"/campaigns/{campaign}", headers={"Accept": "text/html"}),
        ):
            assert (answer.status_code, answer.headers["Retry-After"]) == (503, "1")
            assert "was moved, deleted or replaced" in answer.text
            assert "Put it back" in answer.text
            assert took_s < 5.0
        time.sleep(2.0)
        assert not file.exists()
        elsewhere.rename(file)
        until(lambda: asked(service, "GET", "/readyz")[0].is_success, service)
        come_to_the_end(service, client, campaign)
        assert len(list(client.campaigns.list())) == 1
    assert verify(folder.database, 3).defects == 0
    assert file.stat().st_mode & 0o777 == 0o600


@pytest.mark.fault("database lock held by another program")
def test_a_service_whose_database_is_locked_refuses_soon_and_keeps_its_workers(folder) -> None:
    with serving(folder) as service, Client(service.address.url) as client:
        campaign = client.campaigns.create(**FIELDS).id
        until(lambda: finished(client, campaign) >= 5, service)
        with closing(sqlite3.connect(folder.database_file, isolation_level=None)) as other:
            other.execute("PRAGMA busy_timeout = 30000")
            other.execute("BEGIN IMMEDIATE")
            until_s = time.monotonic() + HELD_S
            answer, took_s = asked(service, "POST", CAMPAIGNS, json=FIELDS)
            assert (answer.status_code, answer.headers["Retry-After"]) == (503, "1")
            assert "holds its lock" in answer.json()["remedy"]
            assert took_s < 8.0  # twice two seconds, on a machine that has much to do
            answer, took_s = asked(service, "GET", "/readyz")
            assert answer.status_code == 503
            assert "locked" in answer.json()["detail"]
            assert took_s < 5.0
            assert asked(service, "GET", f"{CAMPAIGNS}/{campaign}")[0].is_success
            time.sleep(max(0.0, until_s - time.monotonic()))
            other.execute("ROLLBACK")
        come_to_the_end(service, client, campaign)
        assert asked(service, "GET", "/readyz")[0].is_success
        assert "worker lost" not in folder.log("services").read_text()
        assert client.campaigns.get(campaign).counts.duplicates == 0


@pytest.fixture
def open_umask() -> Iterator[None]:
    """Files are made for everybody, unless their maker says otherwise."""
    before = os.umask(0)
    yield
    os.umask(before)


@pytest.mark.fault(
    "umask 000",
    group="storage",
    outcome="The data folder and every file in it, backups, keys and logs among them, "
    "are for their owner alone.",
)
def test_all_that_a_service_leaves_is_for_its_owner_alone(tmp_path, open_umask) -> None:
    folder = DataFolder(tmp_path / "above" / "data")
    keys = folder.path / "worker.key"
    KeyFolder(folder.hub_keys).create("first", keys)
    with serving(folder, keys) as service, Client(service.address.url) as client:
        campaign = client.campaigns.create(**(FIELDS | {"episodes": 5})).id
        until(lambda: client.campaigns.get(campaign).state is CampaignState.DONE, service)
        for name in ("episodes.parquet", "episodes.csv"):
            client.episodes.export(campaign, folder.path / name)
        backup(folder.database, folder.path / "backup.db")
        walked = [folder.path.parent, folder.path, *folder.path.rglob("*")]
        modes = {path: path.stat().st_mode & 0o777 for path in walked}
    names = {path.name for path in modes}
    assert {"eigenfail.db-wal", "services.log", "service.json", "hub-keys"} <= names
    assert {path: oct(mode) for path, mode in modes.items() if mode & 0o077} == {}
