"""Store, hub and supervisor in this process, where a test sees them; workers as in use."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import deadlines
from accepted import accept_spec

from eigenfail.values.campaign import FINAL_STATES, Campaign, CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_services.campaigns.supervisor import Supervisor
from eigenfail_services.hub.keys import HubKeys
from eigenfail_services.hub.server import Hub
from eigenfail_services.store.store import open_store

PATIENCE_S = deadlines.PROCESS_S
LOOK_AGAIN_S = 0.03


class NoAnalyses:
    """Nobody asks for one."""

    def __len__(self) -> int:
        return 0

    def open(self, job: object) -> None:
        raise AssertionError(job)

    def poll(self) -> None:
        pass


class Service:
    """A service on a database file; its supervisor takes its turns while the test waits."""

    def __init__(self, folder: Path, keys: HubKeys | None = None) -> None:
        self.url = f"sqlite:///{folder}/eigenfail.db"
        self.store = open_store(self.url)
        self.hub = Hub(self.store, "tcp://127.0.0.1:*", keys)
        self.supervisor = Supervisor(self.store, self.hub, NoAnalyses())  # type: ignore[arg-type]
        self.hub.start()

    def close(self) -> None:
        self.hub.stop()
        self.supervisor.release()
        self.store.close()

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Wait, and let the supervisor work meanwhile."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline_s, what
            assert self.hub.is_alive(), "the hub's thread has died"
            self.supervisor.turn()
            time.sleep(LOOK_AGAIN_S)

    def go_on(self, for_s: float) -> None:
        """Let it work for some time."""
        until_s = time.monotonic() + for_s
        while time.monotonic() < until_s:
            assert self.hub.is_alive(), "the hub's thread has died"
            self.supervisor.turn()
            time.sleep(LOOK_AGAIN_S)

    def begin(self, **fields: object) -> int:
        """The id of a new campaign."""
        return self.store.campaigns.create(accept_spec(CampaignSpec(name="t", seed=5, **fields))).id  # type: ignore[arg-type]

    def get(self, campaign: int) -> Campaign:
        return self.store.campaigns.get(campaign)

    def finish(self, campaign: int) -> str:
        """The digest of a campaign, once every episode of it was run."""
        self.until(lambda: self.get(campaign).state in FINAL_STATES, "the campaign does not end")
        ended = self.get(campaign)
        assert ended.state is CampaignState.DONE, ended.stopped_because
        assert (ended.counts.completed, ended.counts.errored) == (ended.counts.planned, 0)
        return self.store.episodes.digest(campaign)

    def run(self, **fields: object) -> str:
        return self.finish(self.begin(**fields))

    def crew(self, n: int) -> None:
        """Wait until so many workers are in."""
        self.until(lambda: len(self.hub.workers()) == n, f"there are not {n} workers")


@contextmanager
def worker_at(address: str, name: str, *options: str) -> Iterator["subprocess.Popen[bytes]"]:
    """A worker started by hand, for as long as the block lasts."""
    command = [sys.executable, "-m", "eigenfail_workers", "--connect", address, "--name", name]
    process = subprocess.Popen([*command, *options], stdout=subprocess.DEVNULL)
    try:
        yield process
    finally:
        for asked in (signal.SIGTERM, signal.SIGINT):  # the second one ends its timeout
            process.send_signal(asked)
        process.wait()
