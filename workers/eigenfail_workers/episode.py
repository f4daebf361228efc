"""The loop of one episode: observe, disturb, step, and record."""

from msgspec.structs import replace

from eigenfail.contracts import Simulation
from eigenfail.errors import SimulatorError
from eigenfail.values import episode
from eigenfail.values.channels import PARAMETER
from eigenfail.values.disturbance import Conversion, DisturbanceModel
from eigenfail.values.measures import MAX_MAGNITUDE, MEASURES, Measures
from eigenfail.values.scene import Observation
from eigenfail.values.shapes import Row
from eigenfail_workers.measures.geometry import find_nearest
from eigenfail_workers.measures.recorder import Recorder
from eigenfail_workers.noise.deviations import Deviations
from eigenfail_workers.noise.sources import NoiseSource


class EpisodeDriver:
    """Observes, disturbs and records one episode, which its caller steps.

    Args:
        model: model of the disturbances.
        noise: source of standardised noise.
        recorder: recorder of the episode.
        steps: horizon of the episode.
        dt_s: duration of a step.
    """

    def __init__(
        self,
        model: DisturbanceModel,
        noise: NoiseSource,
        recorder: Recorder,
        steps: int,
        dt_s: float,
    ) -> None:
        self._model = model
        self._deviations = Deviations(model)
        self._conversion = Conversion(model.noise_shape)
        channels = model.list_channels()
        self._perceived = [n for n, each in enumerate(channels) if each.kind is not PARAMETER]
        self._perceives_all = len(self._perceived) == len(channels)
        self._noise = noise
        self._recorder = recorder
        self._steps = steps
        self._dt_s = dt_s

    def disturb(self, seen: Observation) -> Row | None:
        """Return the disturbance of the next step, of each channel; None if the episode has ended.

        Raises:
            EpisodeError: an observation is not finite, or contradicts itself; or the episode ends
                before its horizon without a collision, or exceeds it.
            InvalidValue: the episode starts in a collision.
        """
        recorder = self._recorder
        observation = recorder.observe(seen, self._dt_s)
        if observation.ended:
            self._check_end(observation)
            return None
        if recorder.steps >= self._steps:
            raise SimulatorError(
                f"The episode did not end at its horizon of {self._steps} steps.",
                "The simulation must set `ended` there.",
            )
        actor = find_nearest(observation.ego, observation.others)
        sigma = self._deviations.compute(observation, actor)
        z = self._noise.draw(observation, observation.others[actor])
        # Recorded before the simulation steps: if the step fails, the noise that caused it is kept,
        # and the episode can be replayed.
        recorder.add_disturbance(z, sigma)
        injected = self._conversion.inject(z, sigma)
        if self._perceives_all:
            return injected
        # The simulation was opened with the parameters that the scenario's channels chose.
        return tuple([injected[place] for place in self._perceived])

    def _check_end(self, last: Observation) -> None:
        """Check that an episode has all of its steps: missing steps would count as safe."""
        if not last.collided and self._recorder.steps < self._steps:
            raise SimulatorError(
                f"The episode ended after {self._recorder.steps} of {self._steps} steps, without a "
                f"collision.",
                "Set `ended` at a collision and at the horizon alone.",
            )


def run_episode(
    simulation: Simulation,
    seed: int,
    model: DisturbanceModel,
    noise: NoiseSource,
    recorder: Recorder,
) -> None:
    """Run an episode to its end.

    Raises:
        EpisodeError: the episode cannot be completed; the recorder holds its steps so far.
    """
    driver = EpisodeDriver(model, noise, recorder, simulation.steps, simulation.dt_s)
    disturbance = driver.disturb(simulation.reset(seed))
    while disturbance is not None:
        disturbance = driver.disturb(simulation.step(disturbance))


def make_result(
    setup: episode.EpisodeSetup,
    task: episode.EpisodeTask,
    noise: NoiseSource,
    recorder: Recorder,
    dt_s: float,
) -> episode.EpisodeResult:
    """Return the result of an episode that has ended, without its wall time.

    Raises:
        EpisodeError: a requirement cannot be judged.
    """
    measures = recorder.measures(dt_s)
    _refuse_lost_measures(measures)
    judged = recorder.judge(measures, dt_s)
    failed = recorder.collided
    values: tuple[float | None, ...] = ()
    if judged is not None:
        # Methods search by `robustness_m`. With requirements it is the margin to the first
        # violation; the distance, which it is without them, keeps a column of its own.
        failed, values = judged.violated is not None, judged.values
        measures = replace(
            measures,
            robustness_m=judged.smallest,
            nearest_m=measures.robustness_m,
            # People count requirements from 1.
            violated=None if judged.violated is None else judged.violated + 1,
        )
    failure = episode.Outcome.COLLISION if recorder.collided else episode.Outcome.VIOLATION
    keep_scene = failed or task.index % setup.scene_every == 0
    return episode.EpisodeResult(
        index=task.index,
        seed=task.seed,
        outcome=failure if failed else episode.Outcome.SAFE,
        steps=recorder.steps,
        noise=recorder.noise(),
        source=task.source_kind,
        measures=measures,
        requirements=values,
        states=noise.states(),
        importance=recorder.importance(),
        scene=recorder.scene(dt_s) if keep_scene else None,
    )


def _refuse_lost_measures(measures: Measures) -> None:
    """Refuse distances and severities beyond the stored range; other measures may be missing."""
    for name in ("robustness_m", "severity"):
        value = getattr(measures, name)
        # Written with "not", so that NaN is refused as well.
        if value is not None and not abs(value) <= MAX_MAGNITUDE:
            problem = f"The episode has {MEASURES[name].label} {value:g}."
            remedy = f"Measures are kept up to {MAX_MAGNITUDE:g}: look at positions and speeds."
            raise SimulatorError(problem, remedy)


def make_errored_result(
    task: episode.EpisodeTask, recorder: Recorder, why: episode.EpisodeFault
) -> episode.EpisodeResult:
    """Return the result of an episode that could not be completed."""
    return replace(episode.unrunnable(task, why), steps=recorder.steps, noise=recorder.noise())
