"""Signing in with a browser: a key is shown once, and a cookie stands for it from then on."""

import re

import pytest
from accepted import accept_spec
from starlette.testclient import TestClient

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_api.access.authentication import MOST_SESSIONS, SESSION_COOKIE, Sessions
from eigenfail_api.dashboard.keys_page import keep_own_address

OURS = {"Origin": "http://127.0.0.1:8440", "Accept": "*/*"}
CAMPAIGNS = "/api/v1/campaigns"


@pytest.fixture
def sign_in(browser, keys):
    """Signs in with the key of a scope."""

    def show(scope, wanted="/"):
        form = {"key": keys[scope].token, "next": wanted}
        return browser.post("/login", data=form, headers=OURS)

    return show


def test_pages_lead_to_the_login_and_back(browser, keys, sign_in):
    asked = browser.get("/suites?before=3")
    assert (asked.status_code, asked.headers["location"]) == (
        303,
        "/login?next=/suites%3Fbefore%3D3",
    )
    form = browser.get(asked.headers["location"])
    assert 'name="next" value="/suites?before=3"' in form.text
    done = sign_in("viewer", "/suites?before=3")
    assert (done.status_code, done.headers["location"]) == (303, "/suites?before=3")
    page = browser.get("/suites?before=3")
    assert page.status_code == 200
    assert "signed in as <b>the viewer</b>" in page.text


def test_the_cookie_is_no_key_and_for_nobody_else(browser, keys, sign_in):
    cookie = sign_in("viewer").headers["set-cookie"]
    words = {word.strip() for word in cookie.split(";")}
    assert {"HttpOnly", "SameSite=strict", "Path=/"} <= words
    assert "Secure" not in words
    assert keys["viewer"].token.split("_", 2)[2] not in cookie
    assert cookie != sign_in("viewer").headers["set-cookie"]


def test_the_session_cookie_is_secure_over_https(app, keys):
    with TestClient(app, base_url="https://127.0.0.1", follow_redirects=False) as client:
        done = client.post("/login", data={"key": keys["viewer"].token})
    assert "; Secure" in done.headers["set-cookie"]


def test_a_wrong_key_stays_at_the_form(browser, keys, clock):
    for _ in range(10):
        wrong = browser.post("/login", data={"key": "ef_1_x", "next": "/suites"}, headers=OURS)
        assert wrong.status_code == 401
        assert "Invalid key." in wrong.text
        assert 'value="/suites"' in wrong.text
        assert "set-cookie" not in wrong.headers
        assert "ef_1_x" not in wrong.text
    refused = browser.post("/login", data={"key": "ef_1_x"}, headers=OURS)
    assert (refused.status_code, refused.headers["retry-after"]) == (429, "60")
    assert browser.post("/login", content=b"\xff=1", headers=OURS).status_code == 400


@pytest.mark.parametrize(
    "wanted",
    [
        *("//evil.example", "https://evil.example/", "/\\evil.example", "\\\\evil.example"),
        *(
            "/\t/evil.example",
            "/\n/evil.example",
            "javascript:alert(1)",
            "evil.example",
            "",
            "///x",
            "//[",
        ),
    ],
)
def test_what_comes_next_is_one_of_our_own_pages(wanted, sign_in):
    assert keep_own_address(wanted) == "/"
    assert sign_in("viewer", wanted).headers["location"] == "/"


@pytest.mark.parametrize("wanted", ["/", "/suites?before=3", "/campaigns/1?next=//x"])
def test_our_own_pages_come_next(wanted):
    assert keep_own_address(wanted) == wanted


def test_whoever_signs_out_is_out(browser, sign_in):
    sign_in("viewer")
    word = browser.cookies[SESSION_COOKIE]
    assert browser.get("/suites").status_code == 200
    left = browser.post("/logout", headers=OURS)
    assert (left.status_code, left.headers["location"]) == (303, "/login")
    assert "Max-Age=0" in left.headers["set-cookie"]
    again = browser.get("/suites", headers={"Cookie": f"{SESSION_COOKIE}={word}"})
    assert again.status_code == 303


def test_a_session_ends_with_its_time_or_its_key(browser, sign_in, store, keys, clock):
    sign_in("viewer")
    clock.pass_s(12 * 3_600 - 1)
    assert browser.get("/suites").status_code == 200
    clock.pass_s(1)
    assert browser.get("/suites").status_code == 303
    sign_in("viewer")
    assert browser.get("/suites").status_code == 200
    store.keys.revoke(keys["viewer"].key.id)
    assert browser.get("/suites").status_code == 303


def test_pages_of_others_cannot_use_the_cookie(browser, sign_in, fields, problem, store):
    sign_in("runner")
    for origin in ("https://evil.example", "null", "http://127.0.0.1:3000"):
        forged = browser.post(CAMPAIGNS, json=fields, headers={"Origin": origin})
        problem(forged, 403)
        assert browser.post("/logout", headers={"Origin": origin}).status_code == 403
        assert (
            browser.post("/login", data={"key": "x"}, headers={"Origin": origin}).status_code == 403
        )
    silent = problem(browser.post(CAMPAIGNS, json=fields), 403)
    assert "state its origin" in silent["detail"]
    assert not store.campaigns.page(10).items
    assert browser.post(CAMPAIGNS, json=fields, headers=OURS).status_code == 201


def test_a_cookie_opens_what_its_key_does(browser, sign_in, fields, problem, changes):
    sign_in("viewer")
    problem(browser.post(CAMPAIGNS, json=fields, headers=OURS), 403)
    assert browser.get(CAMPAIGNS, headers=OURS).status_code == 200
    told = [(each.who, each.route, each.status) for each in changes()]
    assert told == [("the viewer", "/login", 303), ("the viewer", CAMPAIGNS, 403)]


def test_pieces_of_pages_and_programs_are_not_sent_to_a_form(browser, keys):
    assert browser.get("/suites", headers={"HX-Request": "true"}).status_code == 401
    assert browser.get(CAMPAIGNS).headers["content-type"] == "application/problem+json"
    assert browser.get("/suites", headers={"Accept": "*/*"}).status_code == 401


def test_where_nobody_needs_a_key_the_form_says_so(browser):
    assert "Authentication is off." in browser.get("/login?next=/suites").text
    assert "signed in as" not in browser.get("/").text


def test_the_oldest_session_makes_room():
    sessions = Sessions()
    first, *others = (sessions.open(key, 0) for key in range(MOST_SESSIONS + 1))
    assert sessions.key_of(first, 0) is None
    assert sessions.key_of(others[0], 0) == 1


SPEC = {"name": "a", "method": "monte_carlo", "episodes": 3, "planner": "idm", "seed": 1}
BUTTONS = re.compile(r"<form[^>]* data-api.*?(<button.*?>)", re.DOTALL)
LAUNCH = re.compile(r'<button[^>]*value="launch".*?>')


@pytest.mark.parametrize(("scope", "reads_only"), [("viewer", True), ("runner", False)])
def test_what_is_not_theirs_to_press_says_so(store, browser, sign_in, scope, reads_only):
    campaign = store.campaigns.create(accept_spec(CampaignSpec(**SPEC))).id
    sign_in(scope)
    page, form = browser.get(f"/campaigns/{campaign}").text, browser.get("/launch").text
    buttons = BUTTONS.findall(page) + LAUNCH.findall(form)
    assert len(buttons) >= 3  # pause, cancel, launch
    assert {" disabled title=" in button for button in buttons} == {reads_only}
    assert ("</b>, read only" in page) is reads_only
