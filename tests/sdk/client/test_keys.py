"""Keys, as a client shows, makes and revokes them."""

import logging
import traceback

import httpx2
import pytest
from starlette.testclient import TestClient

from eigenfail import errors
from eigenfail.client import Client
from eigenfail.values.access import KeyRequest, Quotas, Scope, Usage
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.access import make_key

TOKEN = f"ef_1_{'s' * 43}"


@pytest.fixture
def locked(store):
    """The way to a service that asks for keys, and the token of its administrator."""
    token = make_key(store, KeyRequest("me", Scope.ADMIN)).token
    with TestClient(create_app(store, ApiSettings())) as served:
        yield served._transport, token


def test_a_client_shows_its_key(locked, fields):
    transport, token = locked
    with Client(transport=transport, key=token) as client:
        assert client.campaigns.create(**fields).id == 1


def test_a_client_takes_the_key_of_its_surroundings(locked, monkeypatch):
    transport, token = locked
    monkeypatch.setenv("EIGENFAIL_KEY", f" {token}\n")
    with Client(transport=transport) as client:
        assert client.campaigns.list().first() == ()
    with Client(transport=transport, key="") as client, pytest.raises(errors.Unauthorized):
        client.campaigns.list().first()


def test_without_a_key_one_is_told_what_to_do(locked):
    transport, _ = locked
    with Client(transport=transport) as client:
        assert client.health()
        with pytest.raises(errors.Unauthorized) as caught:
            client.campaigns.get(1)
    assert "EIGENFAIL_KEY" in caught.value.remedy
    assert caught.value.exit_code == 2


def test_a_key_that_allows_too_little_names_what_is_missing(locked, fields):
    transport, token = locked
    with Client(transport=transport, key=token) as client:
        viewer = client.keys.create("dashboards", "viewer", 3_600)
    with Client(transport=transport, key=viewer.token) as client:
        with pytest.raises(errors.Forbidden, match="'runner'"):
            client.campaigns.create(**fields)
        with pytest.raises(errors.Forbidden, match="'admin'"):
            client.keys.list().first()


def test_keys_are_made_listed_and_revoked(locked):
    transport, token = locked
    with Client(transport=transport, key=token) as client:
        made = client.keys.create("nightly", Scope.RUNNER)
        assert [key.name for key in client.keys.list()] == ["nightly", "me"]
        assert client.keys.revoke(made.key.id).revoked_ms
        with pytest.raises(errors.NotFound):
            client.keys.revoke(99)
        with pytest.raises(errors.InvalidValue, match="scope"):
            client.keys.create("x", "root")
        told = [(each.who, each.method, each.status) for each in client.keys.audit()]
    assert told == [("me", "DELETE", 404), ("me", "DELETE", 200), ("me", "POST", 201)]


@pytest.mark.parametrize(
    "wrong", ["secret", "ef_1_short", f"{TOKEN}\nX: y", f"{TOKEN} "[:-2], "ß" * 48]
)
def test_what_is_no_key_is_refused_unsaid(wrong):
    with pytest.raises(errors.InvalidValue) as caught:
        Client(key=wrong)
    assert caught.value.field == "key"
    assert wrong not in str(caught.value)


def test_a_key_is_in_no_text(caplog):
    caplog.set_level(logging.DEBUG)

    def answer(request):
        assert request.headers["authorization"] == f"Bearer {TOKEN}"
        raise httpx2.ConnectError("refused")

    client = Client("http://127.0.0.1:9", httpx2.MockTransport(answer), TOKEN)
    with pytest.raises(errors.ServiceUnreachable) as caught:
        client.keys.revoke(1)
    told = "".join(traceback.format_exception(caught.value))
    assert "No eigenfail service answers" in told
    secret = TOKEN.removeprefix("ef_1_")
    assert secret not in f"{told}{client!r}{vars(client)}{vars(client._link)}{caplog.text}"


def test_quotas_are_set_seen_and_kept_to(locked, fields):
    transport, token = locked
    with Client(transport=transport, key=token) as admin:
        made = admin.keys.create("ci", "runner", quotas=Quotas(max_open=1))
        with Client(transport=transport, key=made.token) as client:
            client.campaigns.create(**fields)
            with pytest.raises(errors.QuotaExceeded, match="max_open"):
                client.campaigns.create(**fields)
        number = made.key.id
        assert admin.keys.usage(number) == Usage(1, admin.campaigns.get(1).counts.planned)
        assert (
            admin.keys.limit(number, Quotas()).quotas == admin.keys.get(number).quotas == Quotas()
        )
