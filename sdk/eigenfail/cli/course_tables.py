"""One campaign as a page, and its course as a table."""

from rich.console import Group
from rich.table import Table
from rich.text import Text

from eigenfail.cli.campaign_facts import campaign_facts, conflict_facts
from eigenfail.cli.figures import cost_per_failure, number, rate
from eigenfail.cli.tables import facts, table
from eigenfail.functions import drives
from eigenfail.values import Campaign, Course, Summary


def campaign_page(campaign: Campaign, summary: Summary) -> Group:
    """What was asked for, what was found, and by which class."""
    conflicts = [conflict_facts(campaign, summary.conflicts)] if drives(campaign.spec) else []
    return Group(campaign_facts(campaign), finding_facts(summary), *conflicts)


def finding_facts(summary: Summary) -> Table:
    """What a campaign found, and at what price."""
    n = f"n = {summary.counts.failures}"
    return facts(
        [
            ("failure rate", f"{rate(summary.failure_rate)} (n = {summary.counts.completed})"),
            *([("", summary.remark)] if summary.remark else []),
            ("log p per step", f"{number(summary.log_probability_per_step)} of failures ({n})"),
            ("severity", f"{number(summary.mean_severity, 1)} m²/s², mean of failures ({n})"),
            ("cost per failure", f"{cost_per_failure(summary.cost)} USD ({n})"),
        ]
    )


def course_table(course: Course) -> Group:
    """The blocks of a course, one a row, under what it shows."""
    figures = ("completed", "failures", "failure rate [95 %]", "log p/step", "median robustness")
    grid = table("episodes", *figures, right=figures)
    for block in course.blocks:
        grid.add_row(
            f"{block.first}–{block.last}",
            str(block.failure_rate.n),
            str(block.failure_rate.k),
            rate(block.failure_rate),
            number(block.log_probability_per_step),
            number(block.median_robustness_m),
        )
    return Group(Text(f"{course.heading} of campaign {course.campaign} ({course.method})"), grid)
