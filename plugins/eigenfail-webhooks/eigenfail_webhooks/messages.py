"""Messages to webhooks on events of the core's log.

The log is read from the place that the webhooks have reached. Its ids appear in order and without
gaps, and the place moves in the transaction that queues the messages. Hence no event is left out or
queued twice, even if a process is killed.
"""

from collections.abc import Callable, Mapping
from itertools import islice
from typing import Any

import msgspec
import structlog

from eigenfail.errors import NotFound
from eigenfail.gate.report import list_conclusions
from eigenfail.values.analysis import AnalysisState
from eigenfail.values.campaign import FINAL_STATES
from eigenfail.values.operations import Event
from eigenfail_services.store.store import Store
from eigenfail_webhooks.outbox import EventMessage, Outbox
from eigenfail_webhooks.values import WebhookEvent

BATCH = 200
"""Events that are read at a time. Fewer without a message are read again: that costs less than a
transaction for each of them."""

MOST_SENTENCES, LONGEST_SENTENCE = 20, 500
"""Most conclusions of a gate in a message, and most characters of each."""

log = structlog.get_logger()


def queue_messages(store: Store, outbox: Outbox) -> None:
    """Queue messages on all events that webhooks have not had.

    Raises:
        StoreUnavailable: the database does not answer.
    """
    while (place := outbox.find_place()) is not None:
        events = store.events.after(place, BATCH)
        wanted = [event for event in events if (event.kind, event.state) in MAKERS]
        messages = [found for event in wanted if (found := _make_message(store, event)) is not None]
        # An event without a message that is due is passed, too: it would be tried for ever.
        if wanted or len(events) == BATCH:
            outbox.queue(messages, events[-1].id)
        if len(events) < BATCH:
            return


def _make_message(store: Store, event: Event) -> EventMessage | None:
    """Return the message on an event of a kind that has one; None if it cannot be made."""
    kind, describe = MAKERS[event.kind, event.state]
    try:
        return EventMessage(event.id, event.at_ms, kind, describe(store, event))
    except (NotFound, msgspec.MsgspecError, ValueError):
        # Rows that were damaged or deleted by hand must not hold up all messages after this one.
        log.exception("no message on an event", event_id=event.id, kind=event.kind)
        return None


def _describe_campaign(store: Store, event: Event) -> dict[str, Any]:
    campaign = store.campaigns.get(event.campaign or 0)
    spec, counts = campaign.spec, campaign.counts
    return {
        "campaign": campaign.id,
        "name": spec.name,
        "state": campaign.state.value,
        "method": spec.method,
        "planner": spec.planner,
        "planned": counts.planned,
        "completed": counts.completed,
        "failures": counts.failures,
        "errored": counts.errored,
        "cancelled": counts.cancelled,
        "reason": campaign.stopped_because,
    }


def _describe_analysis(store: Store, event: Event) -> dict[str, Any]:
    analysis = store.analyses.get(event.subject or 0)
    found = () if analysis.result is None else analysis.result.list_modes(analysis.id)
    return {
        "analysis": analysis.id,
        "campaign": analysis.campaign,
        "state": analysis.state.value,
        "problem": analysis.problem,
        "modes": [
            {"number": mode.number, "name": mode.name, "failures": mode.failures} for mode in found
        ],
    }


def _describe_gate(store: Store, event: Event) -> dict[str, Any]:
    result = store.gates.get(event.subject or 0)
    gate = result.report.gate
    sentences = islice(list_conclusions(result.report), MOST_SENTENCES)
    return {
        "gate": result.id,
        "suite": gate.suite,
        "version": gate.version,
        "run": gate.run,
        "baseline": gate.baseline,
        "conclusions": [each[:LONGEST_SENTENCE] for each in sentences],
    }


Maker = tuple[WebhookEvent, Callable[[Store, Event], dict[str, Any]]]

MAKERS: Mapping[tuple[str, str], Maker] = {
    **{
        ("campaign.state", state.value): (WebhookEvent.CAMPAIGN_ENDED, _describe_campaign)
        for state in FINAL_STATES
    },
    **{
        ("analysis.state", state.value): (WebhookEvent.ANALYSIS_FINISHED, _describe_analysis)
        for state in (AnalysisState.DONE, AnalysisState.FAILED)
    },
    ("gate.failed", ""): (WebhookEvent.GATE_FAILED, _describe_gate),
}
"""The messages by kind and state of an event."""
