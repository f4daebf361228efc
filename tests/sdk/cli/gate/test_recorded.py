"""A gate reports its verdict to the service, which stores and logs it."""

import json

from eigenfail.client.versions import Gates
from eigenfail.errors import Forbidden


def test_a_result_is_listed_shown_and_stored_once(gate, eigenfail, store):
    first = gate("usual", "--json")
    assert gate("usual", "--json").stdout == first.stdout
    newest, *_ = store.gates.page(10).items
    (listed, made) = json.loads(eigenfail("gate", "list", "--json").stdout)
    assert (listed["id"], listed["version"], listed["baseline"]) == (newest.id, "v2", "v1")
    assert (made["baseline"], made["version"]) == ("", "v1")
    shown = json.loads(eigenfail("gate", "show", newest.id, "--json").stdout)
    assert shown["report"] == json.loads(first.stdout)
    assert shown["conclusions"][0] in eigenfail("gate", "show", newest.id).stdout.replace("\n", " ")
    assert "trio" in eigenfail("gate", "list").stdout
    assert eigenfail("gate", "show", 99).exit_code == 2


def test_open_and_closed_gates_are_logged_with_their_results(gate, store):
    assert gate("usual").exit_code == 0
    kind, message = store.events.latest(1)[0].kind, store.events.latest(1)[0].message
    assert kind == "gate.passed"
    assert message == "Version v2 passed the gate of suite 'trio' against v1."
    assert gate("usual", "--strict").exit_code == 1
    (newest,) = store.events.latest(1)
    result = store.gates.get(newest.subject)
    assert (newest.kind, result.id) == ("gate.failed", store.gates.page(1).items[0].id)
    named = result.report.gate
    found = (named.suite, named.version, named.run, named.baseline)
    assert found == ("trio", "v2", "trio @ v2", "v1")
    assert "is closed" in result.conclusions[0]


def test_the_verdict_stands_where_the_service_does_not_take_it(gate, monkeypatch):
    def refuse(*_):
        raise Forbidden("This needs a key with scope 'runner'.", "Request such a key.")

    monkeypatch.setattr(Gates, "record", refuse)
    done = gate("usual", "--strict", "--json")
    assert done.exit_code == 1
    assert not json.loads(done.stdout)["open"]
    assert "did not record the verdict: This needs a key" in done.stderr
