"""The episodes of a campaign by conflict class, and how early its collisions showed."""

from eigenfail.values import MeanTime, Summary
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.summaries import Figure

Tiles = tuple[tuple[str, Figure], ...]


def conflict_tiles(summary: Summary) -> Tiles:
    """As the paper counts them; nothing before the first episode has ended."""
    found, counts = summary.conflicts, summary.counts
    if not counts.completed:
        return ()
    of_all = (f"of {formats.integer(counts.completed)}",)
    of_collisions = (f"of {formats.counted(counts.failures, 'collision')}",)
    unclassified = Figure(formats.integer(found.unclassified), of_collisions)
    return (
        ("Near misses", Figure(formats.integer(found.near_misses), of_all)),
        ("Unavoidable", Figure(formats.integer(found.unavoidable), of_collisions)),
        ("Planner failures", Figure(formats.integer(found.planner_failures), of_collisions)),
        *((("Not classified", unclassified),) if found.unclassified else ()),
        ("Lead time of MinTTC", mean(found.ttc_lead)),
        ("Lead time of DRAC", mean(found.drac_lead)),
    )


def mean(time: MeanTime) -> Figure:
    """A mean, and what it rests on."""
    if time.mean_s is None:
        return Figure(formats.NONE, ("no such collision",))
    return Figure(f"{formats.number(time.mean_s)} s", (f"mean of {formats.integer(time.n)}",))
