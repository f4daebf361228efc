"""A report: what campaigns found, as tables, sentences and pictures that can be handed on."""

from html import escape
from typing import Annotated

import msgspec

from eigenfail.values.campaign import Campaign

MOST_CAMPAIGNS = 20
"""Maximum number of campaigns in one report."""

OWN_EPISODES = "of the episodes that the method chose"
"""Behind the share of failures of a search, which is no failure rate under p(x)."""


Cell = str | bool | int | float | None
"""What stands in a table: unrounded; None where something is not known."""


Slug = Annotated[str, msgspec.Meta(pattern=r"^[a-z0-9]+(-[a-z0-9]+)*$", max_length=80)]
"""A name that is a file's, too."""


class ReportColumn(msgspec.Struct, frozen=True):
    """A column of a table.

    Attributes:
        name: name in CSV and in code; unique within the table.
        title: column heading.
        unit: empty if there is none; a "share" is of one.
    """

    name: str
    title: str
    unit: str = ""


class ReportTable(msgspec.Struct, frozen=True, kw_only=True):
    """Numbers of a report.

    Attributes:
        name: unique name within the report; also the name of its CSV file.
        rows: a cell for each column.
        note: what the table leaves out; empty if nothing.
    """

    name: Slug
    title: str
    columns: tuple[ReportColumn, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""


class ReportPicture(msgspec.Struct, frozen=True, kw_only=True):
    """A picture of a report, in words.

    Attributes:
        name: unique name within the report; also the name of its SVG file.
        alternative: description of the picture for readers who cannot see it.
        table: name of the table with the plotted values.
        campaigns: ids of the campaigns that it shows.
        note: parts that are left out; empty if nothing.
    """

    name: Slug
    title: str
    alternative: str
    table: Slug
    campaigns: tuple[int, ...]
    note: str = ""


class ReportSection(msgspec.Struct, frozen=True, kw_only=True):
    """A part of a report.

    Attributes:
        words: sentences: findings, and how to read them.
    """

    name: Slug
    title: str
    words: tuple[str, ...] = ()
    tables: tuple[ReportTable, ...] = ()
    pictures: tuple[ReportPicture, ...] = ()


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """The findings of campaigns, as they stood when the report was made.

    Attributes:
        made_ms: when; the only thing that differs between two reports on the same results.
        command: command that regenerates the report.
        warnings: limitations of the figures.
        campaigns: settings and results of each campaign in the report.
    """

    title: str
    made_ms: int
    command: str
    warnings: tuple[str, ...]
    campaigns: tuple[Campaign, ...]
    sections: tuple[ReportSection, ...]

    def __repr__(self) -> str:
        """Title and size, on one line."""
        ids = tuple(campaign.id for campaign in self.campaigns)
        sizes = f"sections={len(self.sections)}, tables={len(self.tables)}"
        return f"Report({self.title!r}, campaigns={ids}, {sizes})"

    def _repr_html_(self) -> str:
        """The report's title, campaigns, contents, command and warnings, for a notebook."""
        pictures = sum(len(section.pictures) for section in self.sections)
        sizes = {"sections": len(self.sections), "tables": len(self.tables), "pictures": pictures}
        facts = {
            "report": self.title,
            "campaigns": ", ".join(f"{each.id}: {each.spec.name}" for each in self.campaigns),
            "contents": ", ".join(f"{size} {name}" for name, size in sizes.items()),
            "command": self.command,
        }
        # Names of campaigns are their authors' words, and a notebook runs the scripts of its cells.
        rows = (f"<tr><th>{name}</th><td>{escape(fact)}</td></tr>" for name, fact in facts.items())
        warnings = (f"<p>{escape(warning)}</p>" for warning in self.warnings)
        return f"<table><tbody>{''.join(rows)}</tbody></table>{''.join(warnings)}"

    @property
    def tables(self) -> tuple[ReportTable, ...]:
        """Tables of all sections."""
        return tuple(table for section in self.sections for table in section.tables)
