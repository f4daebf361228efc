"""One slot of a bridge, stepped by itself: for checks; campaigns run in `engine`."""

from msgspec.structs import replace

from eigenfail.errors import SimulatorError
from eigenfail.values import Observation
from eigenfail_workers.bridge.connection import Connection
from eigenfail_workers.bridge.messages import Closed, Push, Reset, Seen, Start, Step
from eigenfail_workers.bridge.observing import after_step, at_start
from eigenfail_workers.bridge.staging import scenario_of

Pair = tuple[float, float]


class BridgeSimulation:
    """A slot of a bridge. Implements `Simulation`.

    Args:
        connection: that nobody else uses meanwhile; it stays open.
        start: what to begin; the seed is that of each reset.
    """

    def __init__(self, connection: Connection, start: Start) -> None:
        self._connection = connection
        self._start = start
        self.dt_s = scenario_of(connection.welcome, start.scenario).dt_s
        self.steps = start.steps
        self._now: Observation | None = None
        self._closed = False

    def reset(self, seed: int) -> Observation:
        """Begin an episode; see `Simulation.reset`."""
        if self._closed:
            raise SimulatorError("The simulation is closed.", "Open another one.")
        self._now = None
        start = replace(self._start, seed=seed)
        self._now = at_start(self._ask(Reset(self._connection.session, self._id(), (start,))))
        return self._now

    def step(self, disturbance: Pair) -> Observation:
        """Disturb and step; see `Simulation.step`."""
        now = self._now
        if now is None or now.ended or self._closed:
            raise SimulatorError("There is no episode to go on with.", "Reset the simulation.")
        self._now = None
        push = Push(self._start.slot, disturbance)
        seen = self._ask(Step(self._connection.session, self._id(), (push,)))
        self._now = after_step(seen, now, disturbance, self.dt_s)
        return self._now

    def _id(self) -> int:
        return self._connection.next_id()

    def _ask(self, request: Reset | Step) -> Seen:
        self._connection.send(request)
        (seen,) = answers(self._connection, request)
        return seen

    def close(self) -> None:
        """Ask no more."""
        self._closed = True
        self._now = None


def answers(connection: Connection, request: Reset | Step) -> tuple[Seen, ...]:
    """What comes of the only request under way.

    Raises:
        EpisodeError: the answer is none to this request, or an error.
        InvalidValue: it is an error, for which the campaign is to blame.
    """
    answer = connection.receive(connection.patience.answer_s)
    if isinstance(answer, Closed) or answer.id != request.id:
        raise SimulatorError("The bridge answered another question.", "It repeats its `id`.")
    if len(answer.slots) != len(request.slots):
        problem = f"The bridge answered for {len(answer.slots)} of {len(request.slots)} slots."
        raise SimulatorError(problem, "It answers for each slot of the request, in its order.")
    return answer.slots
