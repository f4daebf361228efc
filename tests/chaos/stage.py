"""A service in real processes that can be killed, stopped and started again, on one database."""

import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import reader
from accepted import accept_spec
from proxy import Proxy
from sqlalchemy import TextClause, text
from started import Controller, Services, Started, Worker, free_port, wait_until

from eigenfail.values.campaign import FINAL_STATES, Campaign, CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_services.store.store import open_store

SEED = 17
DIFS_ROUNDS = {"initial_share": 0.2, "round_size": 6, "first_steps": 30, "steps": 10}
CAMPAIGNS = {
    "monte_carlo": {"method": "monte_carlo", "episodes": 1_000},
    "ast": {"method": "ast", "episodes": 120, "settings": {"round_size": 6, "gradient_steps": 1}},
    "difs": {"method": "difs", "episodes": 72, "settings": DIFS_ROUNDS},
}
"""Long enough that every one of them is met in the middle of its work."""

JOBS = text("SELECT count(*) FROM jobs")
BROUGHT = text("SELECT count(*) FROM episodes WHERE worker = :worker")
SAVED = text("SELECT coalesce(max(saved_ms), 0) FROM checkpoints WHERE campaign = :campaign")


class Stage:
    """A database, and the processes on it; all of them are ended at the end.

    Attributes:
        hub: where the services listen, unless it is said otherwise, however often they start.
    """

    def __init__(self, url: str, folder: Path) -> None:
        self.url = url
        self.hub = f"tcp://127.0.0.1:{free_port()}"
        self._folder = folder
        self._started: list[Started] = []
        self._lines: list[Proxy] = []
        self._store = open_store(url)

    def controller(self, address: str = "") -> Controller:
        """Start one, at an address or any, and wait until it answers."""
        return self._keep(Controller(self.url, self._folder / "controller.log", address))

    def services(self, hub: str | None = None, *options: str) -> Services:
        """Start them, and wait until they serve."""
        log = self._folder / "services.log"
        return self._keep(Services(self.url, hub or self.hub, log, *options))

    def worker(self, hub: str | None = None) -> Worker:
        """Start one; it connects by itself, as soon as somebody listens."""
        name = f"w{len(self._started)}"
        return self._keep(Worker(hub or self.hub, name, self._folder / f"{name}.log"))

    def line(self, seed: int) -> Proxy:
        """A line to the hub that can be cut."""
        self._lines.append(Proxy(self.hub, seed))
        return self._lines[-1]

    def _keep(self, started):
        self._started.append(started)
        return started

    def create(self, **fields) -> int:
        """A campaign of the simplest world, unless it is said otherwise."""
        plain = {"name": "chaos", "seed": SEED, "planner": "idm", "simulator": "point_mass"}
        return self._store.campaigns.create(accept_spec(CampaignSpec(**plain | fields))).id

    def launch(self, *methods: str) -> dict[str, int]:
        """One campaign of each of these methods, or of every one."""
        return {method: self.create(**CAMPAIGNS[method]) for method in methods or CAMPAIGNS}

    def finished(self, campaign: int) -> int:
        """How many results are committed."""
        counts = self.campaign(campaign).counts
        return counts.completed + counts.errored

    def campaign(self, campaign: int) -> Campaign:
        """As it stands."""
        return self._store.campaigns.get(campaign)

    def move(self, campaign: int, to: CampaignState) -> None:
        """As if a user asked for it."""
        self._store.campaigns.move(campaign, to)

    def wait_for(self, campaign: int, results: int) -> None:
        """Until so many results are committed, or the campaign has ended."""
        wait_until(
            lambda: self.finished(campaign) >= results or self.is_over(campaign),
            f"campaign {campaign} has {results} results",
        )

    def halt(self, services: Services) -> None:
        """Let the services stand still, though not within a transaction, which holds up others."""
        wait_until(lambda: self._halted(services), "the services are between two transactions")

    def _halted(self, services: Services) -> bool:
        services.halt()
        if self._may_write():
            return True
        services.go_on()
        return False

    def _may_write(self) -> bool:
        file = self.url.removeprefix("sqlite:///")
        with closing(sqlite3.connect(file, timeout=0.0)) as connection:
            try:
                connection.execute("BEGIN IMMEDIATE")
            except sqlite3.OperationalError:
                return False
            return True

    def wait_for_more_from(self, worker: Worker, results: int) -> None:
        """Until so many more results of a worker are committed."""
        goal = self.brought(worker) + results
        wait_until(lambda: self.brought(worker) >= goal, f"{worker.name} brings {results} results")

    def brought(self, worker: Worker) -> int:
        """How many results of a worker are kept."""
        return self.ask(BROUGHT, {"worker": worker.name})

    def wait_for_checkpoint(self, campaign: int, after_ms: int) -> None:
        """Until one is saved after that time, or the campaign has ended."""
        wait_until(
            lambda: self.saved_ms(campaign) > after_ms or self.is_over(campaign),
            f"campaign {campaign} saves a checkpoint",
        )

    def saved_ms(self, campaign: int) -> int:
        """When its newest checkpoint was saved; 0 if there is none."""
        return self.ask(SAVED, {"campaign": campaign})

    def ask(self, question: TextClause, values: dict[str, object] | None = None) -> Any:
        """The one answer to a question to the database."""
        with reader.snapshot(self.url) as connection:
            return connection.execute(question, values or {}).scalar_one()

    def is_over(self, campaign: int) -> bool:
        """Whether it has come to an end."""
        return self.campaign(campaign).state in FINAL_STATES

    def are_over(self, campaigns: dict[str, int]) -> bool:
        """Whether all of them have: then whatever is done next proves nothing."""
        return all(map(self.is_over, campaigns.values()))

    def finish(self, *campaigns: int) -> reader.Findings:
        """What the reader says once these are done, and nothing of them is left in the queue."""
        for campaign in campaigns:
            wait_until(lambda c=campaign: self.is_over(c), f"campaign {campaign} ends")
            ended = self.campaign(campaign)
            assert ended.state is CampaignState.DONE, ended.stopped_because
            assert ended.counts.completed == ended.counts.planned, ended.counts
        self.wait_for_rest()
        return self.read()

    def read(self) -> reader.Findings:
        """What the reader says: nothing."""
        found = reader.read(self.url)
        assert (found.lost, found.doubled, found.complaints) == (0, 0, ())
        return found

    def wait_for_rest(self) -> None:
        """Until nothing is left in the queue."""
        wait_until(lambda: not self.ask(JOBS), "the queue is empty")

    def unchanged(self, campaigns: dict[str, int], undisturbed: dict[str, str]) -> reader.Findings:
        """The same as `finish`, and the campaigns of `launch` have the digests of a calm day."""
        found = self.finish(*campaigns.values())
        assert {name: found.digests[campaign] for name, campaign in campaigns.items()} == {
            name: undisturbed[name] for name in campaigns
        }
        return found

    def end(self) -> None:
        """End whatever lives, however it stands."""
        for started in self._started:
            if started.alive:
                started.go_on()
                started.kill()
        for line in self._lines:
            line.close()
        self._store.close()


@contextmanager
def stage_on(url: str) -> Iterator[Stage]:
    """A stage on a database, or on a new file of SQLite; all its processes are ended afterwards."""
    with tempfile.TemporaryDirectory() as folder:
        stage = Stage(url or f"sqlite:///{folder}/eigenfail.db", Path(folder))
        try:
            yield stage
        finally:
            stage.end()
