"""Where a worker sits at the hub's table: what it can hold, what it holds, what it was told."""

from collections.abc import Collection
from typing import NamedTuple

from eigenfail.values import EpisodeTask
from eigenfail.values.worker import Arrival
from eigenfail.wire.messages import Hello
from eigenfail_services.hub.claims import Key

WORK_AHEAD_S = 2.0
"""How much work a worker should hold, so that it never waits for the hub."""

UNNAMED_BEATS = 10
"""Whoever does not name an episode so often in a row has never got it, or has lost it."""

SMOOTHING = 0.2
MOST_APART = 100.0
"""Whatever it tells, no worker is thought to be so many times slower or faster than others."""


class Loan(NamedTuple):
    """An episode that a worker held, and how much work it was thought to be. [s]"""

    task: EpisodeTask
    work_s: float
    seat: "Seat"


class Seat:
    """A worker at the table.

    Attributes:
        arrival: what it told of itself.
        heard_s: when it was last heard.
        bridge: whether it has one.
        running: the episode that it runs, if it said so.
        beside: how many of the campaign that it runs may be run side by side.
        held: what is leased to it, and no result of it was brought.
        load_s: how much work that is thought to be.
        slowness: how many times longer than of others an episode takes of it.
        life: of its process; empty for nobody's.
        setups: the campaigns of which it was sent the setup.
        policies: campaign and version of those that it was sent.
    """

    def __init__(self, hello: Hello, now_s: float) -> None:
        self.name = hello.worker
        self.arrival = Arrival(
            worker=hello.worker, host=hello.host, pid=hello.pid, versions=hello.versions
        )
        self.credit = hello.credit
        self.heard_s = now_s
        self.bridge = hello.bridge
        self.running: Key | None = None
        self.beside = 1
        self.held: dict[Key, EpisodeTask] = {}
        self.load_s = 0.0
        self.slowness = 1.0
        self.life = hello.life
        self.setups: set[int] = set()
        self.policies: set[tuple[int, int]] = set()
        self._slots: dict[int, int] = {}
        self._asked = hello.asked
        self._unnamed: dict[Key, int] = {}
        self._work_s: dict[Key, float] = {}

    def is_of(self, hello: Hello) -> bool:
        """Whether it is the same process that says hello, by whatever connection."""
        return bool(self.life) and self.life == hello.life

    def was_taken_by(self, hello: Hello) -> bool:
        """Whether it was let in by this very hello, said again before its welcome came."""
        return self.is_of(hello) and self._asked == hello.asked

    def runs(self, running: Key | None, slots: int) -> bool:
        """It says what it runs, if anything, with how many side by side; whether that is new."""
        before, self.beside = self.beside, slots if running else 1
        self.running = running
        if running in self.held:
            self._slots[running[0]] = slots
        return self.beside != before

    def slots(self, campaign: int) -> int:
        """How many episodes of a campaign it runs side by side, as far as it has told."""
        return self._slots.get(campaign, 1)

    def lend(self, key: Key, task: EpisodeTask, work_s: float) -> None:
        """An episode is leased to it, and has not been missed yet."""
        self.held[key] = task
        self.load_s += work_s
        self._work_s[key] = work_s
        self._unnamed.pop(key, None)

    def give_back(self, key: Key) -> Loan:
        """It no longer holds an episode."""
        work_s = self._work_s.pop(key)
        task = self.held.pop(key)
        self.load_s = self.load_s - work_s if self.held else 0.0
        return Loan(task, work_s, self)

    def learn(self, ratio: float) -> None:
        """An episode took it so many times as long as is usual."""
        within = min(max(ratio, 1.0 / MOST_APART), MOST_APART)
        self.slowness += SMOOTHING * (within - self.slowness)

    def forget(self, campaign: int) -> None:
        """The worker was told to drop a campaign."""
        self.setups.discard(campaign)
        self._slots.pop(campaign, None)
        self.policies = {policy for policy in self.policies if policy[0] != campaign}

    @property
    def room_s(self) -> float:
        """How much more work it should hold, being hungry: what it runs may end at any time."""
        return max(WORK_AHEAD_S - self.load_s, WORK_AHEAD_S / 2)

    def is_hungry(self) -> bool:
        """Whether it holds no more than half of what it should, and may, or than it runs at once.

        Of those that it runs side by side, all may be over at the same moment.
        """
        held = len(self.held)
        wants = held <= self.beside or self.load_s <= WORK_AHEAD_S / 2
        return wants and held <= self.credit // 2 and self.credit > 0

    def missed(self, expected: Collection[Key], named: Collection[Key]) -> set[Key]:
        """Those of the expected episodes that it has not named for long: it does not hold them.

        Args:
            expected: what the hub believes to be here.
            named: what the worker holds, by its heartbeat.
        """
        # A heartbeat and a lease may cross: once, not time after time.
        unnamed = set(expected).difference(named)
        self._unnamed = {key: self._unnamed.get(key, 0) + 1 for key in unnamed}
        return {key for key, beats in self._unnamed.items() if beats >= UNNAMED_BEATS}
