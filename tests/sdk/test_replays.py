"""Replays that differ: a stack that does not repeat itself, against one that was changed."""

from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from eigenfail import plugins
from eigenfail.cli import episode
from eigenfail.errors import ServiceError
from eigenfail.explanations import WHOLE, build_explanation, describe_replay, tell_story
from eigenfail.replays import (
    explain_episode,
    make_undisturbed_task,
    replay_episode,
    run_once,
)
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import Channel
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import EpisodeTask, Outcome, PriorSource, TrajectorySource
from eigenfail.values.scene import Control
from eigenfail.values.shapes import Markov
from eigenfail.versions import fingerprint_plugins, versions
from eigenfail.worlds import list_channels, resolve_disturbance
from eigenfail_services.analysis.words import Clock, describe_account

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


class Blind:
    """Never brakes, whatever it perceives."""

    Settings = msgspec.defstruct("Settings", [], frozen=True)

    def __init__(self, settings):
        pass

    def reset(self, mission):
        pass

    def act(self, perception):
        return Control(0.0, 0.0)


class Trusting(Blind):
    """Brakes hard for a vehicle that it perceives less than 100 m ahead."""

    def act(self, perception):
        near = any(other.x_m - perception.ego.x_m < 100.0 for other in perception.others)
        return Control(-6.0 if near else 0.0, 0.0)


def push(z, steps=100):
    """Noise of the same value in each step, as an episode's result has it."""
    return EpisodeTask(0, 7, TrajectorySource(np.full((steps, 2), z, np.float32)))


def test_planner_that_fails_without_noise_is_told_apart_from_one_that_noise_misleads(planner):
    planner(Blind)
    failed = run_once(SPEC, TASK)
    assert failed.is_failure
    _, explained = explain_episode(SPEC, failed)
    assert explained.fails_alike
    assert not explained.undisturbed.result.noise.z.any()
    story = build_explanation("1/0", "mine", replay_episode(SPEC, failed), explained, WHOLE)
    assert story.undisturbed is Outcome.COLLISION
    assert story.story[0].startswith("Without noise the same episode fails as well: noise is not")
    assert describe_account(explained, Clock(failed.steps, 0.1, "impact")).startswith(
        "without noise it fails as well"
    )


def test_failure_that_noise_causes_does_not_happen_without_it(planner):
    planner(Trusting)
    failed = run_once(SPEC, push(100.0))
    assert failed.is_failure
    _, explained = explain_episode(SPEC, failed)
    assert explained.undisturbed.result.outcome is Outcome.SAFE
    story = tell_story(explained)
    assert story[0].startswith("Without noise the same episode does not fail. No collision")
    assert describe_account(explained, Clock(failed.steps, 0.1, "impact")) == ""


def test_safe_episode_is_not_run_a_second_time(planner):
    planner(Trusting)
    safe = run_once(SPEC, TASK)
    assert not safe.is_failure
    _, explained = explain_episode(SPEC, safe)
    assert explained.undisturbed is None


def test_episode_without_noise_stays_in_the_scenario_that_its_noise_chose():
    searched = replace(
        SPEC,
        planner="idm",
        scenario_parameters={"distance_m": {"uniform": [52.0, 70.0]}},
        disturbance=DisturbanceModel(
            channels=tuple(map(Channel, ("scenario.distance_m", "longitudinal", "lateral")))
        ),
    )
    z = np.full((100, 3), 1.5, np.float32)
    stored = run_once(searched, EpisodeTask(0, 7, TrajectorySource(z)))
    task = make_undisturbed_task(stored, resolve_disturbance(searched))
    calm = run_once(searched, task)
    assert calm.scene.vehicles[0].tolist() == stored.scene.vehicles[0].tolist()
    kept = list_channels(searched).index("scenario.distance_m")
    assert calm.noise.z[0, kept] == stored.noise.z[0, kept]
    assert not np.delete(calm.noise.z, kept, axis=1).any()


def test_event_that_lasts_for_most_of_the_time_is_absent_without_noise():
    often = Channel("missed", shape=Markov(rate=0.1, mean_steps=20.0))
    blinded = replace(SPEC, planner="idm", disturbance=DisturbanceModel(channels=(often,)))
    z = np.full((100, 1), 5.0, np.float32)
    stored = run_once(blinded, EpisodeTask(0, 7, TrajectorySource(z)))
    assert stored.is_failure
    _, explained = explain_episode(blinded, stored)
    calm = explained.undisturbed.result
    assert not calm.noise.injected.any()
    assert calm.outcome is Outcome.SAFE


def test_failure_of_another_kind_without_noise_is_not_taken_for_the_same(planner):
    planner(Trusting)
    failed = run_once(SPEC, push(100.0))
    _, explained = explain_episode(SPEC, failed)
    other = replace(explained.undisturbed.result, outcome=Outcome.VIOLATION)
    violated = replace(explained, undisturbed=replace(explained.undisturbed, result=other))
    assert not violated.fails_alike
    assert tell_story(violated)[0].startswith("Without noise the same episode fails in another way")


def test_account_stays_if_the_run_without_noise_is_refused(planner, monkeypatch):
    planner(Blind)
    failed = run_once(SPEC, TASK)
    real = plugins.load

    def load(group, name):
        explainer = real(group, name)
        if group != plugins.EXPLAINERS:
            return explainer

        def explain(setup, task):
            if not task.source.z.any():
                raise ServiceError("The bridge has gone.", "Start it.")
            return explainer(setup, task)

        return explain

    monkeypatch.setattr(plugins, "load", load)
    replayed, explained = explain_episode(SPEC, failed)
    assert replayed.same
    assert explained.undisturbed is None
