"""What a reproduction found, beside what the paper prints."""

import msgspec

from eigenfail.values import Interval


class Number(msgspec.Struct, frozen=True):
    """One number.

    Attributes:
        value: None where there is none, as the severity of no failure.
        n: how many episodes or failures it rests on.
        paper: the paper's; None where it prints none.
    """

    value: float | None
    n: int
    interval: Interval | None = None
    paper: float | None = None


class Row(msgspec.Struct, frozen=True):
    """A row of a table; numbers in the order of the table's columns."""

    name: str
    numbers: tuple[Number, ...]
    campaign: int | None = None


class Column(msgspec.Struct, frozen=True):
    """What a column holds; a unit of "share" is printed in per cent."""

    name: str
    title: str
    unit: str


class PaperTable(msgspec.Struct, frozen=True):
    """One of the paper's tables, with our numbers beside its own.

    Attributes:
        name: short, for files and claims.
        note: what a reader must know to compare.
    """

    name: str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    note: str = ""


class Statement(msgspec.Struct, frozen=True):
    """A statement of the paper, held against our numbers.

    Attributes:
        holds: None where our numbers cannot tell.
        figures: on what the verdict rests.
    """

    paper: str
    holds: bool | None
    figures: str


class Reproduction(msgspec.Struct, frozen=True):
    """All of it."""

    scale: str
    seed: int
    tables: tuple[PaperTable, ...]
    statements: tuple[Statement, ...]
