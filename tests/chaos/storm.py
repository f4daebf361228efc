"""Every process of a service on one stage, and the faults that befall it; all from one seed.

The workers' one line to the hub is a stranger's, too: it is cut, gone for a while, or mute one way.
"""

import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
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
        self.faults: dict[str, Fault] = {
            "inner process killed": self._kill_child,
            "worker killed": self._kill_worker,
            "worker held up": lambda: self._hold_up(self._random.choice(self.workers)),
            "learner killed": self._kill_learner,
            "services held up": lambda: self._hold_up(self.services),
            "services killed": self._kill_services,
            "controller killed": self._kill_controller,
            "everything killed": self._kill_everything,
            "line cut": self._cut,
            "line away": lambda: self._pause(self._line.severed()),
            "line mute one way": lambda: self._pause(self._line.muted(self._random.choice([*Way]))),
            **more,
        }

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

    def _pause(self, trouble: AbstractContextManager[None]) -> bool:
        with trouble:
            time.sleep(self._random.uniform(*PAUSE_S))
        return True


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
