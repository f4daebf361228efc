"""The child processes of a worker: one for each set of campaigns that may share a process.

Campaigns whose parts are all built in share a process. A campaign with a plug-in has its own
process, which ends with the campaign. Module globals, caches and patched libraries cannot be
checked: even two campaigns with the same plug-ins would depend on their order in one process.
Functions under test are plug-ins, too. A campaign on a bridge runs no plug-in in this process.
"""

import time
from collections.abc import Callable

from eigenfail.errors import ServiceError
from eigenfail.values.episode import EpisodeSetup, PolicySource
from eigenfail.values.learning import MOST_POLICIES, Policy
from eigenfail.wire.messages import PolicyUpdate, Setup
from eigenfail.worlds import world_of
from eigenfail_workers.limits import Limits
from eigenfail_workers.worker.child_process import ChildProcess, HeldEpisode

MAX_IDLE = 3
"""Most idle processes: with the active one, as many as campaigns run at a time."""

CHECK_EVERY_S = 1.0
CLOSING_S = 5.0
"""Time for a process to close what its campaigns have opened, before it is killed."""

SHARED = -1
"""The group of all campaigns with built-in parts only; other groups are campaign numbers."""

MAX_CHILD_DEATHS = 3
MAX_FAILED_STARTS = 20
"""Most child processes in a row that end without any result."""

MAX_UNREADY_STARTS = 10
"""Most child processes in a row that end before they can take an episode."""


class ProcessFailures:
    """Counts the ends of child processes: for each episode, and in a row."""

    def __init__(self) -> None:
        self._deaths: dict[tuple[int, int], int] = {}
        self._failed_starts = 0
        self._unready_starts = 0

    def record_result(self, campaign: int, index: int) -> None:
        """Clear the count of an episode that has a result, and the count of failed starts."""
        self._deaths.pop((campaign, index), None)
        self._failed_starts = 0

    def record_end(self, *, ready: bool, status: int) -> None:
        """Count the end of a child process.

        Args:
            ready: whether the process could take episodes.
            status: its exit status.

        Raises:
            ServiceError: too many processes in a row were never ready: no episode can run here.
        """
        self._failed_starts += 1
        self._unready_starts = 0 if ready else self._unready_starts + 1
        if self._unready_starts == MAX_UNREADY_STARTS:
            raise ServiceError(
                f"No inner process can start here: {MAX_UNREADY_STARTS} ended, one after the "
                f"other, before they could take an episode (the last with exit status {status}).",
                "See what they printed; `python -m eigenfail_workers.worker.child` starts one.",
            )

    def blame(self, held: HeldEpisode, weight: int) -> bool:
        """Count the end of a process against an episode; return whether it is out of attempts.

        Args:
            held: the episode.
            weight: number of deaths to count; 0 if the episode had not begun.
        """
        # After so many, the episode is not to blame alone: each gets one attempt, not three, so
        # that a worker that can run nothing says so soon.
        if self._failed_starts > MAX_FAILED_STARTS:
            weight = MAX_CHILD_DEATHS
        key = (held.campaign, held.task.index)
        self._deaths[key] = self._deaths.get(key, 0) + weight
        if self._deaths[key] < MAX_CHILD_DEATHS:
            return False
        del self._deaths[key]
        return True


class CampaignSetups:
    """Setups and policies from the hub, which each new child needs until the campaign is dropped.

    Attributes:
        setups: setups by campaign.
    """

    def __init__(self) -> None:
        self.setups: dict[int, EpisodeSetup] = {}
        self._policies: dict[int, dict[int, Policy]] = {}

    def set_up(self, message: Setup) -> None:
        """Keep the setup of a campaign."""
        self.setups[message.campaign] = message.setup

    def add_policy(self, message: PolicyUpdate) -> None:
        """Keep a policy version; the oldest versions are dropped."""
        versions = self._policies.setdefault(message.campaign, {})
        versions[message.policy.version] = message.policy
        for old in sorted(versions)[:-MOST_POLICIES]:
            del versions[old]

    def drop(self, campaign: int) -> None:
        """Forget a campaign."""
        self.setups.pop(campaign, None)
        self._policies.pop(campaign, None)

    def can_run(self, held: HeldEpisode) -> bool:
        """Return whether an episode is still wanted, and its setup and policy are here."""
        source, policies = held.task.source, self._policies.get(held.campaign, {})
        has_policy = not isinstance(source, PolicySource) or source.version in policies
        return held.wanted and held.campaign in self.setups and has_policy

    def run_in(self, child: ChildProcess, held: HeldEpisode) -> None:
        """Send an episode to a child, after the setup and the policy that it needs."""
        child.set_up(held.campaign, self.setups[held.campaign])
        if isinstance(held.task.source, PolicySource):
            child.add_policy(held.campaign, self._policies[held.campaign][held.task.source.version])
        child.run(held)


def find_group(campaign: int, setup: EpisodeSetup) -> int:
    """Return the group of campaigns that may share a process: SHARED, or the campaign alone."""
    return campaign if world_of(setup.simulator).runs_foreign_code(setup) else SHARED


class InnerProcesses:
    """One active process, which holds episodes, and idle ones with the campaigns they have loaded.

    Args:
        start: starts a process.
        limits: limits of the active process. An idle one that uses more than its share of the
            memory, the limit ÷ `MAX_IDLE`, is ended.

    Attributes:
        active: the process that takes episodes.
    """

    def __init__(self, start: Callable[[], ChildProcess], limits: Limits) -> None:
        self._start = start
        # All idle processes together use at most as much memory as the active one may.
        self._idle_mib = limits.memory_mib / MAX_IDLE
        self.active = start()
        self._group: int | None = None
        self._idle: dict[int, ChildProcess] = {}
        self._closing: list[tuple[ChildProcess, float]] = []
        self._next_check_s = 0.0

    def select(self, group: int) -> bool:
        """Make the process of a group the active one; False while another one holds episodes.

        A process without campaigns can serve any group.
        """
        if group == self._group:
            return True
        # Groups take turns only between episodes, so that one process works at a time.
        if self.active.running:
            return False
        if self.active.has_campaigns or group in self._idle:
            self._set_aside()
            # Popped after the active one was set aside: the oldest idle process may have been
            # closed for it.
            self.active = self._idle.pop(group) if group in self._idle else self._start()
        self._group = group
        return True

    def _set_aside(self) -> None:
        """Keep the active process as an idle one if it holds campaigns and uses little memory."""
        useful = self.active.has_campaigns and self._is_small(self.active)
        # Without a group: its campaign was dropped, so that nobody would come back to it.
        if self._group is None or not useful:
            self._close(self.active)
            return
        self._idle[self._group] = self.active
        while len(self._idle) > MAX_IDLE:
            self._close(self._idle.pop(next(iter(self._idle))))

    def _is_small(self, process: ChildProcess) -> bool:
        return process.memory_mib() <= self._idle_mib

    def drop(self, campaign: int) -> None:
        """Drop a campaign; its own process ends after closing its resources."""
        if campaign in self._idle:
            dropped = self._idle.pop(campaign)
            dropped.drop(campaign)
            self._close(dropped)
        if SHARED in self._idle:
            self._idle[SHARED].drop(campaign)
        self.active.drop(campaign)
        if self._group == campaign:
            self._group = None  # it finishes the episodes that it holds, and takes no more

    def replace(self) -> None:
        """Start another active process after the present one has ended."""
        self._group, self.active = None, self._start()

    def clean_up(self) -> None:
        """End idle processes that have exited or use too much, and those that have closed."""
        if (now_s := time.monotonic()) < self._next_check_s:
            return
        self._next_check_s = now_s + CHECK_EVERY_S
        for group, process in list(self._idle.items()):
            # Threads that a planner has left behind may use more and more memory.
            if process.has_ended() or process.find_excess() or not self._is_small(process):
                self._idle.pop(group).end()
        late = [
            each
            for each, until_s in self._closing
            if each.has_ended() or now_s > until_s or each.find_excess()
        ]
        for process in late:
            process.end()
        self._closing = [each for each in self._closing if each[0] not in late]

    def _close(self, process: ChildProcess) -> None:
        process.finish()
        # It is not waited for: the next campaign starts meanwhile.
        self._closing.append((process, time.monotonic() + CLOSING_S))

    def end(self) -> None:
        """Kill all processes."""
        for process in (*self._idle.values(), *(each for each, _ in self._closing)):
            process.end()
        self._idle.clear()
        self._closing.clear()
        self.active.end()
