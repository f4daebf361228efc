"""Write the tables of measures, columns and signals: `python tests/docs/measure_tables.py`."""

from pathlib import Path

from eigenfail.filters import COLUMNS
from eigenfail.values.measures import MEASURES
from eigenfail.values.signals import SIGNALS

DOCS = Path(__file__).parents[2] / "docs"


def render_measures():
    """Return the table of docs/measures.md."""
    rows = [
        (f"`{name}`", measure.formula, measure.unit, measure.source)
        for name, measure in MEASURES.items()
    ]
    return _render_table(("measure", "formula", "unit", "source"), rows)


def render_columns():
    """Return the table of docs/episodes.md."""
    rows = [
        (f"`{column.name}`", ", ".join(column.choices) or column.kind, column.words)
        for column in COLUMNS.values()
    ]
    return _render_table(("column", "values", "what it says"), rows)


def render_signals():
    """Return the table of docs/requirements.md."""
    rows = [
        (
            f"`{name}`",
            signal.words,
            signal.unit,
            "" if signal.absent is None else f"{signal.absent:g}",
            "lane" if signal.needs_lane else "",
        )
        for name, signal in SIGNALS.items()
    ]
    header = ("signal", "what it is", "unit", "where there is none", "needs")
    return _render_table(header, rows)


def _render_table(header, rows):
    cells = [[f" {cell} ".replace("|", r"\|") if cell else " " for cell in row] for row in rows]
    return "\n".join(
        f"|{'|'.join(row)}|"
        for row in [[f" {name} " for name in header], ["---"] * len(header), *cells]
    )


PAGES = {
    "measures.md": ("measures", render_measures),
    "episodes.md": ("columns", render_columns),
    "requirements.md": ("signals", render_signals),
}


def render_page(name):
    """Return a page of docs with the table between its marks made anew."""
    mark, render = PAGES[name]
    begin, end = f"<!-- {mark} -->", f"<!-- /{mark} -->"
    before, _, rest = (DOCS / name).read_text().partition(begin)
    return f"{before}{begin}\n{render()}\n{end}{rest.partition(end)[2]}"


def main():
    """Write the pages."""
    for name in PAGES:
        (DOCS / name).write_text(render_page(name))


if __name__ == "__main__":
    main()
