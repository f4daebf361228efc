"""What a campaign asks for, held against what the bridge knows."""

from collections.abc import Mapping

from eigenfail.bridges import Plain
from eigenfail.errors import InvalidValue, UnknownName
from eigenfail_workers.bridge.messages import Scenario, Start, Welcome


def scenario_of(welcome: Welcome, name: str) -> Scenario:
    """The scenario of that name.

    Raises:
        UnknownName: the bridge has none; those that it has are listed.
    """
    for scenario in welcome.scenarios:
        if scenario.name == name:
            return scenario
    raise UnknownName("scenario", name, (each.name for each in welcome.scenarios))


def check(welcome: Welcome, start: Start, dt_s: float) -> None:
    """Make sure that the bridge knows what an episode needs.

    Args:
        welcome: what it knows.
        start: what is asked of it.
        dt_s: what the campaign takes for the duration of a step.

    Raises:
        UnknownName: a scenario, planner, parameter or setting that the bridge does not have.
        InvalidValue: a horizon or a duration of a step that the scenario does not have.
    """
    scenario = scenario_of(welcome, start.scenario)
    planners = {each.name: each.settings or {} for each in welcome.planners}
    if start.planner not in planners:
        raise UnknownName("planner", start.planner, planners)
    refuse_unknown("scenario_parameters", start.parameters, scenario.parameters or {})
    refuse_unknown("planner_settings", start.settings, planners[start.planner])
    if start.steps > scenario.steps:
        problem = f"'{scenario.name}' has no more than {scenario.steps} steps."
        raise InvalidValue("scenario_parameters.steps", problem, "Ask for no more.")
    if dt_s != scenario.dt_s:
        problem = f"a step of '{scenario.name}' takes {scenario.dt_s:g} s, and not {dt_s:g} s."
        remedy = f"Write dt_s = {scenario.dt_s:g}."
        raise InvalidValue("scenario_parameters.dt_s", problem, remedy)


def refuse_unknown(field: str, given: Mapping[str, Plain], known: Mapping[str, Plain]) -> None:
    """Raises UnknownName for a name that the bridge does not have."""
    for name in given:
        if name not in known:
            raise UnknownName(field, name, known)
