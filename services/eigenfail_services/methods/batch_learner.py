"""Learners with an estimator that requests noise in batches.

The estimator is a generator, see `statistics.batches`. The learner proposes its batches in rounds,
in the order of the requests. The state is only the robustness of every episode: the noise follows
from the robustness and the seed.
"""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from typing import Annotated, ClassVar, Generic, Protocol, TypeVar

import msgspec
import numpy as np

from eigenfail.errors import InvalidValue
from eigenfail.values import learning
from eigenfail.values.episode import EpisodeResult, TrajectorySource
from eigenfail.values.learning import LearnerContext, Proposal
from eigenfail_services.methods import archive, robustness_m
from eigenfail_services.statistics.batches import Array, Requester, Requests


class BatchSimulation(Protocol):
    """An estimator that requests noise in batches."""

    def run(self) -> Requests:
        """Request noise. Call this once."""


S = TypeVar("S", bound=BatchSimulation)


class SimulationDriver(Generic[S]):
    """Drives a simulation: proposes its trajectories in parts, and collects their robustness.

    Attributes:
        simulation: simulation that requests the trajectories.
        robustness: robustness of all trajectories so far, in order; NaN for errored episodes. [m]
        taken: number of trajectories taken from the open batches.
    """

    def __init__(self, simulation: S) -> None:
        self.simulation = simulation
        self._requester = Requester(simulation.run())
        self._batches = deque(self._requester.start())
        self._received: list[float] = []
        self.robustness: list[float] = []
        self.taken = 0

    @property
    def is_done(self) -> bool:
        """True if the simulation has ended."""
        return not self._batches

    @property
    def requested(self) -> int:
        """Number of trajectories in the open batches, which still lack results."""
        return sum(map(len, self._batches))

    def take_trajectories(self, n: int) -> Array:
        """Return the next trajectories of one batch, (up to n, steps, channels).

        Raises:
            ValueError: all requested trajectories were taken, and the simulation waits for results.
        """
        before = self.taken
        for batch in self._batches:
            if before < len(batch):
                chosen = batch[before : before + n]
                self.taken += len(chosen)
                return chosen
            # `taken` counts over all open batches: those before this one were taken whole.
            before -= len(batch)
        raise ValueError("there is no trajectory to be taken")

    def add_robustness(self, robustness: Sequence[float]) -> None:
        """Add the robustness of the next trajectories; this may complete several batches.

        Raises:
            ValueError: the simulation has ended.
        """
        for value in robustness:
            if self.is_done:
                raise ValueError("there are more episodes than the simulation requested")
            self.robustness.append(value)
            self._received.append(value)
            if len(self._received) == len(self._batches[0]):
                self.taken -= len(self._batches.popleft())
                self._batches.extend(self._requester.answer(np.array(self._received)))
                self._received = []


MAX_VALUES_PER_ROUND = 5_000_000
"""Most values of noise in a round, which is sent as one message."""


def limit_round(context: LearnerContext, round_size: int) -> int:
    """Return the number of episodes whose noise fits one message, at most `round_size`."""
    return min(round_size, 1 + MAX_VALUES_PER_ROUND // (context.channels * context.horizon))


def check_values(method: str, most: int, context: LearnerContext, remedy: str) -> None:
    """Raise InvalidValue if the noise of an episode has more than `most` values."""
    values = context.channels * context.horizon
    if values > most:
        raise InvalidValue(
            "method",
            f"{method} takes noise of up to {most} values, and {context.horizon} steps have "
            f"{values}.",
            remedy,
        )


class BatchLearner(ABC, Generic[S]):
    """A learner that proposes the batches of a simulation, at most a round at a time.

    Attributes:
        kind: name of the method in its states.
        lookahead: 0 without `parallel`, and while the simulation waits for all its requests;
            otherwise as many rounds as `parallel` needs.

    Args:
        context: context of the campaign.
        round_size: maximum number of episodes in a round; it is reduced if a round would be too
            large for one message.
    """

    kind: ClassVar[str]
    lookahead = 0

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """State besides robustness: the number of proposed episodes of the open batches."""

        proposed: Annotated[int, msgspec.Meta(ge=0)]

    def __init__(self, context: LearnerContext, round_size: int) -> None:
        self._context = context
        self._round_size = limit_round(context, round_size)
        self._ahead = 0
        if context.parallel:
            self._round_size = min(self._round_size, learning.choose_group_size(context.parallel))
            # More where `round_size` makes rounds smaller than groups.
            wanted = learning.count_rounds_ahead(
                context.parallel, self._round_size, learning.OPEN_GROUPS - 1
            )
            self._ahead = min(wanted, learning.MOST_OPEN_ROUNDS - 1)
        self._drive(SimulationDriver(self._make_simulation()))

    @abstractmethod
    def _make_simulation(self) -> S:
        """Return the simulation of the campaign, before its first batch."""

    @property
    def _is_spent(self) -> bool:
        """True if all episodes of the budget have a result."""
        return len(self._driver.robustness) >= self._context.episodes

    def propose(self, n: int) -> Proposal:
        """Return the next trajectories of a batch, at most a round; empty after the end."""
        if self._driver.is_done:
            return Proposal(())
        # Rounded as messages and the database keep it, so that a replay has the same noise.
        chosen = self._driver.take_trajectories(min(n, self._round_size)).astype(np.float32)
        self._look_ahead()
        return Proposal(tuple(map(TrajectorySource, chosen)))

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Add the robustness of episodes; a complete batch triggers the next batch."""
        self._driver.add_robustness([robustness_m(result) for result in results])
        self._look_ahead()

    def state(self) -> bytes:
        """Return the robustness of all episodes so far."""
        values: archive.Array = np.array(self._driver.robustness, np.float64)
        facts = self._Facts(self._driver.taken)
        return archive.write(self.kind, facts, {"robustness_m": values})

    def restore(self, state: bytes) -> None:
        """Restore a state by running the simulation again with the known robustness.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        facts, arrays = archive.read(self.kind, state, self._Facts)
        # A new simulation, kept only if the whole state could be read.
        driver = SimulationDriver(self._make_simulation())
        with archive.wrap_errors(self.kind):
            driver.add_robustness(arrays["robustness_m"].astype(np.float64).tolist())
            if facts.proposed > driver.requested:
                raise ValueError(
                    f"{facts.proposed} trajectories of {driver.requested} were proposed"
                )
        driver.taken = facts.proposed
        self._drive(driver)

    def _drive(self, driver: SimulationDriver[S]) -> None:
        self._driver = driver
        self._look_ahead()

    def _look_ahead(self) -> None:
        """Set the lookahead to 0 while the simulation waits for its open rounds."""
        waits = self._driver.taken == self._driver.requested
        self.lookahead = 0 if waits else self._ahead
