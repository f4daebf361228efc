"""Each example: keeps to the protocol, is safe by itself, and fails under likely noise."""

from pathlib import Path

import numpy as np
import pytest

from eigenfail.cli.specs import read_spec
from eigenfail.values.episode import EpisodeTask, Outcome, TrajectorySource

BRIDGES = Path(__file__).parents[3] / "examples" / "bridge"
EXAMPLES = {
    "cpp": (BRIDGES / "cpp" / "campaign.toml", 60),
    "sumo": (BRIDGES / "sumo.toml", 60),
    "highway_env": (BRIDGES / "highway_env.toml", 40),
}
"""The campaign, and the episodes of it that are enough for a failure."""


@pytest.fixture(params=EXAMPLES)
def example(request, start_python, start, compiled):
    if request.param == "cpp":
        started = start(compiled(BRIDGES / "cpp" / "main.cpp"))
    else:
        started = start_python(f"{request.param}_bridge.py")
    return started.address, *EXAMPLES[request.param]


def test_doctor_finds_nothing_broken_and_its_campaign_finds_failures(
    example, check_bridge, search, engine
) -> None:
    address, file, episodes = example
    check_bridge(address)
    results = search(file, address, episodes)
    assert [result.index for result in results] == list(range(episodes))
    assert not [result.fault for result in results if result.outcome is Outcome.ERRORED]
    failures = [result for result in results if result.is_failure]
    assert failures
    assert any(not result.is_failure for result in results)

    spec = read_spec(file)
    again = [EpisodeTask(r.index, r.seed, TrajectorySource(r.noise.z)) for r in failures[:1]]
    replays = list(engine(spec, address).run(again))
    assert [replay.digest() for replay in replays] == [each.digest() for each in failures[:1]]

    steps = spec.scenario_parameters["steps"]
    calm = EpisodeTask(0, 0, TrajectorySource(np.zeros((steps, 2), np.float32)))
    (undisturbed,) = engine(spec, address).run([calm])
    assert undisturbed.outcome is Outcome.SAFE
