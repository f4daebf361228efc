"""What is said of workers that were asked for: what lasts, once, and its end."""

from eigenfail_services.campaigns.ray_launcher import (
    ASKED,
    MACHINES,
    REFUSED,
    UNPLACED_AFTER_S,
    PlacementNotices,
)
from eigenfail_services.campaigns.ray_link import ClusterStatus


def said(placement: PlacementNotices, now_s: float, **standing) -> list[tuple[str, str]]:
    notices = placement.note(now_s, ClusterStatus(**{"machines": 1} | standing))
    return [(notice.kind, notice.message) for notice in notices]


def test_a_moment_without_a_place_is_not_worth_a_word() -> None:
    placement = PlacementNotices()
    assert said(placement, 0.0, unplaced=("a", "b")) == []
    assert said(placement, UNPLACED_AFTER_S - 0.1, unplaced=("b",), placed=("a",)) == []
    assert said(placement, UNPLACED_AFTER_S, placed=("a", "b")) == []
    assert said(placement, 2 * UNPLACED_AFTER_S, placed=("a", "b"), unplaced=("c",)) == []


def test_what_lasts_is_said_once_and_so_is_its_change_and_its_end() -> None:
    placement = PlacementNotices()
    said(placement, 0.0, unplaced=("a", "b"))
    assert said(placement, 5.0, unplaced=("a", "b")) == [
        (ASKED, "2 workers asked of Ray, none placed yet.")
    ]
    assert said(placement, 60.0, unplaced=("a", "b")) == []
    assert said(placement, 61.0, unplaced=("a",), placed=("b",)) == [
        (ASKED, "2 workers asked of Ray, 1 placed so far.")
    ]
    assert said(placement, 62.0, placed=("a", "b")) == [
        (ASKED, "2 workers asked of Ray, all placed.")
    ]
    assert said(placement, 63.0, placed=("a",)) == []


def test_who_gives_up_is_named_with_the_reason_once() -> None:
    placement = PlacementNotices()
    refused = {"w.1": "The hub rejects the key of this worker."}
    words = "Worker w.1 gave up: The hub rejects the key of this worker."
    assert said(placement, 0.0, refused=refused) == [(REFUSED, words)]
    assert said(placement, 1.0, refused=refused) == []


def test_a_machine_less_is_said_and_one_more_is_not() -> None:
    placement = PlacementNotices()
    assert said(placement, 0.0, machines=3) == []
    words = "Ray's cluster has become smaller: 3 machines before, 2 now."
    assert said(placement, 1.0, machines=2) == [(MACHINES, words)]
    assert said(placement, 2.0, machines=3) == []
