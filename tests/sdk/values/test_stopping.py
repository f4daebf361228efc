"""Stop rules: bounds, and what is no rule."""

import pytest

from eigenfail.errors import InvalidValue
from eigenfail.settings import read_settings
from eigenfail.values.campaign_spec import StopRules


@pytest.mark.parametrize(
    "wrong",
    [
        {"failures": 0},
        {"failures": 1.5},
        {"half_width": 0.0},
        {"half_width": 0.5},
        {"cv": 0.0},
        {"wall_s": -1.0},
        {"cost_usd": 0.0},
        {"cost_usd": "much"},
    ],
)
def test_a_rule_out_of_bounds_is_refused_by_name(wrong):
    (name,) = wrong
    with pytest.raises(InvalidValue, match=rf"stop\.{name}"):
        read_settings(StopRules, wrong, "stop")


def test_only_the_rules_that_there_are_are_given():
    assert StopRules().given() == {}
    assert StopRules(cv=0.1, failures=3).given() == {"failures": 3, "cv": 0.1}
