"""Numbers and verdicts as people read them."""

from eigenfail.reproduction.results import Column, Number, Statement

UNKNOWN = "–"
SIGNS = {"share": "%", "modes": "", "index": ""}


def heading(column: Column) -> str:
    """What stands over a column."""
    unit = SIGNS.get(column.unit, column.unit)
    return f"{column.title} [{unit}]" if unit else column.title


def in_words(column: Column, number: Number) -> str:
    """Our number with its interval."""
    if number.value is None:
        return UNKNOWN
    told = figure(column, number.value)
    if number.interval is None:
        return told
    ends = (figure(column, end) for end in (number.interval.low, number.interval.high))
    return f"{told} [{', '.join(ends)}]"


def paper_in_words(column: Column, number: Number) -> str:
    """The paper's number in brackets; nothing where it has none."""
    return "" if number.paper is None else f" (paper {figure(column, number.paper)})"


def figure(column: Column, value: float) -> str:
    """Three digits or more, shares in per cent with one decimal."""
    if column.unit == "share":
        return f"{100.0 * value:.1f}"
    if column.unit == "modes":
        return f"{value:.0f}"
    size = abs(value)
    if size and size < 0.1:
        return f"{value:.1e}"
    return f"{value:.{0 if size >= 100.0 else 1 if size >= 10.0 else 2}f}"


def verdict(statement: Statement) -> str:
    """Whether it holds here."""
    return {True: "holds", False: "does not hold", None: "cannot be told"}[statement.holds]
