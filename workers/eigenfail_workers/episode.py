"""One episode, as the paper tells it."""

from eigenfail.contracts import Simulation
from eigenfail.errors import SimulatorError
from eigenfail.values import Conversion, DisturbanceModel
from eigenfail_workers.measures.geometry import nearest
from eigenfail_workers.measures.recorder import Recorder
from eigenfail_workers.noise.models import deviations
from eigenfail_workers.noise.sources import NoiseSource


def run_episode(
    simulation: Simulation,
    seed: int,
    model: DisturbanceModel,
    noise: NoiseSource,
    recorder: Recorder,
) -> None:
    """Observe, disturb and step until the episode ends; the recorder sees everything.

    Raises:
        EpisodeError: the episode cannot be completed; the recorder holds what there is of it.
    """
    conversion = Conversion(model.shape)
    observation = simulation.reset(seed)
    recorder.sees(observation)
    while not observation.ended:
        actor = observation.others[nearest(observation.ego, observation.others)]
        sigma = deviations(model, observation.ego, actor)
        z = noise.draw(observation, actor)
        recorder.injects(z, sigma)
        observation = simulation.step(conversion.to_metres(z, sigma))
        recorder.sees(observation)
        if recorder.steps >= simulation.steps and not observation.ended:
            raise SimulatorError(
                f"The episode did not end at its horizon of {simulation.steps} steps.",
                "The simulation must set `ended` there.",
            )
