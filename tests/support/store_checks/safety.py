"""Checks of what `EpisodeStore` makes of safety measures and times."""

import time

from msgspec.structs import replace

from eigenfail.testing.examples import CRASH, collision, make_errored_result, result
from eigenfail.values.campaign import Overhead
from eigenfail.values.episode import EpisodeResult
from eigenfail.values.measures import Measures
from eigenfail.values.records import ConflictClass
from eigenfail.values.safety import FailurePoint, MeasureTotals, SafetyTotals
from eigenfail.values.summary import SpendingTotals
from eigenfail_services.store.store import Store
from store_checks.examples import BEYOND, deliver, equal, running

TTC = (4.0, 0.5, None, 1.5, 2.0)
"""MinTTC of episodes without a collision. [s]"""

DRAC = (0.5, 7.0, None, 7.25, None)
"""The largest DRAC of the same. [m/s²]"""

SEVERITIES = (9.0, None, 4.0, 1.0, 16.0)


def driven() -> list[EpisodeResult]:
    """Five episodes without a collision, five with one, and one that could not be run."""
    pairs = enumerate(zip(TTC, DRAC, strict=True))
    safe = [result(2 * n, measures=Measures(1.0, None, ttc, drac)) for n, (ttc, drac) in pairs]
    crashes = [
        collision(2 * n + 1, steps=n + 1, measures=replace(CRASH, severity=severity))
        for n, severity in enumerate(SEVERITIES)
    ]
    return [*safe, *crashes, make_errored_result(12, measures=Measures(1.0, 99.0, 0.0, 99.0))]


def sums_up_safety(store: Store) -> None:
    """Violations, medians and worst cases are over completed episodes, of one campaign alone."""
    campaign, other = running(store, episodes=20), running(store)
    nothing = store.figures.safety(campaign.id)
    equal(plain(nothing), ((0, 0, MeasureTotals(), MeasureTotals()), []), "Of nothing")
    deliver(store, campaign, *reversed(driven()))
    deliver(store, other, result(0, measures=Measures(1.0, None, 0.125, 80.0)), collision(1))
    found = store.figures.safety(campaign.id)
    ttc, drac = MeasureTotals(9, 6, 1.25, 0.5), MeasureTotals(3, 1, 7.0, 7.25)
    equal(plain(found), ((10, 5, ttc, drac), [9.0, 4.0, 1.0, 16.0]), "Safety")
    for who in BEYOND:
        equal(store.figures.safety(who).completed, 0, f"Episodes of {who}")


def plain(found: SafetyTotals) -> tuple[object, object]:
    """All but the points, as what can be compared."""
    return (found.completed, found.failures, found.ttc, found.drac), found.severities.tolist()


def shows_failures_as_points(store: Store) -> None:
    """Every failure with a severity is a point, or every k-th from the first one on."""
    campaign = running(store, episodes=20)
    given = driven()
    deliver(store, campaign, *reversed(given))
    by_index = {each.index: each for each in given}
    shown = {most: store.figures.safety(campaign.id, most).points for most in (1, 2, 3, 4, 9)}
    places = {most: [point.index for point in points] for most, points in shown.items()}
    every = {1: [1], 2: [1, 7], 3: [1, 7], 4: [1, 5, 7, 9], 9: [1, 5, 7, 9]}
    equal(places, every, "Points by their most")
    for point in shown[9]:
        equal(point, point_of(by_index[point.index]), f"Point {point.index}")


def point_of(given: EpisodeResult) -> FailurePoint:
    """What an episode is in the scatter."""
    severity = given.measures.severity if given.measures else None
    return FailurePoint(
        given.index,
        given.noise.log_probability / given.steps,
        severity or 0.0,
        ConflictClass.PLANNER_FAILURE,
    )


def follows_progress(store: Store) -> None:
    """Worker time by what became of it; progress in the order in which results were stored."""
    campaign, other = running(store, episodes=20), running(store)
    equal(store.figures.spending(campaign.id), SpendingTotals(), "Spending of nothing")
    deliver(store, campaign, collision(7, wall_s=2.0), make_errored_result(1, wall_s=0.25))
    time.sleep(0.002)
    deliver(store, campaign, result(3), make_errored_result(4, wall_s=8.0), collision(2), result(5))
    deliver(store, other, collision(0))
    found = store.figures.spending(campaign.id)
    equal((found.completed_worker_s, found.errored_worker_s), (3.5, 8.25), "Worker seconds")
    steps = [(each.completed, each.failures) for each in found.progress]
    equal(steps, [(1, 1), (2, 2), (3, 2), (4, 2)], "Progress, equal times by index")
    rows = {row.index: row.finished_ms for row in store.episodes.page(campaign.id, 20).items}
    times = [each.at_ms for each in found.progress]
    equal(times, [rows[index] for index in (7, 2, 3, 5)], "Their times")
    for most, wanted in ((1, [4]), (2, [2, 4]), (3, [2, 4]), (4, [1, 2, 3, 4])):
        few = store.figures.spending(campaign.id, most).progress
        equal([each.completed for each in few], wanted, f"Progress at most {most} times")
    deliver(store, campaign, result(8))
    odd = store.figures.spending(campaign.id, 3).progress
    equal([each.completed for each in odd], [2, 4, 5], "The last one is always there")


def adds_overhead(store: Store) -> None:
    """What active time went into grows with it."""
    campaign, other = running(store), running(store)
    equal(campaign.overhead, Overhead(), "Overhead of a new campaign")
    for overhead in (Overhead(1.0, 0.5, 0.25), Overhead(0.0, 0.25), Overhead()):
        store.campaigns.add_active(campaign.id, 2.0, overhead)
    store.campaigns.add_active(campaign.id, 1.0)
    found = store.campaigns.get(campaign.id)
    equal((found.active_s, found.overhead), (7.0, Overhead(1.0, 0.75, 0.25)), "Overhead")
    equal(store.campaigns.get(other.id).overhead, Overhead(), "Overhead of another campaign")
