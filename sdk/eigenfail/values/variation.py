"""Scenario parameters that vary from episode to episode.

In place of a value, a parameter may have a distribution:

- `{"uniform": [52.0, 70.0]}`: uniform, both ends included; whole numbers for a whole-number
  parameter.
- `{"choice": [1.9, 2.0, 2.1]}`: one value of a list, each with the same probability.
- `{"normal": [58.0, 3.0], "within": [52.0, 70.0]}`: normal by mean and standard deviation, cut off
  at the ends of `within`.
- `{"empirical": [57.1, 60.4, 58.8]}`: the distribution of a sample.

A value is drawn from the episode's seed, and need not be sent or stored. If a channel
`scenario.NAME` makes the parameter a part of the search, its value is the quantile of the channel's
z instead. Searched parameters may be correlated, by a Gaussian copula.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property, lru_cache
from itertools import product
from math import erfc, inf, isfinite, prod, sqrt
from statistics import NormalDist
from types import MappingProxyType
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InputError, InvalidValue, UnknownName
from eigenfail.settings import convert, read_settings

VARIATION_STREAM = 2
"""Separates these draws from the draws of the noise and of the scenario, with the same seed."""

# Each corner is checked as a campaign is made: more would keep its user waiting.
MAX_CORNERS = 4096

Number = int | float


class Uniform(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Uniform distribution from the first to the second value."""

    uniform: tuple[Number, Number]

    def ends(self) -> tuple[Any, ...]:
        """Return the values that must be within the parameter's bounds."""
        return self.uniform

    def draw(self, random: np.random.Generator, like: Any) -> Number:
        """Return a random value, of the same type as `like`."""
        low, high = self.uniform
        # By the kind of the parameter, not of the ends: [52, 70] may stand for metres.
        if isinstance(like, int):
            return int(random.integers(int(low), int(high), endpoint=True))
        # Rounding may lead beyond an end, and the parameter's bounds were checked at the ends.
        return min(max(float(random.uniform(low, high)), low), high)

    def find_quantile(self, p: float, like: Any) -> Number:
        """Return the p-quantile, of the same type as `like`."""
        low, high = self.uniform
        if isinstance(like, int):
            # p may be 1.
            return min(int(low) + int(p * (int(high) - int(low) + 1)), int(high))
        return min(max(low + p * (high - low), low), high)


class Choice(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Uniform distribution over a list of values."""

    choice: Annotated[tuple[Any, ...], msgspec.Meta(min_length=1)]

    def ends(self) -> tuple[Any, ...]:
        """Return the values that must be within the parameter's bounds."""
        return self.choice

    def draw(self, random: np.random.Generator, _like: Any) -> Any:
        """Return a random value."""
        return self.choice[int(random.integers(len(self.choice)))]

    def find_quantile(self, p: float, _like: Any) -> Any:
        """Return the p-quantile, with the values in their given order."""
        return self.choice[min(int(p * len(self.choice)), len(self.choice) - 1)]


class Normal(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Normal distribution with mean and standard deviation, truncated to an interval."""

    normal: tuple[float, Annotated[float, msgspec.Meta(gt=0.0)]]
    within: tuple[Number, Number]

    def ends(self) -> tuple[Any, ...]:
        """Return the values that must be within the parameter's bounds."""
        return self.within

    def draw(self, random: np.random.Generator, like: Any) -> Number:
        """Return a random value, of the same type as `like`."""
        return self.find_quantile(float(random.random()), like)

    def find_quantile(self, p: float, like: Any) -> Number:
        """Return the p-quantile, of the same type as `like`."""
        mean, deviation = self.normal
        low, high = self.within
        first, last = ((end - mean) / deviation for end in (low, high))
        # The lower tail is exact, where 1 - Phi would have lost its digits.
        mirrored = first > 0.0
        ends = (-last, -first) if mirrored else (first, last)
        below, above = (0.5 * erfc(-end / sqrt(2.0)) for end in ends)
        share = below + (1.0 - p if mirrored else p) * (above - below)
        # At 0 and 1, where it is infinite, the ends of `within` are the answer.
        z = STANDARD.inv_cdf(share) if 0.0 < share < 1.0 else inf * (share - 0.5)
        value = min(max(mean + deviation * (-z if mirrored else z), low), high)
        return round(value) if isinstance(like, int) else float(value)

    @property
    def has_mass(self) -> bool:
        """True if the share of the normal distribution between the ends is numerically above 0."""
        mean, deviation = self.normal
        return min(abs((end - mean) / deviation) for end in self.within) < FARTHEST or (
            self.within[0] <= mean <= self.within[1]
        )


MOST_SAMPLES = 10_000


class Empirical(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Distribution of a sample of n: a share of 1 / (n - 1) between neighbouring sorted values.

    The quantile is linear between the sorted values, from the first at p = 0 to the last at p = 1.
    It is definition 7 of Hyndman and Fan (1996), The American Statistician 50, 361-365.
    """

    empirical: Annotated[tuple[Number, ...], msgspec.Meta(min_length=2, max_length=MOST_SAMPLES)]

    def ends(self) -> tuple[Any, ...]:
        """Return the values that must be within the parameter's bounds."""
        return min(self.empirical), max(self.empirical)

    def draw(self, random: np.random.Generator, like: Any) -> Number:
        """Return a random value, of the same type as `like`."""
        return self.find_quantile(float(random.random()), like)

    def find_quantile(self, p: float, like: Any) -> Number:
        """Return the p-quantile, of the same type as `like`."""
        ordered = _sort(self.empirical)
        place = min(max(p, 0.0), 1.0) * (len(ordered) - 1)
        below = min(int(place), len(ordered) - 2)
        low, high = ordered[below], ordered[below + 1]
        value = min(max(low + (place - below) * (high - low), low), high)
        return round(value) if isinstance(like, int) else float(value)


@lru_cache(maxsize=64)
def _sort(values: tuple[Number, ...]) -> list[Number]:
    """Return values in order; cached, because each episode needs a quantile of them."""
    return sorted(values)


STANDARD = NormalDist()

FARTHEST = 30.0
"""An interval beyond this distance on one side of the mean has a share of practically 0. [sd]"""

Distribution = Uniform | Choice | Normal | Empirical
KINDS: dict[str, type[Distribution]] = {
    "uniform": Uniform,
    "choice": Choice,
    "normal": Normal,
    "empirical": Empirical,
}


class Variation(msgspec.Struct, frozen=True, eq=False, dict=True):
    """The parameters of a scenario, each fixed or drawn; made by `read_variation`.

    Attributes:
        kind: the scenario's `Parameters`.
        field: path of the parameters, for errors.
        fixed: the values that all episodes share.
        varied: distributions by name, in the order of the names, which is the order of draws.
        searched: distributions of the parameters whose quantiles a search chooses, by name.
        correlations: coefficients of the Gaussian copula, by names of two searched parameters.
    """

    kind: type[msgspec.Struct]
    field: str
    fixed: Mapping[str, Any]
    varied: Mapping[str, Distribution]
    searched: Mapping[str, Distribution] = MappingProxyType({})
    correlations: Mapping[tuple[str, str], float] = MappingProxyType({})

    def draw(self, seed: int, z: Mapping[str, float] = MappingProxyType({})) -> Any:
        """Return the parameters of an episode.

        Args:
            seed: seed of the episode.
            z: standard normal value of each searched parameter.

        Raises:
            InvalidValue: the scenario refuses the values, although it accepts the ends.
        """
        return self._read(self.drawn(seed) | self.place(z))

    def drawn(self, seed: int) -> dict[str, Any]:
        """Return the parameters that are drawn from the episode's seed, by name."""
        random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(VARIATION_STREAM,)))
        like = self._like
        return {name: one.draw(random, getattr(like, name)) for name, one in self.varied.items()}

    def place(self, z: Mapping[str, float]) -> dict[str, Any]:
        """Return the values of the searched parameters, from the standard normal z of each.

        For correlated parameters, the Cholesky factor of the correlations first combines each z
        with the earlier z. The parameter is the quantile of the result, which is standard normal,
        too.
        """
        return {
            name: self.searched[name].find_quantile(STANDARD.cdf(each), getattr(self._like, name))
            for name, each in self._correlate(z).items()
        }

    def _correlate(self, z: Mapping[str, float]) -> Mapping[str, float]:
        if not self.correlations:
            return z
        names = tuple(self.searched)
        # z of each parameter acts on itself and on those behind it in this order.
        factor = np.linalg.cholesky(make_correlation_matrix(names, self.correlations))
        correlated = factor @ np.array([z[name] for name in names])
        return dict(zip(names, correlated.tolist(), strict=True))

    @cached_property
    def _like(self) -> Any:
        """Parameters of the right types; cached, because reading takes longer than drawing."""
        return next(self.corners())

    def corners(self) -> Iterator[Any]:
        """Return the parameters at all combinations of the distributions' ends.

        Raises:
            InvalidValue: a value is outside its bounds.
            UnknownName: the scenario does not have the parameter.
        """
        return map(self._read, self._combinations())

    def largest(self, measure: Callable[[Any], int]) -> int:
        """Return the largest measure at any corner; raises the same errors as `corners`."""
        return max(map(measure, self.corners()))

    def _combinations(self) -> Iterator[dict[str, Any]]:
        distributions = {**self.varied, **self.searched}
        ends = [one.ends() for one in distributions.values()]
        return (dict(zip(distributions, values, strict=True)) for values in product(*ends))

    def _read(self, drawn: Mapping[str, Any]) -> Any:
        try:
            return read_settings(self.kind, {**self.fixed, **drawn}, self.field)
        except InvalidValue as error:
            raise self._explained(error, drawn) from None

    def _explained(self, error: InvalidValue, drawn: Mapping[str, Any]) -> InputError:
        """Return the error, with the values drawn or the unknown distribution."""
        name = error.field.removeprefix(f"{self.field}.")
        given, problem = self.fixed.get(name), error.problem.removeprefix(f"{error.field}: ")
        # A dict that is no distribution is nearly always a misspelt one, as in {"unform": [1, 2]}.
        if isinstance(given, dict) and given:
            return UnknownName(error.field, str(next(iter(given))), KINDS)
        if not drawn or name in drawn:
            return error
        return InvalidValue(error.field, f"{dict(drawn)} is refused. {problem}")


def read_variation(
    kind: type[msgspec.Struct],
    given: Mapping[str, Any],
    field: str = "scenario_parameters",
    searched: Iterable[str] = (),
    correlations: Mapping[tuple[str, str], float] = MappingProxyType({}),
) -> Variation:
    """Return a scenario's parameters from user input, checked at the ends of all distributions.

    Args:
        kind: the scenario's `Parameters`; their annotations contain the bounds.
        given: value or distribution of each parameter, by name.
        field: path of the parameters, for errors.
        searched: names of the parameters whose quantiles a search chooses.
        correlations: coefficients of the Gaussian copula, by names of two searched parameters.

    Raises:
        UnknownName: a parameter or distribution does not exist.
        InvalidValue: a value or an end is outside its bounds, ends are in the wrong order, or there
            are more combinations of ends than can be checked.
    """
    varied = {
        name: read_distribution(value, f"{field}.{name}")
        # By name: values are drawn in this order, and must not depend on how a file was
        # written.
        for name, value in sorted(given.items())
        if isinstance(value, dict) and not KINDS.keys().isdisjoint(value)
    }
    fixed = {name: value for name, value in given.items() if name not in varied}
    # A parameter that is searched is not drawn: taken out here, it uses up no random number.
    chosen = {name: varied.pop(name) for name in searched if name in varied}
    if prod(len(one.ends()) for one in (*varied.values(), *chosen.values())) > MAX_CORNERS:
        problem = f"the distributions have more than {MAX_CORNERS} combinations of ends."
        raise InvalidValue(field, problem, "Vary fewer parameters, or choose from fewer values.")
    variation = Variation(kind, field, fixed, varied, chosen, correlations)
    # To read a corner checks it: draws between corners are within the bounds, too.
    for _ in variation.corners():
        pass
    return variation


def make_correlation_matrix(
    names: Sequence[str], correlations: Mapping[tuple[str, str], float]
) -> NDArray[np.float64]:
    """Return the correlation matrix, in the order of the names; missing coefficients are 0."""
    matrix = np.eye(len(names))
    for (one, other), coefficient in correlations.items():
        row, column = names.index(one), names.index(other)
        matrix[row, column] = matrix[column, row] = coefficient
    return matrix


def read_distribution(given: Mapping[str, Any], field: str) -> Distribution:
    """Return the distribution that a user gave.

    Raises:
        UnknownName: the distribution has a field that its kind does not have.
        InvalidValue: the ends are not finite numbers in order, or values are missing.
    """
    name = next(name for name in KINDS if name in given)
    found: Distribution = convert(given, KINDS[name], field)
    # In a type's bounds msgspec cannot compare two fields with each other.
    for name, ends in _list_intervals(found):
        low, high = ends
        if not (isfinite(low) and isfinite(high) and low <= high):
            problem = f"[{low}, {high}] is not an interval from a smaller to a larger number."
            raise InvalidValue(f"{field}.{name}", problem)
    if isinstance(found, Empirical):
        return _unify_sample(found, field)
    if isinstance(found, Normal):
        if not all(map(isfinite, found.normal)):
            problem = "mean and standard deviation must be finite numbers."
            raise InvalidValue(f"{field}.normal", problem)
        if not found.has_mass:
            problem = "both ends are more than 30 standard deviations off the mean."
            raise InvalidValue(f"{field}.within", problem)
    return found


def _unify_sample(found: Empirical, field: str) -> Empirical:
    """Return a sample whose values are all whole numbers, or all floats.

    Raises:
        InvalidValue: a value is not finite.
    """
    if not all(map(isfinite, found.empirical)):
        raise InvalidValue(f"{field}.empirical", "all values must be finite numbers.")
    if all(isinstance(each, int) for each in found.empirical):
        return found
    # Whether draws are rounded follows from the smallest value: 56 beside 57.3 stands for 56.0.
    return Empirical(tuple(map(float, found.empirical)))


def _list_intervals(found: Distribution) -> Iterator[tuple[str, tuple[Number, Number]]]:
    """Yield the intervals of a distribution with the names of their fields."""
    match found:
        case Uniform():
            yield "uniform", found.uniform
        case Normal():
            yield "within", found.within


def in_words(given: Mapping[str, Any]) -> dict[str, str]:
    """Return a scenario's parameters in words, such as "uniform 53 … 63", "one of 1.9, 2.0"."""
    return {name: _value_in_words(value) for name, value in given.items()}


def _value_in_words(value: Any) -> str:
    match value:
        case {"uniform": [low, high]}:
            return f"uniform {low} … {high}"
        case {"normal": [mean, deviation], "within": [low, high]}:
            return f"normal {mean} ± {deviation}, within {low} … {high}"
        case {"empirical": [*values]}:
            return f"as in {len(values)} values, {min(values)} … {max(values)}"
        case {"choice": [*values]}:
            return f"one of {', '.join(map(str, values))}"
        case [*values]:
            return ", ".join(map(str, values))
    return str(value)
