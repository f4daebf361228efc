"""The keyword arguments of `create` are the fields of what is created, with types to check."""

from typing import Annotated, Literal, get_args, get_origin, get_type_hints

import httpx2
import msgspec
import numpy as np
import pytest

from eigenfail.client import Client
from eigenfail.client.campaigns import Campaigns
from eigenfail.client.fields import AnalysisFields, CampaignChanges, CampaignFields
from eigenfail.errors import InvalidValue
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign_spec import CampaignSpec

PAIRS = [
    (CampaignFields, CampaignSpec),
    (CampaignChanges, CampaignSpec),
    (AnalysisFields, AnalysisSettings),
]
PLAIN = (int, float, str, type(None))


def list_plain_types(kind):
    """The plain types among those that an annotation allows."""
    if get_origin(kind) is Annotated:
        return list_plain_types(get_args(kind)[0])
    if get_origin(kind) is Literal:
        return {type(value) for value in get_args(kind)}
    if kind in PLAIN:
        return {kind}
    return {each for inner in get_args(kind) for each in list_plain_types(inner)}


@pytest.mark.parametrize(("given", "made"), PAIRS)
def test_every_field_may_be_given_and_no_other(given, made):
    assert set(get_type_hints(given)) == set(made.__struct_fields__)


@pytest.mark.parametrize(("given", "made"), PAIRS)
def test_plain_fields_take_the_types_of_what_is_made(given, made):
    hints = get_type_hints(given)
    plain = [field for field in msgspec.structs.fields(made) if isinstance(field.default, PLAIN)]
    for field in plain:
        taken = list_plain_types(field.type) or {str}  # an enumeration is given by its values
        assert list_plain_types(hints[field.name]) == taken, field.name
    assert len(plain) >= 9


def test_what_has_no_default_must_be_given():
    required = {field.name for field in msgspec.structs.fields(CampaignSpec) if field.required}
    assert required == CampaignFields.__required_keys__
    assert not CampaignChanges.__required_keys__


@pytest.fixture
def unasked():
    """A client whose service must not be asked."""

    def handle(request):
        raise AssertionError(request)

    return Client(transport=httpx2.MockTransport(handle))


def test_fields_beside_a_whole_value_are_refused(unasked):
    spec = CampaignSpec(name="whole", method="monte_carlo", episodes=3)
    settings = AnalysisSettings(components=4)
    for call in (unasked.campaigns.create, unasked.campaigns.check):
        with pytest.raises(
            InvalidValue, match=r"whole CampaignSpec .* fields of it: seed"
        ) as error:
            call(spec, seed=5)
        assert error.value.field == "spec"
    with pytest.raises(InvalidValue, match=r"whole AnalysisSettings .* fields of it: components"):
        unasked.analyses.create(2, settings, components=7)


def test_numbers_of_numpy_are_numbers(client, fields):
    given = fields | {
        "episodes": np.int64(7),
        "price_usd_per_hour": np.float32(0.5),
        "scenario_parameters": {"ego_speed_mps": np.float64(24.0)},
        "stop": {"failures": np.int32(3)},
        "tags": np.array(["a", "b"]),
    }
    made = client.campaigns.create(**given).spec
    assert (made.episodes, made.price_usd_per_hour, made.stop.failures) == (7, 0.5, 3)
    assert (made.scenario_parameters["ego_speed_mps"], made.tags) == (24.0, ("a", "b"))
    assert client.campaigns.clone(1, seed=np.int64(4)).spec.seed == 4
    assert client.campaigns.check(**given).spec.episodes == 7
    (bulk,) = client.campaigns.create_many([given])
    assert bulk.spec == made
    whole = msgspec.structs.replace(made, seed=np.int64(9), price_usd_per_hour=np.float64(2))
    assert client.campaigns.create(whole).spec.seed == 9


def test_what_is_no_plain_data_is_refused_by_the_name_of_its_field(unasked, fields):
    given = fields | {"settings": {"round_size": object()}}
    for call in (unasked.campaigns.create, unasked.campaigns.check):
        with pytest.raises(InvalidValue, match="plain data") as error:
            call(**given)
        assert error.value.field == "settings"
    with pytest.raises(InvalidValue, match="plain data") as error:
        unasked.campaigns.create_many([fields, given])
    assert error.value.field == "[1].settings"
    with pytest.raises(InvalidValue, match="seed: an object of type complex is not"):
        unasked.campaigns.clone(1, seed=1j)


def test_fields_that_are_one_text_are_refused(unasked):
    with pytest.raises(InvalidValue, match=r"Give a list of names: fields=\['index', 'class'\]"):
        unasked.episodes.list(1, fields="index, class")


def test_a_filter_of_campaigns_that_does_not_exist_is_refused(unasked):
    with pytest.raises(TypeError, match="planer_version"):
        unasked.campaigns.list(planer_version="1.1")


def test_type_checkers_see_the_fields():
    assert get_type_hints(Campaigns.clone)["changes"].__args__ == (CampaignChanges,)
    assert get_type_hints(Campaigns.check)["fields"].__args__ == (CampaignChanges,)
