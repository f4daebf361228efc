"""Checks of what the store keeps of requirements: values, violations, and what does not fit."""

from typing import Any

from msgspec.structs import replace

from eigenfail.filters import parse_filter, parse_sort
from eigenfail.testing.examples import collision, make_errored_result, result
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.measures import Measures
from eigenfail.values.records import Delivery, EpisodeRow, Verdict
from eigenfail.values.requirements import NoCollision, TimeHeadway
from eigenfail.values.safety import RequirementTotals
from eigenfail_services.store.store import Store
from store_checks.examples import WORKER, deliver, equal, running

NAMED = (NoCollision(), TimeHeadway())


def judged(index: int, *values: float, **changes: Any) -> EpisodeResult:
    """Return an episode with a robustness of each requirement."""
    places = [place for place, value in enumerate(values, start=1) if value <= 0.0]
    measures = Measures(max(0.0, min(values)), nearest_m=5.0, violated=next(iter(places), None))
    outcome = Outcome.VIOLATION if places else Outcome.SAFE
    fields = {"measures": measures, "requirements": values} | changes
    return result(index, outcome, **fields)


def keeps_the_robustness_of_each_requirement(store: Store) -> None:
    """It comes back with the episode, in the order of the requirements."""
    campaign = running(store, requirements=NAMED)
    deliver(store, campaign, judged(0, 4.0, -0.25), judged(1, 3.0, 0.5))
    found = store.episodes.get(campaign.id, 0)
    equal(found.requirements, (4.0, -0.25), "Requirements")
    equal(found.outcome, Outcome.VIOLATION, "Outcome")
    equal((found.measures.nearest_m, found.measures.violated), (5.0, 2), "Measures")


def counts_violations_as_failures(store: Store) -> None:
    """An episode may violate several; it is one failure, with or without a collision."""
    campaign = running(store, requirements=NAMED)
    crash = collision(2, measures=Measures(0.0, nearest_m=0.0, violated=1))
    results = (
        judged(0, 4.0, -0.25),
        judged(1, 3.0, 0.5),
        replace(crash, requirements=(0.0, -0.5)),
        make_errored_result(3),
    )
    deliver(store, campaign, *results)
    counts = store.campaigns.get(campaign.id).counts
    equal((counts.completed, counts.failures, counts.errored), (3, 2, 1), "Counts")
    wanted = (RequirementTotals(3, 1, 0.0), RequirementTotals(3, 2, -0.5))
    equal(store.figures.safety(campaign.id).requirements, wanted, "Violations")
    equal(store.figures.totals([campaign.id])[campaign.id].failures, 2, "Failures")
    (failures,) = store.episodes.failure_portions(campaign.id)
    equal(failures.indices, (0, 2), "Indices of failures")
    conflicts = store.figures.totals([campaign.id])[campaign.id].conflicts
    found = (conflicts.unavoidable, conflicts.planner_failures, conflicts.unclassified)
    equal(sum(found), 1, "Classes of collisions")


def refuses_what_is_not_judged(store: Store) -> None:
    """A result has as many values as its campaign names requirements, all of them finite."""
    campaign, plain = running(store, requirements=NAMED), running(store)
    unfit = (result(0), judged(1, 1.0), judged(2, 1.0, 2.0, 3.0), judged(3, 1.0, float("nan")))
    verdicts = store.episodes.commit(campaign.id, [Delivery(each, WORKER) for each in unfit])
    equal(set(verdicts), {Verdict.UNWANTED}, "Verdicts")
    verdicts = store.episodes.commit(plain.id, [Delivery(judged(0, 1.0, 2.0), WORKER)])
    equal(verdicts, [Verdict.UNWANTED], "Verdicts of a campaign that names none")


def finds_episodes_by_a_requirement(store: Store) -> None:
    """Episodes are filtered and sorted by the robustness of one; missing values come last."""
    campaign = running(store, requirements=NAMED)
    deliver(store, campaign, judged(0, 4.0, 0.5), judged(1, -1.0, -2.0), judged(2, 3.0, -0.25))
    deliver(store, campaign, make_errored_result(3))

    def list_rows(text: str, sort: str = "index") -> tuple[EpisodeRow, ...]:
        order = parse_sort(sort)
        return store.episodes.page(campaign.id, 10, None, parse_filter(text), order).items

    rows = list_rows("")
    equal([row.requirements for row in rows], [(4.0, 0.5), (-1.0, -2.0), (3.0, -0.25), ()], "All")
    equal([row.index for row in list_rows("requirement_2 <= 0")], [1, 2], "Violated")
    equal([row.index for row in list_rows("requirement_3 > -9")], [], "A third one")
    found = list_rows("requirement_1 > -9", "-requirement_2")
    equal([row.index for row in found], [0, 2, 1], "Sorted")
    equal([row.index for row in list_rows("", "requirement_1")], [1, 2, 0, 3], "All, sorted")
    after = store.episodes.page(campaign.id, 1, 2, (), parse_sort("requirement_1"))
    equal(([row.index for row in after.items], after.next), ([0], 0), "The page behind one")
