"""One episode of a campaign in a slot of a bridge: what is asked next, and what came of it."""

from collections.abc import Mapping
from time import perf_counter

import msgspec
from msgspec.structs import replace

from eigenfail.bridges import Plain, foreign
from eigenfail.errors import EpisodeError, InputError, SimulatorError
from eigenfail.values import EpisodeResult, EpisodeSetup, EpisodeTask, Observation, Policy
from eigenfail_workers.bridge.connection import Connection
from eigenfail_workers.bridge.messages import Pair, Push, Seen, Start
from eigenfail_workers.bridge.observing import after_step, at_start
from eigenfail_workers.episode import Tester, completed, failed
from eigenfail_workers.faults import blamed_on, fault
from eigenfail_workers.measures.recorder import Recorder
from eigenfail_workers.noise import sources


class Drive:
    """An episode under way.

    Args:
        parameters: of its scenario; they hold `steps` and `dt_s`, too.
        settings: of the planner.
        policies: that it may name.

    Attributes:
        task: which episode it is.
    """

    def __init__(
        self,
        setup: EpisodeSetup,
        task: EpisodeTask,
        parameters: msgspec.Struct,
        settings: dict[str, Plain],
        policies: Mapping[int, Policy],
    ) -> None:
        self.task = task
        self._setup = setup
        self._settings = settings
        self._foreign = foreign(parameters)
        named = msgspec.structs.asdict(parameters)
        self._steps, self._dt_s = int(named["steps"]), float(named["dt_s"])
        self._spent_s, self._looked_s = 0.0, perf_counter()
        self._recorder = Recorder(setup.disturbance.shape)
        given = sources.Circumstances(task.seed, self._steps, policies)
        self._noise = sources.begin(task.source, given)
        self._tester = Tester(setup.disturbance, self._noise, self._recorder, self._steps)
        self._seen: Observation | None = None
        self._disturbance: Pair = (0.0, 0.0)

    @property
    def dt_s(self) -> float:
        """What the campaign takes for the duration of a step. [s]"""
        return self._dt_s

    @property
    def has_begun(self) -> bool:
        """Whether the bridge has shown its start."""
        return self._seen is not None

    def start(self, slot: int) -> Start:
        """What its reset says."""
        setup = self._setup
        return Start(
            slot,
            self.task.seed,
            setup.scenario,
            self._foreign,
            setup.planner,
            self._settings,
            self._steps,
        )

    def push(self, slot: int) -> Push:
        """What its next step says."""
        return Push(slot, self._disturbance)

    def hear(self, seen: Seen, beside: int, connection: Connection) -> EpisodeResult | None:
        """Take what the bridge shows; the result, if the episode is over.

        Args:
            seen: the answer to what was asked last.
            beside: how many episodes share its time, itself included.
            connection: over which it was shown.
        """
        try:
            with blamed_on(SimulatorError, "The episode", "Look into the bridge."):
                return self._go_on(seen, beside, connection)
        except (EpisodeError, InputError) as error:
            return self.fail(error, beside)

    def _go_on(self, seen: Seen, beside: int, connection: Connection) -> EpisodeResult | None:
        before, wall_s = self._seen, self._wall_s(beside)
        if before is None:
            now = at_start(seen)
        else:
            now = after_step(seen, before, self._disturbance, self._dt_s)
        self._seen = now
        disturbance = self._tester.disturb(now)
        if disturbance is None:
            done = completed(self._setup, self.task, self._noise, self._recorder, self._dt_s)
            return replace(done, wall_s=wall_s)
        self._disturbance = disturbance
        if wall_s > connection.patience.episode_s:
            raise connection.too_slow()
        return None

    def fail(self, error: EpisodeError | InputError, beside: int) -> EpisodeResult:
        """What is left of it."""
        left = failed(self.task, self._recorder, fault(error))
        return replace(left, wall_s=self._wall_s(beside))

    def _wall_s(self, beside: int) -> float:
        """Its part of the time so far: since the last look, of as many as there are beside it."""
        now_s = perf_counter()
        self._spent_s += (now_s - self._looked_s) / beside
        self._looked_s = now_s
        return self._spent_s
