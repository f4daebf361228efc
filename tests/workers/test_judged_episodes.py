"""Requirements in whole episodes: what is recorded, kept and repeated."""

import pytest

from eigenfail.values import (
    Channel,
    DisturbanceModel,
    EpisodeTask,
    Markov,
    Outcome,
    PriorSource,
    TrajectorySource,
)
from eigenfail.values.requirements import (
    Formula,
    LaneKeeping,
    MeasureLimit,
    NoCollision,
    PreventableCollision,
    SafeDistance,
    TimeHeadway,
    UncausedBraking,
)

TASKS = tuple(EpisodeTask(index, 300 + index, PriorSource()) for index in range(12))
EVERY = (
    NoCollision(),
    PreventableCollision(),
    SafeDistance(),
    TimeHeadway(),
    UncausedBraking(),
    LaneKeeping(),
    MeasureLimit(measure="max_jerk_mps3", at_most=30.0),
    Formula(name="recovers", formula="always(headway_s < 1 implies eventually[0:3] headway_s > 1)"),
)


def run(engine, tasks=TASKS):
    return list(engine.run(tasks))


def test_every_kind_is_judged_on_every_built_in_world(make_engine) -> None:
    for scenario in ("cut_in", "lead_brake", "merge_in"):
        for found in run(make_engine(scenario=scenario, requirements=EVERY), TASKS[:2]):
            assert found.outcome is not Outcome.ERRORED, found.fault
            assert len(found.requirements) == len(EVERY)
            assert found.requirements[0] == found.measures.nearest_m


def test_what_is_required_changes_nothing_but_the_verdict(make_engine) -> None:
    plain = run(make_engine())
    judged = run(make_engine(requirements=(TimeHeadway(at_least_s=0.01),)))
    assert [each.noise.z.tobytes() for each in plain] == [each.noise.z.tobytes() for each in judged]
    assert [each.measures.robustness_m for each in plain] == [
        each.measures.nearest_m for each in judged
    ]
    assert {each.outcome for each in judged} == {Outcome.SAFE}
    assert {each.measures.nearest_m for each in plain} == {None}


def test_a_violation_is_a_failure_with_its_scene(make_engine) -> None:
    strict = run(make_engine(requirements=(NoCollision(), TimeHeadway(at_least_s=0.85))))
    violations = [each for each in strict if each.outcome is Outcome.VIOLATION]
    assert violations
    assert {each.is_failure for each in violations} == {True}
    assert {each.measures.violated for each in violations} == {2}
    assert {each.measures.robustness_m for each in violations} == {0.0}
    assert all(each.scene is not None for each in violations)
    assert all(each.requirements[1] <= 0.0 < each.requirements[0] for each in violations)


def test_robustness_is_in_terms_of_the_scale(make_engine) -> None:
    requirement = TimeHeadway(at_least_s=0.05, scale=0.5)
    for found in run(make_engine(requirements=(requirement,)), TASKS[:3]):
        assert found.measures.robustness_m == pytest.approx(found.requirements[0] / 0.5)


def test_ghosts_make_the_ego_brake_without_a_cause(make_engine) -> None:
    ghosts = DisturbanceModel(channels=(Channel("ghost", shape=Markov(0.02, 10.0)),))
    engine = make_engine(
        scenario="merge_in", planner="idm", disturbance=ghosts, requirements=(UncausedBraking(),)
    )
    found = run(engine, tuple(EpisodeTask(index, index, PriorSource()) for index in range(20)))
    failures = [each for each in found if each.is_failure]
    assert failures
    again = [
        EpisodeTask(each.index, each.seed, TrajectorySource(each.noise.z)) for each in failures
    ]
    assert [each.digest() for each in run(engine, again)] == [each.digest() for each in failures]


def test_a_collision_that_nothing_forbids_is_no_failure(make_engine) -> None:
    model = DisturbanceModel(scale=3.0)
    tasks = tuple(EpisodeTask(index, index, PriorSource()) for index in range(60))
    collided = [each for each in run(make_engine(disturbance=model), tasks) if each.is_failure]
    assert collided
    again = tuple(EpisodeTask(each.index, each.seed, PriorSource()) for each in collided)
    lenient = make_engine(disturbance=model, requirements=(LaneKeeping(beyond_m=50.0),))
    for found in run(lenient, again):
        assert found.outcome is Outcome.SAFE
        assert found.measures.collided_s is not None


def test_a_signal_of_a_channel_is_its_error(make_engine) -> None:
    formula = Formula(formula="always (error.longitudinal < 2.5 and error.longitudinal > -2.5)")
    for found in run(make_engine(requirements=(formula,)), TASKS[:4]):
        largest = abs(found.noise.injected[:, 0]).max()
        assert found.requirements[0] == pytest.approx(2.5 - largest)
