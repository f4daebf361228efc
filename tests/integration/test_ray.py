"""Workers that Ray places: found, killed, replaced, and gone when the service ends."""

import time

import psutil
import pytest

from eigenfail.client import Client
from eigenfail.hosting.service import Launcher
from eigenfail.values import CampaignState
from eigenfail_services.hub.keys import KeyFolder

pytestmark = pytest.mark.service

FIELDS = {"name": "ray", "method": "monte_carlo", "planner": "idm", "episodes": 400, "seed": 8}


def actors(service) -> list[psutil.Process]:
    """The processes in which Ray runs the workers of this service."""
    services = next(part for part in service.parts if part.name == "services")
    below = psutil.Process(services.process.pid).children(recursive=True)
    return [process for process in below if process.name().startswith("ray::WorkerAct")]


def digest(client: Client, campaign: int) -> str:
    ended = client.campaigns.wait(campaign, timeout_s=120)
    assert (ended.state, ended.counts.open) == (CampaignState.DONE, 0)
    return client.campaigns.digest(campaign)


def test_a_killed_ray_worker_is_replaced_and_changes_nothing(fresh_service, tmp_path) -> None:
    """On a hub that asks for keys, which they get from the service without anybody's doing."""
    KeyFolder(tmp_path / "data" / "hub-keys").create("by-hand", tmp_path / "by-hand.key")
    with fresh_service(Launcher.RAY, workers=2) as service, Client(service.address.url) as client:
        undisturbed = digest(client, client.campaigns.create(**FIELDS).id)

        campaign = client.campaigns.create(**FIELDS)
        while client.campaigns.get(campaign.id).counts.completed < 30:
            time.sleep(0.02)
        assert "named=own" in service.parts[1].log.read_text()
        before = actors(service)
        assert len(before) == 2
        before[0].kill()
        assert digest(client, campaign.id) == undisturbed

        deadline = time.monotonic() + 30
        while len({process.pid for process in actors(service)}) < 2:
            assert time.monotonic() < deadline, "Ray did not start the worker again"
            time.sleep(0.1)
        everything = psutil.Process(service.parts[1].process.pid).children(recursive=True)
    gone, alive = psutil.wait_procs(everything, timeout=20)
    assert not [p for p in alive if p.status() != psutil.STATUS_ZOMBIE]
    assert gone


def test_a_cluster_that_is_not_there_is_said_in_one_sentence(tmp_path) -> None:
    import subprocess
    import sys

    done = subprocess.run(
        [sys.executable, "-m", "eigenfail_services", "--database", f"sqlite:///{tmp_path}/e.db",
         "--ray-address", "127.0.0.1:1"],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 3
    assert "Ray cannot be used" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
