"""How long a worker waits in a campaign of `ast`: for its learner above all."""

import tempfile
from collections.abc import Iterable
from pathlib import Path

from benchmarks.figures import Figure

from eigenfail.client import Client
from eigenfail.hosting.service import Launcher, Plan, local_service
from eigenfail.values.records import EpisodeRow

EPISODES = 300
COMMAND = "make bench"


def learner_share() -> Figure:
    """The share of the wall time in which the one worker runs no episode; it holds all waiting.

    From the first result to the last, under training that never ends. The learner has the other
    core.
    """
    with tempfile.TemporaryDirectory() as folder:
        plan = Plan(Path(folder), port=0, workers=1, launcher=Launcher.RAY)
        with local_service(plan) as service, Client(service.address.url) as client:
            share = waiting(client)
    return Figure(value=share, unit="share", n=EPISODES, target="<= 0.5", command=COMMAND)


def waiting(client: Client) -> float:
    """`share_waiting` of a campaign of `ast`."""
    created = client.campaigns.create(name="waiting", method="ast", episodes=EPISODES, seed=1)
    ended = client.campaigns.wait(created.id, timeout_s=600)
    if ended.counts.completed != EPISODES:
        raise SystemExit(f"bench: {ended.state}, {ended.counts}: {ended.stopped_because}")
    return share_waiting(client.episodes.list(created.id))


def share_waiting(rows: Iterable[EpisodeRow]) -> float:
    """1 - time in episodes ÷ wall time, from the first commit to the last."""
    ordered = sorted(rows, key=lambda row: row.finished_ms)
    first_ms, last_ms = ordered[0].finished_ms, ordered[-1].finished_ms
    # Results are committed in groups: the episodes of the first group ran before its commit.
    busy_s = sum(row.wall_s for row in ordered if row.finished_ms > first_ms)
    return 1.0 - busy_s / ((last_ms - first_ms) / 1000.0)
