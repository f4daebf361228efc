"""Two campaigns side by side, over HTTP."""

import pytest

from eigenfail.values.comparison import Comparison
from eigenfail.values.episode import Outcome

URL = "/api/v1/comparisons"


@pytest.fixture
def pair(http, fields, deliver, result):
    """Two campaigns that saw the same noise; the second failed twice as often."""
    ids = [http.post("/api/v1/campaigns", json=fields).json()["id"] for _ in range(2)]
    for campaign, crashes in zip(ids, ((1, 2), (1, 3, 4, 5)), strict=True):
        made = (result(i, Outcome.COLLISION if i in crashes else Outcome.SAFE) for i in range(10))
        deliver(campaign, *made)
    return ids


def test_two_campaigns_are_compared(http, pair, read, store):
    a, b = pair
    found = read(http.get(URL, params={"a": a, "b": b}), Comparison)
    assert (found.a.failures, found.b.failures) == (2, 4)
    assert found.difference.value == pytest.approx(0.2)
    assert (found.pairs.n, found.pairs.only_a, found.pairs.only_b) == (10, 1, 3)
    assert f"Campaign {a} is running" in " ".join(found.warnings)


def test_a_side_may_have_several_seeds(http, fields, pair, read, store):
    a, b = pair
    more = http.post("/api/v1/campaigns", json={**fields, "seed": 1}).json()["id"]
    found = read(http.get(URL, params={"a": f"{a},{more}", "b": str(b)}), Comparison)
    assert found.a.campaigns == (a, more)
    assert found.a.rates == (0.2, None)
    assert found.unpaired_because == "their seeds differ."


@pytest.mark.parametrize("ids", ["", "x", "1,", ",1", "1,,2", "0", "-1", "1;2", "9" * 30])
@pytest.mark.parametrize("side", ["a", "b"])
def test_ids_are_numbers_with_commas(http, problem, ids, side):
    told = problem(http.get(URL, params={"a": 1, "b": 2} | {side: ids}), 422)
    assert told["field"] == side


def test_both_sides_must_be_named_once(http, problem, pair):
    assert problem(http.get(URL, params={"a": pair[0]}), 422)["field"] == "b"
    told = problem(http.get(URL, params={"a": pair[0], "b": f"{pair[0]},{pair[1]}"}), 422)
    assert "listed twice" in told["detail"]
    problem(http.get(URL, params={"a": pair[0], "b": 99}), 404)
