"""Marks of figures, kept in docs/marks.json: `python tests/docs/claim_marks.py` moves them there.

A writer puts a mark right behind a figure in a page, `36.2 %<!-- claim cut_in.idm.rate -->`, and
runs this script. It takes the mark out of the page and keeps the words before the mark, with `#`
for every number, as many as are needed to find one place. Tests read pages with all marks put
back. A mark whose words are not in its page exactly once is an error, so that no figure loses its
check when the page is edited.
"""

import functools
import json
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
FILE = ROOT / "docs" / "marks.json"
GENERATED = frozenset({"docs/reproduction.md", "docs/reproduction_drive.md"})
"""Pages that a plug-in writes with their marks in them."""

NUMBER = r"-?\d+(?:\.\d+)?(?:e-?\d+)?"
MARK = re.compile(
    # A mark on a line of its own belongs to the table below and stays.
    r"^<!-- [^>]* -->$|(?P<mark><!-- (?:claim \S+|seeds \S+|by definition|paper) -->)",
    re.MULTILINE,
)

Marks = list[tuple[str, str]]
"""Words before a mark, and what the mark says, in the order of the page."""


class MarkError(Exception):
    """A mark whose place in its page is not found, or is not the only one."""


def put_back(text: str, marks: Marks) -> str:
    """Return a page with its marks behind the figures.

    Raises:
        MarkError: the words of a mark are not in the page exactly once.
    """
    places = []
    for words, mark in marks:
        ends = [found.end() for found in _compile_words(words).finditer(text)]
        if len(ends) != 1:
            raise MarkError(f"'{words}' is found {len(ends)} times; mark '{mark}' anew.")
        places.append((ends[0], mark))
    for end, mark in sorted(places, reverse=True):
        text = f"{text[:end]}<!-- {mark} -->{text[end:]}"
    return text


def take_out(text: str) -> tuple[str, Marks]:
    """Return a page without the marks behind its figures, and the marks."""
    bare, found, last = "", [], 0
    for match in MARK.finditer(text):
        if match["mark"]:
            bare += text[last : match.start()]
            found.append((len(bare), match["mark"][5:-4]))
            last = match.end()
    bare += text[last:]
    return bare, [(_choose_words(bare, end), mark) for end, mark in found]


def _choose_words(text: str, end: int) -> str:
    """Return the words before a place, the fewest that contain a number and are there once."""
    starts = [match.start() for match in re.finditer(r"(?<!\S)\S", text[:end])]
    for start in reversed(starts):
        words = re.sub(NUMBER, "#", " ".join(text[start:end].split()))
        if "#" in words and [m.end() for m in _compile_words(words).finditer(text)] == [end]:
            return words
    raise MarkError(f"A mark has no number before it: …{text[max(end - 40, 0) : end]}")


@functools.cache
def _compile_words(words: str) -> re.Pattern[str]:
    pattern = r"\s+".join(re.escape(word) for word in words.split(" "))
    return re.compile(rf"(?<!\S){pattern}".replace(r"\#", f"(?:{NUMBER})") + r"(?![\d])")


def read_marks() -> dict[str, Marks]:
    """Return the marks of each page."""
    if not FILE.exists():
        return {}
    kept = json.loads(FILE.read_text("utf-8"))
    return {page: [(words, mark) for words, mark in marks] for page, marks in kept.items()}


def read_pages(root: Path = ROOT) -> dict[str, str]:
    """Return README.md and the pages of docs/ and benchmarks/ by name, with their marks."""
    folders = (root / "docs", root / "benchmarks")
    paths = (root / "README.md", *(path for one in folders for path in sorted(one.glob("*.md"))))
    texts = {path.relative_to(root).as_posix(): path.read_text("utf-8") for path in paths}
    marks = read_marks()
    if gone := marks.keys() - texts.keys():
        raise MarkError(f"docs/marks.json has marks of pages that do not exist: {sorted(gone)}.")
    return {page: put_back(text, marks.get(page, [])) for page, text in texts.items()}


def main() -> None:
    """Move all marks of hand-written pages to docs/marks.json."""
    kept = {}
    for page, text in read_pages().items():
        if page not in GENERATED:
            bare, marks = take_out(text)
            (ROOT / page).write_text(bare, "utf-8")
            if marks:
                kept[page] = marks
    FILE.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", "utf-8")


if __name__ == "__main__":
    main()
