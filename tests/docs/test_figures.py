"""The README and the pages on performance state no measured figure that nothing is held against.

Every paragraph and table of them is searched for what statistics look like: shares, counts
"12 of 300", intervals "[3.1, 7.2]", powers of ten, failures, medians, numbers in tables
(STATISTICS). What is found must be one of these:

- a claim, `36.2 %<!-- claim NAME -->` or `1 of 100<!-- claim NAME -->`: test_claims.py compares it
  with benchmarks/results/claims.json
- code, or in a part that another test compares with what a program prints (COMPARED)
- in a column whose head says that its numbers are targets, or compared elsewhere (COLUMNS)
- in a phrase that belongs to intervals, not to a result (PHRASES)
- marked `10 %<!-- by definition -->`: a setting, a threshold, a bound, or what a formula gives. On
  the line above a table such a mark covers its plain numbers. "By definition" never excuses an
  interval, a count of cases or a rate of failure.

The pages of the reproduction are written with their marks, and the plug-in's tests compare them.
"""

import re
from itertools import groupby
from typing import NamedTuple

import pytest

PAGES = ("README.md", "docs/performance.md", "benchmarks/performance.md", "benchmarks/scale.md")
COMPARED = {
    "README.md": {"demo": "test_documents.py"},
    "benchmarks/performance.md": dict.fromkeys(("episode", "service"), "test_performance_page.py"),
    "benchmarks/scale.md": {"workers": "test_scale_page.py", "episodes": "test_volume_page.py"},
}
COLUMNS = {
    "target": "what a figure is held against",
    "now": "compared with benchmarks/results/latest.json by test_performance_page.py",
}
PHRASES = (
    r"95 % (?:intervals?|upper bound|quantile)\b",
    r"\[95 %\]",
    r"\(95 %\)",
)

PLAIN = r"-?\d[\d,]*(?:\.\d+)?(?:e-?\d+)?"
EXCUSED, CLAIMED = "‡", "†"
NUMBER = rf"(?:{PLAIN}|{EXCUSED})"
INTERVAL = rf"\[{PLAIN}(?: ?%)?(?:,| …) {PLAIN}[^\]\d]*\]"
STATISTICS = {
    "a share": rf"{PLAIN}(?: and {PLAIN})? ?%",
    "a count of cases": rf"\b{PLAIN} of (?:the |all |a grid of )?{NUMBER}(?![\d.]* ?m/?s?\b)",
    "an interval": INTERVAL,
    "a power of ten": r"\d(?:\.\d+)?e-?\d+",
    "failures": rf"{NUMBER} (?:of them )?(?:fail|crash|collide|collisions)\b",
    "a rate": rf"\b(?:fail(?:s|ed|ing)?|crash(?:es|ed)?|collides?|lost) in {NUMBER}",
    "a result": rf"\b(?:severity|median|nearest|index)\b[^\d.;:|{CLAIMED}]{{0,20}}(?<!\w){PLAIN}",
    "a distance": rf"\b(?:no nearer than|comes to) {PLAIN}",
}

BEHIND = r"[^\d|\n\[]{0,12}"
MARKS = {
    rf"{PLAIN} of {PLAIN}[^\d|]{{0,20}}≤ {PLAIN}{BEHIND}<!-- claim \S+ -->": CLAIMED,
    rf"{PLAIN} of {PLAIN}<!-- claim \S+ -->": CLAIMED,
    rf"{PLAIN}{BEHIND}(?:{INTERVAL}{BEHIND})?<!-- claim \S+ -->": CLAIMED,
    rf"(?:{PLAIN}, )+{PLAIN}{BEHIND}<!-- seeds \S+ -->": CLAIMED,
    rf"{PLAIN}{BEHIND}(?:{INTERVAL}{BEHIND})?<!-- paper -->": CLAIMED,
    rf"{PLAIN}{BEHIND}<!-- by definition -->": EXCUSED,
}
ABOVE_A_TABLE = ("<!-- by definition -->", "<!-- paper -->")
CODE_BLOCK = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
STRAY = re.compile(r"<!-- (?:claim|seeds|by definition|paper)\b.*?-->(?!\n\|)")
A_NUMBER = re.compile(rf"[*~≤≥<> −+]*{PLAIN}.{{0,30}}$")


class Table(NamedTuple):
    heads: list[str]
    rows: list[list[str]]
    is_excused: bool


def without_marks(text):
    """The text with a sign in place of every figure that carries a mark."""
    for mark, sign in MARKS.items():
        text = re.sub(mark, sign, text)
    for phrase in PHRASES:
        text = re.sub(phrase, "", text)
    return text


def without_code(name, text):
    """The text without code, and without what other tests compare."""
    for block in COMPARED.get(name, {}):
        before, _, rest = text.partition(f"<!-- {block} -->")
        text = before + rest.partition(f"<!-- /{block} -->")[2]
    return re.sub(r"`[^`]*`", "", CODE_BLOCK.sub("", text))


def cells(line):
    """Of a row of a table."""
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip()[1:-1])]


def tables_and_paragraphs(text):
    """Its tables, and its paragraphs, each on one line."""
    tables, paragraphs, above = [], [""], ""
    for is_table, lines in groupby(text.splitlines(), lambda line: line.startswith("|")):
        if is_table:
            heads, _, *rows = map(cells, lines)
            tables.append(Table(heads, rows, above in ABOVE_A_TABLE))
            continue
        for line in map(str.strip, lines):
            if not line or re.match(r"- |\d+\. |#|>", line):
                paragraphs.append("")
            paragraphs[-1] += f" {line}"
            above = line or above
        paragraphs.append("")
    return tables, paragraphs


def statistics(text):
    """What looks like a statistic in a text without marks: what it is, and its words."""
    for what, pattern in STATISTICS.items():
        for found in re.finditer(pattern, text):
            around = text[max(found.start() - 40, 0) : found.end() + 20]
            yield f"{what}: …{around.strip()}…"


def in_table(table):
    """What looks measured in a table."""
    for row in table.rows:
        for place, (head, cell) in enumerate(zip(table.heads, row, strict=True)):
            if head.split(":")[0] in COLUMNS:
                continue
            yield from statistics(cell)
            if place and not table.is_excused and A_NUMBER.match(cell):
                yield f"a number in a table: {row[0]} | {cell}"


def unmarked(name, text):
    """What a page states as if measured, and holds against nothing."""
    bare = without_marks(without_code(name, text))
    yield from (f"a mark without a figure: {stray}" for stray in STRAY.findall(bare))
    tables, paragraphs = tables_and_paragraphs(bare)
    for paragraph in paragraphs:
        yield from statistics(paragraph)
    for table in tables:
        yield from in_table(table)


@pytest.fixture
def pages(root):
    return {name: (root / name).read_text() for name in PAGES}


def test_every_measured_figure_is_held_against_a_measurement(pages):
    found = {name: list(unmarked(name, text)) for name, text in pages.items()}
    assert {name: figures for name, figures in found.items() if figures} == {}


def test_what_is_left_to_other_tests_is_there(pages, root):
    for page, blocks in COMPARED.items():
        for block, test in blocks.items():
            assert pages[page].count(f"<!-- {block} -->") == 1
            assert pages[page].count(f"<!-- /{block} -->") == 1
            assert (root / "tests" / "docs" / test).exists()


def test_no_exception_is_left_over(pages):
    text = "\n".join(" ".join(page.split()) for page in pages.values())
    assert [phrase for phrase in PHRASES if not re.search(phrase, text)] == []
    heads = {
        head.split(":")[0]
        for name, page in pages.items()
        for table in tables_and_paragraphs(without_code(name, page))[0]
        for head in table.heads
    }
    assert set(COLUMNS) <= heads


TABLE = "| speed | fails |\n|---|--:|\n| 12 m/s | {} |\n"


@pytest.mark.parametrize(
    "text",
    [
        "It loses the track in 68 % of ordinary runs.",
        "At the default 156 of 600 do not get through.",
        "It crashed in 19 of\n2000 episodes.",
        "A rate of 3.1 [1.2, 5.6] was found.",
        "The probability is about 2e-5.",
        "With 1 m 206 fail, with 3 m more.",
        "They crash at a mean severity of 10 m²/s².",
        "Undisturbed it comes to 2.1 m.",
        "Of all it came off best in 7 of 12.",
        "- as an item of a list,\n  which goes on: 4 %",
        TABLE.format("12"),
        TABLE.format("0.4 m/s²"),
        TABLE.format("about one in four, 26 %"),
        "<!-- by definition -->\n" + TABLE.format("12 % [8, 17]"),
        "It fails in 36 %<!-- by definition --> of the runs.",
        "Of the runs 156 of 600<!-- by definition --> do not get through.",
        "A rate of 3.1 % [1.2, 5.6]<!-- by definition --> was found.",
        "A rate of 3.1 %<!-- claims a.rate --> was found.",
        "A first figure, 3 %, and a second one, 4 %<!-- claim a.rate -->.",
        "A rate of 3.1 % was found, and somewhere else a bound<!-- by definition --> was set.",
        "A mark that stands behind no figure<!-- by definition --> is a mistake.",
    ],
)
def test_a_measured_figure_is_found(text):
    assert list(unmarked("page.md", text)) != []


@pytest.mark.parametrize(
    "text",
    [
        "It fails in 36.2 % [34.2, 38.4]<!-- claim a.rate --> of the runs.",
        "It fails in 725<!-- claim a.failures --> of 2000 runs.",
        "(all three: -0.107, -0.121, -0.240<!-- seeds a.gain -->)",
        "Each has a 95 % interval.",
        "Of the budget 8 %<!-- by definition --> is drawn from p.",
        "Theirs failed in 94.6 %<!-- paper --> of the episodes.",
        "Over 10 s at 24 m/s a truck of 16 x 2.5 m goes 240 m.",
        "The command `--share 36 %` is code.",
        "```text\n36 % of 600 fail\n```",
        TABLE.format("36 %<!-- claim a.rate -->"),
        TABLE.format("whatever is near"),
        "<!-- by definition -->\n" + TABLE.format("12"),
        TABLE.replace("fails", "target: at most").format("94.6 % [90, 99]"),
    ],
)
def test_a_definition_is_not_a_measured_figure(text):
    assert list(unmarked("page.md", text)) == []


def test_only_the_page_and_the_block_that_are_compared_elsewhere_are_left_out():
    text = "<!-- demo -->\n36 % fail\n<!-- /demo -->\n"
    assert list(unmarked("README.md", text)) == []
    assert list(unmarked("docs/world.md", text)) != []
    assert list(unmarked("README.md", f"{text}37 % fail")) != []
