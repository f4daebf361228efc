"""Parameters that vary: read, bounded, and drawn from an episode's seed alone."""

from typing import Annotated

import msgspec
import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Meta

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.values.episode import episode_seed
from eigenfail.values.variation import MAX_CORNERS, Empirical, in_words, read_variation

SEEDS = [episode_seed(0, index) for index in range(400)]


class Parameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    distance_m: Annotated[float, Meta(ge=-10.0, le=10.0)] = 1.0
    speed_mps: Annotated[float, Meta(gt=0.0, le=30.0)] = 20.0
    cars: Annotated[int, Meta(ge=1, le=4)] = 2
    side: str = "left"

    def __post_init__(self) -> None:
        if self.distance_m > self.speed_mps:
            raise ValueError("distance_m is above speed_mps")


def varied(**parameters):
    return read_variation(Parameters, parameters)


def draws(name, **parameters):
    variation = varied(**parameters)
    return [getattr(variation.draw(seed), name) for seed in SEEDS]


def test_without_a_distribution_all_episodes_are_alike():
    fixed = varied(distance_m=3)
    assert {fixed.draw(seed) for seed in (0, 1, 2)} == {Parameters(3.0)}
    assert list(fixed.corners()) == [Parameters(3.0)]


def test_a_uniform_parameter_fills_its_interval_evenly():
    values = draws("distance_m", distance_m={"uniform": [-5, 5]})
    assert len(set(values)) == len(values)
    counts, _ = np.histogram(values, bins=4, range=(-5.0, 5.0))
    assert sum(counts) == 400
    assert all(abs(count - 100) < 35 for count in counts)  # four standard deviations of 8.7


def test_a_whole_number_stays_one_and_reaches_both_ends():
    values = draws("cars", cars={"uniform": [1, 3]})
    assert set(values) == {1, 2, 3}
    assert all(isinstance(value, int) for value in values)


def test_a_choice_gives_each_of_its_values():
    values = draws("side", side={"choice": ["left", "right"]})
    assert set(values) == {"left", "right"}
    assert abs(values.count("left") - 200) < 40  # four standard deviations of 10


def test_what_is_fixed_stays_and_what_is_not_named_keeps_its_default():
    drawn = varied(speed_mps=25.0, cars={"choice": [3]}).draw(7)
    assert drawn == Parameters(1.0, 25.0, 3, "left")


@given(st.integers(0, 2**63 - 1))
def test_a_seed_gives_the_same_draw_however_the_table_is_written(seed):
    one = varied(distance_m={"uniform": [-5, 5]}, speed_mps={"uniform": [6.0, 30.0]})
    other = varied(speed_mps={"uniform": [6.0, 30.0]}, distance_m={"uniform": [-5, 5]})
    assert one.draw(seed) == other.draw(seed)


def test_the_draws_of_two_parameters_have_nothing_to_do_with_each_other():
    variation = varied(distance_m={"uniform": [-5, 5]}, speed_mps={"uniform": [6.0, 30.0]})
    drawn = [variation.draw(seed) for seed in SEEDS]
    pairs = np.array([(one.distance_m, one.speed_mps) for one in drawn])
    assert abs(np.corrcoef(pairs.T)[0, 1]) < 0.2  # four standard deviations of 1/20


def test_the_largest_is_looked_for_at_all_combinations_of_ends():
    variation = varied(distance_m={"uniform": [-5, 5]}, cars={"choice": [1, 4, 2]})
    assert len(list(variation.corners())) == 6
    assert variation.largest(lambda one: one.cars * round(-one.distance_m)) == 20


@pytest.mark.parametrize(
    ("parameters", "field", "words"),
    [
        ({"distance_m": {"uniform": [-5, 12]}}, "distance_m", "12 is not a number"),
        ({"distance_m": {"uniform": [-11, 5]}}, "distance_m", "-11 is not a number"),
        ({"cars": {"choice": [1, 9]}}, "cars", "9 is not an integer"),
        ({"cars": {"uniform": [1, 2.5]}}, "cars", "2.5 is not an integer"),
        ({"side": {"choice": ["left", 3]}}, "side", "3 is not text"),
        ({"distance_m": {"uniform": [5, -5]}}, "distance_m.uniform", "[5, -5] is not an interval"),
        ({"distance_m": {"uniform": [5]}}, "distance_m.uniform", "length 2"),
        ({"distance_m": {"uniform": 5}}, "distance_m.uniform", "5 is not a list"),
        ({"distance_m": {"uniform": [0, float("inf")]}}, "distance_m.uniform", "inf"),
        ({"distance_m": {"choice": []}}, "distance_m.choice", "length of at least 1"),
        ({"distance_m": {"empirical": [1.0]}}, "distance_m.empirical", "length of at least 2"),
        ({"distance_m": {"empirical": [1.0, 12.0]}}, "distance_m", "12.0 is not a number"),
        ({"distance_m": {"empirical": [1.0, float("nan")]}}, "distance_m.empirical", "finite"),
        ({"distance_m": {"empirical": [1.0, "2"]}}, "distance_m.empirical[1]", "or a number"),
        ({"distance_m": {"empirical": "gaps.csv"}}, "distance_m.empirical", "not a list"),
        ({"distance_m": 11.0}, "distance_m", "11.0 is not a number"),
    ],
)
def test_what_is_wrong_is_said_by_field_and_value(parameters, field, words):
    with pytest.raises(InvalidValue) as refusal:
        varied(**parameters)
    assert refusal.value.field == f"scenario_parameters.{field}"
    assert words in str(refusal.value)


def test_ends_that_do_not_go_together_are_refused_with_their_values():
    with pytest.raises(InvalidValue, match=r"'distance_m': 9.*is refused\. distance_m is above"):
        varied(distance_m={"uniform": [0, 9]}, speed_mps={"uniform": [5.0, 30.0]})


@pytest.mark.parametrize(
    ("parameters", "field", "known"),
    [
        ({"distance": {"uniform": [0, 1]}}, "scenario_parameters", "distance_m"),
        ({"distance_m": {"unifrom": [0, 1]}}, "scenario_parameters.distance_m", "uniform"),
        (
            {"distance_m": {"choice": [1.0], "uniform": [1, 2]}},
            "scenario_parameters.distance_m",
            "uniform",
        ),
        (
            {"distance_m": {"empirical": [1, 2], "within": [0, 1]}},
            "scenario_parameters.distance_m",
            "empirical",
        ),
    ],
)
def test_unknown_names_are_refused_with_the_known_ones(parameters, field, known):
    with pytest.raises(UnknownName) as refusal:
        varied(**parameters)
    assert refusal.value.field == field
    assert known in refusal.value.known


def test_more_combinations_than_can_be_checked_are_refused():
    many = {"choice": [index / 100 for index in range(65)]}
    with pytest.raises(InvalidValue, match=str(MAX_CORNERS)):
        varied(distance_m=many, speed_mps={"choice": [10.0 + n / 10 for n in range(65)]})


def test_a_normal_parameter_is_normal_within_its_ends():
    variation = varied(distance_m={"normal": [2.0, 3.0], "within": [-1, 5]})
    values = [variation.draw(episode_seed(1, index)).distance_m for index in range(2_000)]
    reference = scipy.stats.truncnorm(-1.0, 1.0, loc=2.0, scale=3.0)
    assert scipy.stats.kstest(values, reference.cdf).pvalue > 0.01
    assert -1.0 <= min(values) < max(values) <= 5.0
    assert [each.distance_m for each in variation.corners()] == [-1.0, 5.0]


@pytest.mark.parametrize(
    ("name", "given", "values"),
    [
        ("distance_m", {"uniform": [-4.0, 4.0]}, {-9.0: -4.0, 0.0: 0.0, 9.0: 4.0}),
        (
            "distance_m",
            {"normal": [1.0, 2.0], "within": [-3, 5]},
            {-40.0: -3.0, 0.0: 1.0, 40.0: 5.0},
        ),
        ("cars", {"uniform": [1, 4]}, {-9.0: 1, -0.1: 2, 0.1: 3, 9.0: 4}),
        ("cars", {"normal": [2.0, 1.0], "within": [1, 4]}, {-40.0: 1, 0.05: 2, 40.0: 4}),
        ("distance_m", {"empirical": [4, -1.0, 1.0]}, {-40.0: -1.0, 0.0: 1.0, 40.0: 4.0}),
        # Phi(0.67449) is 0.75: half-way from the second to the third of the sorted values.
        (
            "distance_m",
            {"empirical": [4, -1.0, 1.0]},
            {-0.6744897501960817: 0.0, 0.6744897501960817: 2.5},
        ),
        ("cars", {"empirical": [4, 1]}, {-40.0: 1, -0.1: 2, 0.1: 3, 40.0: 4}),
        ("side", {"choice": ["left", "right"]}, {-0.1: "left", 0.1: "right", 40.0: "right"}),
    ],
)
def test_a_searched_parameter_is_its_quantile(name, given, values):
    variation = read_variation(Parameters, {name: given, "speed_mps": 20.0}, searched=(name,))
    assert variation.drawn(7) == {}
    for z, exact in values.items():
        value = exact if isinstance(exact, str) else pytest.approx(exact, rel=1e-6, abs=1e-12)
        assert variation.place({name: z}) == {name: value}
        assert getattr(variation.draw(7, {name: z}), name) == value


@pytest.mark.parametrize(("mean", "low", "high"), [(-8.0, 1.0, 5.0), (8.0, -5.0, -1.0)])
def test_a_normal_far_from_its_ends_keeps_to_the_nearer_one(mean, low, high):
    given_ = {"normal": [mean, 1.0], "within": [low, high]}
    variation = read_variation(Parameters, {"distance_m": given_}, searched=("distance_m",))
    a, b = low - mean, high - mean
    reference = scipy.stats.truncnorm(a, b, loc=mean)
    for z in (-3.0, -1.0, 0.0, 1.0, 3.0):
        expected = reference.ppf(scipy.stats.norm.cdf(z))
        assert variation.place({"distance_m": z})["distance_m"] == pytest.approx(expected, rel=1e-6)


@given(st.floats(-8.0, 8.0), st.floats(0.0, 4.0))
def test_a_larger_z_never_makes_a_parameter_smaller(z, more):
    given_ = {"normal": [1.0, 0.5], "within": [-3.0, 5.0]}
    variation = read_variation(Parameters, {"distance_m": given_}, searched=("distance_m",))
    low, high = (variation.place({"distance_m": each})["distance_m"] for each in (z, z + more))
    assert low <= high


@pytest.mark.parametrize(
    ("given", "field"),
    [
        ({"normal": [0.0, 1.0]}, "distance_m.within"),
        ({"normal": [0.0, 0.0], "within": [-1, 1]}, r"distance_m.normal"),
        ({"normal": [0.0, 1.0], "within": [1, -1]}, "distance_m.within"),
        ({"normal": [float("nan"), 1.0], "within": [-1, 1]}, "distance_m.normal"),
        ({"normal": [0.0, 1.0], "within": [-1, 99]}, "distance_m"),
        ({"normal": [0.0, 0.1], "within": [4, 5]}, "distance_m.within"),
    ],
)
def test_a_normal_that_is_none_is_refused(given, field):
    with pytest.raises(InvalidValue) as refused:
        varied(distance_m=given)
    assert field in refused.value.field


@given(st.lists(st.floats(-10.0, 10.0), min_size=2, max_size=9), st.floats(0.0, 1.0))
def test_an_empirical_quantile_is_numpys(values, p):
    found = Empirical(tuple(values)).find_quantile(p, 1.0)
    assert found == pytest.approx(np.quantile(values, p), abs=1e-12)


def test_an_empirical_parameter_is_drawn_from_its_sample():
    values = (-3.0, 0.0, 1.0, 7.0)
    drawn = draws("distance_m", distance_m={"empirical": values}, speed_mps=20.0)
    counts, _ = np.histogram(drawn, bins=values)
    assert all(abs(count - 400 / 3) < 38 for count in counts)  # four standard deviations of 9.4
    assert len(list(varied(distance_m={"empirical": values}).corners())) == 2
    assert in_words({"a": {"empirical": [3, 1, 2]}}) == {"a": "as in 3 values, 1 … 3"}


class Pair(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    a: float = 0.0
    b: float = 0.0
    c: float = 0.0


STANDARD_NORMAL = {"normal": [0.0, 1.0], "within": [-30.0, 30.0]}


def correlated(**coefficients):
    pairs = {tuple(pair): value for pair, value in coefficients.items()}
    given_ = dict.fromkeys("abc", STANDARD_NORMAL)
    return read_variation(Pair, given_, searched=tuple("abc"), correlations=pairs)


@pytest.mark.parametrize("coefficient", [-0.8, 0.0, 0.3, 0.95])
def test_correlated_parameters_are_the_cholesky_factor_of_their_z(coefficient):
    placed = correlated(ab=coefficient).place({"a": 1.5, "b": -0.5, "c": 0.25})
    expected = coefficient * 1.5 + np.sqrt(1.0 - coefficient**2) * -0.5
    assert list(placed.values()) == pytest.approx([1.5, expected, 0.25], abs=1e-6)


@pytest.mark.parametrize("coefficient", [-0.6, 0.0, 0.6])
def test_a_half_space_of_correlated_parameters_has_its_probability(coefficient):
    variation, draws_ = correlated(ab=coefficient, bc=0.3), 4_000
    z = np.random.default_rng(3).standard_normal((draws_, 3))
    placed = [variation.place(dict(zip("abc", row, strict=True))) for row in z.tolist()]
    values = np.array([list(each.values()) for each in placed])
    # The sum of a and b is normal with variance 2 + 2 rho, and each of them stays standard normal.
    border = 2.0
    probability = scipy.stats.norm.sf(border / np.sqrt(2.0 + 2.0 * coefficient))
    failed = int((values[:, 0] + values[:, 1] > border).sum())
    assert scipy.stats.binomtest(failed, draws_, probability).pvalue > 0.001
    for column in values.T:
        assert scipy.stats.kstest(column, "norm").pvalue > 0.001
    expected = [[1.0, coefficient, 0.0], [coefficient, 1.0, 0.3], [0.0, 0.3, 1.0]]
    assert np.corrcoef(values.T) == pytest.approx(np.array(expected), abs=0.06)


def test_marginal_distributions_stay_where_parameters_are_correlated():
    given_ = {"distance_m": {"uniform": [-4.0, 4.0]}, "cars": {"choice": [1, 3]}}
    pairs = {("distance_m", "cars"): 0.999}
    variation = read_variation(
        Parameters, given_, searched=("distance_m", "cars"), correlations=pairs
    )
    assert variation.place({"distance_m": 9.0, "cars": 0.0}) == {"distance_m": 4.0, "cars": 3}
    assert variation.place({"distance_m": -9.0, "cars": 0.0}) == {"distance_m": -4.0, "cars": 1}
