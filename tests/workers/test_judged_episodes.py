"""Requirements in whole episodes: what is recorded, kept and repeated."""

import pytest
from msgspec.structs import replace

from eigenfail.values import episode, requirements
from eigenfail.values.channels import Channel
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.shapes import Markov
from eigenfail_workers.engine import Engine

TASKS = tuple(episode.EpisodeTask(index, 300 + index, episode.PriorSource()) for index in range(12))
EVERY = (
    requirements.NoCollision(),
    requirements.PreventableCollision(),
    requirements.SafeDistance(),
    requirements.TimeHeadway(),
    requirements.UncausedBraking(),
    requirements.KeptLane(),
    requirements.MeasureLimit(measure="max_jerk_mps3", at_most=30.0),
    requirements.Formula(
        name="recovers", formula="always(headway_s < 1 implies eventually[0:3] headway_s > 1)"
    ),
)


def run(engine, tasks=TASKS):
    return list(engine.run(tasks))


def drive(scenario, tasks, **changes):
    """Return the episodes of the intelligent driver in a built-in scenario."""
    setup = episode.EpisodeSetup("highway", scenario, {}, "idm", {}, DisturbanceModel())
    engine = Engine(replace(setup, **changes))
    try:
        return run(engine, tasks)
    finally:
        engine.close()


@pytest.mark.parametrize("scenario", ["cut_in", "lead_brake", "merge_in"])
def test_every_kind_is_judged_on_every_built_in_world(scenario) -> None:
    for found in drive(scenario, TASKS[:2], requirements=EVERY):
        assert found.outcome is not episode.Outcome.ERRORED, found.fault
        assert len(found.requirements) == len(EVERY)
        assert found.requirements[0] == found.measures.nearest_m


def test_what_is_required_changes_nothing_but_the_verdict(make_engine) -> None:
    plain = run(make_engine())
    judged = run(make_engine(requirements=(requirements.TimeHeadway(at_least_s=0.01),)))
    assert [each.noise.z.tobytes() for each in plain] == [each.noise.z.tobytes() for each in judged]
    assert [each.measures.robustness_m for each in plain] == [
        each.measures.nearest_m for each in judged
    ]
    assert {each.outcome for each in judged} == {episode.Outcome.SAFE}
    assert {each.measures.nearest_m for each in plain} == {None}


def test_a_violation_is_a_failure_with_its_scene(make_engine) -> None:
    strict = run(
        make_engine(
            requirements=(requirements.NoCollision(), requirements.TimeHeadway(at_least_s=0.85))
        )
    )
    violations = [each for each in strict if each.outcome is episode.Outcome.VIOLATION]
    assert violations
    assert {each.is_failure for each in violations} == {True}
    assert {each.measures.violated for each in violations} == {2}
    assert {each.measures.robustness_m for each in violations} == {0.0}
    assert all(each.scene is not None for each in violations)
    assert all(each.requirements[1] <= 0.0 < each.requirements[0] for each in violations)


def test_robustness_is_in_terms_of_the_scale(make_engine) -> None:
    requirement = requirements.TimeHeadway(at_least_s=0.05, scale=0.5)
    for found in run(make_engine(requirements=(requirement,)), TASKS[:3]):
        assert found.measures.robustness_m == pytest.approx(found.requirements[0] / 0.5)


def test_ghosts_make_the_ego_brake_without_a_cause() -> None:
    ghosts = DisturbanceModel(channels=(Channel("ghost", shape=Markov(0.02, 10.0)),))
    world = {"disturbance": ghosts, "requirements": (requirements.UncausedBraking(),)}
    tasks = tuple(episode.EpisodeTask(index, index, episode.PriorSource()) for index in range(20))
    failures = [each for each in drive("merge_in", tasks, **world) if each.is_failure]
    assert failures
    again = tuple(
        episode.EpisodeTask(each.index, each.seed, episode.TrajectorySource(each.noise.z))
        for each in failures
    )
    repeated = drive("merge_in", again, **world)
    assert [each.digest() for each in repeated] == [each.digest() for each in failures]


def test_a_collision_that_nothing_forbids_is_no_failure() -> None:
    collided = [each for each in drive("cut_in", TASKS) if each.is_failure]
    assert collided
    again = tuple(
        episode.EpisodeTask(each.index, each.seed, episode.PriorSource()) for each in collided
    )
    for found in drive("cut_in", again, requirements=(requirements.KeptLane(beyond_m=50.0),)):
        assert found.outcome is episode.Outcome.SAFE
        assert found.measures.collided_s is not None
        assert found.measures.nearest_m == 0.0 < found.measures.robustness_m


def test_an_importance_changes_what_is_followed_alone(make_engine) -> None:
    plain = run(make_engine(requirements=(requirements.NoCollision(),)))
    importance = requirements.MeasureLimit(measure="max_drac_mps2", at_most=7.0)
    led = run(make_engine(requirements=(requirements.NoCollision(),), importance=importance))
    assert [each.outcome for each in led] == [each.outcome for each in plain]
    assert [each.requirements for each in led] == [each.requirements for each in plain]
    for one, other in zip(plain, led, strict=True):
        drac = one.measures.max_drac_mps2 or 0.0
        if one.outcome is episode.Outcome.SAFE and drac < 7.0:
            assert other.measures.robustness_m == pytest.approx(8.0 - drac)


def test_a_signal_of_a_channel_is_its_error(make_engine) -> None:
    formula = requirements.Formula(
        formula="always (error.longitudinal < 2.5 and error.longitudinal > -2.5)"
    )
    for found in run(make_engine(requirements=(formula,)), TASKS[:4]):
        largest = abs(found.noise.injected[:, 0]).max()
        assert found.requirements[0] == pytest.approx(2.5 - largest)


def test_promise_for_after_the_end_of_an_episode_is_not_judged() -> None:
    """A collision ends the episode before the window of the promise: nothing was broken."""
    promise = requirements.Formula(formula="eventually[9.5:10] (speed_mps < 100)")
    found = drive("cut_in", TASKS, requirements=(promise,))
    cut = []
    for each in found:
        end_s = each.measures.collided_s
        if end_s is not None and end_s < 9.45:
            cut.append(each)
    assert cut
    for each in cut:
        assert each.outcome is episode.Outcome.SAFE
        assert each.requirements == (None,)
        assert each.measures.violated is None
        assert each.measures.robustness_m == 1.0
    assert all(each.requirements[0] > 0.0 for each in found if each not in cut)
