"""Runs the episodes of a campaign on a bridge, side by side."""

from collections.abc import Iterator, Sequence
from time import monotonic

from eigenfail import bridges
from eigenfail.errors import BridgeLost, EpisodeError, InputError
from eigenfail.values import EpisodeResult, EpisodeSetup, EpisodeTask, Policy, unrunnable
from eigenfail_workers.bridge.again import Again
from eigenfail_workers.bridge.drive import Drive
from eigenfail_workers.bridge.line import Line, line_of_this_worker
from eigenfail_workers.bridge.slots import Slots
from eigenfail_workers.bridge.staging import check
from eigenfail_workers.faults import fault
from eigenfail_workers.noise.policy import keep


class BridgeEngine:
    """Implements `LockstepEngine`.

    Args:
        setup: what all episodes share; `scenario` and `planner` are the bridge's own names.
        line: to the bridge; opened with the first episode.

    Raises:
        InvalidValue: no horizon, or a parameter or setting that no bridge can be told.
    """

    def __init__(self, setup: EpisodeSetup, line: Line) -> None:
        self._setup = setup
        self._line = line
        self._variation = bridges.variation(setup.scenario_parameters)
        self._settings = bridges.read_plain(setup.planner_settings, "planner_settings")
        self._policies: dict[int, Policy] = {}
        self._slots = Slots()
        self._again = Again()
        self._done: list[EpisodeResult] = []
        self._heard_s = monotonic()

    def learn(self, policy: Policy) -> None:
        """Keep a policy version, as it is now; the oldest make room."""
        keep(self._policies, policy)

    @property
    def room(self) -> int:
        """How many more may begin: none before `turn` was asked for what did not; one at first."""
        if self._done or self._again or self._suspect_runs:
            return 0
        return self._free_slots

    @property
    def _suspect_runs(self) -> bool:
        return any(self._again.is_suspect(drive.task) for drive in self._slots.drives())

    @property
    def _free_slots(self) -> int:
        if not self._line.is_open:
            return 1
        return self._line.connection(self._left_s).welcome.slots - len(self._slots)

    @property
    def _left_s(self) -> float:
        """Until the worker would take this process for one that hangs, and somewhat less. [s]"""
        held = max(1, len(self._slots) + len(self._again))
        return held * self._line.patience.episode_s - (monotonic() - self._heard_s)

    def begin(self, task: EpisodeTask) -> None:
        """Put an episode into a free slot; what keeps it from there becomes its result."""
        self._heard_s = monotonic()
        try:
            self._put(task)
        except (EpisodeError, InputError) as error:
            self._done.append(unrunnable(task, fault(error)))

    def _put(self, task: EpisodeTask) -> None:
        parameters = self._variation.draw(task.seed)
        drive = Drive(self._setup, task, parameters, self._settings, self._policies)
        if not self._slots:
            self._line.renew()
        slot = self._slots.free()
        check(self._line.connection(self._left_s).welcome, drive.start(slot), drive.dt_s)
        self._slots.put(slot, drive)

    def turn(self) -> list[EpisodeResult]:
        """Ask those that are not asked yet, and hear one answer; what is finished by then."""
        self._begin_anew()
        if self._slots:
            try:
                self._done += self._heard()
            except BridgeLost as error:
                self._line.drop()
                self._done += self._again.lost(self._slots.clear(), error)
            except (EpisodeError, InputError) as error:
                self._line.drop()
                self._done += self._slots.fail(error)
        done, self._done = self._done, []
        if done:
            self._heard_s = monotonic()
            self._again.forget(done)
        return done

    def _heard(self) -> list[EpisodeResult]:
        connection = self._line.connection(self._left_s)
        self._slots.ask(connection)
        return self._slots.hear(connection.receive(self._left_s), connection)

    def _begin_anew(self) -> None:
        """Put back what was in a bridge that was lost; all of it is given up if none comes back."""
        while self._again and self._free_slots and not self._suspect_runs:
            task = self._again.next(len(self._slots))
            if task is None:
                return
            try:
                self._put(task)
            except (EpisodeError, InputError) as error:
                left = (task, *self._again.give_up())
                self._done += [unrunnable(each, fault(error)) for each in left]

    def run(self, tasks: Sequence[EpisodeTask]) -> Iterator[EpisodeResult]:
        """The results, in the order of the tasks."""
        waiting, results = list(reversed(tasks)), dict[int, EpisodeResult]()
        for task in tasks:
            while task.index not in results:
                while waiting and self.room:
                    self.begin(waiting.pop())
                results |= {result.index: result for result in self.turn()}
            yield results.pop(task.index)

    def close(self) -> None:
        """Let go of what is under way; the connection stays, for other campaigns."""
        if self._slots:
            self._line.drop()


def from_setup(setup: EpisodeSetup) -> BridgeEngine:
    """The engine of a campaign on the bridge of this worker.

    Raises:
        InvalidValue: this worker has none, or the campaign asks for what no bridge can be told.
    """
    return BridgeEngine(setup, line_of_this_worker())
