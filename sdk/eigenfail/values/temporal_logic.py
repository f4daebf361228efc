"""Formulas of signal temporal logic, and how robustly a course satisfies them.

Robustness is defined as by Donzé and Maler (Robust Satisfaction of Temporal Logic over Real-Valued
Signals, 2010, definition 3), at the steps of a course. A comparison has the difference of its
sides, `not` the negative of its part, `and` and `always` the smallest value, `or` and `eventually`
the largest. As in linear temporal logic over steps, the first part of `until` need not hold at the
step when the second part holds. Bounds are in seconds.

Steps before the start and after the end of a course do not count. If the window of a temporal
operator is empty at a step, the operator is not judged there: its robustness is NaN. Parts that are
not judged count as unknown in Kleene's logic. `and` is violated if a part is violated, and `or` is
satisfied if a part is satisfied. Otherwise, they are not judged if a part is not judged. `not` is
judged only if its part is. A temporal operator leaves out steps at which its part is not judged,
and is not judged if none is left.

    formula      = disjunction [ "implies" formula ]
    disjunction  = conjunction { "or" conjunction }
    conjunction  = operand { "and" operand }
    operand      = unary [ ("until" | "since") [bounds] unary ]
    unary        = ("not" | word [bounds]) unary | comparison | "(" formula ")"
    word         = "always" | "eventually" | "historically" | "once"
    bounds       = "[" number (":" | ",") number "]"
    comparison   = sum ("<" | "<=" | ">" | ">=") sum
    sum          = product { ("+" | "-") product }
    product      = factor { "*" factor }
    factor       = "-" factor | number | signal | "abs" "(" sum ")" | "(" sum ")"
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache, reduce
from math import inf, isclose, isnan
from typing import Final, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.values.signals import Samples

LONGEST: Final = 1_000
"""Maximum length of a formula [characters]."""

LARGEST: Final = 1e12
"""Largest number in a formula."""

DEEPEST: Final = 50
"""Maximum number of operators and parentheses inside each other."""

REMEDY: Final = "docs/requirements.md shows what a formula may hold."

Signals = Mapping[str, Samples]


class TimeBounds(NamedTuple):
    """Time bounds of an operator, relative to the step of its evaluation. [s]"""

    first_s: float
    last_s: float

    def count_steps(self, dt_s: float) -> tuple[int, int]:
        """Return the first and the last step."""
        return round(self.first_s / dt_s), round(self.last_s / dt_s)


UNBOUNDED: Final = TimeBounds(0.0, inf)


class Node(ABC):
    """A part of a formula.

    Attributes:
        parts: the parts inside this part.
        bounds: time bounds, for a temporal operator with bounds.
        looks_ahead: whether it uses later steps.
    """

    parts: tuple["Node", ...] = ()
    bounds: TimeBounds = UNBOUNDED
    looks_ahead = False

    @abstractmethod
    def evaluate(self, signals: Signals, dt_s: float) -> Samples:
        """Return the value of the part at each step."""

    def list_nodes(self) -> list["Node"]:
        """Return this part and all parts inside it."""
        return [self, *[node for part in self.parts for node in part.list_nodes()]]

    def find_horizon(self) -> float:
        """Return how far nested bounds look ahead; operators without bounds add 0. [s]"""
        inside = max([0.0, *[part.find_horizon() for part in self.parts]])
        return inside + self.bounds.last_s if self._adds_horizon else inside

    @property
    def _adds_horizon(self) -> bool:
        return self.looks_ahead and self.bounds.last_s < inf


class Constant(Node):
    """A constant."""

    def __init__(self, value: float) -> None:
        self._value = value

    def evaluate(self, signals: Signals, dt_s: float) -> Samples:  # noqa: ARG002 - a constant
        """Return the constant, once for all steps."""
        return np.array([self._value])


class SignalName(Node):
    """A signal."""

    def __init__(self, name: str) -> None:
        self.name = name

    def evaluate(self, signals: Signals, dt_s: float) -> Samples:  # noqa: ARG002 - known by step
        """Return the samples of the named signal."""
        return signals[self.name]


class Combination(Node):
    """A combination of parts, step by step."""

    def __init__(self, combine: Callable[..., Samples], *parts: Node) -> None:
        self._combine = combine
        self.parts = parts

    def evaluate(self, signals: Signals, dt_s: float) -> Samples:
        """Return the combined values."""
        values = [part.evaluate(signals, dt_s) for part in self.parts]
        # `reduce` would return a single value as it is: `not` and `abs` have one part.
        if len(values) == 1:
            return np.asarray(self._combine(values[0]))
        return np.asarray(reduce(self._combine, values))


def find_smaller(one: Samples, other: Samples) -> Samples:
    """Return the robustness of `and`: NaN if a part is not judged and none is violated."""
    # A part that is violated settles `and`, whatever the part that is not judged would say.
    judged = np.fmin(one, other)
    return np.where((np.isnan(one) | np.isnan(other)) & ~(judged <= 0.0), np.nan, judged)


def find_larger(one: Samples, other: Samples) -> Samples:
    """Return the robustness of `or`: NaN if a part is not judged and none is satisfied."""
    # A part that is satisfied settles `or`, as above.
    judged = np.fmax(one, other)
    return np.where((np.isnan(one) | np.isnan(other)) & ~(judged > 0.0), np.nan, judged)


class Window(Node):
    """The smallest or largest value over steps: `always`, `eventually`, `historically`, `once`."""

    def __init__(self, word: str, bounds: TimeBounds, part: Node) -> None:
        self.parts, self.bounds = (part,), bounds
        self.looks_ahead = word in {"always", "eventually"}
        self._smallest = word in {"always", "historically"}

    def evaluate(self, signals: Signals, dt_s: float) -> Samples:
        """Return the extreme value over the steps in the window."""
        (part,) = self.parts
        values = _spread(part.evaluate(signals, dt_s), signals)
        # The past is the future of the reversed course: one way of counting serves both.
        ahead = values if self.looks_ahead else values[::-1]
        found = self._look_ahead(ahead, dt_s)
        return found if self.looks_ahead else found[::-1]

    def _look_ahead(self, values: Samples, dt_s: float) -> Samples:
        # Both leave out what is not judged.
        extreme = np.fmin if self._smallest else np.fmax
        if self.bounds == UNBOUNDED:
            return np.asarray(extreme.accumulate(values[::-1])[::-1])
        # A window that reaches beyond the course holds nothing more.
        first, last = (min(each, len(values)) for each in self.bounds.count_steps(dt_s))
        padded = np.concatenate([values, np.full(last, np.nan)])[first:]
        windows = sliding_window_view(padded, last - first + 1)
        return np.asarray(extreme.reduce(windows, axis=1)[: len(values)])


class Until(Node):
    """`until`: the second part holds at some step, the first before it; `since`: mirrored."""

    def __init__(self, word: str, bounds: TimeBounds, left: Node, right: Node) -> None:
        self.parts, self.bounds = (left, right), bounds
        self.looks_ahead = word == "until"

    def evaluate(self, signals: Signals, dt_s: float) -> Samples:
        """Return the robustness at the best step: second part there, first part before it."""
        left, right = (_spread(part.evaluate(signals, dt_s), signals) for part in self.parts)
        if not self.looks_ahead:
            left, right = left[::-1], right[::-1]
        found = self._look_ahead(left, right, dt_s)
        return found if self.looks_ahead else found[::-1]

    def _look_ahead(self, left: Samples, right: Samples, dt_s: float) -> Samples:
        steps = len(right)
        first, last = 0, steps
        if self.bounds != UNBOUNDED:
            first, last = self.bounds.count_steps(dt_s)
        # At the first step nothing has to have held before.
        found, held = np.full(steps, np.nan), np.full(steps, inf)
        for ahead in range(min(last, steps - 1) + 1):
            reached = steps - ahead
            if ahead >= first:
                there = find_smaller(right[ahead:], held[:reached])
                found[:reached] = np.fmax(found[:reached], there)
            held[:reached] = np.fmin(held[:reached], left[ahead:])
        return found


def _spread(values: Samples, signals: Signals) -> Samples:
    """Return values for every step, even for a part without a signal."""
    steps = len(next(iter(signals.values())))
    return np.broadcast_to(values, (steps,))


class Token(NamedTuple):
    """A word, number or sign, and the place of its first character, counted from 1."""

    text: str
    character: int


_TOKEN = re.compile(r"\s*([A-Za-z_][A-Za-z_0-9.]*|\d+(?:\.\d+)?|[<>]=?|[-+*()\[\]:,])")
_NUMBER = re.compile(r"\d+(?:\.\d+)?")
_NAME = re.compile(r"[A-Za-z_][A-Za-z_0-9.]*")

_WINDOWS: Final = frozenset({"always", "eventually", "historically", "once"})
_WORDS: Final = _WINDOWS | {"until", "since", "and", "or", "not", "implies", "abs"}


class FormulaParser:
    """Parser of one formula.

    Raises:
        InvalidValue: the text is not a formula.
    """

    def __init__(self, formula: str, field: str) -> None:
        self._formula, self._field = formula, field
        self._tokens = self._split()
        self._place = 0
        self._depth = 0

    def parse(self) -> Node:
        """Return the whole formula."""
        found = self._read_formula()
        if not self._at(""):
            raise self._make_error("the end of the formula")
        return found

    def _split(self) -> list[Token]:
        if len(self._formula) > LONGEST:
            problem = f"is longer than {LONGEST} characters."
            raise InvalidValue(self._field, problem, "Split it into several requirements.")
        tokens: list[Token] = []
        place = 0
        while self._formula[place:].strip():
            token = _TOKEN.match(self._formula, place)
            if token is None:
                rest = self._formula[place:].strip()[:20]
                raise InvalidValue(self._field, f"'{rest}' cannot stand in a formula.", REMEDY)
            tokens.append(Token(token[1], token.start(1) + 1))
            place = token.end()
        # An empty token ends the list, so that there always is a next one to look at.
        return [*tokens, Token("", len(self._formula) + 1)]

    def _at(self, *texts: str) -> bool:
        return self._tokens[self._place].text in texts

    def _take(self, *texts: str) -> str:
        """Return the next token and move past it if it is among the texts; else an empty text."""
        if not self._at(*texts):
            return ""
        self._place += 1
        return self._tokens[self._place - 1].text

    def _require(self, text: str) -> None:
        if not self._take(text):
            raise self._make_error(f"'{text}'")

    def _make_error(self, wanted: str) -> InvalidValue:
        text, character = self._tokens[self._place]
        there = f"'{text}' at character {character}" if text else "the end"
        problem = f"'{self._formula}' has {there} in place of {wanted}."
        return InvalidValue(self._field, problem, REMEDY)

    def _read_formula(self) -> Node:
        left = self._read_chain("or")
        if not self._take("implies"):
            return left
        # `a implies b implies c` is `a implies (b implies c)`.
        return Combination(find_larger, Combination(np.negative, left), self._read_formula())

    def _read_chain(self, word: str) -> Node:
        """Return operands with `or` between them, or with `and`, which binds more tightly."""

        def read() -> Node:
            return self._read_chain("and") if word == "or" else self._read_operand()

        parts = [read()]
        while self._take(word):
            parts.append(read())
        combine = find_larger if word == "or" else find_smaller
        return Combination(combine, *parts) if len(parts) > 1 else parts[0]

    def _read_operand(self) -> Node:
        left = self._read_unary()
        if word := self._take("until", "since"):
            return Until(word, self._read_bounds(), left, self._read_unary())
        return left

    def _read_unary(self) -> Node:
        with self._nest():
            if self._take("not"):
                return Combination(np.negative, self._read_unary())
            if word := self._take(*_WINDOWS):
                return Window(word, self._read_bounds(), self._read_unary())
            return self._read_group() if self._begins_group() else self._read_comparison()

    @contextmanager
    def _nest(self) -> Iterator[None]:
        """Count one more nested operator or parenthesis, and refuse too many."""
        # Parser and evaluation recurse: a formula of a request must not exhaust Python's stack.
        self._depth += 1
        if self._depth > DEEPEST:
            problem = f"has more than {DEEPEST} operators and parentheses inside each other."
            raise InvalidValue(self._field, problem, "Split it into several requirements.")
        try:
            yield
        finally:
            self._depth -= 1

    def _begins_group(self) -> bool:
        """Return whether the next parenthesis holds a formula, and not a sum."""
        if not self._at("("):
            return False
        open_ones = 0
        for token in self._tokens[self._place :]:
            open_ones += (token.text == "(") - (token.text == ")")
            # Only a formula has a comparison inside its parentheses.
            if token.text in {"<", "<=", ">", ">="} or open_ones == 0:
                return open_ones > 0
        return True

    def _read_group(self) -> Node:
        self._require("(")
        found = self._read_formula()
        self._require(")")
        return found

    def _read_bounds(self) -> TimeBounds:
        if not self._take("["):
            return UNBOUNDED
        first_s = self._read_number("a time")
        if not self._take(":", ","):
            raise self._make_error("':'")
        last_s = self._read_number("a time")
        self._require("]")
        if first_s > last_s:
            problem = f"[{first_s:g}:{last_s:g}] ends before it begins."
            raise InvalidValue(self._field, problem, f"Write [{last_s:g}:{first_s:g}].")
        return TimeBounds(first_s, last_s)

    def _read_number(self, wanted: str) -> float:
        if not _NUMBER.fullmatch(self._tokens[self._place].text):
            raise self._make_error(wanted)
        number = float(self._take(self._tokens[self._place].text))
        if number > LARGEST:
            problem = f"holds a number above {LARGEST:g}."
            raise InvalidValue(self._field, problem, "Take a smaller one.")
        return number

    def _read_comparison(self) -> Node:
        left = self._read_sum()
        sign = self._take("<", "<=", ">", ">=")
        if not sign:
            raise self._make_error("a comparison such as '> 0.5'")
        right = self._read_sum()
        # > and >= have the same robustness, which differs from them only at 0: there it is
        # violated.
        larger, smaller = (left, right) if sign.startswith(">") else (right, left)
        return Combination(np.subtract, larger, smaller)

    def _read_sum(self) -> Node:
        # A difference is a sum with a negated part, so that there is one kind of node for both.
        parts = [self._read_product()]
        while sign := self._take("+", "-"):
            part = self._read_product()
            parts.append(part if sign == "+" else Combination(np.negative, part))
        return Combination(np.add, *parts) if len(parts) > 1 else parts[0]

    def _read_product(self) -> Node:
        parts = [self._read_factor()]
        while self._take("*"):
            parts.append(self._read_factor())
        return Combination(np.multiply, *parts) if len(parts) > 1 else parts[0]

    def _read_factor(self) -> Node:
        text = self._tokens[self._place].text
        with self._nest():
            if self._take("-"):
                return Combination(np.negative, self._read_factor())
            if self._take("abs"):
                return Combination(np.absolute, self._read_inner_sum())
            if self._at("("):
                return self._read_inner_sum()
        if _NUMBER.fullmatch(text):
            return Constant(self._read_number("a number"))
        if _NAME.fullmatch(text) and text not in _WORDS:
            return SignalName(self._take(text))
        raise self._make_error("a signal or a number")

    def _read_inner_sum(self) -> Node:
        self._require("(")
        found = self._read_sum()
        self._require(")")
        return found


# Every episode of a campaign evaluates the same formulas.
@lru_cache(maxsize=64)
def parse_formula(formula: str, field: str = "formula") -> Node:
    """Return a formula that can be evaluated.

    Raises:
        InvalidValue: the text is not a formula, or does not name a signal.
    """
    found = FormulaParser(formula, field).parse()
    if not list_names(found):
        problem = f"'{formula}' names no signal."
        raise InvalidValue(field, problem, "Write, for example, always (headway_s > 0.5).")
    return found


def list_names(formula: Node) -> frozenset[str]:
    """Return the names of the signals in a formula."""
    nodes = formula.list_nodes()
    return frozenset(node.name for node in nodes if isinstance(node, SignalName))


def check_formula(
    formula: str, known: Collection[str], dt_s: float, duration_s: float, field: str = "formula"
) -> None:
    """Refuse a formula that cannot be judged on an episode of this duration.

    Raises:
        UnknownName: a signal does not exist; the error lists the known ones.
        InvalidValue: the text is not a formula, a bound is not a multiple of a step, or the formula
            looks further ahead than an episode lasts.
    """
    found = parse_formula(formula, field)
    for name in sorted(list_names(found)):
        if name not in known:
            raise UnknownName(f"signal in {field}", name, known)
    bounds = {bound_s for node in found.list_nodes() for bound_s in node.bounds if bound_s < inf}
    for bound_s in sorted(bounds):
        steps = bound_s / dt_s
        # 0.3 s ÷ 0.1 s is no whole number in doubles, and meant as one.
        if not isclose(steps, round(steps), abs_tol=1e-6):
            problem = f"{bound_s:g} s is not a whole number of steps of {dt_s:g} s."
            raise InvalidValue(field, problem, f"Write {round(steps) * dt_s:g}.")
    horizon_s = found.find_horizon()
    # Steps × duration of a step may be rounded down.
    if horizon_s > duration_s * (1.0 + 1e-9):
        raise InvalidValue(
            field,
            f"looks {horizon_s:g} s ahead, and an episode lasts {duration_s:g} s.",
            "Shorten its bounds, or lengthen the episodes.",
        )


def evaluate_formula(formula: str, dt_s: float, signals: Signals) -> float | None:
    """Return the robustness of a formula at the start of a course; None if it is not judged.

    Args:
        formula: a formula that `check_formula` accepts.
        dt_s: time between two values.
        signals: values by name, all finite and of the same length, at least for the signals in the
            formula.
    """
    found = float(parse_formula(formula).evaluate(signals, dt_s)[0])
    return None if isnan(found) else found
