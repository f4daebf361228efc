"""Checks of how `EpisodeStore` is read: lists, sums and digests."""

from math import fsum, isclose

from msgspec.structs import replace

from eigenfail.testing import expect
from eigenfail.testing.examples import collision, make_errored_result, result
from eigenfail.values.episode import Outcome
from eigenfail.values.records import PORTION
from eigenfail_services.store.store import Store
from store_checks.examples import WORKER, alike, deliver, equal, running


def lists_rows(store: Store) -> None:
    """A row says what happened."""
    campaign = running(store)
    given = collision(3)
    deliver(store, campaign, make_errored_result(4), given)
    row, problem = store.episodes.page(campaign.id, 10).items
    found = (row.campaign, row.index, row.seed, row.outcome, row.steps, row.source, row.worker)
    wanted = (campaign.id, 3, 103, Outcome.COLLISION, 3, "policy", WORKER)
    equal(found, wanted, "The row of a collision")
    measured = (row.robustness_m, row.severity, row.min_ttc_s, row.max_drac_mps2, row.wall_s)
    equal(measured, (0.0, 2.5, 1.25, None, 0.5), "Its measures")
    equal(row.log_probability, given.noise.log_probability, "Its log-probability")
    equal((row.digest, row.has_scene, row.problem), (given.digest(), True, ""), "The rest of it")
    equal((problem.outcome, problem.problem), (Outcome.ERRORED, "planner: It raised."), "A fault")
    expect(not problem.has_scene, "A failed episode has a scene.")
    equal(problem.robustness_m, None, "The robustness of a failed episode")


def finds_the_finished(store: Store) -> None:
    """Those that have a result, in index order, each once, without scenes."""
    campaign = running(store, episodes=2_000)
    deliver(store, campaign, collision(3), result(1), *(result(n) for n in range(1_000, 1_800)))
    found = store.episodes.finished(campaign.id, [3, 1, 1, 2, 4_000])
    equal([each.index for each in found], [1, 3], "The finished ones")
    expect(found[1].scene is None, "A scene came along.")
    alike(found[1].states, collision(3).states, "states")
    alike(found[1].noise.z, collision(3).noise.z, "z")
    many = store.episodes.finished(campaign.id, range(2_000))
    equal([e.index for e in many], [1, 3, *range(1_000, 1_800)], "The finished ones of 2000")
    equal(store.episodes.finished(campaign.id, []), [], "The finished ones of none")


def gathers_failures(store: Store) -> None:
    """The noise of collisions, each as long as it lasted."""
    campaign = running(store)
    deliver(
        store,
        campaign,
        collision(8, steps=5),
        result(1),
        make_errored_result(2),
        collision(0, steps=2),
    )
    (found,) = store.episodes.failure_portions(campaign.id)
    equal(found.indices, (0, 8), "Indices of the collisions")
    equal(found.seeds, (collision(0).seed, collision(8).seed), "Their seeds")
    alike(found.noise[0], collision(0, steps=2).noise.z, "z of the first")
    alike(found.noise[1], collision(8, steps=5).noise.z, "z of the second")


def hands_out_failures_in_portions(store: Store) -> None:
    """All of them, in index order, each once, a bounded number at a time."""
    campaign = running(store, episodes=5_000)
    equal(list(store.episodes.failure_portions(campaign.id)), [], "Portions of none")
    count = PORTION + 3
    deliver(store, campaign, result(1), *(collision(2 * n, steps=2) for n in range(count)))
    portions = list(store.episodes.failure_portions(campaign.id))
    equal([len(portion.indices) for portion in portions], [PORTION, 3], "Sizes of the portions")
    indices = [index for portion in portions for index in portion.indices]
    equal(indices, list(range(0, 2 * count, 2)), "Their indices")
    alike(portions[1].noise[2], collision(indices[-1], steps=2).noise.z, "z of the last")


def tells_the_course_of_failures(store: Store) -> None:
    """In failures with a scene, in index order."""
    campaign = running(store)
    equal(list(store.episodes.failure_courses(campaign.id)), [], "Courses of no failure")
    crashes = [collision(8, steps=5), collision(0, steps=2)]
    without = result(3, Outcome.COLLISION)
    safe = replace(collision(1), outcome=Outcome.SAFE)
    deliver(store, campaign, *crashes, without, safe, make_errored_result(2))
    found = list(store.episodes.failure_courses(campaign.id))
    equal([each.index for each in found], [0, 8], "Failures with a scene")
    for each, crash in zip(found, crashes[::-1], strict=True):
        equal(each.dt_s, 0.1, "Duration of a step")
        alike(each.speed_mps, crash.scene.vehicles[:, 0, 3], "Speed of the ego")
        alike(each.end, crash.scene.vehicles[-2:], "Vehicles at the end")
        alike(each.sizes, crash.scene.sizes, "Their sizes")


def sums_up_failures(store: Store) -> None:
    """Totals are sums over collisions alone."""
    campaign = running(store)
    nothing = store.figures.totals([campaign.id])[campaign.id]
    equal((nothing.failures, nothing.log_probability, nothing.steps), (0, 0.0, 0), "No failures")
    crashes = [collision(4, steps=5), collision(2, steps=2)]
    deliver(store, campaign, *crashes, result(0), make_errored_result(1))
    found = store.figures.totals([campaign.id])[campaign.id]
    equal((found.failures, found.steps, found.severity), (2, 7, 5.0), "Two failures")
    wanted = fsum(each.noise.log_probability for each in crashes)
    expect(isclose(found.log_probability, wanted), f"log p sums to {found.log_probability}.")
