"""Which episodes are to be run and are with nobody, in the order in which they go out."""

from collections import OrderedDict
from collections.abc import Collection

from eigenfail.values import EpisodeTask


class Waiting:
    """A line of episodes for each campaign, and what its learner wants results of."""

    def __init__(self) -> None:
        self._lines: dict[int, OrderedDict[int, EpisodeTask]] = {}
        self._wanted: dict[int, set[int]] = {}
        self._has_some: dict[int, None] = {}

    def campaigns(self) -> Collection[int]:
        """Those of which some episode waits."""
        return self._has_some.keys()

    def of(self, campaign: int) -> OrderedDict[int, EpisodeTask]:
        """What waits of a campaign, by index."""
        return self._lines.get(campaign, OrderedDict())

    def knows(self, campaign: int) -> bool:
        """Whether anything of a campaign was asked for, and not called off."""
        return campaign in self._lines

    def wants(self, campaign: int, index: int) -> bool:
        """Whether a result of an episode is wanted, whoever has it."""
        return index in self._wanted.get(campaign, ())

    def want(self, campaign: int, tasks: Collection[EpisodeTask]) -> None:
        """Results of these are wanted, whoever has them."""
        self._wanted.setdefault(campaign, set()).update(task.index for task in tasks)
        self._lines.setdefault(campaign, OrderedDict())

    def add(self, campaign: int, task: EpisodeTask) -> None:
        """At the end of the line."""
        self._lines[campaign][task.index] = task
        self._has_some[campaign] = None

    def put_back(self, campaign: int, task: EpisodeTask) -> None:
        """At its front, if it is wanted; else it will be, with the policy that it then needs."""
        if self.wants(campaign, task.index):
            self.add(campaign, task)
            self._lines[campaign].move_to_end(task.index, last=False)

    def take(self, campaign: int, index: int | None = None) -> EpisodeTask:
        """Out of the line: the first, or that of an index, which must be in it."""
        line = self._lines[campaign]
        task = line.popitem(last=False)[1] if index is None else line.pop(index)
        if not line:
            del self._has_some[campaign]
        return task

    def settle(self, campaign: int, index: int) -> None:
        """It has a result."""
        self._wanted.get(campaign, set()).discard(index)
        if index in self.of(campaign):
            self.take(campaign, index)

    def call_off(self, campaign: int) -> None:
        """Nothing of it is wanted any more."""
        self._lines.pop(campaign, None)
        self._wanted.pop(campaign, None)
        self._has_some.pop(campaign, None)
