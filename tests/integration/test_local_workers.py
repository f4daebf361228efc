"""Workers that the services start on their machine: killed, replaced, gone at the end."""

import time

import deadlines
import psutil
import pytest

from eigenfail.client import Client
from eigenfail.hosting.service import Launcher
from eigenfail.values import CampaignState
from eigenfail_services.hub.keys import KeyFolder

pytestmark = pytest.mark.service

FIELDS = {"name": "local", "method": "monte_carlo", "planner": "idm", "episodes": 400, "seed": 8}


def list_workers(service) -> list[psutil.Process]:
    """The parent processes of the workers of a service."""
    services = psutil.Process(service.parts[1].process.pid)
    return [one for one in services.children() if "eigenfail_workers" in one.cmdline()]


def find_digest(client: Client, campaign: int) -> str:
    ended = client.campaigns.wait(campaign, timeout_s=deadlines.CAMPAIGN_S)
    assert (ended.state, ended.counts.open) == (CampaignState.DONE, 0)
    return client.campaigns.digest(campaign)


@pytest.mark.fault(
    "SIGKILL of a worker that the services started",
    group="processes",
    outcome="They start another one of its name after a second, and its episodes go to others"
    " meanwhile. The campaign keeps its digest.",
)
def test_a_killed_local_worker_is_replaced_and_changes_nothing(fresh_service, tmp_path) -> None:
    """On a hub that asks for keys, which they get from the service."""
    KeyFolder(tmp_path / "data" / "hub-keys").create("by-hand", tmp_path / "by-hand.key")
    with (
        fresh_service(Launcher.LOCAL, workers=2) as service,
        Client(service.address.url) as client,
    ):
        undisturbed = find_digest(client, client.campaigns.create(**FIELDS).id)

        campaign = client.campaigns.create(**FIELDS)
        while client.campaigns.get(campaign.id).counts.completed < 30:
            time.sleep(0.02)
        assert "named=own" in service.parts[1].log.read_text()
        before = list_workers(service)
        names = {process.cmdline()[-3] for process in before}
        assert len(names) == 2
        before[0].kill()
        assert find_digest(client, campaign.id) == undisturbed

        deadline = time.monotonic() + deadlines.PROCESS_S
        while len(list_workers(service)) < 2:
            assert time.monotonic() < deadline, "the worker was not started again"
            time.sleep(0.1)
        assert {process.cmdline()[-3] for process in list_workers(service)} == names
        everything = psutil.Process(service.parts[1].process.pid).children(recursive=True)
    gone, alive = psutil.wait_procs(everything, timeout=deadlines.PROCESS_S)
    assert not [p for p in alive if p.status() != psutil.STATUS_ZOMBIE]
    assert gone
