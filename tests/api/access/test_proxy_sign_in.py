"""Sign-in by a reverse proxy: who is believed, and which headers name nobody."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from starlette.requests import HTTPConnection
from starlette.testclient import TestClient

from eigenfail.errors import Forbidden, InvalidValue
from eigenfail_api.access.proxy import PEER, ProxySignIn
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings

ADDRESS = "http://127.0.0.1:8440"
PROXY, BALANCER, STRANGER = "10.9.0.1", "10.9.0.7", "10.9.1.1"
SCOPES = {"staff": "viewer", "safety": "runner", "admins": "admin"}
USER = {"X-Forwarded-User": "ada@example.org", "X-Forwarded-Groups": "staff,safety"}
READ, WRITE = "/api/v1/campaigns", "/api/v1/campaigns"


def sign_in(**changes):
    """Settings with a trusted proxy, and a balancer that is believed of addresses alone."""
    plain = {
        "sign_in_proxies": (PROXY, "fd00:9::/64"),
        "sign_in_scopes": SCOPES,
        "proxies": (PROXY, BALANCER),
    }
    return ApiSettings(**plain | changes)


@pytest.fixture
def app(store, clock):
    return create_app(store, sign_in(), clock)


@pytest.fixture
def come_from(app):
    """Requests of a peer."""

    def connect(peer, **options):
        return TestClient(app, base_url=ADDRESS, client=(peer, 50_000), **options)

    return connect


@pytest.fixture
def proxy(come_from):
    return come_from(PROXY)


def test_the_user_of_a_trusted_proxy_has_the_scope_of_the_groups(proxy, fields, changes):
    assert proxy.get(READ, headers=USER).status_code == 200
    own = USER | {"Origin": ADDRESS}
    assert proxy.post(WRITE, json=fields, headers=own).status_code == 201
    refused = proxy.post("/api/v1/keys", json={"name": "x", "scope": "admin"}, headers=own)
    assert refused.status_code == 403
    assert "the user 'proxy:ada@example.org' has scope 'runner'" in refused.json()["detail"]
    lines = [(entry.who, entry.key, entry.status, entry.route) for entry in changes()]
    assert lines == [
        ("proxy:ada@example.org", None, 201, "/api/v1/campaigns"),
        ("proxy:ada@example.org", None, 403, "/api/v1/keys"),
    ]


def test_the_audit_log_has_the_address_that_the_proxy_reports(proxy, fields, changes):
    headers = USER | {"Origin": ADDRESS, "X-Forwarded-For": "192.0.2.7"}
    proxy.post(WRITE, json=fields, headers=headers)
    assert [entry.address for entry in changes()] == ["192.0.2.7"]


@pytest.mark.parametrize("peer", [f"::ffff:{PROXY}", "fd00:9::7"])
def test_networks_hold_for_both_families(come_from, peer):
    assert come_from(peer).get(READ, headers=USER).status_code == 200


@pytest.mark.fault(
    "forged header of a user: from another peer, twice, empty, or as a list",
    group="api",
    outcome="Of peers that are not a named proxy it is ignored, whatever `X-Forwarded-For` says, "
    "and a key is required. Of a named proxy, all but one name of one user is a 403.",
)
@pytest.mark.parametrize(
    "peer", [STRANGER, BALANCER, "10.9.0.2", "127.0.0.1", "fd00:9:1::1", "testclient", ""]
)
@pytest.mark.parametrize(
    "more",
    [
        {},
        {"X-Forwarded-For": PROXY},
        {"X-Forwarded-For": f"{PROXY}, {PROXY}"},
        {"X-Real-IP": PROXY},
        {"Forwarded": f"for={PROXY}"},
        {"X-Auth-Request-User": "ada"},
    ],
)
def test_of_other_peers_the_headers_are_ignored(come_from, peer, more):
    """The peer is that of the connection, whatever a header says of it."""
    client = come_from(peer)
    assert client.get(READ, headers=USER | more).status_code == 401
    visit = {**USER, **more, "Accept": "text/html"}
    page = client.get("/", headers=visit, follow_redirects=False)
    assert (page.status_code, page.headers["Location"]) == (303, "/login?next=/")


def test_a_key_still_opens_from_anywhere(come_from, keys, show):
    token = show(keys["viewer"].token)
    for peer in (PROXY, STRANGER):
        assert come_from(peer).get(READ, headers=token).status_code == 200
    # The headers of a stranger add nothing to the key.
    admin = USER | {"X-Forwarded-Groups": "admins"} | token
    assert come_from(STRANGER).get("/api/v1/keys", headers=admin).status_code == 403


@pytest.mark.fault("forged header of a user: from another peer, twice, empty, or as a list")
@pytest.mark.parametrize(
    "headers",
    [
        [("X-Forwarded-User", "mallory"), ("X-Forwarded-User", "ada")],
        [("x-forwarded-user", "mallory"), ("X-FORWARDED-USER", "ada")],
        [("X-Forwarded-User", "mallory, ada")],
        [("X-Forwarded-User", "ada,")],
        [("X-Forwarded-User", "")],
        [("X-Forwarded-User", "   ")],
        [("X-Forwarded-User", "a" * 101)],
        [("X-Forwarded-User", "ada\tmallory")],
        [("X-Forwarded-User", "<b>ada</b>")],
        [("X-Forwarded-User", "ada"), ("X-Forwarded-Groups", "admins")],
    ],
)
def test_what_does_not_name_one_user_once_is_refused(proxy, headers):
    """Such as a header of the client beside that of the proxy; the last line adds a second list."""
    given = [*headers, ("X-Forwarded-Groups", "staff")]
    answer = proxy.get(READ, headers=given)
    assert answer.status_code == 403
    assert answer.json()["type"] == "urn:eigenfail:forbidden"


@pytest.mark.parametrize("name", ["X_Forwarded_User", "X-Forwarded_User", "X-Forwarded-User-Id"])
def test_other_names_of_a_header_name_nobody(proxy, name):
    assert proxy.get(READ, headers={name: "mallory"}).status_code == 401
    answer = proxy.get(READ, headers=USER | {name: "mallory", "X_Forwarded_Groups": "admins"})
    assert answer.status_code == 200
    admin = proxy.get("/api/v1/keys", headers=USER | {"X_Forwarded_Groups": "admins"})
    assert admin.status_code == 403


@pytest.mark.parametrize(
    ("groups", "status"),
    [
        (None, 403),
        ("", 403),
        ("guests", 403),
        ("Staff", 403),
        ("admin", 403),
        ("*", 403),
        ("staff", 200),
        (" guests , staff ", 200),
        ("staff;admins", 403),
    ],
)
def test_a_user_without_a_group_of_a_scope_is_refused(proxy, groups, status):
    headers = {"X-Forwarded-User": "ada"}
    if groups is not None:
        headers["X-Forwarded-Groups"] = groups
    assert proxy.get(READ, headers=headers).status_code == status


def test_every_user_can_have_a_scope(store, clock):
    app = create_app(store, sign_in(sign_in_scopes={"*": "viewer", "admins": "admin"}), clock)
    client = TestClient(app, base_url=ADDRESS, client=(PROXY, 1))
    ada = {"X-Forwarded-User": "ada"}
    assert client.get(READ, headers=ada).status_code == 200
    assert client.get("/api/v1/keys", headers=ada).status_code == 403
    admin = ada | {"X-Forwarded-Groups": "admins"}
    assert client.get("/api/v1/keys", headers=admin).status_code == 200


@pytest.mark.parametrize(
    "origin", [None, "http://evil.example", "http://127.0.0.1:8441", "null", "http://10.9.0.1"]
)
@pytest.mark.parametrize("path", [WRITE, "/launch/form", "/logout"])
def test_no_page_of_another_site_changes_anything(proxy, store, fields, origin, path):
    """The browser sends the proxy's cookie with a forged form, too: the Origin has to be ours."""
    headers = USER if origin is None else USER | {"Origin": origin}
    assert proxy.post(path, json=fields, headers=headers).status_code == 403
    assert store.campaigns.page(10).items == ()


def test_an_authorization_of_the_proxy_is_not_taken_for_a_key(proxy, keys, show):
    """oauth2-proxy sends Basic with the name of the user; and the user is who the proxy says."""
    basic = USER | {"Authorization": "Basic YWRhOg=="}
    assert proxy.get(READ, headers=basic).status_code == 200
    admin = USER | show(keys["admin"].token)
    assert proxy.get("/api/v1/keys", headers=admin).status_code == 403


def test_pages_say_who_is_signed_in_and_leave_signing_out_to_the_proxy(proxy):
    page = proxy.get("/", headers=USER | {"Accept": "text/html"})
    assert page.status_code == 200
    assert "signed in as <b>proxy:ada@example.org</b>" in page.text
    assert "Sign out" not in page.text


def test_users_have_rates_of_their_own(store, clock):
    app = create_app(store, sign_in(max_requests_per_s=0.2), clock)
    client = TestClient(app, base_url=ADDRESS, client=(PROXY, 1))
    statuses = [client.get(READ, headers=USER).status_code for _ in range(2)]
    assert statuses == [200, 429]
    assert client.get(READ, headers=USER | {"X-Forwarded-User": "bob"}).status_code == 200


def test_without_proxies_the_headers_mean_nothing(store, clock, keys):
    app = create_app(store, ApiSettings(), clock)
    for peer in ("127.0.0.1", PROXY, ""):
        client = TestClient(app, base_url=ADDRESS, client=(peer, 1))
        assert client.get(READ, headers=USER).status_code == 401


def find_user(*values, peer=PROXY):
    """The user of a request with these values of the header, byte by byte; None if refused."""
    headers = [(b"x-forwarded-user", value) for value in values]
    headers.append((b"x-forwarded-groups", b"staff"))
    request = HTTPConnection({"type": "http", "headers": headers, PEER: peer})
    try:
        return ProxySignIn(sign_in()).find_user(request)
    except Forbidden:
        return None


@given(
    st.binary(max_size=110)
    | st.text(max_size=110).map(lambda text: text.encode("utf-8", "replace"))
)
def test_a_name_is_taken_as_it_is_or_refused(raw):
    found = find_user(raw)
    if found is None:
        return
    assert found.name == raw.decode().strip()
    assert found.name.isprintable()
    assert 0 < len(found.name) <= 100
    assert not set(found.name) & set(',;"<>')


@given(st.binary(min_size=1, max_size=20), st.binary(min_size=1, max_size=20))
def test_two_headers_never_name_a_user(one, other):
    assert find_user(one, other) is None


@pytest.mark.parametrize("name", ["ada", "Zoë Müller", "CORP\\ada", "o'hara@example.org", "a"])
def test_usual_names_are_taken(name):
    assert find_user(name.encode()).name == name
    assert find_user(name.encode("latin-1")) is None or name.isascii()


@pytest.mark.parametrize(
    "wrong",
    [
        {"sign_in_proxies": ("0.0.0.0/0",)},
        {"sign_in_proxies": ("::/0",)},
        {"sign_in_proxies": ("0.0.0.0/1", "128.0.0.0/1")},
        {"sign_in_proxies": ("10.0.0.0/7",)},
        {"sign_in_proxies": ("10.0.0.5/32", "12.0.0.0/8", "fd01::/16", "13.0.0.0/8")},
        {"sign_in_proxies": ("fd00::/15",)},
        {"sign_in_proxies": ("::/1", "8000::/1")},
        {"sign_in_scopes": {}},
        {"sign_in_groups_header": "x-forwarded-user"},
    ],
)
def test_settings_with_which_anybody_is_anybody_are_refused(store, wrong):
    with pytest.raises(InvalidValue, match="sign_in"):
        create_app(store, sign_in(**wrong))


def test_a_network_of_a_company_is_taken(store):
    networks = ("10.0.0.0/8", "10.1.0.0/16", "172.16.0.0/12", "fd01::/16", "fd01:1::/32")
    create_app(store, sign_in(sign_in_proxies=networks))


@pytest.mark.parametrize(
    "wrong",
    [
        {"sign_in_proxies": ("proxy.example",)},
        {"sign_in_proxies": ("10.9.0.1/8",)},
        {"sign_in_scopes": {"staff": "owner"}},
        {"sign_in_user_header": "X_Forwarded_User"},
        {"sign_in_user_header": ""},
    ],
)
def test_settings_of_the_wrong_form_are_refused(wrong):
    with pytest.raises(ValidationError):
        sign_in(**wrong)
