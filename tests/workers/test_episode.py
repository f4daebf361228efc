"""The loop itself, on a simulation that plays back prepared observations."""

from collections.abc import Sequence

from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.scene import Observation, VehicleState
from eigenfail_workers.episode import run_episode
from eigenfail_workers.measures.recorder import Recorder

Pair = tuple[float, float]

MODEL = DisturbanceModel(0.5, 1.0, 0.5, 2.0)


def car(x: float, y: float = 0.0) -> VehicleState:
    return VehicleState(x, y, 0.0, 10.0, 4.0, 2.0)


def seen(step: int, *others: VehicleState, ended: bool = False) -> Observation:
    return Observation(step, car(0.0), others, False, ended)


class Playback:
    dt_s = 0.1

    def __init__(self, observations: Sequence[Observation]) -> None:
        self.observations = observations
        self.steps = len(observations) - 1
        self.disturbances: list[Pair] = []

    def reset(self, seed: int) -> Observation:
        self.seed = seed
        return self.observations[0]

    def step(self, disturbance: Pair) -> Observation:
        self.disturbances.append(disturbance)
        return self.observations[len(self.disturbances)]

    def close(self) -> None:
        """Nothing."""


class Counting:
    """z = (1, 0.5), (2, 1), (3, 1.5) …; remembers for which actor."""

    def __init__(self) -> None:
        self.actors: list[VehicleState] = []

    def draw(self, observation: Observation, actor: VehicleState) -> Pair:
        self.actors.append(actor)
        return float(len(self.actors)), 0.5 * len(self.actors)

    def states(self) -> None:
        """None."""


def test_the_paper_in_two_steps() -> None:
    simulation = Playback(
        [
            seen(0, car(20.0, 4.0), car(-40.0)),
            seen(1, car(30.0, 4.0), car(-10.0, -2.0)),
            seen(2, car(40.0, 4.0), car(-8.0), ended=True),
        ]
    )
    noise, recorder = Counting(), Recorder()
    run_episode(simulation, 77, MODEL, noise, recorder)
    assert simulation.seed == 77
    # sigma = (0.5 |dx| + 1, 0.5 |dy| + 2): (11, 4) for the first actor, (6, 3) for the second
    assert noise.actors == [car(20.0, 4.0), car(-10.0, -2.0)]
    assert simulation.disturbances == [(1.0 * 11.0, 0.5 * 4.0), (2.0 * 6.0, 1.0 * 3.0)]
    assert recorder.noise().sigma.tolist() == [[11.0, 4.0], [6.0, 3.0]]
    assert recorder.noise().z.tolist() == [[1.0, 0.5], [2.0, 1.0]]
    assert recorder.measures(0.1).robustness_m == 4.0
