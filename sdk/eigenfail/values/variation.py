"""Scenario parameters that vary from episode to episode.

In place of a value a parameter may have a distribution: `{"uniform": [52.0, 70.0]}`, both ends
included, of whole numbers where the parameter is one; `{"choice": [1.9, 2.0, 2.1]}`, each as
likely; `{"normal": [58.0, 3.0], "within": [52.0, 70.0]}`, a normal distribution by mean and
standard deviation, cut off at the ends of `within`; or `{"empirical": [57.1, 60.4, 58.8]}`, the
distribution of a sample. A value is drawn from the episode's own seed, so that nothing has to
travel or be kept; or, where a channel `scenario.NAME` makes the parameter a part of the search, it
is the quantile that belongs to the channel's z. Parameters that are searched may be correlated, by
a Gaussian copula.
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
"""Sets these draws apart from those of the noise and of the scenario, from the same seed."""

# Each corner is checked as a campaign is made: more would keep its user waiting.
MAX_CORNERS = 4096

Number = int | float


class Uniform(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Anywhere from the first to the second."""

    uniform: tuple[Number, Number]

    def ends(self) -> tuple[Any, ...]:
        """What has to be within the parameter's bounds."""
        return self.uniform

    def draw(self, random: np.random.Generator, like: Any) -> Number:
        """A value of the kind that `like` has."""
        low, high = self.uniform
        # By the kind of the parameter, not of the ends: [52, 70] may stand for metres.
        if isinstance(like, int):
            return int(random.integers(int(low), int(high), endpoint=True))
        # Rounding may lead beyond an end, and the parameter's bounds were checked at the ends.
        return min(max(float(random.uniform(low, high)), low), high)

    def find_quantile(self, p: float, like: Any) -> Number:
        """The value of the kind that `like` has below which lies a share p."""
        low, high = self.uniform
        if isinstance(like, int):
            # p may be 1.
            return min(int(low) + int(p * (int(high) - int(low) + 1)), int(high))
        return min(max(low + p * (high - low), low), high)


class Choice(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One of these."""

    choice: Annotated[tuple[Any, ...], msgspec.Meta(min_length=1)]

    def ends(self) -> tuple[Any, ...]:
        """What has to be within the parameter's bounds."""
        return self.choice

    def draw(self, random: np.random.Generator, _like: Any) -> Any:
        """A value."""
        return self.choice[int(random.integers(len(self.choice)))]

    def find_quantile(self, p: float, _like: Any) -> Any:
        """The value below which lies a share p, in the order in which they are given."""
        return self.choice[min(int(p * len(self.choice)), len(self.choice) - 1)]


class Normal(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Normal with this mean and standard deviation, given that it is between two ends."""

    normal: tuple[float, Annotated[float, msgspec.Meta(gt=0.0)]]
    within: tuple[Number, Number]

    def ends(self) -> tuple[Any, ...]:
        """What has to be within the parameter's bounds."""
        return self.within

    def draw(self, random: np.random.Generator, like: Any) -> Number:
        """A value of the kind that `like` has."""
        return self.find_quantile(float(random.random()), like)

    def find_quantile(self, p: float, like: Any) -> Number:
        """The value of the kind that `like` has below which lies a share p."""
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
        """Whether the share of the normal distribution between the ends is numerically above 0."""
        mean, deviation = self.normal
        return min(abs((end - mean) / deviation) for end in self.within) < FARTHEST or (
            self.within[0] <= mean <= self.within[1]
        )


MOST_SAMPLES = 10_000


class Empirical(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """As in a sample: between neighbouring values of n, in order, there is a share of 1 / (n - 1).

    Its quantile is linear between the sorted values, the first at p = 0 and the last at p = 1
    (definition 7 of Hyndman and Fan 1996, The American Statistician 50, 361-365).
    """

    empirical: Annotated[tuple[Number, ...], msgspec.Meta(min_length=2, max_length=MOST_SAMPLES)]

    def ends(self) -> tuple[Any, ...]:
        """What has to be within the parameter's bounds."""
        return min(self.empirical), max(self.empirical)

    def draw(self, random: np.random.Generator, like: Any) -> Number:
        """A value of the kind that `like` has."""
        return self.find_quantile(float(random.random()), like)

    def find_quantile(self, p: float, like: Any) -> Number:
        """The value of the kind that `like` has below which lies a share p."""
        ordered = _sort(self.empirical)
        place = min(max(p, 0.0), 1.0) * (len(ordered) - 1)
        below = min(int(place), len(ordered) - 2)
        low, high = ordered[below], ordered[below + 1]
        value = min(max(low + (place - below) * (high - low), low), high)
        return round(value) if isinstance(like, int) else float(value)


@lru_cache(maxsize=64)
def _sort(values: tuple[Number, ...]) -> list[Number]:
    """Return values in order; cached, as each episode asks for a quantile of them."""
    return sorted(values)


STANDARD = NormalDist()

FARTHEST = 30.0
"""Beyond it, between two ends on one side of the mean, there is no share to speak of. [sd]"""

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
        field: where they stood, for errors.
        fixed: the values that all episodes share.
        varied: distributions in the order of their names, which is the order of the draws.
        searched: distributions of the parameters whose quantiles a search chooses, by name.
        correlations: coefficients of the Gaussian copula of these, by two of their names.
    """

    kind: type[msgspec.Struct]
    field: str
    fixed: Mapping[str, Any]
    varied: Mapping[str, Distribution]
    searched: Mapping[str, Distribution] = MappingProxyType({})
    correlations: Mapping[tuple[str, str], float] = MappingProxyType({})

    def draw(self, seed: int, z: Mapping[str, float] = MappingProxyType({})) -> Any:
        """The parameters of an episode.

        Args:
            seed: of the episode.
            z: standard normal value of each parameter that is searched.

        Raises:
            InvalidValue: the scenario refuses them, though it takes those at the ends.
        """
        return self._read(self.drawn(seed) | self.place(z))

    def drawn(self, seed: int) -> dict[str, Any]:
        """Those of the episode's parameters that are drawn from its seed, by name."""
        random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(VARIATION_STREAM,)))
        like = self._like
        return {name: one.draw(random, getattr(like, name)) for name, one in self.varied.items()}

    def place(self, z: Mapping[str, float]) -> dict[str, Any]:
        """The values of parameters that are searched, from the standard normal z of each.

        A correlated parameter is the quantile of what the Cholesky factor of the correlations makes
        of its z and of those before it, which is standard normal, too.
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
        """Parameters of the right kinds. To read them takes longer than to draw from them."""
        return next(self.corners())

    def corners(self) -> Iterator[Any]:
        """The parameters at all combinations of the distributions' ends.

        Raises:
            InvalidValue: some are outside their bounds.
            UnknownName: the scenario has no such parameter.
        """
        return map(self._read, self._combinations())

    def largest(self, measure: Callable[[Any], int]) -> int:
        """The largest measure at any corner; raises as `corners` does."""
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
        """The complaint, with the value that a distribution gave."""
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
    """A scenario's parameters as a user gave them, checked at the ends of all distributions.

    Args:
        kind: the scenario's `Parameters`; their annotations carry the bounds.
        given: for each name a value, or a distribution.
        field: where they stood, for the error.
        searched: names of the parameters whose quantiles a search chooses.
        correlations: coefficients of the Gaussian copula of these, by two of their names.

    Raises:
        UnknownName: no such parameter, or no such distribution.
        InvalidValue: a value or an end outside its bounds, ends in the wrong order, or more
            combinations of ends than can be checked.
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
    """Return the matrix of coefficients between pairs of names, in their order; others are 0."""
    matrix = np.eye(len(names))
    for (one, other), coefficient in correlations.items():
        row, column = names.index(one), names.index(other)
        matrix[row, column] = matrix[column, row] = coefficient
    return matrix


def read_distribution(given: Mapping[str, Any], field: str) -> Distribution:
    """A distribution as a user gave it.

    Raises:
        UnknownName: it has a field besides its kind that is of another kind, or of none.
        InvalidValue: its ends are not finite numbers in order, or it has no value.
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
        InvalidValue: one is not finite.
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
    """A scenario's parameters as people read them: "uniform 53 … 63", "one of 1.9, 2.0, 2.1"."""
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
