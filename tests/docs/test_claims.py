"""Pages say what benchmarks/results/claims.json says, and the figures in it hold their targets.

A figure in a document is marked by a comment right behind it, with the claim's name:
`35.6 % [33.5, 37.8]<!-- claim cut_in.idm.mc2000.failure_rate -->`. The number is the claim's value
to the digits printed, the bracket its interval, rounded outwards to two digits or more; with a %
before the mark both are per cent. A share may be printed as `1 of 100` or `all 78`, and one of 0
with the upper end of its interval: `0 of 2,000: ≤ 0.150 %`.
`95.3, 93.4, 94.7 %<!-- seeds cut_in.ast.train1000.failure_rate -->` are the values of each seed, as
the claim's note tells them with four digits; the smallest, the largest and the median are those of
the claim's `spread` and `value`, rounded from all of their digits. The README and the reproduction
of the paper have such marks; the figures of other pages name the claim in their text, or none.
"""

import re
from decimal import ROUND_HALF_UP, Decimal
from importlib import import_module
from typing import NamedTuple

import msgspec
import pytest

NUMBER = r"-?\d+(?:\.\d+)?(?:e-?\d+)?"
MARK = re.compile(
    rf"(?P<value>{NUMBER})[^\d|\n\[]*"
    rf"(?:\[(?P<low>{NUMBER}), (?P<high>{NUMBER})[^\d\]]*\][^\d|\n\[]*)?"
    r"<!-- claim (?P<name>\S+) -->"
)
BEFORE_A_BOUND = re.compile(r"(?:(?<!\d)0 of (?P<n>\d+)[^\d|]{0,20})?≤ $")
BEFORE_A_COUNT = re.compile(r"(?:(?P<k>\d+) of|\b[Aa]ll) $")
SEEDS = re.compile(
    rf"(?P<values>(?:{NUMBER}, )+{NUMBER}(?: and {NUMBER})?)"
    r"(?P<unit>[^\d|\n\[]*)<!-- seeds (?P<name>\S+) -->"
)
ANY_MARK = re.compile(r"<!-- claim (\S+) -->")


class Claim(msgspec.Struct):
    value: float | None
    n: int
    unit: str
    command: str
    commit: str
    interval: tuple[float, float] | None = None
    target: str = ""
    note: str = ""
    spread: tuple[float, float] | None = None


class Marked(NamedTuple):
    name: str
    printed: tuple[str, ...]
    percent: bool
    before: str


def marked(text):
    """The figures that a text marks."""
    text = plain(text)
    assert len(MARK.findall(text)) == len(ANY_MARK.findall(text)), "a mark without a figure"
    for found in MARK.finditer(text):
        printed = tuple(found[part] for part in ("value", "low", "high") if found[part])
        before = " ".join(text[max(found.start() - 60, 0) : found.start()].split("\n"))
        yield Marked(found["name"], printed, "%" in found[0], before)


RAISED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def plain(text):
    """The text with its numbers as programs write them: -1234.5, 1.2e-4."""
    text = re.sub(r"(?<=\d),(?=\d{3}(?!\d))", "", text.replace("−", "-"))
    return re.sub(r"×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", lambda found: f"e{found[1].translate(RAISED)}", text)


def agree(printed, value):
    """Whether a printed number is a value, rounded to its digits."""
    number = Decimal(printed)
    half_a_digit = 0.5 * 10.0 ** int(number.as_tuple().exponent)
    return abs(float(number) - value) <= half_a_digit * (1.0 + 1e-6)


def is_rounded(printed, value, scale=1):
    """Whether a printed number is a value rounded to its digits, a half away from zero."""
    number = Decimal(printed)
    return number == (scale * Decimal(repr(value))).quantize(number, ROUND_HALF_UP)


def is_outward(printed, value, sign):
    """Whether a printed bound is the value rounded outwards (up for sign 1), to two digits."""
    number = Decimal(printed)
    digit = 10.0 ** int(number.as_tuple().exponent)
    beyond = sign * (float(number) - value)
    enough = len(number.as_tuple().digits) > 1 or float(number) == value
    return enough and -1e-9 * abs(value) <= beyond < digit * (1.0 + 1e-6)


def holds(figure, claim):
    """Whether a printed figure is what the claim says."""
    values = (claim.value, *(claim.interval or ()))
    value, *ends = (value * 100.0 if figure.percent else value for value in values)
    number, *bounds = figure.printed
    if bound := BEFORE_A_BOUND.search(figure.before):
        counted = bound["n"] is None or int(bound["n"]) == claim.n
        return counted and value == 0.0 and len(ends) == 2 and is_outward(number, ends[1], 1)
    count = BEFORE_A_COUNT.search(figure.before)
    if count and claim.unit.startswith("share") and not figure.percent:
        return (int(count["k"] or number), int(number)) == (round(value * claim.n), claim.n)
    if not bounds:
        return agree(number, value)
    return agree(number, value) and len(ends) == 2 and all(map(is_outward, bounds, ends, (-1, 1)))


def wrong(text, claims):
    """What a text states otherwise than the claims do."""
    for figure in marked(text):
        claim = claims.get(figure.name)
        if claim is None or claim.value is None:
            yield f"{figure.name} is not known"
        elif not holds(figure, claim):
            yield f"{figure.name}: printed {figure.printed}, found {claim.value} {claim.interval}"


def wrong_seeds(text, claims):
    """What a text states of seeds otherwise than the notes of the claims do."""
    found = list(SEEDS.finditer(text))
    assert len(found) == text.count("<!-- seeds "), "a mark without figures"
    for marks in found:
        note = getattr(claims.get(marks["name"]), "note", "")
        values = re.findall(NUMBER, note.partition(" seeds: ")[2].partition(";")[0])
        scale = 100.0 if "%" in marks["unit"] else 1.0
        printed = marks["values"].replace(" and ", ", ").split(", ")
        if len(printed) != len(values) or not all(
            agree(one, scale * float(value)) for one, value in zip(printed, values, strict=True)
        ):
            yield f"{marks['name']}: printed {printed}, found {values}"
        else:
            yield from wrong_ranks(marks["name"], printed, claims[marks["name"]], int(scale))


def wrong_ranks(name, printed, claim, scale):
    """What is stated of the smallest, largest and median seed otherwise than with all digits."""
    if claim.spread is None:
        yield f"{name}: the values of its seeds have no spread"
        return
    ordered = sorted(printed, key=Decimal)
    ranks = [(ordered[0], claim.spread[0]), (ordered[-1], claim.spread[1])]
    if claim.note.startswith("median of") and len(ordered) % 2:
        ranks.append((ordered[len(ordered) // 2], claim.value))
    for one, value in ranks:
        if not is_rounded(one, value, scale):
            yield f"{name}: printed {one}, found {value}"


def held(claim):
    """Whether a claim is within the target that it names."""
    kind, *bounds = re.findall(rf"^(?:=|<=|>=)|{NUMBER}", claim.target)
    low, high = {
        "=": lambda x: (x, x),
        "<=": lambda x: (float("-inf"), x),
        ">=": lambda x: (x, float("inf")),
    }.get(kind, lambda x: (float(kind), x))(float(bounds[0]))
    return claim.value is not None and low <= claim.value <= high


COMMAND = "python -m benchmarks.claims"
PAGES = ("README.md", "docs/reproduction.md", "docs/reproduction_drive.md")


@pytest.fixture(scope="module")
def claims(root):
    stored = (root / "benchmarks" / "results" / "claims.json").read_bytes()
    return msgspec.json.decode(stored, type=dict[str, Claim])


@pytest.mark.parametrize("page", PAGES)
def test_every_marked_figure_is_the_claim_that_it_names(claims, root, page):
    text = (root / page).read_text()
    assert [*wrong(text, claims), *wrong_seeds(text, claims)] == []


def change_digits(text, ends):
    """The text with another digit at each of these ends of numbers."""
    for end in reversed(ends):
        text = f"{text[: end - 1]}{(int(text[end - 1]) + 5) % 10}{text[end:]}"
    return text


@pytest.mark.parametrize("page", PAGES)
def test_a_number_that_is_changed_in_a_page_is_found(claims, root, page):
    """Change the last digit of every value and of every end of an interval: all are found."""
    text = plain((root / page).read_text())
    figures = list(MARK.finditer(text))
    assert figures
    for part in ("value", "low", "high"):
        ends = [figure.end(part) for figure in figures if figure[part]]
        assert len(list(wrong(change_digits(text, ends), claims))) == len(ends), part
    marks = list(SEEDS.finditer(text))
    for place in range(3):
        ends = [[*re.finditer(NUMBER, one["values"])][place] for one in marks]
        ends = [one.start("values") + end.end() for one, end in zip(marks, ends, strict=True)]
        assert len(list(wrong_seeds(change_digits(text, ends), claims))) >= len(ends), place


def test_every_target_has_been_measured(claims):
    targets = import_module("benchmarks.targets").TARGETS
    assert set(targets) <= set(claims)
    assert {name: claims[name].target for name in targets} == {
        name: target.words() for name, target in targets.items()
    }


MEASURED_ONCE = {"cut_in.rulebook.plain_monte_carlo.p_fail"}


def test_every_claim_says_what_it_rests_on_and_holds_its_target(claims):
    for name, claim in claims.items():
        assert claim.n > 0, name
        assert claim.unit, name
        # What was measured once, outside the project, says so in place of a command.
        assert claim.command == COMMAND or name in MEASURED_ONCE, name
        assert claim.commit, name
        assert not claim.target or held(claim), name


def test_a_mark_without_a_figure_is_found():
    with pytest.raises(AssertionError, match="without a figure"):
        list(wrong("| 35.7 % | none<!-- claim a.rate --> |", {}))
    with pytest.raises(AssertionError, match="without figures"):
        list(wrong_seeds("80 %<!-- seeds a.rate -->", {}))


@pytest.mark.parametrize(
    ("target", "value", "expected"),
    [
        ("= 0", 0.0, True),
        ("= 0", 1.0, False),
        ("<= 1.5", 1.5, True),
        ("<= 1.5", 1.6, False),
        (">= 2.5", 2.4, False),
        ("0.25 … 0.55", 0.25, True),
        ("0.25 … 0.55", 0.6, False),
        ("1e-06 … 0.0005", 2e-6, True),
        ("1e-06 … 0.0005", 2e-7, False),
        ("1e-06 … 0.0005", None, False),
    ],
)
def test_a_target_is_read_as_it_is_written(target, value, expected):
    assert held(Claim(value, 1, "", COMMAND, "0", None, target)) is expected
