"""A word of the glossary."""

import msgspec


class Term(msgspec.Struct, frozen=True, kw_only=True):
    """What a statistic is, in a sentence or two.

    Attributes:
        key: names it in addresses.
        name: as it is called.
        words: what it is, and what it is not.
        unit: of its figures; empty where it has none.
        labels: under which it stands in tables and on pages, without unit, threshold or interval.
    """

    key: str
    name: str
    words: str
    unit: str = ""
    labels: tuple[str, ...] = ()
