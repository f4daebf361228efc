"""A whole service whose disk is full: it says so, loses nothing, and goes on when there is room."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import deadlines
import httpx2
import psutil
import pytest
from small_disks import fill, mount_small_disk

from eigenfail.client import Client
from eigenfail.hosting.folder import DataFolder
from eigenfail.hosting.service import Launcher, LocalService, Plan, local_service
from eigenfail.values.campaign import CampaignState, Counts
from eigenfail_services.upkeep.verify import verify

pytestmark = [pytest.mark.service, pytest.mark.timeout(deadlines.TEST_S)]

PATIENCE_S = deadlines.CAMPAIGN_S
ROOM = "12m"
FIELDS = {"name": "full", "method": "monte_carlo", "planner": "idm", "episodes": 300, "seed": 5}


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of its own with little room."""
    folder = tmp_path / "data"
    folder.mkdir()
    with mount_small_disk(folder, ROOM):
        yield folder


def until(done: Callable[[], bool], service: LocalService) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not done():
        service.check()
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


@pytest.mark.fault(
    "disk full",
    group="storage",
    outcome="Uncommitted results are not acknowledged and are tried again every second, "
    "leasing pauses, and `/readyz` answers 503 with the reason. Work resumes by "
    "itself once there is space.",
)
def test_a_full_disk_is_told_and_when_there_is_room_work_goes_on(small_disk: Path) -> None:
    plan = Plan(small_disk, port=0, launcher=Launcher.NONE)
    with local_service(plan) as service, Client(service.address.url) as client:
        words = ["eigenfail_workers", "--connect", service.address.hub]
        worker = subprocess.Popen([sys.executable, "-m", *words], stdout=subprocess.DEVNULL)
        try:
            campaign = client.campaigns.create(**FIELDS).id
            until(lambda: counts(client, campaign).completed >= 20, service)
            with standing_still(worker):
                fill(small_disk / "filler")
            told = refusal(service)
            assert told["type"] == "urn:eigenfail:store-unwritable"
            assert "has room" in told["remedy"]
            assert counts(client, campaign).open > 0
            (small_disk / "filler").unlink()
            until(lambda: ready(service).is_success, service)
            until(lambda: client.campaigns.get(campaign).state is CampaignState.DONE, service)
            assert counts(client, campaign).completed == FIELDS["episodes"]
            assert verify(DataFolder(small_disk).database, 3).defects == 0
        finally:
            worker.terminate()
            assert worker.wait(PATIENCE_S) == 0


@contextmanager
def standing_still(worker: "subprocess.Popen[bytes]") -> Iterator[None]:
    """It brings nothing meanwhile: what is yet to come needs room that is no more."""
    everybody = [psutil.Process(worker.pid), *psutil.Process(worker.pid).children(recursive=True)]
    for process in everybody:
        process.suspend()
    try:
        yield
    finally:
        for process in everybody:
            process.resume()


def refusal(service: LocalService) -> dict[str, str]:
    """What is told of a service that is not ready, once it is not."""
    answers: list[httpx2.Response] = []

    def refuses() -> bool:
        answers.append(ready(service))
        return answers[-1].status_code == 503

    until(refuses, service)
    return answers[-1].json()


def counts(client: Client, campaign: int) -> Counts:
    return client.campaigns.get(campaign).counts


def ready(service: LocalService) -> httpx2.Response:
    return httpx2.get(f"{service.address.url}/readyz")
