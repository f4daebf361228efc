"""What two sides had found once so much was spent, campaign by campaign."""

from bisect import bisect_right
from collections.abc import Iterator, Sequence

import msgspec

from eigenfail.values import CampaignCost, CostPoint
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import Chart, rounded

STEPS = 10
"""Rows of the table."""

ROUNDING = 1e-9
SIDES = ("A", "B")
FINDS = {"failures": "Failures", "modes": "Distinct modes"}


class Line(msgspec.Struct, frozen=True):
    """A campaign of a side."""

    side: int
    cost: CampaignCost

    @property
    def name(self) -> str:
        """As a column is headed."""
        return f"{SIDES[self.side]}: {self.cost.campaign} {self.cost.method}"


def bill_charts(*sides: Sequence[CampaignCost]) -> tuple[Chart, ...]:
    """Failures, and modes where any are known, against the money spent."""
    lines = [Line(side, cost) for side, costs in enumerate(sides) for cost in costs]
    known = {find: [line for line in lines if told(line, find)] for find in FINDS}
    return tuple(bill_chart(find, some) for find, some in known.items() if some)


def told(line: Line, find: str) -> bool:
    """Whether a campaign has a curve of what was found."""
    curve = line.cost.curve
    return len(curve) > 1 and getattr(curve[-1], find) is not None


def bill_chart(find: str, lines: Sequence[Line]) -> Chart:
    """One of them."""
    title = f"{FINDS[find]} against cost"
    return Chart(
        id=f"bill-{find}-chart",
        kind="bills",
        title=title,
        caption=f"{FINDS[find]} found once so much was spent, a line for each campaign.",
        data={
            "what": FINDS[find],
            "lines": [
                {
                    "name": line.name,
                    "side": line.side,
                    "usd": rounded(point.usd for point in line.cost.curve),
                    "found": [getattr(point, find) for point in line.cost.curve],
                }
                for line in lines
            ],
        },
        columns=("USD", *(line.name for line in lines)),
        rows=tuple(rows(find, lines)),
        note="A dash: nothing more was spent.",
    )


def rows(find: str, lines: Sequence[Line]) -> Iterator[tuple[str, ...]]:
    """What each had found by equal steps of money."""
    most = max(line.cost.cost.total_usd for line in lines)
    for step in range(1, STEPS + 1):
        usd = most * step / STEPS
        yield (formats.number(usd), *(found_by(find, line.cost, usd) for line in lines))


def found_by(find: str, cost: CampaignCost, usd: float) -> str:
    """What one had found by an amount; a dash once nothing more was spent."""
    if usd > cost.cost.total_usd * (1.0 + ROUNDING):
        return formats.NONE
    spent = [point.usd for point in cost.curve]
    point: CostPoint = cost.curve[max(bisect_right(spent, usd * (1.0 + ROUNDING)) - 1, 0)]
    return formats.integer(getattr(point, find))
