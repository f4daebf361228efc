"""Engine that runs the episodes of a campaign on a bridge, several side by side."""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from time import monotonic
from typing import NamedTuple

from eigenfail import bridges
from eigenfail.errors import BridgeLost, EpisodeError, InputError, UnknownName
from eigenfail.values.episode import EpisodeResult, EpisodeSetup, EpisodeTask, unrunnable
from eigenfail.values.learning import Policy
from eigenfail.worlds import resolve_disturbance
from eigenfail_workers.accounts import RecordedStep
from eigenfail_workers.bridge import messages
from eigenfail_workers.bridge.connection import (
    Connection,
    SharedConnection,
    connect_from_environment,
)
from eigenfail_workers.bridge.episode import BridgeCampaign, BridgeEpisode
from eigenfail_workers.faults import make_fault
from eigenfail_workers.noise.campaign_noise import CampaignNoise

MAX_LOSSES = 3

SlotGroup = dict[int, BridgeEpisode]
"""Episodes by slot."""


class RetryQueue:
    """Episodes to run again because the bridge was lost while they ran.

    An episode that one more loss would fail runs alone, so that the loss can be attributed to it.
    """

    def __init__(self) -> None:
        self._losses: dict[int, int] = {}
        self._waiting: deque[EpisodeTask] = deque()

    def __len__(self) -> int:
        """Number of episodes that wait to be run again."""
        return len(self._waiting)

    def add(self, episodes: list[BridgeEpisode], error: BridgeLost) -> list[EpisodeResult]:
        """Count a loss for each episode; return the results of episodes out of attempts."""
        results = []
        for episode in episodes:
            index = episode.task.index
            self._losses[index] = self._losses.get(index, 0) + 1
            if self._losses[index] < MAX_LOSSES:
                self._waiting.append(episode.task)
            else:
                said = f"It was loss no. {MAX_LOSSES} while this episode ran, the last time alone."
                last = BridgeLost(f"{error.problem} {said}", error.remedy)
                results.append(episode.fail(last, len(episodes)))
        # Those that may run beside others go first; a suspect must wait until it is alone.
        self._waiting = deque(sorted(self._waiting, key=self.is_suspect))
        return results

    def is_suspect(self, task: EpisodeTask) -> bool:
        """Return whether one more loss would fail the episode."""
        return self._losses.get(task.index, 0) == MAX_LOSSES - 1

    def pop(self, beside: int) -> EpisodeTask | None:
        """Return the next episode, or None if it must wait for the episodes that run."""
        if not self._waiting or (beside and self.is_suspect(self._waiting[0])):
            return None
        return self._waiting.popleft()

    def clear(self) -> list[EpisodeTask]:
        """Remove and return all episodes that wait."""
        removed = list(self._waiting)
        self._waiting.clear()
        return removed

    def forget(self, results: Iterable[EpisodeResult]) -> None:
        """Forget the losses of finished episodes."""
        for result in results:
            self._losses.pop(result.index, None)


class PendingRequest(NamedTuple):
    """A request that the bridge has not answered yet.

    Attributes:
        group: group of episodes that the request is for.
        slots: slots that it requests, in order.
    """

    group: SlotGroup
    slots: tuple[int, ...]


class SlotTable:
    """The episodes in the slots of a bridge, in two groups that take turns.

    The bridge steps one group while this process measures another. A request covers either the new
    or the running episodes of a group; the group's next request follows after the answer.
    The result of an episode does not depend on the number of episodes that run alongside.
    """

    def __init__(self) -> None:
        self._groups: tuple[SlotGroup, SlotGroup] = {}, {}
        self._pending: dict[int, PendingRequest] = {}

    def __len__(self) -> int:
        """Number of episodes that run."""
        return sum(map(len, self._groups))

    def find_free(self) -> int:
        """Return the lowest slot without an episode."""
        taken = self._groups[0].keys() | self._groups[1].keys()
        return next(slot for slot in range(len(taken) + 1) if slot not in taken)

    def add(self, slot: int, episode: BridgeEpisode) -> None:
        """Add an episode, which begins with the next request of its group."""
        # Groups of equal size keep both the bridge and this process busy.
        min(self._groups, key=len)[slot] = episode

    def send_requests(self, connection: Connection) -> None:
        """Send the next request of each group without a pending one.

        Raises:
            BridgeLost: a request cannot be sent.
        """
        # By identity: groups are dictionaries, and two empty ones are equal.
        waiting = [id(request.group) for request in self._pending.values()]
        for group in self._groups:
            if id(group) not in waiting:
                self._send(connection, group)

    def _send(self, connection: Connection, group: SlotGroup) -> None:
        new = tuple(slot for slot, episode in group.items() if not episode.has_begun)
        begun = tuple(slot for slot, episode in group.items() if episode.has_begun)
        # Episodes begin and go on in one turn of the group: two requests, in this order.
        if new:
            starts = tuple([group[slot].make_start(slot) for slot in new])
            reset = messages.ResetRequest(connection.session, connection.next_id(), starts)
            connection.send(reset)
            self._pending[reset.id] = PendingRequest(group, new)
        if begun:
            steps = tuple([group[slot].make_step(slot) for slot in begun])
            step = messages.StepRequest(connection.session, connection.next_id(), steps)
            connection.send(step)
            self._pending[step.id] = PendingRequest(group, begun)

    def process(
        self, answer: messages.Observations | messages.Closed, connection: Connection
    ) -> list[EpisodeResult]:
        """Advance the episodes of an answer, and return the results of ended episodes.

        Raises:
            SimulatorError: the answer matches no request, or has another number of slots.
        """
        request = self._pending.pop(answer.id, None)
        group, slots = request or ({}, ())
        observations = messages.match_answer(answer, answer.id if request else None, len(slots))
        beside, results = len(self), list[EpisodeResult]()
        for slot, seen in zip(slots, observations, strict=True):
            result = group[slot].advance(seen, beside, connection)
            if result is not None:
                del group[slot]
                results.append(result)
        return results

    def fail(self, error: EpisodeError | InputError) -> list[EpisodeResult]:
        """Remove all episodes, and return their results."""
        beside = len(self)
        return [episode.fail(error, beside) for episode in self.clear()]

    def clear(self) -> list[BridgeEpisode]:
        """Remove and return all episodes."""
        episodes = self.list_episodes()
        self._pending.clear()
        for group in self._groups:
            group.clear()
        return episodes

    def list_episodes(self) -> list[BridgeEpisode]:
        """Return the episodes that run."""
        return [episode for group in self._groups for episode in group.values()]


class BridgeEngine:
    """Runs episodes in the slots of a bridge. Implements `LockstepEngine`.

    Args:
        setup: setup of the campaign; `scenario` and `planner` are names that the bridge offers.
        connection: connection to the bridge; opened with the first episode.
        recorded: list that is filled with the steps of the last episode, as the bridge explains
            them; None if it is not asked to.

    Attributes:
        declined: reason why no episode of the campaign can run on this bridge: all episodes need a
            name that the bridge does not offer. Empty as long as no such name is known.

    Raises:
        InvalidValue: the horizon is missing, or a parameter or setting cannot be sent to a bridge.
    """

    def __init__(
        self,
        setup: EpisodeSetup,
        connection: SharedConnection,
        recorded: list[RecordedStep] | None = None,
    ) -> None:
        model = resolve_disturbance(setup)
        settings = bridges.read_plain(setup.planner_settings, "planner_settings")
        self._campaign = BridgeCampaign(
            setup, settings, model, CampaignNoise(model), setup.make_judge(), recorded
        )
        self._connection = connection
        self._variation = bridges.variation(setup.scenario_parameters, model=model)
        self._horizon = self._variation.largest(lambda parameters: int(parameters.steps))
        self._slots = SlotTable()
        self._retries = RetryQueue()
        self._done: list[EpisodeResult] = []
        self._progress_s = monotonic()
        self.declined = ""

    def add_policy(self, policy: Policy) -> None:
        """Store a copy of a policy version; the oldest versions are dropped."""
        self._campaign.noise.add_policy(policy)

    @property
    def room(self) -> int:
        """Number of episodes that may begin; 0 until `turn` has handled failures, 1 at first."""
        if self._done or self._retries or self._suspect_runs:
            return 0
        return self._free_slots

    @property
    def _suspect_runs(self) -> bool:
        return any(self._retries.is_suspect(each.task) for each in self._slots.list_episodes())

    @property
    def _free_slots(self) -> int:
        if not self._connection.is_open:
            return 1
        return self._connection.get(self._left_s).welcome.slots - len(self._slots)

    @property
    def _left_s(self) -> float:
        """Time until shortly before the worker would kill this process for taking too long. [s]"""
        # The worker multiplies its limit by the episodes that it has begun; those to run again
        # count.
        held = max(1, len(self._slots) + len(self._retries))
        return held * self._connection.timeouts.episode_s - (monotonic() - self._progress_s)

    def begin(self, task: EpisodeTask) -> None:
        """Put an episode into a free slot; an error that prevents this becomes its result."""
        self._progress_s = monotonic()
        try:
            self._start(task)
        except (EpisodeError, InputError) as error:
            self._done.append(unrunnable(task, make_fault(error)))

    def _start(self, task: EpisodeTask) -> None:
        z = self._campaign.noise.choose(task, self._horizon)
        parameters = self._variation.draw(task.seed, z)
        # With episodes in flight a disconnection must count as a loss of each of them.
        if not self._slots:
            self._connection.drop_if_dead()
        slot = self._slots.find_free()
        try:
            welcome = self._connection.get(self._left_s).welcome
            episode = BridgeEpisode(self._campaign, task, parameters, welcome)
        except UnknownName as error:
            self.declined = str(error)
            raise
        self._slots.add(slot, episode)

    def turn(self) -> list[EpisodeResult]:
        """Send the requests that are due, process one answer, and return finished episodes."""
        self._start_retries()
        if self._slots:
            try:
                # Opened again here if an error has closed it: waiting episodes need no other path.
                connection = self._connection.get(self._left_s)
                self._slots.send_requests(connection)
                answer = connection.receive(self._left_s)
                self._done += self._slots.process(answer, connection)
            except BridgeLost as error:
                self._connection.drop()
                self._done += self._retries.add(self._slots.clear(), error)
            except (EpisodeError, InputError) as error:
                self._connection.drop()
                self._done += self._slots.fail(error)
        done, self._done = self._done, []
        if done:
            self._progress_s = monotonic()
            self._retries.forget(done)
        return done

    def _start_retries(self) -> None:
        """Run lost episodes again; if that fails, all of them fail, as no bridge answers."""
        while self._retries and self._free_slots and not self._suspect_runs:
            task = self._retries.pop(len(self._slots))
            if task is None:
                return
            try:
                self._start(task)
            except (EpisodeError, InputError) as error:
                failed = (task, *self._retries.clear())
                self._done += [unrunnable(each, make_fault(error)) for each in failed]

    def run(self, tasks: Sequence[EpisodeTask]) -> Iterator[EpisodeResult]:
        """Yield the results in the order of the tasks."""
        waiting, results = list(reversed(tasks)), dict[int, EpisodeResult]()
        for task in tasks:
            while task.index not in results:
                while waiting and self.room:
                    self.begin(waiting.pop())
                results |= {result.index: result for result in self.turn()}
            yield results.pop(task.index)

    def close(self) -> None:
        """Abandon the episodes that run; the connection stays open for other campaigns."""
        if self._slots:
            self._connection.drop()


def make_bridge_engine(setup: EpisodeSetup) -> BridgeEngine:
    """Return the engine of a campaign on the bridge of this worker.

    Raises:
        InvalidValue: this worker lacks a bridge, or the campaign cannot be sent to one.
    """
    return BridgeEngine(setup, connect_from_environment())
