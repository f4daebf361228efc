"""The paper's experiments over several seeds: figures, verdicts, and the parts of a page."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple

import msgspec
from benchmarks.figures import Figure
from benchmarks.learning_figures import each as spell_seeds
from benchmarks.samples import COMMAND

from eigenfail import intervals
from eigenfail.values.estimates import Interval
from eigenfail_reproduction import page, seeds
from eigenfail_reproduction.paper import (
    REPLAYED,
    PaperColumn,
    PaperNumber,
    PaperReproduction,
    PaperRow,
    PaperTable,
)

SAMPLES = ("monte_carlo", "held")
"""First words of campaigns whose episodes are drawn from one distribution with every seed: their
seeds are one sample. Searches and what they leave differ from seed to seed."""


EARLIER_DIFS = """\
- **Earlier `difs`**: in the tables `difs` and `difs_paper` are of an earlier version of `difs`. It
  was a mixture of normals, corrected by a small network; `difs_paper` had a guidance of 2.
  `eigenfail reproduce` runs the present `difs`: its rows will differ.
"""


class SeedRuns(msgspec.Struct, frozen=True):
    """What was found with each seed."""

    found: tuple[PaperReproduction, ...]


def read(path: Path) -> tuple[PaperReproduction, ...]:
    """Return the kept runs."""
    return msgspec.json.decode(path.read_bytes(), type=SeedRuns).found


def write(runs: SeedRuns, path: Path) -> None:
    """Replace the kept runs."""
    path.write_bytes(msgspec.json.format(msgspec.json.encode(runs), indent=2) + b"\n")


def list_verdicts(prefix: str, found: Sequence[PaperReproduction]) -> Iterator[tuple[str, Figure]]:
    """How many statements can be asked, hold, are refuted, and are not shown."""
    judged = seeds.judge_over_seeds(found)
    scenario = found[0].scenario
    yield f"{prefix}.asked", count(seeds.count_asked(judged), judged, scenario)
    for name, verdict in (
        ("holds", seeds.SeedVerdict.HOLDS),
        ("refuted", seeds.SeedVerdict.DOES_NOT_HOLD),
    ):
        of = [one for one in judged if one.verdict is verdict and one.is_shown]
        yield f"{prefix}.{name}", count(len(of), judged, scenario)
    yield f"{prefix}.undecided", count(sum(map(is_undecided, judged)), judged, scenario)


def is_undecided(judged: seeds.JudgedStatement) -> bool:
    """Whether a statement was asked, and its verdict rests on seeds that are undecided."""
    return judged.verdict is not seeds.SeedVerdict.CANNOT_BE_ASKED and not judged.is_shown


def count(value: int, judged: Sequence[seeds.JudgedStatement], scenario: str) -> Figure:
    """A number of statements, of all."""
    note = f"of {len(judged)} statements, over the seeds of {scenario}"
    return Figure(value=float(value), unit="statements", n=len(judged), command=COMMAND, note=note)


class CellOverSeeds(NamedTuple):
    """One number of a table with every seed.

    Attributes:
        claim: its name in documents.
        row: name of the campaign.
        numbers: the number with each seed; without a value if a seed has none.
    """

    claim: str
    row: str
    column: PaperColumn
    numbers: tuple[PaperNumber, ...]

    @property
    def is_pooled(self) -> bool:
        """Whether the seeds are counted together: draws of one distribution, or replays."""
        return self.column.unit == REPLAYED or self.row.startswith(SAMPLES)

    def make_figure(self) -> Figure | None:
        """The median with the smallest and the largest, or a share of all seeds together.

        Returns:
            None if no seed has a value.
        """
        known = [one for one in self.numbers if one.value is not None]
        if not known:
            return None
        if self.column.unit == REPLAYED:
            return pool_replays(known)
        if self.is_pooled and all(one.draws for one in known):
            return pool_draws(known)
        values = [one.value or 0.0 for one in known]
        return Figure(
            value=median(values),
            unit=self.column.unit,
            n=sum(one.n for one in known),
            spread=(min(values), max(values)),
            command=COMMAND,
            paper=known[0].paper,
            note=spell_seeds([one.value for one in self.numbers]),
        )

    def format(self) -> str:
        """The figure with its mark, and behind it how far the seeds differ."""
        figure = self.make_figure()
        if figure is None or figure.value is None:
            return "–"
        number = PaperNumber(figure.value, figure.n, find_interval(figure))
        text = f"{page.format_our_number(self.column, number)}<!-- claim {self.claim} -->"
        known = sum(one.value is not None for one in self.numbers)
        parts = [] if known == len(self.numbers) else [f"{known} of {len(self.numbers)} seeds"]
        if figure.spread and figure.spread[0] != figure.spread[1]:
            low, high = (
                page.format_our_number(self.column, PaperNumber(end, figure.n)).removesuffix(" %")
                for end in figure.spread
            )
            parts.insert(0, f"{low} to {high}")
        return f"{text} ({', '.join(parts)})" if parts else text


def pool_draws(rates: Sequence[PaperNumber]) -> Figure:
    """The share of all draws, with its interval; doubtful draws count in the upper end."""
    draws = [rate.draws for rate in rates if rate.draws is not None]
    k, trials = sum(one.k for one in draws), sum(one.trials for one in draws)
    ends = intervals.find_interval(k, trials, sum(one.doubtful for one in draws))
    n = sum(rate.n for rate in rates)
    return Figure(
        value=k / n,
        unit="share",
        n=n,
        interval=(ends.low, ends.high),
        command=COMMAND,
        paper=rates[0].paper,
        note=f"draws of {len(rates)} seeds",
    )


def pool_replays(shares: Sequence[PaperNumber]) -> Figure:
    """The share of all replays that failed: a count, without an interval."""
    n = sum(one.n for one in shares)
    k = sum(round((one.value or 0.0) * one.n) for one in shares)
    note = f"replays of {len(shares)} seeds"
    paper = shares[0].paper
    return Figure(value=k / n, unit=REPLAYED, n=n, command=COMMAND, paper=paper, note=note)


def find_interval(figure: Figure) -> Interval | None:
    """The interval of a figure."""
    return Interval(*figure.interval) if figure.interval else None


def list_cells(found: Sequence[PaperReproduction], table: PaperTable) -> Iterator[CellOverSeeds]:
    """Every number of a table of the first seed, with the other seeds; row by row."""
    prefix = page.PREFIXES[found[0].scenario]
    for row in table.rows:
        others = [find_numbers(one, table.name, row.name) for one in found]
        for column in table.columns:
            numbers = tuple(one.get(column.name, PaperNumber(None, 0)) for one in others)
            name = page.claim_name(prefix, table, row, column)
            yield CellOverSeeds(name, row.name, column, numbers)


def find_numbers(found: PaperReproduction, name: str, row: str) -> Mapping[str, PaperNumber]:
    """The numbers of a row, by the name of their column; nothing without that row."""
    for table in found.tables:
        for each in table.rows:
            if (table.name, each.name) == (name, row):
                pairs = zip(table.columns, each.numbers, strict=True)
                return {column.name: number for column, number in pairs}
    return {}


def list_tables(found: Sequence[PaperReproduction]) -> list[PaperTable]:
    """Each table that any seed has, with all rows of any seed, in the order of the first ones."""
    tables: dict[str, PaperTable] = {}
    rows: dict[str, dict[str, PaperRow]] = {}
    for table in (table for one in found for table in one.tables if table.rows):
        tables.setdefault(table.name, table)
        for row in table.rows:
            rows.setdefault(table.name, {}).setdefault(row.name, row)
    return [
        msgspec.structs.replace(table, rows=tuple(rows[name].values()))
        for name, table in tables.items()
    ]


def list_figures(found: Sequence[PaperReproduction]) -> Iterator[tuple[str, Figure]]:
    """Every number of every table."""
    for table in list_tables(found):
        for cell in list_cells(found, table):
            figure = cell.make_figure()
            if figure is not None:
                yield cell.claim, figure


def format_tables(found: Sequence[PaperReproduction], captions: Mapping[str, str]) -> Iterator[str]:
    """Each table in Markdown, with its caption by its name."""
    for table in list_tables(found):
        yield f"## {table.title}\n"
        yield captions[table.name]
        yield from format_grid(found, table)
        yield ""


def format_grid(found: Sequence[PaperReproduction], table: PaperTable) -> Iterator[str]:
    """A table, with a column for the paper's numbers where it gives them."""
    grid: dict[str, list[CellOverSeeds]] = {}
    for cell in list_cells(found, table):
        grid.setdefault(cell.row, []).append(cell)
    columns = [*zip(*grid.values(), strict=True)]
    beside = [any(find_paper(one) is not None for one in column) for column in columns]
    heads = ["", *(page.format_heading(column) for column in table.columns)]
    yield format_line(heads, ["paper"] * len(beside), beside)
    yield f"|---|{'--:|' * (len(beside) + sum(beside))}"
    for row, cells in grid.items():
        printed = [row, *(one.format() for one in cells)]
        yield format_line(printed, [format_paper(one) for one in cells], beside)


def format_line(cells: Sequence[str], papers: Sequence[str], beside: Sequence[bool]) -> str:
    """A line of a table: each cell but the first is followed by the paper's, if there is one."""
    first, *others = cells
    line = [first]
    for cell, paper, has in zip(others, papers, beside, strict=True):
        line += [cell, paper] if has else [cell]
    return f"| {' | '.join(line)} |"


def find_paper(cell: CellOverSeeds) -> float | None:
    """The paper's number of a cell."""
    return next((one.paper for one in cell.numbers if one.paper is not None), None)


def format_paper(cell: CellOverSeeds) -> str:
    """The paper's number, or a dash."""
    return page.format_printed(cell.column, find_paper(cell))


OF_VERDICTS = """\
Columns count the seeds in which a statement holds, is refuted, is undecided, and cannot be asked.
"""


def format_verdicts(
    judged: Sequence[seeds.JudgedStatement], reasons: Mapping[tuple[str, str], str]
) -> Iterator[str]:
    """The table of verdicts with their reasons."""
    yield "| the paper | judged by | verdict | holds | refuted | undecided | not asked | why |"
    yield "|---|---|---|--:|--:|--:|--:|---|"
    for one in judged:
        verdict = f"{one.verdict}{' (not shown)' * is_undecided(one)}"
        counts = f"{one.held} | {one.refuted} | {one.undecided} | {one.unasked}"
        yield (
            f"| {one.paper} | {name_subject(one.subject)} | {verdict} | {counts} | "
            f"{reasons[one.paper, one.subject]} |"
        )
    yield ""


def format_rules(found: PaperReproduction) -> Iterator[str]:
    """The table of the rules of verdicts, with the numbers of a seed."""
    yield "| the paper | holds if | numbers |\n|---|---|---|"
    for one in found.statements:
        yield f"| {one.paper} | {one.rule} | {one.figures} |"
    yield ""


def name_subject(subject: str) -> str:
    """The learners that a statement was judged by, as code."""
    return ", ".join(f"`{name}`" for name in subject.split(", ") if name) or "–"
