"""Whole episodes with what they measure: off the road, beyond the truck, in a crash."""

from collections.abc import Callable
from typing import Any

import pytest
from msgspec import structs

from eigenfail import plugins
from eigenfail.values.episode import EpisodeResult, EpisodeTask, Outcome, PriorSource
from eigenfail.values.records import ConflictClass, assess
from eigenfail_workers.engine import Engine

MakeEngine = Callable[..., Engine]


def episode(engine: Engine) -> EpisodeResult:
    (result,) = engine.run([EpisodeTask(0, 1, PriorSource())])
    return result


@pytest.fixture(params=["highway", "point_mass"])
def simulator(request: pytest.FixtureRequest) -> str:
    return request.param


def test_a_truck_that_leaves_the_road_drives_on(
    make_engine: MakeEngine, steady: type, simulator: str
) -> None:
    turning = {"acceleration_mps2": 0.0, "steering_rad": -0.02}
    free = {"gap_m": 90.0, "slower_mps": 0.0}
    engine = make_engine(
        steady, simulator=simulator, planner_settings=turning, scenario_parameters=free
    )
    result = episode(engine)
    assert (result.outcome, result.steps) == (Outcome.SAFE, 60)
    # On a circle of 16 m / (2 sin 0.01) the centre is 1.75 m aside after about 53 m.
    assert result.measures.left_road_s == pytest.approx(2.6, abs=0.2)
    assert result.measures.clipped_steps == 0


def test_what_the_truck_cannot_do_is_clipped_and_counted(
    make_engine: MakeEngine, steady: type, simulator: str
) -> None:
    braking = {"acceleration_mps2": -12.0, "steering_rad": 0.0}
    engine = make_engine(steady, simulator=simulator, planner_settings=braking)
    result = episode(engine)
    assert result.outcome is Outcome.SAFE
    assert result.measures.clipped_steps == result.steps == 60
    assert result.measures.hard_brakings == 1
    assert result.measures.max_jerk_mps3 == pytest.approx(70.0)
    assert result.measures.left_road_s is None


def test_a_truck_that_does_not_react_fails_where_braking_would_have_helped(
    make_engine: MakeEngine, steady: type, simulator: str
) -> None:
    result = episode(make_engine(steady, simulator=simulator))
    measures = result.measures
    assert result.outcome is Outcome.COLLISION
    assert measures.collided_s == pytest.approx(0.1 * result.steps)
    # Closing at 8 m/s from 30 m: 12 m are left after 2.25 s, which step 23 sees at 11.6 m
    # (11.53 m from the corner that the car, still turned a little, puts out).
    assert measures.ttc_violated_s == pytest.approx(2.3)
    assert measures.drac_at_warning_mps2 == pytest.approx(64.0 / 23.2, rel=1e-2)
    # DRAC = 32 / gap passes 7 m/s² below 4.57 m, after 3.18 s.
    assert measures.drac_violated_s == pytest.approx(3.2)
    found = assess(result.outcome, measures)
    assert found.conflict is ConflictClass.PLANNER_FAILURE
    assert (found.ttc_lead_s, found.drac_lead_s) == (pytest.approx(1.5), pytest.approx(0.6))


def test_a_scenario_that_starts_in_a_collision_is_refused_as_the_inputs_fault(
    make_engine: MakeEngine, plug_in: Callable[..., None], small_cut_in: Any, simulator: str
) -> None:
    class Overlapping(type(small_cut_in)):
        def __call__(self, parameters: Any, seed: int) -> Any:
            staged = super().__call__(parameters, seed)
            return structs.replace(staged, actors=(structs.replace(staged.ego, x_m=15.9),))

    plug_in(plugins.SCENARIOS, "overlapping", Overlapping)
    result = episode(make_engine(simulator=simulator, scenario="overlapping"))
    assert (result.outcome, result.steps, result.measures) == (Outcome.ERRORED, 0, None)
    assert result.fault.kind == "input"
    assert "starts in a collision" in result.fault.message
    assert assess(result.outcome, result.measures).conflict is None
