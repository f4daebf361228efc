"""How long an episode without a collision lasts, as a campaign keeps it."""

import pytest
from accepted import accept_spec
from msgspec.structs import replace

from eigenfail import functions
from eigenfail.errors import InvalidValue
from eigenfail.values.campaign import EpisodeForm
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.worlds import world_of
from eigenfail_services.store.store import Store

SPEC = CampaignSpec(name="first", method="monte_carlo", episodes=10)


def test_form_is_that_of_the_scenario(store: Store) -> None:
    form = store.campaigns.create(accept_spec(SPEC)).form
    assert form == EpisodeForm(100, 0.1, ("longitudinal", "lateral"))


def test_form_of_the_papers_steps_has_700_of_two_hundredths_of_a_second(store: Store) -> None:
    given = {"dt_s": 0.02, "duration_s": 14.0}
    form = store.campaigns.create(accept_spec(replace(SPEC, scenario_parameters=given))).form
    assert (form.steps, form.step_s) == (700, 0.02)


def test_a_campaign_has_one_duration_of_a_step() -> None:
    spec = replace(SPEC, scenario_parameters={"dt_s": {"uniform": [0.02, 0.1]}})
    with pytest.raises(InvalidValue, match="duration of a step varies") as refused:
        world_of(spec.simulator).find_form(spec)
    assert refused.value.field == "scenario_parameters"


def test_form_of_a_bridge_is_what_the_campaign_says(store: Store) -> None:
    given = {"steps": 40, "dt_s": 0.25}
    made = store.campaigns.create(
        accept_spec(replace(SPEC, simulator="bridge", scenario_parameters=given))
    )
    assert (made.form.steps, made.form.step_s) == (40, 0.25)


def test_steps_of_a_function_have_no_duration(store: Store) -> None:
    function = {"simulator": functions.SIMULATOR, "scenario": "function", "planner": "m:f"}
    made = store.campaigns.create(
        accept_spec(replace(SPEC, **function, scenario_parameters={"steps": 7}))
    )
    assert (made.form.steps, made.form.step_s) == (7, None)


def test_campaign_of_a_scenario_that_is_not_here_has_no_form(store: Store) -> None:
    assert store.campaigns.create(accept_spec(replace(SPEC, scenario="gone"))).form == EpisodeForm()
