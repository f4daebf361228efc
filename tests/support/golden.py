"""Golden files: texts that users read, kept under tests/golden and compared as a whole.

`pytest --update` writes what the tests produce now; the difference is then reviewed in git.
"""

import ast
import difflib
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from page_text import render_page

FOLDER = Path(__file__).parents[1] / "golden"
REMEDY = "Run pytest --update to accept it, and review the difference."

VARYING = (
    (re.compile(r"/tmp/pytest-of-[^/\s]+/pytest-\d+/(?:popen-gw\d+/)?[^/\s'`]+"), "{folder}"),
    (re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d(?:\.\d+)?)?(?: ?UTC|Z|\+00:00)?"), "{time}"),
    (re.compile(r"\b20\d\d-\d\d-\d\d\b"), "{date}"),
    (re.compile(r"(?<=\beigenfail )\d+\.\d+\.\d+\b"), "{version}"),
    (re.compile(r"(?<=127\.0\.0\.1:)(?!8440\b)\d+"), "{port}"),
    (re.compile(r"\b[0-9a-f]{64}\b"), "{digest}"),
    (re.compile(r"\b[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}\b"), "{uuid}"),
)
"""What differs from run to run or from machine to machine, and the word that stands for it."""


def normalise(text: str) -> str:
    """Return a text without what varies and without spaces at the ends of its lines."""
    for pattern, word in VARYING:
        text = pattern.sub(word, text)
    return "\n".join(line.rstrip() for line in text.strip("\n").splitlines()) + "\n"


class Golden:
    """Compares texts with the golden files of a folder, or writes them."""

    def __init__(self, update: bool, folder: Path = FOLDER) -> None:
        self._update = update
        self._folder = folder

    def check(self, name: str, text: str) -> None:
        """Fail, with the difference, unless the normalised text is that of the golden file."""
        file = self._folder / f"{name}.txt"
        found = normalise(text)
        if self._update:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(found, "utf-8")
            return
        if not file.exists():
            pytest.fail(f"There is no golden file {name}.txt. {REMEDY}\n\n{found}", pytrace=False)
        expected = file.read_text("utf-8")
        if found != expected:
            lines = difflib.unified_diff(
                *(text.splitlines() for text in (expected, found)),
                f"{name}.txt",
                "this run",
                lineterm="",
            )
            difference = "\n".join(lines)
            pytest.fail(f"{name} has changed. {REMEDY}\n\n{difference}", pytrace=False)

    def check_page(self, name: str, html: str, part: str | None = None) -> None:
        """Compare a page as text, or the part of it that has an id."""
        self.check(name, render_page(normalise(html), part))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update", action="store_true", help="write golden files anew")


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--update") and os.environ.get("CI") == "true":
        raise pytest.UsageError("--update is refused where CI=true: golden files are reviewed.")


@pytest.fixture(scope="session")
def golden(pytestconfig: pytest.Config) -> Golden:
    """The golden files."""
    return Golden(pytestconfig.getoption("--update"))


def find_unused(files: Iterable[str], sources: Iterable[str]) -> list[str]:
    """Return the names of golden files that no string in the sources of tests gives.

    A formatted string gives every name that fits, with words for what is put into it.
    """
    patterns = {pattern for source in sources for pattern in _list_patterns(source)}
    known = re.compile("|".join(sorted(patterns)) or r"(?!)")
    return sorted(name for name in files if not known.fullmatch(name))


def _list_patterns(source: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and "/" in node.value:
            yield re.escape(node.value)
        elif isinstance(node, ast.JoinedStr):
            parts = [
                re.escape(part.value) if isinstance(part, ast.Constant) else r"[\w-]+"
                for part in node.values
            ]
            if "/" in "".join(parts):
                yield "".join(parts)
