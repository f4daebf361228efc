"""`eigenfail key`, of a service and of a database itself."""

import json

import pytest

from eigenfail.values.access import TOKEN
from eigenfail_services.access import DatabaseKeys
from eigenfail_services.store.store import open_store


@pytest.fixture
def database(tmp_path):
    """The address of a database with the schema and nothing else."""
    url = f"sqlite:///{tmp_path / 'e.db'}"
    open_store(url).close()
    return url


def test_a_service_makes_lists_and_revokes(eigenfail, monkeypatch):
    made = eigenfail("key", "create", "me", "--scope", "admin", "--expires", "90d")
    assert made.exit_code == 0, made.output
    assert "Key 1 for 'me', admin, until 2" in made.stdout
    (token,) = [line for line in made.stdout.splitlines() if TOKEN.fullmatch(line)]
    refused = eigenfail("key", "list")
    assert refused.exit_code == 2
    assert "EIGENFAIL_KEY" in refused.stderr
    monkeypatch.setenv("EIGENFAIL_KEY", token)
    second = json.loads(eigenfail("key", "create", "ci", "--scope", "runner", "--json").stdout)
    assert TOKEN.fullmatch(second["token"])
    assert eigenfail("key", "revoke", 2).exit_code == 0
    listed = eigenfail("key", "list").stdout
    assert "revoked" in listed
    assert "valid" in listed
    assert second["token"] not in listed
    audit = eigenfail("key", "audit", "--limit", 1).stdout
    assert "DELETE /api/v1/keys/{key}" in audit
    assert "POST" not in audit


def test_the_first_key_is_made_on_the_database(eigenfail, database):
    made = eigenfail("key", "create", "me", "--scope", "admin", "--database", database, "--json")
    assert made.exit_code == 0, made.output
    token = json.loads(made.stdout)["token"]
    store = open_store(database)
    record = store.keys.find(1)
    assert (record.key.name, record.key.expires_ms) == ("me", None)
    assert token not in str(record)
    store.close()
    listed = json.loads(eigenfail("key", "list", "--database", database, "--json").stdout)
    assert [key["name"] for key in listed] == ["me"]
    refused = eigenfail("key", "revoke", 1, "--database", database)
    assert (refused.exit_code, "Make another administrator's key" in refused.stderr) == (2, True)
    other = eigenfail("key", "create", "you", "--scope", "admin", "--database", database)
    assert other.exit_code == 0
    assert eigenfail("key", "revoke", 1, "--database", database).exit_code == 0
    (revoked, _, created) = json.loads(
        eigenfail("key", "audit", "--database", database, "--json").stdout
    )
    assert (created["who"], created["subject"], created["status"]) == (
        "database",
        "/api/v1/keys/1",
        201,
    )
    assert (revoked["method"], revoked["route"]) == ("DELETE", "/api/v1/keys/{key}")


def test_the_first_key_is_an_administrators(check_session, database):
    create = ("key", "create", "ci", "--scope", "runner", "--database", database)
    check_session("cli/errors/first_key", create)


def test_a_time_or_a_limit_that_is_none_is_refused(check_session):
    create = ("key", "create", "me", "--scope", "admin")
    times = ("soon", "0d", "-1d", "1.5h", "90", "d")
    limits = ("many", "-1", "1.5", "", "9" * 19)
    wrong = (*(f"--expires={each}" for each in times), *(f"--max-open={each}" for each in limits))
    check_session("cli/errors/keys", *((*create, each) for each in wrong))


def test_a_name_may_look_like_an_option(database):
    keys = DatabaseKeys(database)
    made = keys.create("--me", "admin", 3_600)
    assert TOKEN.fullmatch(made.token)
    assert [key.name for key in keys.list()] == ["--me"]


def test_quotas_are_set_changed_one_by_one_and_lifted(eigenfail, database):
    there = ("--database", database)
    assert eigenfail("key", "create", "me", "--scope", "admin", *there).exit_code == 0
    wanted = ("--max-open", 3, "--max-episodes-per-day", 1_000)
    made = eigenfail("key", "create", "ci", "--scope", "runner", *wanted, *there)
    assert made.exit_code == 0, made.output
    changed = eigenfail("key", "limit", 2, "--max-open", "none", "--max-episodes", 50, *there)
    assert changed.exit_code == 0, changed.output
    listed = json.loads(eigenfail("key", "list", "--json", *there).stdout)
    none = {"max_open": None, "max_episodes": None, "max_episodes_per_day": None}
    assert listed[0]["quotas"] == none | {"max_episodes": 50, "max_episodes_per_day": 1_000}
    assert listed[1]["quotas"] == none
    audit = json.loads(eigenfail("key", "audit", "--json", *there).stdout)
    assert (audit[0]["route"], audit[0]["subject"]) == (
        "/api/v1/keys/{key}/quotas",
        "/api/v1/keys/2",
    )


def test_a_service_limits_keys(eigenfail, monkeypatch):
    made = json.loads(eigenfail("key", "create", "me", "--scope", "admin", "--json").stdout)
    monkeypatch.setenv("EIGENFAIL_KEY", made["token"])
    assert "max_open 0" in eigenfail("key", "limit", 1, "--max-open", 0).stdout
    assert eigenfail("key", "limit", 9, "--max-open", 0).exit_code == 2
