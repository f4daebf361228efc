"""Episodes in a distribution of scenarios: each its own, and the same whoever runs it."""

import msgspec
import numpy as np
import pytest

from eigenfail import plugins
from eigenfail.settings import read_settings
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import (
    EpisodeTask,
    Outcome,
    PriorSource,
    TrajectorySource,
    episode_seed,
    learner_seed,
)
from eigenfail.values.learning import LearnerContext
from eigenfail.values.variation import read_variation
from eigenfail.worlds import PLUGIN_WORLD
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.campaigns.validation import check_spec
from eigenfail_workers.engine import Engine
from eigenfail_workers.explain import explain
from eigenfail_workers.scenarios.cut_in import CutInParameters

VARIED = {
    "distance_m": {"uniform": [52, 70]},
    "actor_speed_mps": {"uniform": [12.0, 16.0]},
    "final_offset_m": {"choice": [1.9, 2.1]},
}
SPEC = CampaignSpec(
    name="varied",
    method="monte_carlo",
    episodes=64,
    planner="idm",
    simulator="point_mass",
    scenario_parameters=VARIED,
    scene_every=1,
)
TASKS = [EpisodeTask(index, episode_seed(3, index), PriorSource()) for index in range(64)]


def run(tasks, spec=SPEC):
    engine = Engine(spec.setup())
    try:
        return list(engine.run(tasks))
    finally:
        engine.close()


def digests(results):
    return [result.digest() for result in results]


@pytest.fixture(scope="module")
def whole():
    return run(TASKS)


@pytest.mark.parametrize("size", [1, 7])
def test_episodes_do_not_depend_on_their_batch(whole, size):
    parts = [run(TASKS[first : first + size]) for first in range(0, len(TASKS), size)]
    assert digests(result for part in parts for result in part) == digests(whole)


def test_an_engine_that_goes_on_is_as_good_as_a_new_one(whole):
    assert digests(run(TASKS[::-1]))[::-1] == digests(whole)


def test_every_episode_starts_in_its_own_variation(whole):
    variation = read_variation(CutInParameters, VARIED)
    for task, result in zip(TASKS, whole, strict=True):
        wanted = variation.draw(task.seed)
        assert result.scene.vehicles[0, 1, 3] == pytest.approx(wanted.actor_speed_mps)
    assert len({float(result.scene.vehicles[0, 1, 3]) for result in whole}) == len(whole)


def test_an_episode_is_that_of_a_campaign_with_these_parameters_fixed(whole):
    variation = read_variation(CutInParameters, VARIED)
    for task, result in list(zip(TASKS, whole, strict=True))[:8]:
        drawn = msgspec.to_builtins(variation.draw(task.seed))
        (fixed,) = run([task], msgspec.structs.replace(SPEC, scenario_parameters=drawn))
        assert fixed.digest() == result.digest()


def test_a_stored_episode_replays_and_explains_in_its_own_variation(whole):
    kept = next(result for result in whole if result.is_failure)
    task = EpisodeTask(kept.index, kept.seed, TrajectorySource(kept.noise.z))
    assert run([task])[0].digest() == kept.digest()
    assert explain(SPEC.setup(), task).result.digest() == kept.digest()


def test_the_horizon_holds_for_all_and_shorter_episodes_are_whole(whole):
    longest = PLUGIN_WORLD.find_form(SPEC).steps
    safe = {result.steps for result in whole if result.outcome is Outcome.SAFE}
    at_the_corner = with_parameters(distance_m=52.0, actor_speed_mps=16.0)
    assert longest == PLUGIN_WORLD.find_form(at_the_corner).steps
    assert max(safe) <= longest
    assert len(safe) > 1


def with_parameters(**parameters):
    return msgspec.structs.replace(SPEC, scenario_parameters=parameters)


def test_noise_beyond_an_episodes_end_changes_nothing(whole):
    horizon = PLUGIN_WORLD.find_form(SPEC).steps
    short = next(r for r in whole if r.outcome is Outcome.SAFE and r.steps < horizon)
    z = np.ones((horizon, 2), np.float32)
    z[: short.steps] = short.noise.z
    (again,) = run([EpisodeTask(short.index, short.seed, TrajectorySource(z))])
    assert again.digest() == short.digest()


SETTINGS = {"monte_carlo": {}, "cem": {"batch": 10}, "ast": {"round_size": 10, "batch_size": 16}}


@pytest.mark.parametrize("name", SETTINGS)
def test_methods_work_over_a_distribution(name):
    spec = check_spec(msgspec.structs.replace(SPEC, method=name, settings=SETTINGS[name])).spec
    method, steps = plugins.load(plugins.METHODS, name), PLUGIN_WORLD.find_form(spec).steps
    context = LearnerContext(learner_seed(1), 30, steps, np.zeros((0, steps, 2), np.float32))
    learner = method(context, read_settings(method.Settings, spec.settings, "settings"))
    results = list(run_in_process(Rounds(learner, 1, 30), Engine(spec.setup())))
    assert [result.index for result in results] == list(range(30))
    assert Outcome.ERRORED not in {result.outcome for result in results}


class Uneven:
    """Longer in the middle of its only parameter than at either end."""

    class Parameters(msgspec.Struct, frozen=True):
        middle: float = 0.0

    def __call__(self, parameters, seed):
        longer = round(10 * (1.0 - abs(parameters.middle)))
        return msgspec.structs.replace(self.staged, steps=self.staged.steps + longer)


def test_an_episode_longer_than_any_at_the_ends_fails_and_says_why(small_cut_in, plug_in, nervous):
    staged = small_cut_in(small_cut_in.Parameters(), 0)
    plug_in(plugins.SCENARIOS, "uneven", type("Scenario", (Uneven,), {"staged": staged}))
    plug_in(plugins.PLANNERS, "nervous", nervous)
    spec = msgspec.structs.replace(
        SPEC,
        scenario="uneven",
        planner="nervous",
        scenario_parameters={"middle": {"uniform": [-1.0, 1.0]}},
    )
    (result,) = run(TASKS[:1], spec)
    assert (result.outcome, result.fault.kind) == (Outcome.ERRORED, "input")
    assert "longer than any at the ends of the distributions: 60." in result.fault.message
