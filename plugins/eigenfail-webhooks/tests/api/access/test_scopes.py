"""The scopes of the routes, and what the audit log has of them."""

import re

import pytest

from eigenfail_api.access.authentication import is_change
from eigenfail_api.extensions import list_requests
from eigenfail_webhooks.routes import extension

ADMIN = (
    "GET /api/v1/webhooks",
    "POST /api/v1/webhooks",
    "GET /api/v1/webhooks/{webhook}",
    "DELETE /api/v1/webhooks/{webhook}",
    "POST /api/v1/webhooks/{webhook}/test",
)
"""All of them: an address may be a secret, and a message leaves the service."""

BODY = {"url": "https://hooks.example/services/T0/a-secret"}


def test_every_route_is_listed_here():
    assert sorted(list_requests(extension.routers)) == sorted(ADMIN)


@pytest.mark.parametrize("request_line", ADMIN)
def test_a_route_is_answered_to_administrators_alone(http, as_holder, request_line):
    method, path = request_line.replace("{webhook}", "1").split(" ")
    as_holder("admin", "POST", "/api/v1/webhooks", json=BODY)
    body = {"json": BODY} if path.endswith("webhooks") and method == "POST" else {}
    for verb in (method, "HEAD") if method == "GET" else (method,):
        assert http.request(verb, path, **body).status_code == 401
        for scope in ("viewer", "runner"):
            assert as_holder(scope, verb, path, **body).status_code == 403
        assert as_holder("admin", verb, path, **body).is_success


def test_the_audit_log_has_events_but_no_address_and_no_secret(as_holder, store):
    secret = as_holder("admin", "POST", "/api/v1/webhooks", json=BODY).json()["secret"]
    as_holder("admin", "POST", "/api/v1/webhooks/1/test")
    as_holder("admin", "DELETE", "/api/v1/webhooks/1")
    deleted, tested, made = store.audit.page(10).items
    assert made.details == 'events = ["campaign.ended","analysis.finished","gate.failed"]'
    assert (tested.details, deleted.details) == ("", "")
    assert (made.subject, deleted.method) == ("/api/v1/webhooks/1", "DELETE")
    for hidden in (secret, "a-secret"):
        assert hidden not in repr([made, tested, deleted])
    assert all(is_change(each.method, each.route) for each in (deleted, tested, made))


def test_the_readme_names_the_least_scopes(plugin):
    text = (plugin / "README.md").read_text()
    row = re.compile(r"^\| `(/api/\S+)` \| ([A-Z]+) \| (\w+) \|", re.MULTILINE)
    found = {(f"{verb} {address}", scope) for address, verb, scope in row.findall(text)}
    assert found == {(line, "admin") for line in ADMIN}
