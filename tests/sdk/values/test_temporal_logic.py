"""Formulas of temporal logic: their robustness by the definition, and what is refused."""

import random
from collections.abc import Callable, Sequence
from math import inf

import numpy as np
import pytest

from eigenfail.errors import InputError, InvalidValue
from eigenfail.values import temporal_logic

Values = list[float | None]
Trace = dict[str, list[float]]
Formula = tuple[str, Callable[[Trace], Values]]
"""A text, and its robustness at each step by the definition."""

DT_S = 0.5
FORMULAS = 10_000
KNOWN = ("a", "b", "error.c")


def window(first: int, last: int, values: Sequence[float | None]) -> list[float]:
    """Return the judged values at some steps that there are."""
    steps = range(max(first, 0), min(last, len(values) - 1) + 1)
    return [value for k in steps if (value := values[k]) is not None]


def join(one: float | None, other: float | None) -> float | None:
    """Return `and` of Kleene's logic: not judged, unless a part decides."""
    known = [each for each in (one, other) if each is not None]
    if len(known) == 2 or (known and known[0] <= 0.0):
        return min(known)
    return None


def choose(one: float | None, other: float | None) -> float | None:
    """Return `or` of Kleene's logic."""
    known = [each for each in (one, other) if each is not None]
    if len(known) == 2 or (known and known[0] > 0.0):
        return max(known)
    return None


def negate(one: float | None) -> float | None:
    """Return `not`."""
    return None if one is None else -one


def compare(generator: random.Random) -> Formula:
    """Return a comparison of signals and numbers; its robustness is the difference of its sides."""
    name, other = generator.choice(KNOWN), generator.choice(KNOWN)
    limit, factor = round(generator.uniform(-2, 2), 2), generator.choice((1, 2, 3))
    sides: Sequence[tuple[str, Callable[[Trace, int], float]]] = (
        (f"{name}", lambda trace, k: trace[name][k]),
        (f"abs({name})", lambda trace, k: abs(trace[name][k])),
        (
            f"{factor} * {name} + {other}",
            lambda trace, k: factor * trace[name][k] + trace[other][k],
        ),
        (f"({name} - {other})", lambda trace, k: trace[name][k] - trace[other][k]),
    )
    text, value = generator.choice(sides)
    sign = generator.choice(("<", "<=", ">", ">="))
    slope = 1.0 if sign.startswith(">") else -1.0
    number = f"{limit}"
    return f"({text} {sign} {number})", lambda trace: [
        slope * (value(trace, k) - limit) for k in range(len(trace[name]))
    ]


def connect(
    kind: str, values: Callable[[Trace], Values], other: Callable[[Trace], Values]
) -> Callable[[Trace], Values]:
    """Return the values of two formulas that "and", "or" or "implies" connects."""
    operators = {
        "and": join,
        "or": choose,
        "implies": lambda one, two: choose(negate(one), two),
    }
    return lambda trace: [
        operators[kind](one, two) for one, two in zip(values(trace), other(trace), strict=True)
    ]


def reach(
    offsets: range, values: Callable[[Trace], Values], other: Callable[[Trace], Values]
) -> Callable[[Trace], Values]:
    """Return the values of "until" or "since": `other` holds at an offset, `values` before it.

    Args:
        offsets: steps at which `other` may hold, from the present one; negative in the past.
        values: values of what must hold at each step before.
        other: values of what must hold in the end.
    """

    def hold(trace: Trace) -> Values:
        left, right, steps = values(trace), other(trace), len(trace["a"])
        found: Values = []
        for k in range(steps):
            reached = []
            for offset in offsets[:steps]:
                if not 0 <= k + offset < steps:
                    continue
                before = left[k : k + offset] if offset > 0 else left[k + offset + 1 : k + 1]
                held = min([each for each in before if each is not None], default=inf)
                reached.append(join(right[k + offset], held))
            found.append(max([each for each in reached if each is not None], default=None))
        return found

    return hold


def nest(generator: random.Random, depth: int) -> Formula:
    """Return a random formula with operators inside each other."""
    if depth == 0:
        return compare(generator)
    kind = generator.choice(("not", "and", "or", "implies", "ahead", "back", "until", "since"))
    text, values = nest(generator, depth - 1)
    if kind == "not":
        return f"not({text})", lambda trace: [negate(value) for value in values(trace)]
    first = generator.randrange(3)
    last = first + generator.randrange(3)
    bounded = generator.random() < 0.7
    bounds = f"[{first * DT_S:g}:{last * DT_S:g}]" if bounded else ""
    low, high = (first, last) if bounded else (0, 10**6)
    if kind in ("ahead", "back"):
        sign = 1 if kind == "ahead" else -1
        words = (("always", "eventually"), ("historically", "once"))[kind == "back"]
        word, pick = generator.choice(((words[0], min), (words[1], max)))
        return f"{word}{bounds}({text})", lambda trace: [
            pick(window(*sorted((k + sign * low, k + sign * high)), values(trace)), default=None)
            for k in range(len(trace["a"]))
        ]
    other_text, other = nest(generator, depth - 1)
    if kind in ("and", "or", "implies"):
        return f"({text} {kind} {other_text})", connect(kind, values, other)
    steps = range(low, high + 1) if kind == "until" else range(-low, -high - 1, -1)
    return f"(({text}) {kind}{bounds} ({other_text}))", reach(steps, values, other)


def test_it_is_the_robustness_of_the_definition() -> None:
    generator, unjudged = random.Random(11), 0
    for _ in range(FORMULAS):
        text, values = nest(generator, generator.randrange(4))
        steps = generator.randrange(1, 12)
        trace = {name: [generator.uniform(-3, 3) for _ in range(steps)] for name in KNOWN}
        signals = {name: np.array(each) for name, each in trace.items()}
        found = temporal_logic.evaluate_formula(text, DT_S, signals)
        expected = values(trace)[0]
        unjudged += expected is None
        if expected is None:
            assert found is None, (text, trace)
        else:
            assert found == pytest.approx(expected, abs=1e-9), (text, trace)
    assert unjudged > FORMULAS // 50


@pytest.mark.parametrize(
    ("formula", "a", "expected"),
    [
        ("eventually[9.5:10](a < 100)", [1.0, 2.0], None),
        ("always[9.5:10](a < 100)", [1.0, 2.0], None),
        ("not eventually[9.5:10](a < 100)", [1.0, 2.0], None),
        ("always[0.5:1](a < 100)", [1.0, 2.0], 98.0),
        # Only the promises whose time has come are judged.
        ("always(a < 3 implies eventually[0.5:1](a > 3))", [9.0, 9.0, 2.0], 6.0),
        ("always(a < 3 implies eventually[0.5:1](a > 3))", [2.0, 2.5, 1.0], -0.5),
        ("a > 0 and eventually[9:10](a > 0)", [-1.0], -1.0),
        ("a > 0 and eventually[9:10](a > 0)", [1.0], None),
        ("a > 0 or eventually[9:10](a > 0)", [1.0], 1.0),
        ("a > 0 or eventually[9:10](a > 0)", [-1.0], None),
        ("once[1:2](a > 0)", [1.0, 2.0], None),
        ("(a > 0) until[5:6] (a > 1)", [1.0, 2.0], None),
        ("(a > 0) since[1:2] (a > 1)", [1.0, 2.0], None),
    ],
)
def test_window_without_steps_is_not_judged(formula, a, expected) -> None:
    assert temporal_logic.evaluate_formula(formula, DT_S, {"a": np.array(a)}) == expected


def test_a_formula_is_evaluated_anew_for_each_course() -> None:
    long, short = np.array([1.0, -2.0, 3.0]), np.array([0.5])
    for values in (long, short, long):
        assert temporal_logic.evaluate_formula("always(a > 0)", DT_S, {"a": values}) == values.min()


@pytest.mark.parametrize(
    ("formula", "words"),
    [
        ("always(speed)", "in place of a comparison"),
        ("1 < 2", "names no signal"),
        ("", "in place of a signal or a number"),
        ("a > b > 1", "in place of the end"),
        ("a > 1 and", "the end in place of a signal"),
        ("and > 1", "'and' at character 1 in place of a signal"),
        ("a > 1; b > 1", "cannot stand"),
        ("a = 1", "cannot stand"),
        ("a / b > 1", "cannot stand"),
        ("(" * 51 + "a > 1" + ")" * 51, "inside each other"),
        ("-" * 60 + "a > 1", "inside each other"),
        ("not " * 60 + "a > 1", "inside each other"),
        ("a > 1 and " * 120 + "a > 1", "longer than"),
        ("(a > 1", "in place of '.'"),
        ("a > 1)", "in place of the end"),
        ("always[1](a > 1)", "in place of ':'"),
        (f"always[1:{'9' * 400}](a > 1)", "a number above"),
        ("always[0:0.7](a > 1)", "whole number of steps"),
        ("always[2:1](a > 1)", "ends before it begins"),
        ("always[a:1](a > 1)", "in place of a time"),
        ("eventually[0:5](always[0:5.5](a > 1))", "looks 10.5 s ahead"),
    ],
)
def test_what_is_no_formula_is_refused(formula: str, words: str) -> None:
    with pytest.raises(InvalidValue, match=words):
        temporal_logic.check_formula(formula, KNOWN, DT_S, 10.0)


@pytest.mark.parametrize(
    ("formula", "same"),
    [
        ("not a > 1 and b > 1", "(not (a > 1)) and (b > 1)"),
        ("always a > 1 or b > 1", "(always (a > 1)) or (b > 1)"),
        ("a > 1 or b > 1 and a > 2", "(a > 1) or ((b > 1) and (a > 2))"),
        ("a > 1 implies b > 1 implies a > 2", "(a > 1) implies ((b > 1) implies (a > 2))"),
        ("a > 1 until b > 1 and a > 2", "((a > 1) until (b > 1)) and (a > 2)"),
        ("a - b - 1 > 0", "((a - b) - 1) > 0"),
        ("(a + 1) * 2 > b", "((a + 1) * 2) > b"),
        ("always[0,1] a > - 1", "always[0:1] (a > -1)"),
    ],
)
def test_operators_bind_as_the_manual_says(formula: str, same: str) -> None:
    generator = np.random.default_rng(3)
    for _ in range(20):
        signals = {name: generator.normal(size=6) for name in ("a", "b")}
        found = temporal_logic.evaluate_formula(formula, DT_S, signals)
        assert found == temporal_logic.evaluate_formula(same, DT_S, signals)


def test_an_unknown_signal_is_named_with_the_near_one() -> None:
    with pytest.raises(InputError, match=r"Did you mean 'error\.c'"):
        temporal_logic.check_formula("error.d > 1", KNOWN, DT_S, 10.0)


def test_sums_and_products_may_be_as_long_as_a_formula() -> None:
    signals = {"a": np.array([2.0])}
    assert temporal_logic.evaluate_formula("a" + "+a" * 490 + ">0", DT_S, signals) == 982.0
    assert temporal_logic.evaluate_formula("a" + "-a" * 490 + ">0", DT_S, signals) == -978.0
    assert temporal_logic.evaluate_formula("1" + "*a" * 30 + ">0", DT_S, signals) == 2.0**30


def test_the_names_are_those_of_its_signals() -> None:
    found = temporal_logic.parse_formula("always(not(a > 1) implies once[0:1](error.c < 2))")
    assert temporal_logic.list_names(found) == {"a", "error.c"}
