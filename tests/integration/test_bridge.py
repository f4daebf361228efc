"""A campaign on a bridge through a real service: workers, a program of its own, and trouble."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import deadlines
import pytest

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.explanations import encode_question, explain_in_process
from eigenfail.replays import replay_episode
from eigenfail.values.analysis import AnalysisState
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec

pytestmark = pytest.mark.service

BRIDGE = Path(__file__).parents[2] / "examples" / "bridge" / "minimal.py"
NOISY = {"scale": 2.0}
FIELDS = {"name": "b", "method": "monte_carlo", "planner": "idm", "seed": 3, "disturbance": NOISY}
ON_BRIDGE = {"simulator": "bridge", "scenario_parameters": {"steps": 100}}
FITS = ON_BRIDGE | {"episodes": 4}


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
    ended = client.campaigns.wait(created.id, timeout_s=deadlines.CAMPAIGN_S)
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
    proof = client.analyses.wait_for_proof(analysis.id, timeout_s=deadlines.CAMPAIGN_S)
    (scenario,) = proof.scenarios
    assert scenario.medoids.rate.value == 1.0


def test_an_episode_is_explained_by_the_bridge_as_built_in(client, start_worker, bridge) -> None:
    start_worker()
    fields = {"planner": "rulebook", "episodes": 2, "scene_every": 1}
    behind = finish(client, **fields, **ON_BRIDGE)
    built_in = finish(client, **fields)
    # The services of this module were started before there was a bridge; they ask as this does.
    stored = client.episodes.get(behind.id, 1)
    found = explain_in_process(encode_question(behind.id, behind.spec, stored))
    expected = client.episodes.explanation(built_in.id, 1)
    with pytest.raises(InvalidValue, match="this process knows no bridge"):
        client.episodes.explanation(behind.id, 1)
    assert found.replayed.same
    assert found.story == expected.story
    assert found.steps == expected.steps


def test_the_adversary_learns_on_a_bridge(client, start_worker, bridge) -> None:
    start_worker()
    settings = {"round_size": 5, "warm_up": 5, "gradient_steps": 1}
    first = finish(client, method="ast", episodes=20, settings=settings, **ON_BRIDGE)
    again = finish(client, method="ast", episodes=20, settings=settings)
    assert client.campaigns.digest(first.id) == client.campaigns.digest(again.id)


@pytest.mark.fault("SIGKILL of a bridge")
def test_a_bridge_that_dies_and_comes_back_costs_no_episode(client, start_worker, bridge) -> None:
    start_worker()
    created = client.campaigns.create(**FIELDS, episodes=300, **ON_BRIDGE)
    deadline = time.monotonic() + deadlines.PROCESS_S
    while client.campaigns.get(created.id).counts.completed < 50:
        assert time.monotonic() < deadline, "the campaign does not move"
        time.sleep(0.02)
    bridge.kill()
    bridge.start()
    ended = client.campaigns.wait(created.id, timeout_s=deadlines.CAMPAIGN_S)
    assert ended.state is CampaignState.DONE
    assert (ended.counts.completed, ended.counts.errored) == (300, 0)
    built_in = finish(client, episodes=300)
    assert client.campaigns.digest(created.id) == client.campaigns.digest(built_in.id)


def test_a_campaign_names_no_address_and_says_how_long_an_episode_is(client) -> None:
    with pytest.raises(InvalidValue, match="steps: is missing"):
        client.campaigns.create(**FIELDS, episodes=1, simulator="bridge")


SLOTS = 6
BEFORE = 12
"""So many are lent before the hub knows how long one takes."""

SLOW = """
import sys, time
from minimal import Bridge, built_in, serve, welcome

class Slow(Bridge):
    def answer(self, request):
        if request["type"] == "step":
            time.sleep(0.25)
        if request["type"] == "reset":
            with open(sys.argv[2], "a") as begun:
                print(*(each["slot"] for each in request["slots"]), sep="\\n", file=begun)
        return super().answer(request)

serve(sys.argv[1], Slow(welcome({slots}), built_in))
"""


def test_every_slot_of_a_bridge_is_kept_busy_however_slow_it_is(
    client, start_worker, tmp_path, monkeypatch
) -> None:
    address, begun = f"ipc://{tmp_path}/b", tmp_path / "begun"
    monkeypatch.setenv("EIGENFAIL_BRIDGE", address)
    monkeypatch.setenv("PYTHONPATH", str(BRIDGE.parent))
    command = [sys.executable, "-c", SLOW.format(slots=SLOTS), address, begun]
    with subprocess.Popen(command) as slow:
        try:
            start_worker()
            steps = {"scenario_parameters": {"steps": 8}}
            finish(client, episodes=BEFORE + 2 * SLOTS, **ON_BRIDGE | steps)
        finally:
            slow.kill()
    taken = [int(slot) for slot in begun.read_text().split()]
    # The lowest free one is taken: whoever is in the last one has others in all that are before.
    assert SLOTS - 1 in taken[BEFORE:]


def wait_for_check(client, spec, *, fits: bool) -> None:
    """Wait until a campaign fits the offers of the bridges, or until it does not."""
    until_s = time.monotonic() + deadlines.PROCESS_S
    while bool(client.campaigns.check(spec).problems) is fits:
        assert time.monotonic() < until_s, "the offers of the bridges stay as they are"
        time.sleep(0.1)


MISSPELT = {"simulator": "bridge", "scenario_parameters": {"steps": 100, "distance": 60.0}}


@pytest.mark.fault(
    "launch of a campaign with a name that a connected bridge does not know",
    group="api",
    outcome="It is refused with 422, the field, the closest name and the known ones; nothing is "
    "created.",
)
def test_a_campaign_that_does_not_fit_a_connected_bridge_is_not_launched(
    client, start_worker, bridge
) -> None:
    spec = CampaignSpec(**FIELDS, episodes=4, **MISSPELT)
    wait_for_check(client, spec, fits=True)  # The workers of earlier tests have left.
    start_worker()
    wait_for_check(client, spec, fits=False)
    before = len(list(client.campaigns.list()))
    with pytest.raises(UnknownName, match=r"scenario_parameters: .* mean 'distance_m'\?") as told:
        client.campaigns.create(spec)
    assert (told.value.field, told.value.http_status) == ("scenario_parameters", 422)
    channel = {"channels": [{"name": "swapped"}, {"name": "vehicle_1.speed"}]}
    fits = client.campaigns.check(CampaignSpec(**FIELDS | {"disturbance": channel}, **FITS))
    assert not fits.problems
    with pytest.raises(UnknownName, match="requirements"):
        client.campaigns.create(
            **FIELDS, **FITS, requirements=[{"kind": "formula", "formula": "bridge.gap_m > 0"}]
        )
    assert len(list(client.campaigns.list())) == before
    # Without its bridge the worker knows of no offer: the launch is accepted, as before.
    bridge.kill()
    wait_for_check(client, spec, fits=True)


@pytest.mark.fault(
    "campaign with a name that the bridge does not know",
    group="plug-ins",
    outcome="The campaign is paused before an episode is spent, with the unknown name, the known "
    "ones and the remedy; a corrected copy runs.",
)
def test_a_misspelt_parameter_pauses_its_campaign_before_an_episode_is_spent(
    client, start_worker, bridge
) -> None:
    # Launched before any worker has told what its bridge offers.
    created = client.campaigns.create(**FIELDS, episodes=40, **MISSPELT)
    start_worker()
    start_worker()
    rests = client.campaigns.wait(created.id, timeout_s=deadlines.CAMPAIGN_S)
    assert rests.state is CampaignState.PAUSED
    assert (rests.counts.completed, rests.counts.errored) == (0, 0)
    assert (
        "scenario_parameters: 'distance' is not known to the bridge 'minimal'"
        in rests.stopped_because
    )
    assert "Did you mean 'distance_m'?" in rests.stopped_because
    assert f"eigenfail campaign clone {created.id} --set FIELD=VALUE" in rests.stopped_because
    # Nothing has changed: it is declined again, and again with its reason.
    client.campaigns.resume(created.id)
    again = client.campaigns.wait(created.id, timeout_s=deadlines.CAMPAIGN_S)
    assert (again.state, again.counts.errored) == (CampaignState.PAUSED, 0)
    finish(client, episodes=40, **ON_BRIDGE)
