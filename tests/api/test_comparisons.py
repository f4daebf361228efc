"""Two campaigns side by side, over HTTP."""

import pytest

URL = "/api/v1/comparisons"


@pytest.mark.parametrize("ids", ["", "x", "1,", ",1", "1,,2", "0", "-1", "1;2", "9" * 30])
@pytest.mark.parametrize("side", ["a", "b"])
def test_ids_are_numbers_with_commas(http, problem, ids, side):
    told = problem(http.get(URL, params={"a": 1, "b": 2} | {side: ids}), 422)
    assert told["field"] == side


def test_both_sides_must_be_named_once(http, problem, campaign):
    assert problem(http.get(URL, params={"a": campaign}), 422)["field"] == "b"
    told = problem(http.get(URL, params={"a": campaign, "b": f"{campaign},99"}), 422)
    assert "listed twice" in told["detail"]
    problem(http.get(URL, params={"a": campaign, "b": 99}), 404)
