"""Checks of what `EpisodeStore` says of conflicts: classes, counts, the worst first."""

from math import fsum, isclose

from msgspec.structs import replace

from eigenfail.filters import make_outcome_condition
from eigenfail.testing import expect
from eigenfail.testing.examples import CRASH, collision, make_errored_result, result
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.measures import Measures
from eigenfail.values.records import ConflictClass, ConflictTotals, assess
from eigenfail_services.store.store import Store
from store_checks.examples import deliver, equal, running

WARNED = replace(CRASH, severity=2.0, drac_violated_s=3.25)
ASSESSED: tuple[tuple[Measures, ConflictClass | None], ...] = (
    (WARNED, ConflictClass.PLANNER_FAILURE),
    (replace(WARNED, drac_at_warning_mps2=7.0), ConflictClass.PLANNER_FAILURE),
    (replace(WARNED, drac_at_warning_mps2=7.5), ConflictClass.UNAVOIDABLE),
    (replace(WARNED, drac_at_warning_mps2=3.5, peak_braking_mps2=3.2), ConflictClass.UNAVOIDABLE),
    (
        replace(WARNED, drac_at_warning_mps2=7.5, peak_braking_mps2=8.0),
        ConflictClass.PLANNER_FAILURE,
    ),
    (replace(WARNED, drac_at_warning_mps2=3.5, peak_braking_mps2=0.0), ConflictClass.UNAVOIDABLE),
    (Measures(0.0, collided_s=2.0), ConflictClass.UNAVOIDABLE),
    (Measures(0.0, severity=9.0), None),
)
CLOSE = (0.0, 1.25, 1.5, 1.75, None)
"""MinTTC of episodes without a collision, of which two are near misses. [s]"""

ENDS = (
    *((None, None, None), (7.0, 7.0, None), (7.5, 0.0, 3.0), (9.0, 7.0, None), (9.0, 7.5, 8.0)),
    *((9.0, 7.5, None), (30.0, 22.0, 7.0), (3.5, 3.5, 3.2)),
)
"""Largest DRAC, that at the last step, and the ego's peak braking, of episodes without a collision:
the last three were unresolved. [m/s²]
"""


def every_class() -> list[EpisodeResult]:
    """Episodes of every class, and one that could not be run."""
    crashes = [collision(3 * n, measures=m) for n, (m, _) in enumerate(ASSESSED)]
    safe = [result(3 * n + 1, measures=Measures(1.0, min_ttc_s=s)) for n, s in enumerate(CLOSE)]
    ends = [
        result(
            30 + n,
            measures=Measures(
                1.0, max_drac_mps2=largest, final_drac_mps2=last, peak_braking_mps2=peak
            ),
        )
        for n, (largest, last, peak) in enumerate(ENDS)
    ]
    return [*crashes, *safe, *ends, make_errored_result(2, measures=Measures(1.0, min_ttc_s=0.5))]


def rows_are_assessed(store: Store) -> None:
    """A row holds every measure, and what `assess` makes of them."""
    campaign, given = running(store, episodes=40), every_class()
    deliver(store, campaign, *given)
    by_index = {each.index: each for each in given}
    for row in store.episodes.page(campaign.id, 100).items:
        episode = by_index[row.index]
        for name in Measures.__struct_fields__:
            wanted = getattr(episode.measures, name)
            equal(getattr(row, name), wanted, f"{name} of episode {row.index}")
        equal(row.assessed, assess(episode.outcome, episode.measures), f"Class of {row.index}")
    crashes = store.episodes.page(
        campaign.id, 100, where=make_outcome_condition(Outcome.COLLISION)
    ).items
    equal([row.assessed.conflict for row in crashes], [c for _, c in ASSESSED], "Classes")


def counts_conflicts(store: Store) -> None:
    """Totals count classes and sum lead times, of one campaign alone."""
    campaign, other = running(store, episodes=40), running(store)
    nothing = store.figures.totals([campaign.id])[campaign.id].conflicts
    equal(nothing, ConflictTotals(), "Conflicts of nothing")
    given = every_class()
    deliver(store, campaign, *given)
    deliver(store, other, collision(0), result(1))
    found = store.figures.totals([campaign.id])[campaign.id].conflicts
    counted = (found.unavoidable, found.planner_failures, found.unclassified, found.near_misses)
    equal(counted, (4, 3, 1, 2), "Unavoidable, planner failures, unclassified, near misses")
    equal(found.unresolved, 3, "Unresolved")
    assessed = [assess(each.outcome, each.measures) for each in given]
    ttc = [each.ttc_lead_s for each in assessed if each.ttc_lead_s is not None]
    drac = [each.drac_lead_s for each in assessed if each.drac_lead_s is not None]
    equal((found.ttc_leads, found.drac_leads), (len(ttc), len(drac)), "Known lead times")
    expect(isclose(found.ttc_lead_s, fsum(ttc)), f"Lead times sum to {found.ttc_lead_s}.")
    expect(isclose(found.drac_lead_s, fsum(drac)), f"Lead times sum to {found.drac_lead_s}.")
