"""Where a worker sits at the hub's table: what it can hold, what it holds, what it was told."""

from collections.abc import Collection

from eigenfail.values import EpisodeTask
from eigenfail.values.worker import Arrival
from eigenfail.wire.messages import Hello
from eigenfail_services.hub.claims import Key

WORK_AHEAD_S = 2.0
"""How much work a worker should hold, so that it never waits for the hub."""

UNNAMED_BEATS = 10
"""Whoever does not name an episode so often in a row has never got it, or has lost it."""


class Seat:
    """A worker at the table.

    Attributes:
        arrival: what it told of itself.
        heard_s: when it was last heard.
        running: the episode that it runs, if it said so.
        held: what is leased to it, and no result of it was brought.
        load_s: how much work that is thought to be.
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
        self.running: Key | None = None
        self.held: dict[Key, EpisodeTask] = {}
        self.load_s = 0.0
        self.life = hello.life
        self.setups: set[int] = set()
        self.policies: set[tuple[int, int]] = set()
        self._asked = hello.asked
        self._unnamed: dict[Key, int] = {}
        self._work_s: dict[Key, float] = {}

    def is_of(self, hello: Hello) -> bool:
        """Whether it is the same process that says hello, by whatever connection."""
        return bool(self.life) and self.life == hello.life

    def was_taken_by(self, hello: Hello) -> bool:
        """Whether it was let in by this very hello, said again before its welcome came."""
        return self.is_of(hello) and self._asked == hello.asked

    def lend(self, key: Key, task: EpisodeTask, work_s: float) -> None:
        """An episode is leased to it, and has not been missed yet."""
        self.held[key] = task
        self.load_s += work_s
        self._work_s[key] = work_s
        self._unnamed.pop(key, None)

    def give_back(self, key: Key) -> tuple[EpisodeTask, float]:
        """It no longer holds an episode, which was thought to be so much work."""
        work_s = self._work_s.pop(key)
        task = self.held.pop(key)
        self.load_s = self.load_s - work_s if self.held else 0.0
        return task, work_s

    def forget(self, campaign: int) -> None:
        """The worker was told to drop a campaign."""
        self.setups.discard(campaign)
        self.policies = {policy for policy in self.policies if policy[0] != campaign}

    @property
    def room_s(self) -> float:
        """How much more work it should hold, being hungry: what it runs may end at any time."""
        return max(WORK_AHEAD_S - self.load_s, WORK_AHEAD_S / 2)

    def is_hungry(self) -> bool:
        """Whether it holds no more than half of what it should, and may, or a single episode."""
        held = len(self.held)
        wants = held <= 1 or self.load_s <= WORK_AHEAD_S / 2
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
