"""How long an episode without a collision lasts."""

import pytest
from msgspec.structs import replace

from eigenfail import functions, plugins
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_services.campaigns.summary import find_horizon_s

SPEC = CampaignSpec(name="first", method="monte_carlo", episodes=10)


def test_it_is_the_scenarios_in_seconds() -> None:
    assert find_horizon_s(SPEC) == 10.0


def test_of_a_bridge_it_is_what_the_campaign_says() -> None:
    given = {"steps": 40, "dt_s": 0.25}
    assert find_horizon_s(replace(SPEC, simulator="bridge", scenario_parameters=given)) == 10.0


def test_steps_of_a_function_have_no_duration() -> None:
    assert find_horizon_s(replace(SPEC, simulator=functions.SIMULATOR)) is None


def test_a_scenario_that_is_not_here_has_none() -> None:
    assert find_horizon_s(replace(SPEC, scenario="gone")) is None


@pytest.mark.parametrize("error", [RuntimeError, KeyError])
def test_a_scenario_that_raises_costs_no_summary(monkeypatch, error) -> None:
    def broken() -> None:
        raise error("a stranger's bug")

    load = plugins.load
    known = {(plugins.SCENARIOS, "broken"): broken}
    monkeypatch.setattr(plugins, "load", lambda *name: known.get(name) or load(*name))
    assert find_horizon_s(replace(SPEC, name=error.__name__, scenario="broken")) is None
