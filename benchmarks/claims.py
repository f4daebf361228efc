"""Find the figures that the documents state, by campaigns; write docs/claims.json."""

import os
import tempfile
from pathlib import Path
from statistics import median

from figures import ROOT, Figure, show, write

from eigenfail.cli.local_service import Launcher, Plan, local_service
from eigenfail.client import Client
from eigenfail.values import Summary
from eigenfail.values.records import EpisodeRow
from eigenfail_services.statistics.intervals import rate

COMMAND = "make claims"
SEED = 20261121
EPISODES = 2000


def monte_carlo(client: Client, planner: str) -> tuple[Summary, list[EpisodeRow]]:
    """A Monte Carlo campaign on cut_in, and its episodes."""
    created = client.campaigns.create(
        name=f"claims {planner}",
        method="monte_carlo",
        planner=planner,
        episodes=EPISODES,
        seed=SEED,
    )
    ended = client.campaigns.wait(created.id, timeout_s=1200)
    if ended.counts.completed != EPISODES:
        raise SystemExit(f"{planner}: {ended.state}, {ended.counts}: {ended.stopped_because}")
    return client.campaigns.summary(created.id), list(client.episodes.list(created.id))


def world(client: Client) -> dict[str, Figure]:
    """How the planners fare under the disturbance model itself."""
    rulebook, rows = monte_carlo(client, "rulebook")
    idm, _ = monte_carlo(client, "idm")
    return {
        "cut_in.rulebook.mc2000.failures": Figure(
            value=rulebook.counts.failures,
            unit="episodes",
            n=EPISODES,
            target="= 0",
            paper=0.0,
            command=COMMAND,
        ),
        "cut_in.idm.mc2000.failure_rate": Figure(
            value=idm.counts.failures / EPISODES,
            unit="share",
            n=EPISODES,
            interval=rate_interval(idm.counts.failures),
            target="0.25 … 0.55",
            paper=0.401,
            command=COMMAND,
        ),
        "cut_in.rulebook.mc2000.median_min_ttc_s": middle(
            [row.min_ttc_s for row in rows], "s", ">= 2.5", paper=3.50
        ),
        "cut_in.rulebook.mc2000.median_drac": middle(
            [row.max_drac_mps2 for row in rows], "m/s²", "<= 1.5", paper=0.40
        ),
    }


def rate_interval(failures: int) -> tuple[float, float]:
    """The 95 % interval of the failure rate."""
    interval = rate(failures, EPISODES).interval
    return interval.low, interval.high


def middle(values: list[float | None], unit: str, target: str, paper: float) -> Figure:
    """The median over the episodes in which the measure was defined."""
    defined = [value for value in values if value is not None]
    return Figure(
        value=median(defined),
        unit=unit,
        n=len(defined),
        target=target,
        paper=paper,
        note="the paper's is of DiFS runs",
        command=COMMAND,
    )


def main() -> None:
    """Run, write, show."""
    workers = os.cpu_count() or 1
    with tempfile.TemporaryDirectory() as folder:
        plan = Plan(Path(folder), port=0, workers=workers, launcher=Launcher.RAY)
        with local_service(plan) as service, Client(service.address.url) as client:
            figures = world(client)
    write(ROOT / "docs" / "claims.json", figures)
    show(figures)


if __name__ == "__main__":
    main()
