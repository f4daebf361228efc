"""Who asks too fast is told to wait, and others do not notice."""

from contextlib import suppress

import pytest
from fastapi import HTTPException
from hypothesis import given
from hypothesis import strategies as st
from starlette.testclient import TestClient

from eigenfail_api.access.throttling import BURST_S, MOST_CALLERS, RateLimiter
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings

CAMPAIGNS = "/api/v1/campaigns"


@pytest.fixture
def app(store, clock):
    settings = ApiSettings(max_requests_per_s=2.0, max_keyless_requests_per_s=4.0)
    return create_app(store, settings, clock)


def test_who_asks_too_fast_has_to_wait(http, keys, show, clock):
    fast, other = show(keys["viewer"].token), show(keys["runner"].token)
    statuses = [http.get(CAMPAIGNS, headers=fast).status_code for _ in range(12)]
    assert statuses == [200] * 10 + [429] * 2
    refused = http.get(CAMPAIGNS, headers=fast)
    assert refused.headers["Retry-After"] == "1"
    assert "more than 2 requests per second" in refused.json()["detail"]
    assert http.get(CAMPAIGNS, headers=other).status_code == 200
    clock.pass_s(float(refused.headers["Retry-After"]))
    assert http.get(CAMPAIGNS, headers=fast).status_code == 200


def test_browsers_are_counted_by_their_key(browser, keys):
    browser.post("/login", data={"key": keys["viewer"].token})
    statuses = {browser.get("/suites").status_code for _ in range(20)}
    assert statuses == {200, 429}


def test_who_needs_no_key_is_counted_by_address(app, clock, problem):
    def asking(address):
        return TestClient(app, base_url="http://127.0.0.1", client=(address, 50_000))

    with asking("10.0.0.1") as fast, asking("10.0.0.2") as other:
        statuses = [fast.get(CAMPAIGNS).status_code for _ in range(22)]
        assert statuses == [200] * 20 + [429] * 2
        refused = fast.post(CAMPAIGNS, json={})
        assert (
            "This address sends more than 4 requests per second" in problem(refused, 429)["detail"]
        )
        assert refused.headers["Retry-After"] == "1"
        assert fast.get("/healthz").status_code == 200
        assert other.get(CAMPAIGNS).status_code == 200
        clock.pass_s(1.0)
        assert fast.get(CAMPAIGNS).status_code == 200


def test_pages_and_programs_do_not_notice_it(store):
    with TestClient(create_app(store, ApiSettings()), base_url="http://127.0.0.1") as http:
        assert {http.get(CAMPAIGNS).status_code for _ in range(500)} == {200}
    assert ApiSettings().max_keyless_requests_per_s > ApiSettings().max_requests_per_s


@given(st.lists(st.integers(-2_000, 3_000), max_size=200), st.floats(0.1, 50.0))
def test_never_more_than_the_burst_and_what_time_brings(pauses, per_s):
    pace, now_ms, granted, passed_ms = RateLimiter(per_s, "it"), 0, 0, 0
    for pause_ms in pauses:
        now_ms += pause_ms
        passed_ms += abs(pause_ms)
        with suppress(HTTPException):
            pace.take(1, now_ms)
            granted += 1
    assert granted <= max(1.0, BURST_S * per_s) + passed_ms / 1_000 * per_s + 1e-6


def test_what_is_remembered_is_bounded():
    pace = RateLimiter(1.0, "it")
    for key in range(MOST_CALLERS + 5):
        pace.take(key, 0)
    assert len(pace._buckets) == MOST_CALLERS
