"""Checks of how `EpisodeStore` takes results."""

from math import inf, nan
from threading import get_ident
from typing import Any

import numpy as np
from msgspec.structs import replace

from eigenfail.testing import expect
from eigenfail.testing.examples import collision, floats, make_errored_result, result
from eigenfail.values.campaign import Campaign, Counts
from eigenfail.values.disturbance import DisturbanceModel, NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.learning import STATE, count_state
from eigenfail.values.measures import MEASURES, Measures
from eigenfail.values.records import Delivery, Verdict
from eigenfail.values.scene import Scene
from eigenfail.values.shapes import Correlated
from eigenfail_services.store.store import Store
from store_checks.examples import (
    WORKER,
    alike,
    deliver,
    equal,
    name_channels,
    noise_of,
    result_of,
    running,
)

KEPT, DUPLICATE, ALARM, UNWANTED = Verdict


def counts(store: Store, campaign: Campaign) -> Counts:
    """What is counted by now; it must hold together."""
    found = store.campaigns.get(campaign.id).counts
    expect(found.open >= 0, f"More episodes have ended than were planned: {found}.")
    return found


def returns_what_was_delivered(store: Store) -> None:
    """Every kind of result comes back bit for bit."""
    campaign = running(store)
    given = (
        collision(0, steps=7),
        result(1),
        make_errored_result(2),
        result(9, source="trajectory"),
    )
    equal(deliver(store, campaign, *given), [KEPT] * 4, "Verdicts on four new results")
    for each in given:
        same_result(store.episodes.get(campaign.id, each.index), each)


def same_result(found: EpisodeResult, given: EpisodeResult) -> None:
    """Expect the same result, with everything that is kept of it."""
    for name in ("index", "seed", "outcome", "steps", "source", "measures", "fault", "wall_s"):
        equal(getattr(found, name), getattr(given, name), f"{name} of episode {given.index}")
    alike(found.noise.z, given.noise.z, "z")
    alike(found.noise.sigma, given.noise.sigma, "sigma")
    alike(found.states, given.states, "states")
    alike(found.importance, given.importance, "importance")
    same_scene(found.scene, given.scene)
    equal(found.digest(), given.digest(), "The digest of a result that is read")


def same_scene(found: Scene | None, given: Scene | None) -> None:
    """Expect the same scene, or none."""
    if found is None or given is None:
        expect(found is given, "A scene came or went.")
        return
    equal(found.dt_s, given.dt_s, "dt_s")
    for name in ("vehicles", "sizes", "perceived", "controls"):
        alike(getattr(found, name), getattr(given, name), name)


def keeps_the_first(store: Store) -> None:
    """The first result stays; the same again is a duplicate, another an alarm that is logged."""
    campaign = running(store)
    deliver(store, campaign, result(0))
    events = store.events.last()
    verdicts = deliver(
        store, campaign, result(0), result(0, salt=1), make_errored_result(0), result(1)
    )
    equal(verdicts, [DUPLICATE, ALARM, ALARM, KEPT], "Verdicts")
    same_result(store.episodes.get(campaign.id, 0), result(0))
    equal(counts(store, campaign), Counts(10, completed=2, duplicates=3), "Counts")
    alarms = store.events.after(events, 10)
    equal([e.kind for e in alarms], ["episode.alarm"] * 2, "Events of two alarms")
    told = f"Worker {WORKER} brought another result of episode 0 "
    expect(all(told in e.message for e in alarms), "An alarm does not name worker and episode.")


def runs_other_work_while_it_commits(store: Store) -> None:
    """The other work runs in the thread that waits, and the results are there after it."""
    campaign = running(store)
    threads: list[int] = []
    verdicts = store.episodes.commit(
        campaign.id, [Delivery(result(0), WORKER)], lambda: threads.append(get_ident())
    )
    equal(verdicts, [KEPT], "Verdicts")
    # A slow disk lets it run several times.
    equal(set(threads), {get_ident()}, "Threads in which the other work ran")
    equal(counts(store, campaign), Counts(10, completed=1), "Counts")


def refuses_what_does_not_fit(store: Store) -> None:
    """Results that the campaign did not ask for are unwanted; their neighbours are kept."""
    campaign = running(store)
    flat = NoiseTrajectory(floats(0, 6), floats(0, 6))
    uneven = NoiseTrajectory(floats(0, 3, 2), floats(0, 4, 2))
    misfits = (
        result(10),
        result(-1),
        result(2**70),
        result(1, noise=flat),
        result(1, noise=uneven),
        result(1, states=floats(0, 3)),
        result(1, states=floats(0, 4, len(STATE))),  # of three steps
        result(1, seed=2**64 - 1),
        result(1, seed=-1),
        replace(result(1), steps=2**64 - 1),
        replace(result(1), steps=-1),
    )
    for misfit in misfits:
        equal(deliver(store, campaign, misfit), [UNWANTED], f"A result like {misfit}")
    equal(deliver(store, campaign, misfits[0], result(1)), [UNWANTED, KEPT], "Its neighbour")
    equal(deliver(store, campaign, result(2, seed=0)), [KEPT], "The smallest seed")
    equal(counts(store, campaign), Counts(10, completed=2), "Counts")


def keeps_no_number_that_is_none(store: Store) -> None:
    """NaN, infinity and what nothing can measure are never stored as measures."""
    campaign = running(store)
    beyond = 2**31
    numbers = (0.0, nan, inf, -inf, inf, nan, inf, inf, nan, inf, beyond, -1)
    named: dict[str, Any] = dict(zip(MEASURES, numbers, strict=False))
    nowhere = Measures(**named)
    partly = result(0, Outcome.COLLISION, measures=nowhere)
    wholly = result(1, measures=Measures(nan, 1.0, 1.0, 1.0), wall_s=nan)
    endless = NoiseTrajectory(floats(2, 3, 2), np.full((3, 2), np.inf, np.float32))
    huge = result(3, measures=Measures(1.0, severity=1e308, max_drac_mps2=-1e308), wall_s=1e308)
    below = result(5, measures=Measures(1.0, min_ttc_s=-0.5, max_jerk_mps3=-0.0))
    less = result(6, measures=Measures(-0.5, severity=1.0))
    given = (partly, wholly, result(2, noise=endless), huge, result(4, wall_s=-1.0), below, less)
    equal(deliver(store, campaign, *given), [KEPT] * 7, "Verdicts")
    equal(store.episodes.get(campaign.id, 0).measures, Measures(0.0), "Measures of NaN")
    equal(store.episodes.get(campaign.id, 1).measures, None, "Measures without a robustness")
    rows = store.episodes.page(campaign.id, 10).items
    equal((rows[0].severity, rows[0].min_ttc_s, rows[0].max_drac_mps2), (None,) * 3, "Row 0")
    equal((rows[1].robustness_m, rows[1].severity, rows[1].wall_s), (None, None, 0.0), "Row 1")
    equal(rows[2].log_probability, 0.0, "A log-probability that is not finite")
    equal((rows[3].severity, rows[3].max_drac_mps2, rows[3].wall_s), (None, None, 0.0), "Row 3")
    equal(rows[4].wall_s, 0.0, "A negative time")
    equal((rows[5].min_ttc_s, rows[5].max_jerk_mps3), (None, 0.0), "A negative measure")
    equal((rows[6].robustness_m, rows[6].severity), (None, None), "A negative robustness")
    equal(store.figures.totals([campaign.id])[campaign.id].severity, None, "The sum over nothing")


def knows_the_shape_of_the_noise(store: Store) -> None:
    """Noise comes back in the shape of its campaign's; what has another shape is unwanted."""
    shape = Correlated(0.75, 0.5)
    campaign = running(store, disturbance=DisturbanceModel(shape=shape))
    noise = replace(result(0).noise, shape=shape)
    given = (result(0, noise=noise), make_errored_result(1), result(2))
    equal(deliver(store, campaign, *given), [KEPT, KEPT, UNWANTED], "Verdicts on shapes")
    kept = (store.episodes.get(campaign.id, 0), *store.episodes.finished(campaign.id, [0, 1]))
    equal([each.noise.shape for each in kept], [shape] * 3, "The shapes")
    log_p = noise.log_probability
    equal([each.noise.log_probability for each in kept], [log_p, log_p, 0.0], "Their log p")
    equal(store.episodes.page(campaign.id, 1).items[0].log_probability, log_p, "log p in a list")


def knows_the_channels_of_the_noise(store: Store) -> None:
    """Noise comes back with its channels; what has another number of them is unwanted."""
    for channels in (1, 3, 5):
        campaign = running(store, **name_channels(channels))
        states = floats(1, 3, count_state(channels))
        seen = result_of(channels, 1, outcome=Outcome.COLLISION, states=states)
        lost = make_errored_result(2, noise=noise_of(2, steps=0))
        never_seen = make_errored_result(3, noise=noise_of(channels, steps=0), states=states[:0])
        given = (result_of(channels), seen, lost, never_seen)
        misfits = (
            *(result_of(other, 4) for other in (channels - 1, channels + 1)),
            result_of(channels, 4, states=floats(0, 3, len(STATE) + (channels < 3))),
        )
        equal(deliver(store, campaign, *given, *misfits), [KEPT] * 4 + [UNWANTED] * 3, "Verdicts")
        for each in (*given[:2], never_seen):
            same_result(store.episodes.get(campaign.id, each.index), each)
        found = store.episodes.get(campaign.id, 2)
        equal(found.noise.sigma.shape, (0, channels), "The shape of noise without a step")
        equal(found.digest(), lost.digest(), "The digest of an episode that never ran")
        (failures,) = store.episodes.failure_portions(campaign.id)
        (failed,) = failures.noise
        alike(failed, seen.noise.z, "The noise of a failure")


def takes_any_text(store: Store) -> None:
    """What a planner or worker says cannot keep a result from being stored."""
    campaign = running(store)
    for index, text in enumerate(("nul\x00nul", "half \ud800", "long " * 100_000, "'; DROP --")):
        delivery = Delivery(make_errored_result(index, text, source=text), text)
        equal(store.episodes.commit(campaign.id, [delivery]), [KEPT], "An odd text's verdict")
        row = store.episodes.page(campaign.id, 1, after=index - 1).items[0]
        expect(row.problem.startswith(f"planner: {text[:3]}"), f"Its problem: {row.problem!r}.")
    deliver(store, campaign, result(4, measures=Measures(0.1, cause="nul\x00nul")))
    equal(store.episodes.get(campaign.id, 4).measures, Measures(0.1, cause="nul�nul"), "A cause")
