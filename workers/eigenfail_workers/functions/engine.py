"""Runs the episodes of a campaign on a function, in this process."""

from collections.abc import Iterator, Sequence
from time import perf_counter

import numpy as np
from msgspec.structs import replace

from eigenfail.errors import EpisodeError, InputError, SimulatorError
from eigenfail.functions import LIMIT_S, FunctionParameters, FunctionUnderTest
from eigenfail.settings import read_settings
from eigenfail.values import (
    DisturbanceModel,
    EpisodeResult,
    EpisodeSetup,
    EpisodeTask,
    Measures,
    NoiseTrajectory,
    Observation,
    Outcome,
    Policy,
    VehicleState,
    unrunnable,
)
from eigenfail_workers.faults import blamed_on, fault
from eigenfail_workers.functions.asking import robustness_of
from eigenfail_workers.functions.finding import find
from eigenfail_workers.noise import sources
from eigenfail_workers.noise.policy import keep
from eigenfail_workers.noise.rounding import to_float32

NOBODY = VehicleState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""What an adversary sees where there is nobody: zero throughout."""


class FunctionEngine:
    """Implements `EpisodeEngine`: an episode is one call of a function of its whole noise.

    The function is given a_t = sigma · u_t, where sigma is the disturbance model's scale and u is
    z in the model's shape, so that with the default model it is given z. An adversary's policy
    chooses z step by step; of the scene it sees zeros, and the progress.

    Args:
        function: what is under test.
        steps: length of a noise trajectory.
        model: its scale and its shape count.
        limit_s: how long one call may take.
    """

    def __init__(
        self,
        function: FunctionUnderTest,
        steps: int,
        model: DisturbanceModel = DisturbanceModel(),  # noqa: B008 - it is frozen
        limit_s: float = LIMIT_S,
    ) -> None:
        self._function = function
        self._steps = steps
        self._shape = model.shape
        self._sigma = np.full((steps, 2), to_float32(model.scale), np.float32)
        self._limit_s = limit_s
        self._policies: dict[int, Policy] = {}

    def learn(self, policy: Policy) -> None:
        """Keep a policy version, as it is now; the oldest make room."""
        keep(self._policies, policy)

    def run(self, tasks: Sequence[EpisodeTask]) -> Iterator[EpisodeResult]:
        """The results, in the order of the tasks."""
        return map(self._run, tasks)

    def close(self) -> None:
        """Nothing is held."""

    def _run(self, task: EpisodeTask) -> EpisodeResult:
        began = perf_counter()
        try:
            with blamed_on(SimulatorError, "The noise", "Look into its source."):
                drawn = self._drawn(task)
            result = self._judged(drawn)
        except (EpisodeError, InputError) as error:
            result = unrunnable(task, fault(error))
        return replace(result, wall_s=perf_counter() - began)

    def _drawn(self, task: EpisodeTask) -> EpisodeResult:
        """The episode with its noise, before anything is known of its outcome."""
        given = sources.Circumstances(task.seed, self._steps, self._policies)
        source = sources.begin(task.source, given)
        seen = (Observation(step, NOBODY, (NOBODY,)) for step in range(self._steps))
        z = np.array([source.draw(observation, NOBODY) for observation in seen], np.float32)
        return EpisodeResult(
            index=task.index,
            seed=task.seed,
            outcome=Outcome.SAFE,
            steps=self._steps,
            noise=NoiseTrajectory(z, self._sigma, self._shape),
            source=task.source_kind,
            states=source.states(),
        )

    def _judged(self, drawn: EpisodeResult) -> EpisodeResult:
        """The episode with its outcome; for replay its noise is kept even if the function fails."""
        try:
            robustness = robustness_of(self._function, drawn.noise.metres.copy(), self._limit_s)
        except SimulatorError as error:
            return replace(drawn, outcome=Outcome.FAILED, states=None, fault=fault(error))
        outcome = Outcome.SAFE if robustness > 0.0 else Outcome.COLLISION
        return replace(drawn, outcome=outcome, measures=Measures(max(0.0, robustness)))


def from_setup(setup: EpisodeSetup) -> FunctionEngine:
    """The engine of a campaign on a function.

    Raises:
        UnknownName: a parameter that there is not.
        InvalidValue: a parameter outside its bounds, or no such function here.
    """
    given = read_settings(FunctionParameters, setup.scenario_parameters, "scenario_parameters")
    return FunctionEngine(find(setup.planner), given.steps, setup.disturbance, given.limit_s)
