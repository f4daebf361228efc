"""Checks of webhooks: events are queued with what they are about, and claimed by one process."""

import json
from collections.abc import Callable
from contextlib import closing
from functools import partial
from typing import Any
from unittest.mock import patch

import pytest
from msgspec.structs import replace
from store_checks.crowds import at_once
from store_checks.examples import BEYOND, equal, running
from store_checks.gates import make_report
from store_checks.modes import crashed

from eigenfail.errors import Conflict, IllegalTransition, NotFound
from eigenfail.gate.verdicts import GateVerdict
from eigenfail.testing import expect, expect_error
from eigenfail.testing.examples import analysis_result
from eigenfail.values.analysis import AnalysisSettings, AnalysisState
from eigenfail.values.campaign import CampaignState
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import Database, find_backend
from eigenfail_services.store.events import EventSubject, append_event
from eigenfail_services.store.store import Store, open_store
from eigenfail_webhooks import messages, values
from eigenfail_webhooks import outbox as outboxes
from eigenfail_webhooks.messages import queue_messages
from eigenfail_webhooks.outbox import ClaimedDelivery, DeliveryAttempt, Outbox, claim_first
from eigenfail_webhooks.store import WebhookStore
from eigenfail_webhooks.tables import deliveries

URL, SECRET = "https://hooks.example/eigenfail", "whsec_bm90IGEgc2VjcmV0IG9mIGFueWJvZHk="
LONG_S, PASSED_S = 600.0, 0.0
DELIVERED = DeliveryAttempt(values.DeliveryState.DELIVERED, 204)
GONE = DeliveryAttempt(values.DeliveryState.FAILED, 410, "It is gone.", deactivates=True)
LATER = DeliveryAttempt(values.DeliveryState.PENDING, 500, "It answered 500.", 3_600_000)
GATE = make_report(GateVerdict.NEW)


def hooks(store: Store) -> WebhookStore:
    """The webhooks of a store."""
    return WebhookStore(store.database)


def outbox(store: Store) -> Outbox:
    """The outbox of a store."""
    return Outbox(store.database)


def add(store: Store, *events: values.WebhookEvent) -> values.Webhook:
    """A webhook that is told of events, or of all of them."""
    return hooks(store).create(values.WebhookRequest(URL, events or values.EVERY_EVENT), SECRET)


def queued(store: Store, webhook: values.Webhook) -> list[values.WebhookDelivery]:
    """The last deliveries of a webhook, oldest first, once all events were read."""
    queue_messages(store, outbox(store))
    return [*hooks(store).get(webhook.id).deliveries][::-1]


def claim(store: Store, lease_s: float = LONG_S) -> ClaimedDelivery | None:
    """The next delivery that is due, once all events were read."""
    queue_messages(store, outbox(store))
    return outbox(store).claim(lease_s, now_ms())


def taken(store: Store, lease_s: float = LONG_S) -> ClaimedDelivery:
    """The same; there must be one."""
    found = claim(store, lease_s)
    if found is None:
        raise AssertionError("There was nothing to claim.")
    return found


def deliver(store: Store, webhook: values.Webhook) -> list[dict[str, Any]]:
    """Deliver all that is due, and return what a webhook got."""
    payloads = []
    while (found := claim(store)) is not None:
        expect(
            outbox(store).conclude(found, DELIVERED, now_ms()),
            "It was claimed.",
        )
        payloads += [found.payload] if found.webhook == webhook.id else []
    return [json.loads(each) for each in payloads]


def deactivate(store: Store, webhook: values.Webhook) -> None:
    """As if the receiver had answered a test event with 410 Gone."""
    hooks(store).test(webhook.id)
    expect(
        outbox(store).conclude(taken(store), GONE, now_ms()),
        "It was claimed.",
    )


def tells_of_the_end_of_a_campaign(store: Store) -> None:
    """Each end of a campaign is told once, to those who are told of such events."""
    first, second = add(store), add(store, values.WebhookEvent.CAMPAIGN_ENDED)
    others, silent = add(store, values.WebhookEvent.GATE_FAILED), add(store)
    deactivate(store, silent)
    done, stopped, dead = (running(store) for _ in range(3))
    equal(queued(store, first), [], "Deliveries before an end")
    store.campaigns.move(done.id, CampaignState.DONE)
    store.campaigns.move(stopped.id, CampaignState.CANCELLING)
    store.campaigns.move(stopped.id, CampaignState.CANCELLED)
    store.campaigns.move(stopped.id, CampaignState.CANCELLED)  # users may ask twice
    store.campaigns.move(dead.id, CampaignState.DEAD, "It broke.")
    with expect_error(IllegalTransition, "A second end."):
        store.campaigns.move(dead.id, CampaignState.DONE)
    told = deliver(store, first)
    equal([each["type"] for each in told], ["campaign.ended"] * 3, "Kinds")
    ends = [(each["data"]["campaign"], each["data"]["state"]) for each in told]
    wanted = [(done.id, "done"), (stopped.id, "cancelled"), (dead.id, "dead")]
    equal(ends, wanted, "Ends that are told")
    equal(told[2]["data"]["reason"], "It broke.", "The reason")
    same = [[each.event for each in queued(store, webhook)] for webhook in (first, second)]
    equal(same[0], same[1], "Ids of the events at two webhooks")
    equal(len({*same[0]}), 3, "Different events")
    equal(queued(store, others), [], "One that is told of other events")
    equal([each.kind for each in queued(store, silent)], ["webhook.test"], "An inactive one")


def tells_of_modes_and_gates(store: Store) -> None:
    """An analysis tells its modes; a gate that passed is logged, and told to nobody."""
    webhook, campaign = add(store), crashed(store)
    done, failed = (store.analyses.create(campaign.id, AnalysisSettings()).id for _ in range(2))
    store.analyses.start(done)
    words = ("Mode 1: It brakes late. So.", "Mode 2: It steers.")
    store.analyses.finish(done, replace(analysis_result(), words=words))
    store.analyses.finish(done, analysis_result())
    store.analyses.fail(failed, "Too few.")
    for verdict in (GateVerdict.FIXED, GateVerdict.NEW):
        store.gates.record(make_report(verdict))
    logged = [each.kind for each in store.events.latest(2)]
    equal(logged, ["gate.failed", "gate.passed"], "Kinds in the log")
    told = deliver(store, webhook)
    kinds = ["analysis.finished", "analysis.finished", "gate.failed"]
    equal([each["type"] for each in told], kinds, "Kinds")
    modes = [(mode["number"], mode["name"]) for mode in told[0]["data"]["modes"]]
    equal(modes, [(1, "It brakes late"), (2, "It steers")], "Modes that are told")
    equal((told[1]["data"]["state"], told[1]["data"]["problem"]), ("failed", "Too few."), "Failure")
    equal(told[2]["data"]["version"], "v2", "The version at the gate")


def make_changes(store: Store) -> dict[str, Callable[[], object]]:
    """A change for each kind of message, by the module of the core that makes it."""
    campaign = crashed(store)
    analysis = store.analyses.create(campaign.id, AnalysisSettings()).id
    return {
        "campaigns": partial(store.campaigns.move, campaign.id, CampaignState.DONE),
        "analyses": partial(store.analyses.finish, analysis, analysis_result()),
        "gates": partial(store.gates.record, GATE),
    }


KINDS = ["campaign.ended", "analysis.finished", "gate.failed"]


def tells_nothing_of_what_was_rolled_back(store: Store) -> None:
    """Where the change of state is rolled back, there is no message on it."""
    webhook, changes = add(store), make_changes(store)
    last = store.events.last()
    for module, change in changes.items():
        place = f"eigenfail_services.store.{module}.append_event"
        with (
            patch(place, side_effect=ZeroDivisionError),
            expect_error(ZeroDivisionError, "The log cannot be written."),
        ):
            change()
    equal(store.events.last(), last, "The last event in the log")
    equal(queued(store, webhook), [], "Deliveries")


def goes_on_where_it_broke_off(store: Store) -> None:
    """Whichever message cannot be queued, the next call queues all of them, in order and once."""
    webhook, other, changes = add(store), add(store), make_changes(store)
    for change in changes.values():
        change()
    insert = outboxes._insert_deliveries
    for failing in range(len(changes)):
        turns = iter([insert] * failing)

        def break_off(*given: Any, turns: Any = turns) -> Any:
            for turn in turns:
                return turn(*given)
            raise ZeroDivisionError

        with (
            patch.object(outboxes, "_insert_deliveries", break_off),
            expect_error(ZeroDivisionError, "The outbox cannot be written."),
        ):
            queue_messages(store, outbox(store))
        equal(hooks(store).get(webhook.id).deliveries, (), "Deliveries after a failure")
    for each in (webhook, other):
        equal([found.kind for found in queued(store, each)], KINDS, "Deliveries")
    queue_messages(store, outbox(store))
    equal(len(queued(store, webhook)), len(KINDS), "Deliveries after one more call")


def reads_events_in_batches(store: Store) -> None:
    """However many events there are between two messages, all of them are read."""
    webhook, changes = add(store), make_changes(store)
    for change in changes.values():
        for number in range(3):
            store.events.append("campaign.progress", f"Part {number}.")
        change()
    for size in (1, 2, 100):
        with patch.object(messages, "BATCH", size):
            equal([each.kind for each in queued(store, webhook)], KINDS, "Deliveries")


def tells_events_to_one_of_several_processes(store: Store) -> None:
    """Of several processes that read the same events, one queues each message."""
    webhook, changes = add(store), make_changes(store)
    for change in changes.values():
        change()
    at_once(lambda _: queue_messages(store, outbox(store)))
    equal([each.kind for each in queued(store, webhook)], KINDS, "Deliveries")


def tells_nothing_of_before(store: Store) -> None:
    """A webhook is told of events after its creation; the others of all, wherever they are read."""
    first, changes = add(store), [*make_changes(store).values()]
    changes[0]()
    second = add(store)
    changes[1]()
    equal([each.kind for each in queued(store, first)], KINDS[:2], "Deliveries to the first")
    equal([each.kind for each in queued(store, second)], KINDS[1:2], "Deliveries to the second")


def leaves_out_an_event_whose_subject_is_gone(store: Store) -> None:
    """It holds up none of the others."""
    webhook = add(store)
    with store.database.writing() as connection:
        subject = EventSubject(77, AnalysisState.FAILED)
        append_event(connection, "analysis.state", "It failed.", subject=subject)
    make_changes(store)["gates"]()
    equal([each.kind for each in queued(store, webhook)], KINDS[2:], "Deliveries")
    # It is passed once: otherwise it would be tried at each turn.
    assert outbox(store).find_place() == store.events.last()


def claims_one_at_a_time(store: Store) -> None:
    """A webhook has one delivery at a time, the oldest first; others are not held up by it."""
    slow, other = add(store), add(store)
    oldest, newer = (hooks(store).test(slow.id) for _ in range(2))
    elsewhere = hooks(store).test(other.id)
    first, second = taken(store), taken(store)
    equal([first.id, second.id], [oldest.id, elsewhere.id], "Claims")
    equal((first.url, first.secret, first.attempt), (URL, SECRET, 1), "What is claimed")
    equal(claim(store), None, "A claim while both are busy")
    expect(outbox(store).conclude(first, DELIVERED, now_ms()), "It was claimed.")
    equal(taken(store).id, newer.id, "The next one")
    listed = [
        [(each.id, each.state, each.status) for each in webhook.deliveries]
        for webhook in hooks(store).page(10).items
    ]
    waiting = values.DeliveryState.PENDING, None
    delivered = oldest.id, values.DeliveryState.DELIVERED, 204
    equal(
        listed,
        [[(elsewhere.id, *waiting)], [(newer.id, *waiting), delivered]],
        "Webhooks with their last deliveries",
    )


def delivers_again_what_was_lost(store: Store) -> None:
    """A lost claim runs out: the same event is claimed again, and the late answer is refused."""
    webhook = add(store)
    event = hooks(store).test(webhook.id).event
    lost = taken(store, PASSED_S)
    again = taken(store)
    equal((again.event, again.attempt), (event, 2), "The second claim")
    expect(
        not outbox(store).conclude(lost, DELIVERED, now_ms()),
        "The claim was lost.",
    )
    equal(queued(store, webhook)[0].state, values.DeliveryState.PENDING, "State")
    failed = DeliveryAttempt(values.DeliveryState.PENDING, 500, "It answered 500.", 5_000)
    at_ms = now_ms()
    expect(
        outbox(store).conclude(again, failed, at_ms),
        "The second claim holds.",
    )
    equal(outbox(store).claim(LONG_S, at_ms + 4_999), None, "Before it is due")
    due = outbox(store).claim(LONG_S, at_ms + 5_000)
    equal(due and (due.event, due.attempt), (event, 3), "When it is due")


def deactivates_with_the_outcome(store: Store) -> None:
    """A webhook that is gone becomes inactive with the outcome, unless the claim was lost."""
    webhook = add(store)
    hooks(store).test(webhook.id)
    hooks(store).test(webhook.id)
    lost = taken(store, PASSED_S)
    again = taken(store)
    expect(
        not outbox(store).conclude(lost, GONE, now_ms()),
        "The claim was lost.",
    )
    expect(hooks(store).get(webhook.id).active, "A lost claim deactivates nothing.")
    expect(
        outbox(store).conclude(again, GONE, now_ms()),
        "The second claim holds.",
    )
    expect(not hooks(store).get(webhook.id).active, "The webhook is gone.")
    expect(not outbox(store).has_due(now_ms()), "What is pending waits.")
    equal(claim(store), None, "A claim for an inactive webhook")


def lists_the_last_deliveries(store: Store) -> None:
    """A webhook is shown with its newest ten deliveries; nothing is due once all have ended."""
    webhook, other = add(store), add(store)
    made = [hooks(store).test(webhook.id) for _ in range(values.LAST_DELIVERIES + 2)]
    equal(queued(store, webhook), made[2:], "The last deliveries")
    equal(queued(store, other), [], "Deliveries of another one")
    equal(len(deliver(store, webhook)), len(made), "Deliveries that were made")
    equal(outbox(store).has_due(now_ms()), False, "Nothing is due")
    ended = {(each.state, each.status, each.attempts) for each in queued(store, webhook)}
    equal(ended, {(values.DeliveryState.DELIVERED, 204, 1)}, "Their outcome")


def removes_webhooks(store: Store) -> None:
    """With a webhook its secret and its deliveries go; unknown ones are not found."""
    webhook, other = add(store), add(store)
    _, kept = (hooks(store).test(each.id) for each in (webhook, other))
    equal(hooks(store).page(1).next, other.id, "Pages")
    equal(hooks(store).delete(webhook.id), webhook, "What was removed")
    equal(taken(store).id, kept.id, "What is still to be delivered")
    for unknown in (webhook.id, *BEYOND):
        with expect_error(NotFound, "No such webhook."):
            hooks(store).get(unknown)
        with expect_error(NotFound, "No such webhook."):
            hooks(store).test(unknown)
        with expect_error(NotFound, "No such webhook."):
            hooks(store).delete(unknown)


def bounds_the_number_of_webhooks(store: Store) -> None:
    """More than 50 are refused."""
    for _ in range(values.MAX_WEBHOOKS):
        add(store)
    with expect_error(Conflict, "One too many."):
        add(store)


def deletes_old_deliveries_that_ended(store: Store) -> None:
    """Ended ones beyond the bound are deleted; pending ones stay, however old they are."""
    webhook = add(store)
    waiting = hooks(store).test(webhook.id)
    expect(outbox(store).conclude(taken(store), LATER, now_ms()), "It was claimed.")
    with patch.object(outboxes, "KEPT_DELIVERIES", 2), patch.object(outboxes, "PRUNED_EVERY", 1):
        for _ in range(5):
            hooks(store).test(webhook.id)
            expect(outbox(store).conclude(taken(store), DELIVERED, now_ms()), "It was claimed.")
    kept = [each.id for each in queued(store, webhook)]
    equal(kept, [waiting.id, *(waiting.id + n for n in (4, 5))], "Deliveries that are kept")


def hands_out_each_delivery_once(store: Store) -> None:
    """Of several processes that claim at once, each delivery goes to one."""
    webhooks = [add(store) for _ in range(3)]
    for webhook in webhooks * 2:
        hooks(store).test(webhook.id)
    claimed = [found.id for found in at_once(lambda _: claim(store)) if found is not None]
    equal(len({*claimed}), len(claimed), "Deliveries that were claimed once")
    expect(len(claimed) >= len(webhooks), f"One of each webhook is claimed: {claimed}.")


CHECKS = (
    tells_of_the_end_of_a_campaign,
    tells_of_modes_and_gates,
    tells_nothing_of_what_was_rolled_back,
    goes_on_where_it_broke_off,
    reads_events_in_batches,
    tells_events_to_one_of_several_processes,
    tells_nothing_of_before,
    leaves_out_an_event_whose_subject_is_gone,
    claims_one_at_a_time,
    delivers_again_what_was_lost,
    deactivates_with_the_outcome,
    lists_the_last_deliveries,
    removes_webhooks,
    bounds_the_number_of_webhooks,
    deletes_old_deliveries_that_ended,
    hands_out_each_delivery_once,
)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_store_with_webhooks(check: Callable[[Store], None], store: Store) -> None:
    check(store)


def test_last_deliveries_are_found_by_an_index(sqlite_url: str) -> None:
    query = f"SELECT * FROM {deliveries} WHERE webhook = 1 ORDER BY id DESC LIMIT 10"
    with (
        closing(Database(find_backend(sqlite_url))) as database,
        database.reading() as connection,
    ):
        (plan,) = connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {query}").all()
    index = "ix_plugin_webhooks_deliveries_webhook"
    assert plan[3] == f"SEARCH {deliveries} USING INDEX {index} (webhook=?)"


def test_open_transactions_claim_deliveries_of_different_webhooks(
    prepared_postgres_url: str,
) -> None:
    store = open_store(prepared_postgres_url)
    webhooks = [add(store) for _ in range(2)]
    for webhook in webhooks * 2:
        hooks(store).test(webhook.id)
    at_ms, writing = now_ms() + 1, store.database.writing
    with writing() as first, writing() as second, writing() as third:
        claimed = [claim_first(each, LONG_S, at_ms) for each in (first, second)]
        assert [each and each.webhook for each in claimed] == [each.id for each in webhooks]
        assert claim_first(third, LONG_S, at_ms) is None
    with writing() as late:
        assert claim_first(late, LONG_S, at_ms) is None
    store.close()
