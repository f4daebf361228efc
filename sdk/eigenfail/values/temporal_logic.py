"""Formulas of signal temporal logic: what may stand in one, and how robustly a course satisfies it.

Robustness is that of Donzé and Maler (Robust Satisfaction of Temporal Logic over Real-Valued
Signals, 2010, definition 3): a comparison has the difference of its sides, `and` and `always` the
smallest value, `or` and `eventually` the largest. rtamt computes it; what a formula may hold is
decided here, before rtamt sees it, because its language can also import Python modules.
"""

import re
from collections.abc import Collection, Mapping
from functools import lru_cache
from math import isclose
from typing import Any, Final

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.values.signals import Samples

OPERATORS: Final = frozenset(
    {
        *("always", "eventually", "until", "historically", "once", "since"),
        *("and", "or", "not", "implies", "iff", "xor", "abs"),
    }
)
"""Words of the language; every other word is the name of a signal."""

LONGEST: Final = 1_000
"""Characters of a formula."""

DEEPEST: Final = 50
"""Parentheses of a formula inside each other."""

REMEDY: Final = "docs/requirements.md shows what a formula may hold."

_TOKEN = re.compile(
    r"\s*(?:(?P<word>[A-Za-z_][A-Za-z_0-9.]*)|(?P<number>\d+(?:\.\d+)?)"
    r"|(?P<comparison>[<>]=?|==)|(?P<sign>[-+*()\[\]:,]))"
)
_WORD = re.compile(r"[A-Za-z_][A-Za-z_0-9.]*")
_BOUNDS = re.compile(r"\[([^\]]*)\]")
_SECONDS = re.compile(r"\s*(\d+(?:\.\d+)?)\s*[:,]\s*(\d+(?:\.\d+)?)\s*")

_DOT: Final = "__of__"
"""Stands for the dot in the name of a signal: rtamt takes what follows a dot for an attribute."""


def list_names(formula: str, field: str = "formula") -> frozenset[str]:
    """Return the names of the signals in a formula.

    Raises:
        InvalidValue: it holds something that no formula may hold, or nothing is compared in it.
    """
    if len(formula) > LONGEST:
        raise InvalidValue(field, f"is longer than {LONGEST} characters.", REMEDY)
    names: set[str] = set()
    place, depth, compares = 0, 0, False
    while formula[place:].strip():
        token = _TOKEN.match(formula, place)
        if token is None:
            rest = formula[place:].strip()[:20]
            raise InvalidValue(field, f"'{rest}' cannot stand in a formula.", REMEDY)
        place = token.end()
        word, sign = token["word"], token["sign"]
        compares = compares or token["comparison"] is not None
        depth += (sign == "(") - (sign == ")")
        if depth > DEEPEST:
            problem = f"has more than {DEEPEST} parentheses inside each other."
            raise InvalidValue(field, problem, "Split it into several requirements.")
        if word is not None and word not in OPERATORS:
            names.add(word)
    if not compares or not names:
        problem = f"'{formula}' compares no signal with a number."
        raise InvalidValue(field, problem, "Write, for example, always (headway_s > 0.5).")
    return frozenset(names)


def check_formula(
    formula: str, known: Collection[str], dt_s: float, duration_s: float, field: str = "formula"
) -> None:
    """Refuse a formula that cannot be judged on an episode of this duration.

    Raises:
        UnknownName: a signal that does not exist, with those that do.
        InvalidValue: it is no formula; a bound is no multiple of a step; or it looks further ahead
            than an episode lasts.
    """
    for name in sorted(list_names(formula, field)):
        if name not in known:
            raise UnknownName(f"signal in {field}", name, known)
    for bounds in _BOUNDS.findall(formula):
        _check_bounds(bounds, dt_s, field)
    try:
        horizon_s = _parse(formula, dt_s).horizon_s
    except InvalidValue:
        raise
    except Exception as error:
        place = str(error).removeprefix("RTAMT Exception: ").strip()
        problem = f"'{formula}' is not a formula: {place}."
        raise InvalidValue(field, problem, REMEDY) from error
    if horizon_s > duration_s * (1.0 + 1e-9):
        raise InvalidValue(
            field,
            f"looks {horizon_s:g} s ahead, and an episode lasts {duration_s:g} s.",
            "Shorten its bounds, or lengthen the episodes.",
        )


def _check_bounds(bounds: str, dt_s: float, field: str) -> None:
    seconds = _SECONDS.fullmatch(bounds)
    if seconds is None:
        raise InvalidValue(field, f"[{bounds}] is not a pair of times.", "Write [0:3], in seconds.")
    first_s, last_s = map(float, seconds.groups())
    if first_s > last_s:
        problem = f"[{bounds}] ends before it begins."
        raise InvalidValue(field, problem, f"Write [{last_s:g}:{first_s:g}].")
    for bound_s in (first_s, last_s):
        steps = bound_s / dt_s
        if not isclose(steps, round(steps), abs_tol=1e-6):
            problem = f"{bound_s:g} s is not a whole number of steps of {dt_s:g} s."
            raise InvalidValue(field, problem, f"Write {round(steps) * dt_s:g}.")


def evaluate_formula(formula: str, dt_s: float, signals: Mapping[str, Samples]) -> float:
    """Return the robustness of a formula at the start of a course.

    Args:
        formula: as `check_formula` lets it pass.
        dt_s: time between two values.
        signals: values by name, all of the same length, of those in the formula at least.

    Raises:
        InvalidValue: rtamt is not installed.
    """
    return _parse(formula, dt_s).evaluate(signals)


class _Monitor:
    """A formula that rtamt has read."""

    def __init__(self, formula: str, dt_s: float) -> None:
        try:
            import rtamt
        except ImportError as error:
            raise InvalidValue(
                "requirements",
                "formulas of temporal logic need rtamt, which is not installed here.",
                "Install eigenfail[stl], for services and workers.",
            ) from error
        self._names = list_names(formula)
        self._dt_s = dt_s
        self._monitor: Any = rtamt.StlDiscreteTimeSpecification()
        for name in sorted(self._names):
            self._monitor.declare_var(_replace_dots(name), "float")
        self._monitor.set_sampling_period(dt_s, "s", 0.1)
        self._monitor.spec = _replace_dots(formula)
        self._monitor.parse()

    @property
    def horizon_s(self) -> float:
        """How far the bounds of the formula look ahead; without bounds it sees to the end."""
        return max(_find_horizon(each) for each in self._monitor.ast.specs)

    def evaluate(self, signals: Mapping[str, Samples]) -> float:
        """Return the robustness at the start."""
        steps = len(signals[next(iter(self._names))])
        values = {_replace_dots(name): signals[name].tolist() for name in self._names}
        times = [step * self._dt_s for step in range(steps)]
        return float(self._monitor.evaluate({"time": times, **values})[0][1])


def _replace_dots(formula: str) -> str:
    return _WORD.sub(lambda word: word[0].replace(".", _DOT), formula)


@lru_cache(maxsize=64)
def _parse(formula: str, dt_s: float) -> _Monitor:
    return _Monitor(formula, dt_s)


_LOOKING_AHEAD = frozenset({"TimedEventually", "TimedAlways", "TimedUntil"})


def _find_horizon(node: Any) -> float:
    """Return the largest sum of bounds of operators inside each other that look ahead. [s]"""
    inside = max((_find_horizon(child) for child in node.children), default=0.0)
    ahead = type(node).__name__ in _LOOKING_AHEAD
    return inside + float(node.end) if ahead else inside
