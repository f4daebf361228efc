"""Learners whose estimator requests noise in waves.

Such an estimator is a generator: it yields a wave of trajectories and is sent their robustness. A
learner hands a wave out in rounds. Its state is the robustness of every episode and nothing else:
the noise follows from that and the seed.
"""

from abc import ABC, abstractmethod
from collections.abc import Generator, Sequence
from typing import Annotated, Any, ClassVar, Generic, Protocol, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values import EpisodeResult, LearnerContext, Proposal, TrajectorySource
from eigenfail_services.methods import archive, robustness_m

Array = NDArray[np.float64]


class WaveSimulation(Protocol):
    """An estimator that requests noise in waves."""

    def run(self) -> Generator[Array, Array, Any]:
        """Yield noise, shape (n, steps, 2); be sent robustness, shape (n,), NaN where errored."""


S = TypeVar("S", bound=WaveSimulation)


class SimulationDriver(Generic[S]):
    """Drives a simulation wave by wave: hands out its trajectories in pieces, collects robustness.

    Attributes:
        simulation: simulation that requests the trajectories.
        robustness: robustness of all trajectories so far, in order, NaN of errored episodes. [m]
        wave: trajectories that are requested, shape (n, steps, 2); empty after the end.
        proposed: number of trajectories of the wave that were taken.
    """

    def __init__(self, simulation: S) -> None:
        self.simulation = simulation
        self._running = simulation.run()
        self.robustness: list[float] = []
        self.wave: Array = next(self._running)
        self.proposed = 0
        self._received: list[float] = []

    @property
    def is_done(self) -> bool:
        """Whether the simulation has ended."""
        return not len(self.wave)

    def take(self, n: int) -> Array:
        """Return at most n of the remaining trajectories, shape (up to n, steps, 2)."""
        chosen = self.wave[self.proposed : self.proposed + n]
        self.proposed += len(chosen)
        return chosen

    def add_robustness(self, robustness: Sequence[float]) -> None:
        """Add the robustness of the next trajectories, which may fill several waves.

        Raises:
            ValueError: the simulation has ended.
        """
        for value in robustness:
            if self.is_done:
                raise ValueError("there are more episodes than the simulation requested")
            self.robustness.append(value)
            self._received.append(value)
            if len(self._received) == len(self.wave):
                self._finish_wave(np.array(self._received))

    def _finish_wave(self, robustness: Array) -> None:
        try:
            self.wave = self._running.send(robustness)
        except StopIteration:
            self.wave = self.wave[:0]
        self.proposed, self._received = 0, []


MAX_VALUES_PER_ROUND = 5_000_000
"""Most values of noise in a round, which is sent as one message."""


class WaveLearner(ABC, Generic[S]):
    """A learner that hands out the waves of a simulation, at most a round at a time.

    Attributes:
        kind: name of the method in its states.
        lookahead: 0, as each wave depends on the one before.

    Args:
        context: context of the campaign.
        round_size: episodes in a round at most; a round that is too large for one message is
            smaller.
    """

    kind: ClassVar[str]
    lookahead = 0

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """State besides robustness: number of episodes of the wave that were proposed."""

        proposed: Annotated[int, msgspec.Meta(ge=0)]

    def __init__(self, context: LearnerContext, round_size: int) -> None:
        self._context = context
        self._round_size = min(round_size, 1 + MAX_VALUES_PER_ROUND // (2 * context.horizon))
        self._driver = SimulationDriver(self._make_simulation())

    @abstractmethod
    def _make_simulation(self) -> S:
        """Return the simulation of the campaign, before its first wave."""

    @property
    def _is_spent(self) -> bool:
        """Whether all episodes of the budget have a result."""
        return len(self._driver.robustness) >= self._context.episodes

    def propose(self, n: int) -> Proposal:
        """Return the rest of the wave, at most a round; nothing after the end."""
        chosen = self._driver.take(min(n, self._round_size)).astype(np.float32)
        return Proposal(tuple(map(TrajectorySource, chosen)))

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Add the robustness of episodes; a complete wave leads to the next one."""
        self._driver.add_robustness([robustness_m(result) for result in results])

    def state(self) -> bytes:
        """Return the robustness of all episodes so far."""
        values: archive.Array = np.array(self._driver.robustness, np.float64)
        facts = self._Facts(self._driver.proposed)
        return archive.write(self.kind, facts, {"robustness_m": values})

    def restore(self, state: bytes) -> None:
        """Restore a state by running the simulation again with the known robustness.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        facts, arrays = archive.read(self.kind, state, self._Facts)
        driver = SimulationDriver(self._make_simulation())
        with archive.wrap_errors(self.kind):
            driver.add_robustness(arrays["robustness_m"].astype(np.float64).tolist())
            if facts.proposed > len(driver.wave):
                raise ValueError(
                    f"{facts.proposed} trajectories of a wave of {len(driver.wave)} were proposed"
                )
        driver.proposed = facts.proposed
        self._driver = driver
