"""Every process of a service on one stage, and the faults that befall it; all from one seed.

The workers' one line to the hub is a stranger's, too: it is cut, gone for a while, or mute one way.
"""

import sqlite3
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from functools import partial
from random import Random
from types import MappingProxyType
from typing import NamedTuple

import psutil
import reader
from proxy import Way
from stage import CAMPAIGNS, Stage
from started import Started, Worker, wait_until

WORKERS = 2
PAUSE_S = (0.2, 12.0)
"""From nothing to longer than silence and leases last."""

MOST_RESULTS = 30
"""Between two faults."""

Fault = Callable[[], bool]
NOTHING_MORE: Mapping[str, Fault] = MappingProxyType({})


class Storm:
    """Kills and holds up processes, and starts again at once what was killed.

    Args:
        more: faults of what these processes stand on; each says whether it could be caused.

    Attributes:
        faults: what may befall them, by its name.
        befell: how often each was caused.
        campaigns: that were run, in order, with their methods.
        met: the kinds of faults that a campaign met.
    """

    def __init__(self, stage: Stage, random: Random, more: Mapping[str, Fault] = NOTHING_MORE):
        self.stage = stage
        self.befell = Counter[str]()
        self.campaigns: list[tuple[str, int]] = []
        self.met: defaultdict[int, set[str]] = defaultdict(set)
        self._random = random
        self._deck: list[str] = []
        self._spared: dict[str, int] = {}
        self.services, self.controller = stage.services(), stage.controller()
        self._line = stage.line(seed=random.randrange(2**31))
        self.workers = [self._worker() for _ in range(WORKERS)]
        own = {kind: partial(cause, self) for kind, cause in CAUSES.items()}
        self.faults: dict[str, Fault] = {**own, **more}

    def rage(self, over: Callable[[], bool], kinds: Iterable[str] = ()) -> None:
        """Run campaigns, one method after the other, and cause faults (of some kinds)."""
        kinds = list(kinds or self.faults)
        while not over():
            method = list(CAMPAIGNS)[len(self.campaigns) % len(CAMPAIGNS)]
            campaign = self.stage.create(**CAMPAIGNS[method])
            self.campaigns.append((method, campaign))
            while not (over() or self.stage.is_over(campaign)):
                more = self._random.randint(1, MOST_RESULTS)
                self.stage.wait_for(campaign, self.stage.finished(campaign) + more)
                kind = self._draw(kinds)
                self.befell[kind] += self.faults[kind]()
                self.met[campaign].add(kind)

    def _draw(self, kinds: list[str]) -> str:
        """Each kind comes as often as any other."""
        if not self._deck:
            self._deck = self._random.sample(kinds, len(kinds))
        return self._deck.pop()

    def _kill_child(self) -> bool:
        worker = self._random.choice(self.workers)
        # An episode whose process dies three times is given up, as it should be.
        return self._is_further(worker.name, self.stage.brought(worker)) and kill(worker.inner())

    def _kill_learner(self) -> bool:
        # So is a campaign whose learner dies three times without a round learnt in between.
        _, campaign = self.campaigns[-1]
        saved = self.stage.saved_ms(campaign)
        return self._is_further("learner", saved) and kill(self.services.learners())

    def _is_further(self, who: str, now: int) -> bool:
        """Whether somebody has got on since this was asked the last time."""
        before, self._spared[who] = self._spared.get(who, 0), now
        return now != before

    def _kill_worker(self) -> bool:
        place = self._random.randrange(WORKERS)
        self.workers[place].kill()
        self.workers[place] = self._worker()
        return True

    def _kill_services(self) -> bool:
        self.services.kill()
        self.services = self.stage.services()
        return True

    def _kill_controller(self) -> bool:
        self.controller.kill()
        self.controller = self.stage.controller()
        return True

    def _kill_everything(self) -> bool:
        for process in (self.services, self.controller, *self.workers):
            process.kill()
        self.services, self.controller = self.stage.services(), self.stage.controller()
        self.workers = [self._worker() for _ in range(WORKERS)]
        return True

    def _worker(self) -> Worker:
        return self.stage.worker(self._line.address)

    def _cut(self) -> bool:
        self._line.cut()
        return True

    def _hold_up(self, process: Started) -> bool:
        return self._pause(held_up(process))

    def _hold_up_worker(self) -> bool:
        return self._hold_up(self._random.choice(self.workers))

    def _hold_up_services(self) -> bool:
        return self._hold_up(self.services)

    def _sever(self) -> bool:
        return self._pause(self._line.severed())

    def _mute(self) -> bool:
        return self._pause(self._line.muted(self._random.choice([*Way])))

    def _pause(self, trouble: AbstractContextManager[None]) -> bool:
        with trouble:
            time.sleep(self._random.uniform(*PAUSE_S))
        return True


CAUSES: Mapping[str, Callable[[Storm], bool]] = MappingProxyType(
    {
        "SIGKILL of a worker's inner process": Storm._kill_child,
        "SIGKILL of a worker": Storm._kill_worker,
        "SIGSTOP of a worker": Storm._hold_up_worker,
        "SIGKILL of a learner": Storm._kill_learner,
        "SIGSTOP of the services": Storm._hold_up_services,
        "SIGKILL of the services": Storm._kill_services,
        "SIGKILL of the controller": Storm._kill_controller,
        "SIGKILL of every process at once": Storm._kill_everything,
        "worker connection cut": Storm._cut,
        "worker connection unavailable": Storm._sever,
        "worker connection silent in one direction": Storm._mute,
    }
)
SERVER_SHUTDOWN = "immediate shutdown of PostgreSQL"
WRITE_LOCK = "write lock of another program on the SQLite file"
KINDS = (*CAUSES, SERVER_SHUTDOWN, WRITE_LOCK)
"""The kinds of faults that a storm injects, as the tables of docs/faults.md name them."""


def hold_write_lock(url: str, random: Random) -> bool:
    """Lock a SQLite database against writes for some seconds."""
    with write_lock(url):
        time.sleep(random.uniform(*PAUSE_S))
    return True


@contextmanager
def write_lock(url: str) -> Iterator[None]:
    """Hold the write lock of a SQLite database, as another program would."""
    path = url.removeprefix("sqlite:///")
    with closing(sqlite3.connect(path, isolation_level=None, timeout=PAUSE_S[1])) as other:
        other.execute("BEGIN IMMEDIATE")
        yield
        other.execute("ROLLBACK")


@contextmanager
def held_up(process: Started) -> Iterator[None]:
    """Meanwhile it stands still."""
    process.halt()
    try:
        yield
    finally:
        process.go_on()


def kill(processes: list[psutil.Process]) -> bool:
    """kill -9; False if there is none at the moment."""
    for process in processes:
        with suppress(psutil.NoSuchProcess):
            process.kill()
    return bool(processes)


class Verdict(NamedTuple):
    """What is left of it.

    Attributes:
        differing: campaigns whose digest is another than on a calm day.
    """

    found: reader.Findings
    differing: list[int]


def verdict(storm: Storm, calm: Mapping[str, str]) -> Verdict:
    """Once all campaigns have ended."""
    for _, campaign in storm.campaigns:
        wait_until(lambda c=campaign: storm.stage.is_over(c), f"campaign {campaign} ends")
    storm.stage.wait_for_rest()
    found = reader.read(storm.stage.url)
    return Verdict(found, [c for m, c in storm.campaigns if found.digests[c] != calm[m]])
