"""A campaign on a bridge through a real service: workers, a program of its own, and trouble."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from eigenfail.errors import InvalidValue
from eigenfail.stories.replays import replay_episode
from eigenfail.values import AnalysisState, CampaignState, Outcome

pytestmark = pytest.mark.service

BRIDGE = Path(__file__).parents[2] / "examples" / "bridge" / "minimal.py"
NOISY = {"scale": 2.0}
FIELDS = {"name": "b", "method": "monte_carlo", "planner": "idm", "seed": 3, "disturbance": NOISY}
ON_BRIDGE = {"simulator": "bridge", "scenario_parameters": {"steps": 100}}


@pytest.fixture
def bridge(tmp_path, monkeypatch) -> Iterator["Program"]:
    address = f"ipc://{tmp_path}/b"
    monkeypatch.setenv("EIGENFAIL_BRIDGE", address)
    program = Program(address)
    program.start()
    yield program
    program.kill()


class Program:
    """The reference bridge as a program of its own."""

    def __init__(self, address: str) -> None:
        self.address = address

    def start(self) -> None:
        self.process = subprocess.Popen([sys.executable, BRIDGE, self.address])

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()


def finish(client, **fields):
    created = client.campaigns.create(**FIELDS | fields)
    ended = client.campaigns.wait(created.id, timeout_s=120)
    assert ended.state is CampaignState.DONE, ended.stopped_because
    return ended


def test_the_failures_are_those_of_the_same_world_built_in(client, start_worker, bridge) -> None:
    start_worker()
    start_worker()
    behind = finish(client, episodes=120, **ON_BRIDGE)
    built_in = finish(client, episodes=120)
    assert behind.counts.failures > 10
    assert client.campaigns.digest(behind.id) == client.campaigns.digest(built_in.id)

    failure = next(row for row in client.episodes.list(behind.id) if row.outcome == "collision")
    stored = client.episodes.get(behind.id, failure.index)
    assert replay_episode(behind.spec, stored).same

    analysis = client.analyses.wait(client.analyses.create(behind.id).id)
    assert analysis.state is AnalysisState.DONE, analysis.problem
    client.analyses.prove(analysis.id)
    proof = client.analyses.wait_for_proof(analysis.id, timeout_s=60)
    (scenario,) = proof.scenarios
    assert scenario.medoids.rate.value == 1.0


def test_the_adversary_learns_on_a_bridge(client, start_worker, bridge) -> None:
    start_worker()
    settings = {"round_size": 5, "warm_up": 5, "gradient_steps": 1}
    first = finish(client, method="ast", episodes=20, settings=settings, **ON_BRIDGE)
    again = finish(client, method="ast", episodes=20, settings=settings)
    assert client.campaigns.digest(first.id) == client.campaigns.digest(again.id)


def test_a_bridge_that_dies_costs_the_episodes_in_it_and_no_more(
    client, start_worker, bridge
) -> None:
    start_worker()
    created = client.campaigns.create(**FIELDS, episodes=600, **ON_BRIDGE)
    deadline = time.monotonic() + 60
    while client.campaigns.get(created.id).counts.completed < 50:
        assert time.monotonic() < deadline, "the campaign does not move"
        time.sleep(0.02)
    bridge.kill()
    bridge.start()
    ended = client.campaigns.wait(created.id, timeout_s=120)
    assert ended.state is CampaignState.DONE
    # As many as it held side by side, and what began in their slots before its death was seen.
    assert 1 <= ended.counts.failed <= 64
    failed = [row for row in client.episodes.list(created.id) if row.outcome is Outcome.FAILED]
    assert {row.problem.partition(":")[0] for row in failed} == {"simulator"}


def test_a_campaign_names_no_address_and_says_how_long_an_episode_is(client) -> None:
    with pytest.raises(InvalidValue, match="steps: is missing"):
        client.campaigns.create(**FIELDS, episodes=1, simulator="bridge")
