"""Details of a change for the audit log: the fields that a request gave, with their values.

Only the fields listed here are recorded. A new body, or a field that may hold a secret (such as an
address with a password), leaves nothing in the audit log until it is added.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import msgspec
from starlette.types import Scope

from eigenfail.gate.report import GateReport, GateRun
from eigenfail.values.access import UNLIMITED, KeyRequest, Quotas, redact
from eigenfail.values.campaign_spec import PriorityChange
from eigenfail.values.triage import TriageChange
from eigenfail.wire.http import ModeName

RECORDED: dict[type[msgspec.Struct], tuple[str, ...]] = {
    GateReport: ("gate", "open"),
    GateRun: ("suite", "version", "baseline"),
    KeyRequest: ("name", "scope", "expires_s", "quotas"),
    ModeName: ("name",),
    PriorityChange: ("priority",),
    Quotas: ("max_open", "max_episodes", "max_episodes_per_day"),
    TriageChange: ("state", "ticket"),
}
"""Fields of a body that the audit log has; of other bodies it has none. Extensions add theirs."""

RECORDED_IN_FORMS = ("state", "ticket")
"""Fields of the form of triage on a page that the audit log has."""

LONGEST_VALUE, LONGEST_DETAILS = 120, 600
"""Most characters of a value, and of all of them together."""

_KEY = "eigenfail.details"
_CUT = "…"


def record_body(scope: Scope, body: object) -> None:
    """Keep the details of a body until the request's line of the audit log is written."""
    if type(body) in RECORDED:
        scope[_KEY] = format_details(_iterate_fields(body))


def record_form(scope: Scope, form: Mapping[str, str]) -> None:
    """Keep the details of a form in the same way; an empty field counts as given."""
    scope[_KEY] = format_details((name, form[name]) for name in RECORDED_IN_FORMS if name in form)


def read_details(scope: Scope) -> str:
    """Return the details of the request's body or form; empty without any."""
    details: str = scope.get(_KEY, "")
    return details


def format_details(fields: Iterator[tuple[str, Any]]) -> str:
    """Return fields and their values in JSON as text, cut if too long, with keys redacted."""
    # First taken out, then cut: half of a key would not be recognised.
    values = ((name, redact(msgspec.json.encode(value).decode())) for name, value in fields)
    texts = (f"{name} = {_cut(value, LONGEST_VALUE)}" for name, value in values)
    return _cut(", ".join(texts), LONGEST_DETAILS)


def _cut(text: str, longest: int) -> str:
    return text if len(text) <= longest else f"{text[: longest - 1]}{_CUT}"


def _iterate_fields(body: Any) -> Iterator[tuple[str, Any]]:
    """Yield the recorded fields, except fields that change nothing."""
    for name in RECORDED[type(body)]:
        value = getattr(body, name)
        if type(value) in RECORDED:
            yield from () if value == UNLIMITED else _iterate_fields(value)
        # A quota of null is a change: there is none any more.
        elif value not in (None, ()) or isinstance(body, Quotas):
            yield name, value
