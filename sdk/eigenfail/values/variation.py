"""Scenario parameters that vary from episode to episode, drawn from the episode's own seed.

In place of a value a parameter may have a distribution: `{"uniform": [52.0, 70.0]}`, both ends
included, of whole numbers where the parameter is one; or `{"choice": [1.9, 2.0, 2.1]}`, each as
likely. Nothing is drawn but from the episode's seed, so that nothing has to travel or be kept.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import product
from math import isfinite, prod
from typing import Annotated, Any

import msgspec
import numpy as np

from eigenfail.errors import InputError, InvalidValue, UnknownName
from eigenfail.settings import convert, read_settings

VARIATION_STREAM = 2
"""Sets these draws apart from those of the noise and of the scenario, from the same seed."""

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
        if isinstance(like, int):
            return int(random.integers(int(low), int(high), endpoint=True))
        return min(max(float(random.uniform(low, high)), low), high)


class Choice(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One of these."""

    choice: Annotated[tuple[Any, ...], msgspec.Meta(min_length=1)]

    def ends(self) -> tuple[Any, ...]:
        """What has to be within the parameter's bounds."""
        return self.choice

    def draw(self, random: np.random.Generator, _like: Any) -> Any:
        """A value."""
        return self.choice[int(random.integers(len(self.choice)))]


Distribution = Uniform | Choice
KINDS: dict[str, type[Distribution]] = {"uniform": Uniform, "choice": Choice}


class Variation(msgspec.Struct, frozen=True, eq=False):
    """The parameters of a scenario, each fixed or drawn; made by `read_variation`.

    Attributes:
        kind: the scenario's `Parameters`.
        field: where they stood, for errors.
        fixed: the values that all episodes share.
        varied: distributions in the order of their names, which is the order of the draws.
    """

    kind: type[msgspec.Struct]
    field: str
    fixed: Mapping[str, Any]
    varied: Mapping[str, Distribution]

    def draw(self, seed: int) -> Any:
        """The parameters of the episode with this seed.

        Raises:
            InvalidValue: the scenario refuses them, though it takes those at the ends.
        """
        return self._read(self.drawn(seed))

    def drawn(self, seed: int) -> dict[str, Any]:
        """Those of the episode's parameters that vary, by name."""
        return self._drawn(seed, self._like())

    def table(self, seeds: Iterable[int]) -> Iterator[dict[str, Any]]:
        """All parameters of the episodes with these seeds, by name."""
        like = self._like()
        shared = msgspec.structs.asdict(like)
        return (shared | self._drawn(seed, like) for seed in seeds)

    def _like(self) -> Any:
        """Parameters of the right kinds."""
        return self._read(next(self._combinations()))

    def _drawn(self, seed: int, like: Any) -> dict[str, Any]:
        random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(VARIATION_STREAM,)))
        return {name: one.draw(random, getattr(like, name)) for name, one in self.varied.items()}

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
        ends = [one.ends() for one in self.varied.values()]
        return (dict(zip(self.varied, values, strict=True)) for values in product(*ends))

    def _read(self, drawn: Mapping[str, Any]) -> Any:
        try:
            return read_settings(self.kind, {**self.fixed, **drawn}, self.field)
        except InvalidValue as error:
            raise self._explained(error, drawn) from None

    def _explained(self, error: InvalidValue, drawn: Mapping[str, Any]) -> InputError:
        """The complaint, with the value that a distribution gave."""
        name = error.field.removeprefix(f"{self.field}.")
        given, problem = self.fixed.get(name), error.problem.removeprefix(f"{error.field}: ")
        if isinstance(given, dict) and given:
            return UnknownName(error.field, str(next(iter(given))), KINDS)
        if not drawn or name in drawn:
            return error
        return InvalidValue(error.field, f"{dict(drawn)} is refused. {problem}")


def read_variation(
    kind: type[msgspec.Struct], given: Mapping[str, Any], field: str = "scenario_parameters"
) -> Variation:
    """A scenario's parameters as a user gave them, checked at the ends of all distributions.

    Args:
        kind: the scenario's `Parameters`; their annotations carry the bounds.
        given: for each name a value, or a distribution.
        field: where they stood, for the error.

    Raises:
        UnknownName: no such parameter, or no such distribution.
        InvalidValue: a value or an end outside its bounds, ends in the wrong order, or more
            combinations of ends than can be checked.
    """
    varied = {
        name: read_distribution(value, f"{field}.{name}")
        for name, value in sorted(given.items())
        if isinstance(value, dict) and not KINDS.keys().isdisjoint(value)
    }
    fixed = {name: value for name, value in given.items() if name not in varied}
    if prod(len(one.ends()) for one in varied.values()) > MAX_CORNERS:
        problem = f"the distributions have more than {MAX_CORNERS} combinations of ends."
        raise InvalidValue(field, problem, "Vary fewer parameters, or choose from fewer values.")
    variation = Variation(kind, field, fixed, varied)
    for _ in variation.corners():
        pass
    return variation


def read_distribution(given: Mapping[str, Any], field: str) -> Distribution:
    """A distribution as a user gave it.

    Raises:
        InvalidValue: its ends are not finite numbers in order, or it has no value.
    """
    name = next(name for name in KINDS if name in given)
    found: Distribution = convert(given, KINDS[name], field)
    if isinstance(found, Uniform):
        low, high = found.uniform
        if not (isfinite(low) and isfinite(high) and low <= high):
            problem = f"[{low}, {high}] is not an interval from a smaller to a larger number."
            raise InvalidValue(f"{field}.uniform", problem)
    return found


def in_words(given: Mapping[str, Any]) -> dict[str, str]:
    """A scenario's parameters as people read them: "uniform 53 … 63", "one of 1.9, 2.0, 2.1"."""
    return {name: _value_in_words(value) for name, value in given.items()}


def _value_in_words(value: Any) -> str:
    match value:
        case {"uniform": [low, high]}:
            return f"uniform {low} … {high}"
        case {"choice": [*values]}:
            return f"one of {', '.join(map(str, values))}"
        case [*values]:
            return ", ".join(map(str, values))
    return str(value)
