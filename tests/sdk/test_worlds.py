"""What differs between roads, functions and bridges."""

from msgspec.structs import replace

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.worlds import PLUGIN_WORLD, describe_disturbance, drawn_for, world_of

ROAD = CampaignSpec(name="n", method="monte_carlo", episodes=1, planner="idm")
FUNCTION = replace(
    ROAD,
    simulator="function",
    scenario="function",
    planner="m:f",
    scenario_parameters={"steps": 7},
)
BRIDGE = replace(ROAD, simulator="bridge", scenario="x", scenario_parameters={"steps": 50})


def test_simulators_that_are_plug_ins_share_a_world() -> None:
    assert world_of("highway") is world_of("gone") is PLUGIN_WORLD
    assert world_of("function") is not world_of("bridge")


def test_steps_last_in_all_worlds_but_functions() -> None:
    forms = [world_of(spec.simulator).find_form(spec) for spec in (ROAD, FUNCTION, BRIDGE)]
    found = {
        spec.simulator: (form.steps, form.step_s)
        for spec, form in zip((ROAD, FUNCTION, BRIDGE), forms, strict=True)
    }
    assert found == {"highway": (100, 0.1), "function": (7, None), "bridge": (50, 0.1)}


def test_only_roads_have_parameters_of_a_plug_in() -> None:
    assert "distance_m" in PLUGIN_WORLD.default_parameters(ROAD)
    assert world_of("function").default_parameters(FUNCTION) == {}
    assert world_of("bridge").default_parameters(BRIDGE) == {}


def test_a_function_has_a_scale_where_roads_have_slopes() -> None:
    assert describe_disturbance(FUNCTION)["sigma"] == "1 at every step"
    assert set(describe_disturbance(ROAD)) > {"shape"}


def test_nothing_is_drawn_of_fixed_or_unknown_scenarios() -> None:
    assert drawn_for(ROAD, 0) == drawn_for(replace(ROAD, scenario="gone"), 0) == {}
    assert drawn_for(FUNCTION, 0) == drawn_for(replace(FUNCTION, scenario_parameters={}), 0) == {}


def test_built_in_parts_share_a_process_and_functions_do_not() -> None:
    setups = [spec.setup() for spec in (ROAD, FUNCTION, BRIDGE)]
    foreign = [world_of(setup.simulator).runs_foreign_code(setup) for setup in setups]
    assert foreign == [False, True, False]
