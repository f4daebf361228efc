"""Prints what became of episodes, as JSON: `python -m recorded_episodes`, compiled or interpreted.

Every built-in simulator, scenario and planner, with noise of each source and other parameters.
"""

import json
from collections.abc import Iterator
from hashlib import sha256

import msgspec
import numpy as np

from eigenfail import plugins
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import (
    EpisodeResult,
    EpisodeTask,
    Importance,
    PolicySource,
    PriorSource,
    TrajectorySource,
    episode_seed,
)
from eigenfail.values.learning import Layer, Policy

EPISODES = len(Importance)
WORLDS = [
    ({"simulator": simulator, "scenario": scenario, "planner": planner})
    for simulator in ("highway", "point_mass")
    for scenario in ("cut_in", "lead_brake", "merge_in")
    for planner in ("rulebook", "idm")
] + [{"simulator": "highway", "scenario": "highway_drive", "planner": "rulebook"}]
VARIED = (
    {"scenario_parameters": {"distance_m": 53.0}},
    {"scenario": "merge_in", "scenario_parameters": {"behind_m": 5.0}},
    {"planner_settings": {"refine": {"knots": 40}, "tracker": {"gate": 6.0}}},
)


def main() -> None:
    """Run and print."""
    print(json.dumps({str(world): [*run_world(world)] for world in (*WORLDS, *VARIED)}))


def run_world(world: dict[str, object]) -> Iterator[str]:
    """Digest and full contents of each episode."""
    spec = CampaignSpec(name="compiled", method="monte_carlo", episodes=1, seed=1, **world)
    engine = plugins.load(plugins.ENGINES, "default")(spec.setup())
    engine.add_policy(make_policy())
    for result in engine.run([*make_tasks()]):
        yield f"{result.digest()} {hash_contents(result)}"
    engine.close()


def make_policy() -> Policy:
    random = np.random.default_rng(1)

    def make_layer(rows: int, columns: int) -> Layer:
        weight = 0.4 * random.standard_normal((rows, columns))
        return Layer(weight.astype(np.float32), np.zeros(rows, np.float32))

    hidden = (make_layer(16, 8), make_layer(16, 16))
    return Policy(1, hidden, make_layer(2, 16), make_layer(2, 16), amplitude=3.0, hold=5)


def make_tasks() -> Iterator[EpisodeTask]:
    """Noise from the prior, held noise of 3 sigma, which ends in collisions, and a policy's."""
    random = np.random.default_rng(2)
    for episode in range(EPISODES):
        held = np.repeat(random.uniform(-3.0, 3.0, (40, 2)), 5, axis=0).astype(np.float32)
        importance = [*Importance][episode % len(Importance)]
        sources = PriorSource(), TrajectorySource(held, importance), PolicySource(1)
        for source in sources:
            yield EpisodeTask(episode, episode_seed(3, episode), source)


def hash_contents(result: EpisodeResult) -> str:
    """SHA-256 of all that is in a result, but for the time that it took."""
    untimed = msgspec.structs.replace(result, wall_s=0.0)
    return sha256(msgspec.msgpack.encode(untimed, enc_hook=encode_array)).hexdigest()


def encode_array(array: object) -> tuple[str, tuple[int, ...], bytes]:
    assert isinstance(array, np.ndarray)
    return str(array.dtype), array.shape, array.tobytes()


if __name__ == "__main__":
    main()
