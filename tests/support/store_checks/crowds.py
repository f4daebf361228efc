"""Checks of a store that many use at once."""

from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from threading import Barrier
from typing import TypeVar

import deadlines
from accepted import accept_spec

from eigenfail.errors import IllegalTransition
from eigenfail.testing import expect
from eigenfail.testing.examples import result, spec
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign import CampaignState, Counts
from eigenfail.values.operations import Event
from eigenfail.values.records import Verdict
from eigenfail_services.store.store import Store
from store_checks.examples import deliver, equal, running

CROWD = 8
EACH = 12
PATIENCE_S = deadlines.CAMPAIGN_S
"""Nobody waits as long, not even on a busy machine."""

Answer = TypeVar("Answer")


def at_once(work: Callable[[int], Answer], crowd: int = CROWD) -> list[Answer]:
    """What each of a crowd gets, all beginning together; the first error ends the check."""
    start = Barrier(crowd)

    def begin(number: int) -> Answer:
        start.wait(PATIENCE_S)
        return work(number)

    with ThreadPoolExecutor(crowd) as pool:
        return list(pool.map(begin, range(crowd)))


def winners(store: Store, campaign: int, *targets: CampaignState) -> int:
    """How many of a crowd can move a campaign to one of the targets."""

    def move(number: int) -> bool:
        with suppress(IllegalTransition):
            store.campaigns.move(campaign, targets[number % len(targets)])
            return True
        return False

    return sum(at_once(move))


def moves_have_one_winner(store: Store) -> None:
    """Of those who start, end and bury one campaign at once, one succeeds; the others hear it."""
    for _ in range(3):
        campaign = store.campaigns.create(accept_spec(spec())).id
        equal(winners(store, campaign, CampaignState.RUNNING), 1, "Who started it")
        equal(winners(store, campaign, CampaignState.DONE, CampaignState.DEAD), 1, "Who ended it")
        kinds = [event.kind for event in store.events.after(0, 1_000, campaign)]
        equal(kinds, ["campaign.created", *["campaign.state"] * 2], "What the log tells")


def one_key_makes_one_campaign(store: Store) -> None:
    """One request, sent by everybody at once, makes one campaign."""
    ids = at_once(lambda _: store.campaigns.create(accept_spec(spec()), "key").id)
    equal(len(set(ids)), 1, "Campaigns of one key")
    equal(len(store.campaigns.page(100).items), 1, "Campaigns in the store")


def one_replay_is_linked_once(store: Store) -> None:
    """One replay, linked by everybody at once, is linked once, and nobody is refused."""
    for _ in range(3):
        campaign, replay = running(store).id, running(store).id
        analysis = store.analyses.create(campaign, AnalysisSettings()).id
        at_once(partial(link, store, analysis, replay))
        equal(store.analyses.replays(analysis), (replay,), "The replays")


def link(store: Store, analysis: int, replay: int, _number: int) -> None:
    """What each of a crowd does."""
    store.analyses.link_replay(analysis, replay)


def results_are_kept_once(store: Store) -> None:
    """Everybody brings everything: each episode is kept once, the rest is counted."""
    campaign = running(store, episodes=EACH)

    def bring(number: int) -> list[Verdict]:
        order = [(number + n) % EACH for n in range(EACH)]
        halves = order[: EACH // 2], order[EACH // 2 :]
        return [v for half in halves for v in deliver(store, campaign, *map(result, half))]

    verdicts = Counter(verdict for mine in at_once(bring) for verdict in mine)
    again = (CROWD - 1) * EACH
    equal(verdicts, {Verdict.KEPT: EACH, Verdict.DUPLICATE: again}, "Verdicts")
    counts = store.campaigns.get(campaign.id).counts
    equal(counts, Counts(EACH, completed=EACH, duplicates=again), "Counts")


def counts_hold_while_everybody_writes(store: Store) -> None:
    """Results, moves, billing and billing's readers at once lose nothing of each other."""
    campaign = running(store, episodes=CROWD * EACH)

    def work(number: int) -> None:
        for n in range(EACH):
            deliver(store, campaign, result(number * EACH + n))
            store.campaigns.add_active(campaign.id, 0.5)
            counts = store.campaigns.get(campaign.id).counts
            done = len(store.episodes.page(campaign.id, 1_000).items)
            expect(counts.completed <= done, f"{counts.completed} counted, {done} there.")

    at_once(work)
    after = store.campaigns.get(campaign.id)
    equal(after.counts, Counts(CROWD * EACH, completed=CROWD * EACH), "Counts")
    equal(after.active_s, CROWD * EACH / 2, "Active time")


def jobs_go_to_one_each(store: Store) -> None:
    """Nobody gets what another has."""
    wanted = sorted(store.campaigns.create(accept_spec(spec())).id for _ in range(CROWD + 4))

    def work(number: int) -> list[int]:
        mine = []
        while (job := store.jobs.claim(f"worker-{number}", 60.0)) is not None:
            mine.append(job.subject)
            expect(store.jobs.finish(job), "A held job could not be finished.")
        return mine

    equal(sorted(job for mine in at_once(work) for job in mine), wanted, "Jobs done")


def followers_miss_nothing(store: Store) -> None:
    """Who reads on from the last id seen sees every event, in order, while others write."""
    campaign = running(store, episodes=CROWD * EACH)
    before = store.events.last()
    total = (CROWD - 1) * EACH

    def follow() -> list[Event]:
        seen: list[Event] = []
        while len(seen) < total:
            seen += store.events.after(seen[-1].id if seen else before, 5)
        return seen

    def work(number: int) -> list[Event]:
        if number == 0:
            return follow()
        for n in range(EACH):
            if n % 2:
                store.events.append("campaign.progress", f"{number}: {n}", campaign.id)
            else:
                store.campaigns.create(accept_spec(spec()))
        return []

    seen = at_once(work)[0]
    equal([e.id for e in seen], list(range(before + 1, before + total + 1)), "Events seen")
