"""A12 of small lists, by hand."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.errors import InvalidValue
from eigenfail_services.statistics.comparison import effect_size, name_magnitude


@pytest.mark.parametrize(
    ("a", "b", "a12", "name"),
    [
        ([1, 2], [3, 4], 1.0, "large"),
        ([3, 4], [1, 2], 0.0, "large"),
        ([1, 2, 3], [1, 2, 3], 0.5, "negligible"),
        # Of 9 pairs 5 are won and 2 are ties: 6 / 9.
        ([1, 3, 5], [3, 4, 5], 6 / 9, "medium"),
        ([1, 1, 1, 1], [1, 1, 1, 2], 0.625, "small"),
    ],
)
def test_by_hand(a, b, a12, name) -> None:
    found = effect_size(a, b)
    assert found.a12 == pytest.approx(a12)
    assert (found.magnitude, found.n_a, found.n_b) == (name, len(a), len(b))


@pytest.mark.parametrize(
    ("a12", "name"),
    [(0.559, "negligible"), (0.56, "small"), (0.64, "medium"), (0.71, "large"), (0.29, "large")],
)
def test_the_names_begin_where_vargha_and_delaney_have_them(a12, name) -> None:
    assert name_magnitude(a12) == name
    assert name_magnitude(1.0 - a12) == name


values = st.lists(st.integers(0, 5).map(float), min_size=2, max_size=8)


@given(values, values)
def test_the_sides_add_up_to_one(a, b) -> None:
    assert effect_size(a, b).a12 + effect_size(b, a).a12 == pytest.approx(1.0)


@pytest.mark.parametrize(("a", "b"), [([], [1.0, 2.0]), ([1.0], [1.0, 2.0]), ([1.0, 2.0], [1.0])])
def test_a_single_value_has_no_effect_size(a, b) -> None:
    with pytest.raises(InvalidValue, match="at least 2"):
        effect_size(a, b)
