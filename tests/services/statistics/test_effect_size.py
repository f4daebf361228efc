"""A12 of small lists, by hand."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import mannwhitneyu

from eigenfail.errors import InvalidValue
from eigenfail_services.statistics.comparison import can_distinguish, effect_size, name_magnitude


@pytest.mark.parametrize(
    ("a", "b", "a12", "name"),
    [
        ([1, 2, 3, 4], [5, 6, 7, 8], 1.0, "large"),
        ([5, 6, 7, 8, 9], [1, 2, 3], 0.0, "large"),
        ([1, 2, 3, 4], [1, 2, 3, 4], 0.5, "negligible"),
        # Of 16 pairs 9 are won and 3 are ties: 10.5 / 16.
        ([1, 3, 5, 5], [3, 4, 5, 6], 10.5 / 16, "medium"),
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


values = st.lists(st.integers(0, 5).map(float), min_size=4, max_size=8)


@given(values, values)
def test_the_sides_add_up_to_one(a, b) -> None:
    assert effect_size(a, b).a12 + effect_size(b, a).a12 == pytest.approx(1.0)


@pytest.mark.parametrize("sizes", [(0, 9), (1, 9), (2, 2), (3, 3), (3, 4)])
def test_so_few_values_that_chance_sets_them_apart_have_no_effect_size(sizes) -> None:
    assert not can_distinguish(*sizes)
    a, b = ([float(place)] * size for place, size in enumerate(sizes))
    with pytest.raises(InvalidValue, match="no effect size that says anything"):
        effect_size(a, b)


@pytest.mark.parametrize(("sizes", "p_value"), [((4, 4), 0.0286), ((3, 5), 0.0357)])
def test_fully_apart_is_rare_by_chance_from_these_sizes_on(sizes, p_value) -> None:
    assert can_distinguish(*sizes)
    a, b = range(sizes[0]), range(10, 10 + sizes[1])
    assert mannwhitneyu(a, b, method="exact").pvalue == pytest.approx(p_value, abs=5e-5)
