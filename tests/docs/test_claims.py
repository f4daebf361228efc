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


@pytest.mark.parametrize("page", PAGES)
def test_a_figure_that_is_changed_in_a_page_is_found(claims, root, page):
    """Change the last digit of every marked figure: each of them must be found."""
    text = plain((root / page).read_text())
    figures = list(MARK.finditer(text))
    assert figures
    for end in reversed([figure.end("value") for figure in figures]):
        text = f"{text[: end - 1]}{(int(text[end - 1]) + 5) % 10}{text[end:]}"
    assert len(list(wrong(text, claims))) == len(figures)


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


RATE = {"a.rate": Claim(0.3565, 2000, "share", COMMAND, "0", (0.3358, 0.37775))}
SMALL = {"p": Claim(1.247e-4, 9, "probability", COMMAND, "0", (4.02e-5, 3.7e-4))}


@pytest.mark.parametrize(
    "text",
    [
        "| idm | 35.6 % [33.5, 37.8]<!-- claim a.rate -->, severity 4.1 | 40.1 |",
        "| idm | 35.7 % <!-- claim a.rate --> | 40.1 % |",
        "a rate of 36 [33, 38 %]<!-- claim a.rate --> at 58 m",
        "| 0.36 | 0.357<!-- claim a.rate --> |",
    ],
)
def test_a_figure_that_agrees_passes(text):
    assert list(wrong(text, RATE)) == []


def test_small_probabilities_are_compared_by_their_digits():
    for printed in ("1.2e-4", "1.25e-4 [4.0e-5, 3.7e-4]", "1.25×10⁻⁴"):
        assert list(wrong(f"{printed}<!-- claim p -->", SMALL)) == []
    for printed in ("1.3e-4", "1.25e-4 [4e-5, 3.7e-4]", "1.25e-4 [4.1e-5, 3.7e-4]"):
        assert len(list(wrong(f"{printed}<!-- claim p -->", SMALL))) == 1


COUNTS = {
    "none": Claim(0.0, 2000, "share", COMMAND, "0", (0.0, 0.0014967)),
    "all": Claim(1.0, 78, "share", COMMAND, "0"),
    "one": Claim(0.01, 100, "share of replays", COMMAND, "0"),
}


@pytest.mark.parametrize(
    ("right", "wrongs"),
    [
        (
            "0 of 2,000: ≤ 0.150 %<!-- claim none -->",
            ("0 of 2,000: ≤ 0.149 %", "0 of 200: ≤ 0.150 %", "0 of 2,000: ≤ 0.1 %", "0 % [0, 0.1]"),
        ),
        ("in 0 of 2000 runs (≤ 0.15 %<!-- claim none -->)", ("in 0 of 2000 runs (≤ 0.16 %",)),
        ("all 78<!-- claim all -->", ("all 79", "77 of 78", "100 % [96, 100]")),
        ("1 of 100<!-- claim one -->", ("2 of 100", "1 of 10", "all 100")),
    ],
)
def test_counts_and_bounds_are_compared_with_the_share_and_its_n(right, wrongs):
    assert list(wrong(right, COUNTS)) == []
    mark = right[right.index("<!--") :]
    for text in wrongs:
        assert len(list(wrong(f"{text}{mark}", COUNTS))) == 1, text


@pytest.mark.parametrize(
    "text",
    [
        "| 35.5 % [33.5, 37.8]<!-- claim a.rate --> |",
        "| 35.7 % [33.5, 37.9]<!-- claim a.rate --> |",
        "| 35.7 % [33.6, 37.8]<!-- claim a.rate --> |",
        "| 35.7 % [33.5, 37.7]<!-- claim a.rate --> |",
        "| 35.7 [33.5, 37.8]<!-- claim a.rate --> |",
        "| 35.7 %<!-- claim a.rte --> |",
    ],
)
def test_a_figure_that_differs_is_found(text):
    assert len(list(wrong(text, RATE))) == 1


OF_SEEDS = {
    "a.rate": Claim(
        0.9, 3, "share", COMMAND, "0", spread=(0.8, 1.0), note="median of 2 seeds: 1, 0.8"
    )
}


def test_the_values_of_each_seed_are_those_of_the_note():
    for right in ("100, 80 %<!-- seeds a.rate -->", "(1.0, 0.80<!-- seeds a.rate -->)"):
        assert list(wrong_seeds(right, OF_SEEDS)) == []
    for other in ("100, 81 %", "80, 100 %", "100, 80", "100, 80, 80 %"):
        assert len(list(wrong_seeds(f"{other}<!-- seeds a.rate -->", OF_SEEDS))) == 1
    assert len(list(wrong_seeds("1, 0.8<!-- seeds a.rat -->", OF_SEEDS))) == 1
    with pytest.raises(AssertionError, match="without figures"):
        list(wrong_seeds("80 %<!-- seeds a.rate -->", OF_SEEDS))


OF_DIGITS = {
    "a.ratio": Claim(
        *(1.2949, 300, "ratio", COMMAND, "0"),
        spread=(-0.004951, 1.3150976),
        note="median of 3 seeds: 1.295, 1.315, -0.00495",
    )
}


def test_the_smallest_middle_and_largest_seed_are_rounded_from_all_of_their_digits():
    """The four digits of the note allow 1.30 or 1.29, and 1.31 or 1.32."""
    assert list(wrong_seeds("1.29, 1.32, -0.00<!-- seeds a.ratio -->", OF_DIGITS)) == []
    for other in ("1.29, 1.31, -0.00", "1.30, 1.32, -0.00", "1.295, 1.315, -0.0049"):
        assert len(list(wrong_seeds(f"{other}<!-- seeds a.ratio -->", OF_DIGITS))) == 1, other
    whole = {"a.ratio": msgspec.structs.replace(OF_DIGITS["a.ratio"], spread=None)}
    assert len(list(wrong_seeds("1.29, 1.32, -0.00<!-- seeds a.ratio -->", whole))) == 1


@pytest.mark.parametrize(
    ("value", "right", "wrong_one"),
    [
        (0.125, "0.13", "0.12"),
        (-0.125, "-0.13", "-0.12"),
        (2.5, "3", "2"),
        (0.1249, "0.12", "0.13"),
    ],
)
def test_a_half_is_rounded_away_from_zero(value, right, wrong_one):
    assert is_rounded(right, value)
    assert not is_rounded(wrong_one, value)


def test_a_mark_without_a_figure_is_found():
    with pytest.raises(AssertionError, match="without a figure"):
        list(wrong("| 35.7 % | none<!-- claim a.rate --> |", RATE))


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
