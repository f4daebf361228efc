"""The paper's experiments over several seeds: figures, verdicts, and the parts of a page."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple

import msgspec
from benchmarks.figures import Figure
from benchmarks.learning_figures import each as spell_seeds
from benchmarks.samples import COMMAND, share

from eigenfail_reproduction import page, seeds
from eigenfail_reproduction.paper import (
    REPLAYED,
    PaperColumn,
    PaperNumber,
    PaperReproduction,
    PaperTable,
)

SAMPLES = ("monte_carlo", "held")
"""First words of campaigns whose episodes are drawn from one distribution with every seed: their
seeds are one sample. Searches and what they leave differ from seed to seed."""


class SeedRuns(msgspec.Struct, frozen=True):
    """What was found with each seed."""

    found: tuple[PaperReproduction, ...]


def read(path: Path) -> tuple[PaperReproduction, ...]:
    """What is kept."""
    return msgspec.json.decode(path.read_bytes(), type=SeedRuns).found


def write(runs: SeedRuns, path: Path) -> None:
    """Replace what is kept."""
    path.write_bytes(msgspec.json.format(msgspec.json.encode(runs), indent=2) + b"\n")


def list_verdicts(prefix: str, found: Sequence[PaperReproduction]) -> Iterator[tuple[str, Figure]]:
    """How many statements can be asked, hold, are refuted, and are not shown."""
    judged = seeds.judge_over_seeds(found)
    yield f"{prefix}.asked", count(seeds.count_asked(judged), found)
    for name, verdict in (
        ("holds", seeds.SeedVerdict.HOLDS),
        ("refuted", seeds.SeedVerdict.DOES_NOT_HOLD),
    ):
        of = [one for one in judged if one.verdict is verdict and one.is_shown]
        yield f"{prefix}.{name}", count(len(of), found)
    yield f"{prefix}.undecided", count(sum(map(is_undecided, judged)), found)


def is_undecided(judged: seeds.JudgedStatement) -> bool:
    """Whether a statement was asked, and its verdict rests on seeds that are undecided."""
    return judged.verdict is not seeds.SeedVerdict.CANNOT_BE_ASKED and not judged.is_shown


def count(value: int, found: Sequence[PaperReproduction]) -> Figure:
    """A number of statements, of all."""
    n = len(seeds.judge_over_seeds(found))
    note = f"of {n} statements, over the seeds of {found[0].scenario}"
    return Figure(value=float(value), unit="statements", n=n, command=COMMAND, note=note)


class CellOverSeeds(NamedTuple):
    """One number of a table with every seed.

    Attributes:
        claim: its name in documents.
        row: name of the campaign.
        numbers: the number with each seed.
    """

    claim: str
    row: str
    column: PaperColumn
    numbers: tuple[PaperNumber, ...]

    @property
    def is_sample(self) -> bool:
        """Whether the seeds are one sample of independent draws."""
        share_of_draws = all(one.interval for one in self.numbers) and self.column.unit == "share"
        return share_of_draws and self.row.startswith(SAMPLES)

    def make_figure(self) -> Figure | None:
        """The median with the smallest and the largest; None without a value.

        The share of a sample, and that of replays, are of all seeds together.
        """
        known = [one for one in self.numbers if one.value is not None]
        if not known:
            return None
        paper, values = known[0].paper, [one.value or 0.0 for one in known]
        if self.is_sample or self.column.unit == REPLAYED:
            figure = share([draw for one in known for draw in spell_draws(one)])
            ends = figure.interval if self.is_sample else None
            return msgspec.structs.replace(
                figure, unit=self.column.unit, interval=ends, paper=paper
            )
        return Figure(
            value=median(values),
            unit=self.column.unit,
            n=max(one.n for one in known),
            spread=(min(values), max(values)),
            command=COMMAND,
            paper=paper,
            note=spell_seeds([one.value for one in self.numbers]),
        )

    def format(self) -> str:
        """The figure with its mark, and behind it how far the seeds differ."""
        figure = self.make_figure()
        if figure is None or figure.value is None:
            return "–"
        number = PaperNumber(figure.value, figure.n, find_interval(figure))
        text = f"{page.format_our_number(self.column, number)}<!-- claim {self.claim} -->"
        if figure.spread is None:
            return text
        low, high = (
            page.format_our_number(self.column, PaperNumber(end, figure.n)).removesuffix(" %")
            for end in figure.spread
        )
        known = sum(one.value is not None for one in self.numbers)
        of = "" if known == len(self.numbers) else f", {known} seeds"
        return f"{text} ({low} to {high}{of})" if low != high or of else text


def find_interval(figure: Figure) -> page.Interval | None:
    """The interval of a figure."""
    return page.Interval(*figure.interval) if figure.interval else None


def spell_draws(rate: PaperNumber) -> list[bool]:
    """Whether each of the draws behind a rate failed, in any order."""
    failures = round((rate.value or 0.0) * rate.n)
    return [True] * failures + [False] * (rate.n - failures)


def list_cells(found: Sequence[PaperReproduction], table: PaperTable) -> Iterator[CellOverSeeds]:
    """Every number of a table of the first seed, with the other seeds; row by row."""
    prefix = page.PREFIXES[found[0].scenario]
    for row in table.rows:
        others = [find_numbers(one, table.name, row.name) for one in found]
        for column in table.columns:
            numbers = tuple(one[column.name] for one in others if one)
            name = page.claim_name(prefix, table, row, column)
            yield CellOverSeeds(name, row.name, column, numbers)


def find_numbers(found: PaperReproduction, name: str, row: str) -> Mapping[str, PaperNumber]:
    """The numbers of a row, by the name of their column; nothing without that row."""
    table: PaperTable = next(one for one in found.tables if one.name == name)
    numbers = next((one.numbers for one in table.rows if one.name == row), None)
    columns = table.columns if numbers else ()
    return {column.name: one for column, one in zip(columns, numbers or (), strict=True)}


def list_tables(found: Sequence[PaperReproduction]) -> Iterator[PaperTable]:
    """Each table, with all rows that any seed has."""
    for table in found[0].tables:
        alike = [next(one for one in each.tables if one.name == table.name) for each in found]
        rows = {row.name: row for each in reversed(alike) for row in each.rows}
        names = dict.fromkeys(row.name for each in alike for row in each.rows)
        yield msgspec.structs.replace(table, rows=tuple(rows[name] for name in names))


def list_figures(found: Sequence[PaperReproduction]) -> Iterator[tuple[str, Figure]]:
    """Every number of every table."""
    for table in list_tables(found):
        for cell in list_cells(found, table):
            figure = cell.make_figure()
            if figure is not None:
                yield cell.claim, figure


def format_tables(found: Sequence[PaperReproduction], notes: Mapping[str, str]) -> Iterator[str]:
    """Each table in Markdown, with its caption and what is noted of it."""
    for table in list_tables(found):
        yield f"## {table.title}\n"
        yield f"{table.note} {notes.get(table.name, '')}".rstrip() + "\n"
        yield from format_grid(found, table)
        yield ""


def format_grid(found: Sequence[PaperReproduction], table: PaperTable) -> Iterator[str]:
    """A table with the number of episodes or failures of one seed, and the paper's numbers."""
    grid: dict[str, list[CellOverSeeds]] = {}
    for cell in list_cells(found, table):
        grid.setdefault(cell.row, []).append(cell)
    columns = [*zip(*grid.values(), strict=True)]
    beside = [any(one.numbers[0].paper is not None for one in column) for column in columns]
    heads = [
        f" {page.format_heading(column)} |{has * ' paper |'}"
        for column, has in zip(table.columns, beside, strict=True)
    ]
    yield f"| |{''.join(heads)}"
    yield f"|---|{'--:|' * (len(beside) + sum(beside))}"
    for row, cells in grid.items():
        printed = (
            f" {one.format()} |{has * f' {format_paper(one)} |'}"
            for one, has in zip(cells, beside, strict=True)
        )
        yield f"| {row} |{''.join(printed)}"


def format_paper(cell: CellOverSeeds) -> str:
    """The paper's number, or a dash."""
    return page.format_printed(cell.column, cell.numbers[0].paper)


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
