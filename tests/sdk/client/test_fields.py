"""The keyword arguments of `create` are the fields of what is created, with types to check."""

from typing import Annotated, Literal, get_args, get_origin, get_type_hints

import msgspec
import pytest

from eigenfail.client.campaigns import Campaigns
from eigenfail.client.fields import AnalysisFields, CampaignChanges, CampaignFields
from eigenfail.values import AnalysisSettings, CampaignSpec

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


def test_type_checkers_see_the_fields():
    assert get_type_hints(Campaigns.clone)["changes"].__args__ == (CampaignChanges,)
    assert get_type_hints(Campaigns.check)["fields"].__args__ == (CampaignChanges,)
