"""Write the tables of faults into docs/faults.md: `python tests/docs/fault_table.py`.

Each row is a kind of fault, read from the marks of the tests that inject it:

    @pytest.mark.fault("kind", group="storage", outcome="What happens.")

One test of a kind gives group and outcome; the others name the kind alone. The marks are read from
the sources and not by collecting the tests, which would import all that they test. Therefore a mark
is a decorator of a test function, and its arguments are literal strings.
"""

import ast
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

sys.path += [str(Path(__file__).parents[1] / name) for name in ("chaos", "support")]

from storm import KINDS as STORM_KINDS

TESTS = Path(__file__).parents[1]
PAGE = TESTS.parent / "docs" / "faults.md"
GROUPS = ("processes", "time", "messages", "storage", "plug-ins", "api")
CLAIM = re.compile(r"(?<=The tests inject )\d+(?= kinds of faults\.)")
LEAST_KINDS = 40
SOAK = "tests/soak/soak.py"


class Mark(NamedTuple):
    """One `pytest.mark.fault` on one test.

    Attributes:
        test: as `tests/path.py::name`.
        place: as `tests/path.py:line`, for messages.
    """

    kind: str
    group: str
    outcome: str
    test: str
    place: str


class Fault(NamedTuple):
    """A kind of fault: one row of a table."""

    kind: str
    group: str
    outcome: str
    tests: tuple[str, ...]


class MarkError(Exception):
    """Marks that cannot be made into a table.

    Attributes:
        problems: one sentence each, which begins with the place of the mark or the kind.
    """

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("\n".join(problems))
        self.problems = problems


def read_faults(folder: Path = TESTS, root: Path = TESTS.parent) -> list[Fault]:
    """Return the kinds of faults that the tests in a folder inject, by group and name.

    Raises:
        MarkError: a mark is in the wrong place, not literal, incomplete or contradicts another.
    """
    marks: list[Mark] = []
    problems: list[str] = []
    for path in sorted(folder.rglob("*.py")):
        text = path.read_text()
        if "mark.fault" in text:
            _read_marks(text, path.relative_to(root).as_posix(), marks, problems)
    faults = [
        _combine_marks(kind, marks, problems) for kind in dict.fromkeys(m.kind for m in marks)
    ]
    if problems:
        raise MarkError(problems)
    return sorted(faults, key=lambda fault: (GROUPS.index(fault.group), fault.kind.casefold()))


def _read_marks(text: str, path: str, marks: list[Mark], problems: list[str]) -> None:
    tree = ast.parse(text, path)
    decorators = set()
    for function in _list_tests(tree, path):
        for decorator in function.decorator_list:
            if isinstance(decorator, ast.Call) and _is_mark(decorator.func):
                decorators.add(decorator.func)
                place = f"{path}:{decorator.lineno}"
                try:
                    values = _read_arguments(decorator)
                except ValueError as error:
                    problems.append(f"{place}: {error}")
                else:
                    marks.append(Mark(*values, f"{path}::{function.name}", place))
    problems.extend(
        f"{path}:{node.lineno}: a fault mark must be a decorator of a test function, with its "
        "arguments; not a module's, a class's or a parameter's mark, and no alias."
        for node in ast.walk(tree)
        if _is_mark(node) and node not in decorators
    )


def _list_tests(tree: ast.Module, path: str) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    if not path.rpartition("/")[2].startswith("test_"):
        return
    for node in tree.body:
        is_function = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        if is_function and node.name.startswith("test_"):
            yield node


def _is_mark(node: ast.AST) -> bool:
    """Whether an expression is `pytest.mark.fault` or `mark.fault`."""
    if not (isinstance(node, ast.Attribute) and node.attr == "fault"):
        return False
    return (isinstance(node.value, ast.Attribute) and node.value.attr == "mark") or (
        isinstance(node.value, ast.Name) and node.value.id == "mark"
    )


def _read_arguments(call: ast.Call) -> tuple[str, str, str]:
    """Kind, group and outcome of a mark; the last two are empty if it gives neither."""
    given = {keyword.arg: keyword.value for keyword in call.keywords}
    literal = [
        node.value
        for node in (*call.args, *given.values())
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    if len(literal) != len(call.args) + len(given):
        raise ValueError("the arguments of a fault mark must be literal strings.")
    if len(call.args) != 1 or set(given) not in (set(), {"group", "outcome"}):
        raise ValueError("a fault mark has a kind, and either group and outcome or neither.")
    values = dict(zip(("kind", *given), literal, strict=True))
    kind, group, outcome = values["kind"], values.get("group", ""), values.get("outcome", "")
    _check_words(kind, group, outcome, is_complete=bool(given))
    return kind, group, outcome


def _check_words(kind: str, group: str, outcome: str, *, is_complete: bool) -> None:
    if not kind or kind != kind.strip() or kind.endswith("."):
        raise ValueError(f"the kind '{kind}' must be a noun phrase without a full stop.")
    if any(character in kind + outcome for character in "|\n"):
        raise ValueError("a kind or an outcome must not contain '|' or a new line.")
    if is_complete and group not in GROUPS:
        raise ValueError(f"the group '{group}' is none of {', '.join(GROUPS)}.")
    if is_complete and not outcome.endswith("."):
        raise ValueError("the outcome must be one or more sentences.")


def _combine_marks(kind: str, marks: Iterable[Mark], problems: list[str]) -> Fault:
    own = [mark for mark in marks if mark.kind == kind]
    told = list(dict.fromkeys((mark.group, mark.outcome) for mark in own if mark.outcome))
    places = ", ".join(mark.place for mark in own)
    if not told:
        problems.append(f"'{kind}' has no group and outcome; give them at one of {places}.")
    if len(told) > 1:
        problems.append(f"'{kind}' has several groups or outcomes; leave one of those at {places}.")
    group, outcome = told[0] if told else (GROUPS[0], "")
    return Fault(kind, group, outcome, tuple(dict.fromkeys(mark.test for mark in own)))


def render_table(faults: Iterable[Fault]) -> str:
    """Return the table of faults of one group."""
    rows = (
        f"| {fault.kind[0].upper()}{fault.kind[1:]} | {fault.outcome} | {_render_tests(fault)} |"
        for fault in faults
    )
    return "\n".join(["| fault | what happens | tests |", "|---|---|---|", *rows])


def _render_tests(fault: Fault) -> str:
    soak = [SOAK] if fault.kind in STORM_KINDS else []
    return "<br>".join(f"`{test}`" for test in (*fault.tests, *soak))


def render_page(page: str, faults: Sequence[Fault]) -> str:
    """Return a page with a new table between the markers of each group.

    Raises:
        MarkError: there are fewer kinds than 40, a kind of the soak has no test, or the page lacks
            the markers of a group.
    """
    kinds = {fault.kind for fault in faults}
    problems = [
        f"'{kind}' is injected by the soak, and no test has a mark of it."
        for kind in STORM_KINDS
        if kind not in kinds
    ]
    if len(kinds) < LEAST_KINDS:
        problems.append(f"The tests mark {len(kinds)} kinds of faults, {LEAST_KINDS} at least.")
    for group in GROUPS:
        begin, end = f"<!-- faults: {group} -->", f"<!-- /faults: {group} -->"
        before, found, rest = page.partition(begin)
        _old, closed, after = rest.partition(end)
        if not (found and closed):
            problems.append(f"The page has no '{begin}' and '{end}'.")
            continue
        table = render_table(fault for fault in faults if fault.group == group)
        page = f"{before}{begin}\n{table}\n{end}{after}"
    if problems:
        raise MarkError(problems)
    return CLAIM.sub(str(len(kinds)), page)


def main() -> None:
    """Write the page; exit code 1 if the marks cannot be made into tables."""
    try:
        PAGE.write_text(render_page(PAGE.read_text(), read_faults()))
    except MarkError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
