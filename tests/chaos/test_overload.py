"""Overload is not death: far more processes than cores, and nobody who lives is given up."""

import os
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import deadlines
import pytest
from inprocess import Service, worker_at
from structlog.testing import capture_logs

from eigenfail.values.campaign import CampaignState
from eigenfail_api.routes.campaigns import CANCEL, steer
from eigenfail_services.hub.worker_sessions import SILENCE_LIMIT_S

WORKERS = 6
CORES = 2
OVERLOAD_S = float(os.environ.get("EIGENFAIL_OVERLOAD_S") or 1.2 * SILENCE_LIMIT_S)
"""Longer than who says nothing is waited for. EIGENFAIL_OVERLOAD_S=600 lasts for ten minutes."""

pytestmark = [pytest.mark.service, pytest.mark.timeout(deadlines.TEST_S + OVERLOAD_S)]

ENDLESS = {
    "method": "ast",
    "planner": "rulebook",
    "episodes": 1_000_000,
    "settings": {"round_size": 24, "warm_up": 24, "gradient_steps": 1},
}


@pytest.fixture
def two_cores() -> Iterator[None]:
    """This thread has no more, nor has what it starts: the hub, its learner, and workers."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(before)[:CORES])
    yield
    os.sched_setaffinity(0, before)


@pytest.mark.fault(
    "more busy processes than cores",
    group="time",
    outcome="Heartbeats come from a process of their own; the hub gives up no living worker "
    "(12 s in the tests, ten minutes with EIGENFAIL_OVERLOAD_S=600).",
)
def test_six_workers_and_a_learner_on_two_cores_all_stay(two_cores, tmp_path: Path) -> None:
    with ExitStack() as stack, capture_logs() as log:
        service = stack.enter_context(closing(Service(tmp_path)))
        for number in range(WORKERS):
            stack.enter_context(worker_at(service.hub.address, f"w{number}"))
        service.crew(WORKERS)
        campaign = service.begin(**ENDLESS)
        service.until(lambda: len(brought_by(service, campaign)) == WORKERS, "not all work")
        service.go_on(OVERLOAD_S)
        assert len(service.hub.workers()) == WORKERS
        service.until(lambda: min(brought_by(service, campaign).values()) > 1, "some bring one")
        service.until(lambda: bool(service.get(campaign).trained_episodes), "nothing is learnt")
        steer(service.store, campaign, CANCEL)
        service.until(lambda: service.get(campaign).state is CampaignState.CANCELLED, "no end")
    said = Counter(line["event"] for line in log)
    assert said["worker lost"] == 0
    assert said["worker joined"] == WORKERS


def brought_by(service: Service, campaign: int) -> Counter[str]:
    """How many of the first thousand results each of the workers brought."""
    return Counter(row.worker for row in service.store.episodes.page(campaign, 1_000).items)
