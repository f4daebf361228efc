"""One episode, as the paper tells it."""

from msgspec.structs import replace

from eigenfail.contracts import Simulation
from eigenfail.errors import SimulatorError
from eigenfail.values import (
    Conversion,
    DisturbanceModel,
    EpisodeFault,
    EpisodeResult,
    EpisodeSetup,
    EpisodeTask,
    Observation,
    Outcome,
    unrunnable,
)
from eigenfail_workers.measures.geometry import nearest
from eigenfail_workers.measures.recorder import Recorder
from eigenfail_workers.noise.models import deviations
from eigenfail_workers.noise.sources import NoiseSource

Pair = tuple[float, float]


class Tester:
    """Observes and disturbs one episode, whoever steps it; the recorder sees everything.

    Args:
        steps: the horizon.
    """

    def __init__(
        self, model: DisturbanceModel, noise: NoiseSource, recorder: Recorder, steps: int
    ) -> None:
        self._model = model
        self._conversion = Conversion(model.shape)
        self._noise = noise
        self._recorder = recorder
        self._steps = steps

    def disturb(self, observation: Observation) -> Pair | None:
        """The disturbance of the next step [m]; None if the episode has ended.

        Raises:
            SimulatorError: a vehicle is nowhere, or the episode goes on beyond its horizon.
        """
        recorder = self._recorder
        recorder.sees(observation)
        if observation.ended:
            return None
        if recorder.steps >= self._steps:
            raise SimulatorError(
                f"The episode did not end at its horizon of {self._steps} steps.",
                "The simulation must set `ended` there.",
            )
        actor = observation.others[nearest(observation.ego, observation.others)]
        sigma = deviations(self._model, observation.ego, actor)
        z = self._noise.draw(observation, actor)
        recorder.injects(z, sigma)
        return self._conversion.to_metres(z, sigma)


def run_episode(
    simulation: Simulation,
    seed: int,
    model: DisturbanceModel,
    noise: NoiseSource,
    recorder: Recorder,
) -> None:
    """Observe, disturb and step until the episode ends.

    Raises:
        EpisodeError: the episode cannot be completed; the recorder holds what there is of it.
    """
    tester = Tester(model, noise, recorder, simulation.steps)
    disturbance = tester.disturb(simulation.reset(seed))
    while disturbance is not None:
        disturbance = tester.disturb(simulation.step(disturbance))


def completed(
    setup: EpisodeSetup, task: EpisodeTask, noise: NoiseSource, recorder: Recorder, dt_s: float
) -> EpisodeResult:
    """The result of an episode that ended, but for its wall time."""
    keep_scene = recorder.collided or task.index % setup.scene_every == 0
    return EpisodeResult(
        index=task.index,
        seed=task.seed,
        outcome=Outcome.COLLISION if recorder.collided else Outcome.SAFE,
        steps=recorder.steps,
        noise=recorder.noise(),
        source=task.source_kind,
        measures=recorder.measures(dt_s),
        states=noise.states(),
        scene=recorder.scene(dt_s) if keep_scene else None,
    )


def failed(task: EpisodeTask, recorder: Recorder, why: EpisodeFault) -> EpisodeResult:
    """What is left of an episode that could not be completed."""
    return replace(unrunnable(task, why), steps=recorder.steps, noise=recorder.noise())
