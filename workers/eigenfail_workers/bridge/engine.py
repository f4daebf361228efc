"""Runs the episodes of a campaign on a bridge, side by side."""

from collections.abc import Iterator, Sequence

from eigenfail import bridges
from eigenfail.errors import EpisodeError, InputError
from eigenfail.values import EpisodeResult, EpisodeSetup, EpisodeTask, Policy, unrunnable
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
        self._done: list[EpisodeResult] = []

    def learn(self, policy: Policy) -> None:
        """Keep a policy version, as it is now; the oldest make room."""
        keep(self._policies, policy)

    @property
    def room(self) -> int:
        """How many more may begin: none before `turn` was asked for what did not; one at first."""
        if self._done:
            return 0
        if not self._line.is_open:
            return 1
        return self._line.connection().welcome.slots - len(self._slots)

    def begin(self, task: EpisodeTask) -> None:
        """Put an episode into a free slot; what keeps it from there becomes its result."""
        try:
            parameters = self._variation.draw(task.seed)
            drive = Drive(self._setup, task, parameters, self._settings, self._policies)
            if not self._slots:
                self._line.renew()
            slot = self._slots.free()
            check(self._line.connection().welcome, drive.start(slot), drive.dt_s)
        except (EpisodeError, InputError) as error:
            self._done.append(unrunnable(task, fault(error)))
        else:
            self._slots.put(slot, drive)

    def turn(self) -> list[EpisodeResult]:
        """Ask those that are not asked yet, and hear one answer; what is finished by then."""
        if self._slots:
            try:
                connection = self._line.connection()
                self._slots.ask(connection)
                self._done += self._slots.hear(connection.receive())
            except (EpisodeError, InputError) as error:
                self._line.drop()
                self._done += self._slots.fail(error)
        done, self._done = self._done, []
        return done

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
