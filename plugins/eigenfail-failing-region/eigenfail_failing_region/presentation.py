"""The failing region in sentences and a table."""

from eigenfail.presentation import tables
from eigenfail.presentation.figures import format_count, format_number
from eigenfail_failing_region.values import Region


def describe_region(found: Region) -> tuple[tables.Block, ...]:
    """Return where among the parameters of a scenario the episodes of campaigns fail."""
    ids = ", ".join(map(str, found.campaigns))
    varied = ", ".join(found.parameters) or "nothing"
    counts = f"{format_count(found.failures)} of {format_count(found.episodes)} episodes failed"
    heading = f"Failing region of {found.scenario}, campaigns {ids}: {counts}; {varied} varied"
    remarks = tables.list_notes([(found.problem, *(f"Warning: {each}" for each in found.warnings))])
    if not found.boxes:
        return (heading, *remarks)
    return (heading, tabulate_boxes(found), _describe_chance(found), *remarks)


def _describe_chance(found: Region) -> str:
    return (
        f"Found on half of the episodes, counted on the others: "
        f"{tables.format_line(found.failure_rate)} of these fail. By chance alone: "
        f"p = {format_number(found.p_value)}."
    )


def tabulate_boxes(found: Region) -> tables.Table:
    """Return the boxes of a failing region, one a row, and all of them together."""
    shares = ("Share of all failures [95 %]", "Failure rate inside [95 %]")
    boxes = [(box.words, box.coverage, box.precision) for box in found.boxes]
    # Of a single box the row of all of them would be the same.
    if len(boxes) > 1:
        boxes.append(("all of these", found.coverage or boxes[0][1], found.precision))
    rows = tuple(
        (words, coverage, precision, *((precision.k, precision.n) if precision else (None, None)))
        for words, coverage, precision in boxes
    )
    columns = (*tables.name_columns("Where"), *tables.count_columns(*shares, "Failed", "Episodes"))
    return tables.Table("Failing region", columns, rows)
