"""A worker that is killed while a campaign runs: who replaces it, and what the campaign becomes."""

import time
from collections.abc import Callable
from typing import Any

import deadlines
import psutil

from eigenfail.client import Client
from eigenfail.hosting.service import LocalService
from eigenfail.values.campaign import CampaignState

ListWorkers = Callable[[LocalService], list[psutil.Process]]
"""The processes of the workers of a service."""


def find_digest(client: Client, campaign: int) -> str:
    """Return the digest of a campaign, once it has ended whole."""
    ended = client.campaigns.wait(campaign, timeout_s=deadlines.CAMPAIGN_S)
    assert (ended.state, ended.counts.open) == (CampaignState.DONE, 0)
    return client.campaigns.digest(campaign)


def check_replacement(
    service: LocalService, fields: dict[str, Any], list_workers: ListWorkers
) -> None:
    """Kill one of two workers in the middle of a campaign; both are there again afterwards.

    The campaign has the digest of the same one on two workers that live.
    """
    with Client(service.address.url) as client:
        undisturbed = find_digest(client, client.campaigns.create(**fields).id)
        campaign = client.campaigns.create(**fields)
        while client.campaigns.get(campaign.id).counts.completed < 30:
            time.sleep(0.02)
        assert "named=own" in service.parts[1].log.read_text()
        before = list_workers(service)
        assert len(before) == 2
        before[0].kill()
        assert find_digest(client, campaign.id) == undisturbed
    deadline = time.monotonic() + deadlines.PROCESS_S
    while len({process.pid for process in list_workers(service)}) < 2:
        assert time.monotonic() < deadline, "the worker was not started again"
        time.sleep(0.1)


def list_descendants(service: LocalService) -> list[psutil.Process]:
    """Return the processes that the services started."""
    return psutil.Process(service.parts[1].process.pid).children(recursive=True)


def check_gone(processes: list[psutil.Process]) -> None:
    """Wait until all of some processes have ended."""
    gone, alive = psutil.wait_procs(processes, timeout=deadlines.PROCESS_S)
    assert not [p for p in alive if p.status() != psutil.STATUS_ZOMBIE]
    assert gone
