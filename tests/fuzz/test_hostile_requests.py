"""Some hostile requests to a real service; hostile_requests.py sends many more."""

from http import HTTPStatus

import pytest
from hostile_requests import MOST_GROWN_MIB, Sweep, faults_in, is_wrong, sweep

SEED = 20261122
FEW = 400


@pytest.mark.service
@pytest.mark.fault(
    "hostile requests to every route",
    group="api",
    outcome="Each is answered with less than 500, or hung up on; no traceback, no lasting memory.",
)
def test_hostile_requests_are_refused_and_nothing_breaks() -> None:
    found = sweep(FEW, SEED)
    assert found.complaints() == []
    assert found.statuses.total() >= FEW
    assert {HTTPStatus.OK, HTTPStatus.BAD_REQUEST, HTTPStatus.NOT_FOUND} <= found.statuses.keys()


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"wrong": ["500 at GET /"]}, "500"),
        ({"log": "a\nTraceback (most recent call last):\nb"}, "traceback"),
        ({"grown_mib": 2 * MOST_GROWN_MIB}, "Memory"),
        ({"answers": False}, "not answer"),
    ],
)
def test_what_must_not_be_is_complained_of(fields, said) -> None:
    (complaint,) = Sweep(**{"answers": True} | fields).complaints()
    assert said in complaint


def test_a_busy_service_may_say_so() -> None:
    assert not is_wrong(503, "1")
    assert is_wrong(503, "")
    assert is_wrong(500, "1")


def test_a_fault_that_nobody_waited_for_is_counted() -> None:
    series = 'eigenfail_http_requests_total{method="GET",route="/",status="%d"} 1.0'
    metrics = "\n".join(series % status for status in (200, 499, 500, 503))
    assert faults_in(metrics) == [f"Counted: {series % 500}"]
