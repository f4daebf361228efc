"""Somebody sets the wall clock by an hour: keys and sessions end by it, and nothing else does."""

from types import SimpleNamespace

import pytest

from eigenfail.values.access import KeyRequest, Scope
from eigenfail_services.access import make_key
from eigenfail_services.store import clock as clocks

HOUR_S = 3_600
CAMPAIGNS = "/api/v1/campaigns"
OURS = {"Origin": "http://127.0.0.1:8440", "Accept": "*/*"}
JUMPS_S = [HOUR_S, -HOUR_S]


@pytest.fixture(autouse=True)
def set_wall(clock, monkeypatch):
    """The store and the API read the same wall clock, which the test sets."""
    told = SimpleNamespace(time_ns=lambda: clock.at_ms * 1_000_000, monotonic_ns=lambda: 0)
    monkeypatch.setattr(clocks, "time", told)


@pytest.fixture
def ending(store, keys):
    """Keys that end in half an hour, in two hours."""
    requests = (KeyRequest(f"{s}", Scope.VIEWER, s) for s in (HOUR_S // 2, 2 * HOUR_S))
    return [make_key(store, request).token for request in requests]


@pytest.mark.fault("wall clock that jumps")
@pytest.mark.parametrize("jump_s", JUMPS_S)
def test_keys_end_by_the_clock_as_it_is_set(*, http, ending, keys, show, clock, jump_s) -> None:
    def statuses() -> list[int]:
        tokens = [*ending, keys["viewer"].token]
        return [http.get(CAMPAIGNS, headers=show(token)).status_code for token in tokens]

    assert statuses() == [200, 200, 200]
    clock.pass_s(jump_s)
    assert statuses() == [401 if jump_s > 0 else 200, 200, 200]
    clock.pass_s(-jump_s)
    assert statuses() == [200, 200, 200]


@pytest.mark.fault("wall clock that jumps")
@pytest.mark.parametrize("jump_s", JUMPS_S)
def test_a_session_stays_and_ends_by_the_clock(browser, keys, clock, jump_s) -> None:
    browser.post("/login", data={"key": keys["viewer"].token, "next": "/"}, headers=OURS)
    clock.pass_s(jump_s)
    assert browser.get("/suites").status_code == 200
    clock.pass_s(12 * HOUR_S - jump_s)
    assert browser.get("/suites").status_code == 303


@pytest.mark.fault("wall clock that jumps")
def test_who_showed_wrong_keys_waits_no_longer_than_a_minute(http, keys, show, clock) -> None:
    wrong = show("ef_1_wrong")
    statuses = [http.get(CAMPAIGNS, headers=wrong).status_code for _ in range(11)]
    assert statuses == [401] * 10 + [429]
    clock.pass_s(-HOUR_S)
    assert http.get(CAMPAIGNS, headers=wrong).status_code == 401


@pytest.mark.fault("wall clock that jumps")
@pytest.mark.parametrize("jump_s", JUMPS_S)
def test_a_request_that_is_repeated_makes_one_campaign_and_lists_keep_their_order(
    *, http, as_holder, keys, show, fields, clock, jump_s
) -> None:
    def create(key: str) -> int:
        named = {**show(keys["runner"].token), "Idempotency-Key": key}
        return http.post(CAMPAIGNS, json={**fields, "name": key}, headers=named).json()["id"]

    first = create("a")
    clock.pass_s(jump_s)
    assert create("a") == first
    second = create("b")
    clock.pass_s(-jump_s)
    third = create("c")
    listed = as_holder("viewer", "GET", CAMPAIGNS).json()["items"]
    assert [campaign["id"] for campaign in listed] == [third, second, first]
    told = as_holder("admin", "GET", "/api/v1/audit").json()["items"]
    assert [line["id"] for line in told] == sorted((line["id"] for line in told), reverse=True)
