"""Replays that differ: a stack that does not repeat itself, against one that was changed."""

from types import SimpleNamespace

import msgspec
import pytest
from msgspec.structs import replace

from eigenfail import plugins
from eigenfail.cli import episode
from eigenfail.explanations import describe_replay
from eigenfail.replays import explain_episode, replay_episode, run_once
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeTask, PriorSource
from eigenfail.values.scene import Control
from eigenfail.versions import fingerprint_plugins, versions

SPEC = CampaignSpec(
    name="t",
    method="monte_carlo",
    episodes=1,
    simulator="point_mass",
    scenario="cut_in",
    planner="mine",
)
TASK = EpisodeTask(0, 7, PriorSource())


class Drifting:
    """Brakes harder in each episode of the process, from its fourth step on."""

    Settings = msgspec.defstruct("Settings", [], frozen=True)
    episodes = 0
    change_mps2 = 0.25

    def __init__(self, settings):
        self.step = 0

    def reset(self, mission):
        self.step = 0
        type(self).episodes += 1

    def act(self, perception):
        self.step += 1
        braking_mps2 = self.change_mps2 * self.episodes if self.step > 3 else 0.0
        return Control(-braking_mps2, 0.0)


@pytest.fixture
def planner(monkeypatch):
    """Registers a planner under the name of the campaign's."""
    load = plugins.load

    def use(made):
        monkeypatch.setattr(
            plugins, "load", lambda group, name: made if name == "mine" else load(group, name)
        )

    return use


def test_stack_that_does_not_repeat_itself_is_named_with_the_difference(planner):
    planner(Drifting)
    stored = run_once(SPEC, TASK)
    replayed = replay_episode(SPEC, stored)
    assert not replayed.same
    assert replayed.unsteady is not None
    assert "robustness" in replayed.unsteady
    # The fourth decision acts in step 4: its speed is another one then.
    assert "from step 4 on" in replayed.unsteady
    said = episode._explain_difference(replace(replayed, differing=("code of x 1 then, 2 now",)))
    assert said.startswith("The stack does not repeat itself")
    assert "code of" not in said
    explained, _ = explain_episode(SPEC, stored)
    assert describe_replay(explained).startswith("NOT DETERMINISTIC")


def test_changed_stack_that_repeats_itself_is_not_called_unsteady(planner):
    steady = type("Steady", (Drifting,), {"episodes": 0, "change_mps2": 0.0})
    planner(steady)
    stored = run_once(SPEC, TASK)
    assert replay_episode(SPEC, stored).same
    changed = replace(SPEC, scenario_parameters={"distance_m": 60.0})
    replayed = replay_episode(changed, stored)
    assert (replayed.same, replayed.unsteady) == (False, None)
    assert describe_replay(replayed).startswith("DIFFERENT")


def test_replay_by_the_code_of_the_campaign_lists_no_difference():
    spec = replace(SPEC, planner="idm")
    worker = SimpleNamespace(versions={**versions(), **fingerprint_plugins(), "code of other": "1"})
    client = SimpleNamespace(episodes=SimpleNamespace(worker=lambda *_: worker))
    assert fingerprint_plugins()
    assert episode._list_differences(client, spec, 1, 0) == ()
    worker.versions["code of eigenfail_workers"] = "older"
    (found,) = episode._list_differences(client, spec, 1, 0)
    assert found.startswith("code of eigenfail_workers older then, ")
