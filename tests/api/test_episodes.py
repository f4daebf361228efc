"""Episodes over HTTP: a list without trajectories, one with all of them."""

import numpy as np
import pytest
from msgspec.structs import replace

from eigenfail.values.episode import Outcome
from eigenfail.values.measures import Measures

URL = "/api/v1/campaigns"


@pytest.fixture
def filled(campaign, deliver, result, failed):
    """A campaign with five safe episodes, two collisions and one that could not be run."""
    safe = [result(i) for i in range(5)]
    collisions = [result(i, Outcome.COLLISION) for i in (5, 6)]
    deliver(campaign, *safe, *collisions, failed(7))
    return campaign


def test_the_cursor_of_index_0_is_a_cursor(http, filled):
    rest = http.get(f"{URL}/{filled}/episodes", params={"after": 0}).json()
    assert [row["index"] for row in rest["items"]] == list(range(1, 8))


def test_an_episode_carries_noise_and_scene_to_the_last_bit(http, filled, result):
    body = http.get(f"{URL}/{filled}/episodes/5").json()
    told = result(5, Outcome.COLLISION)
    assert np.array_equal(np.asarray(body["noise"]["z"], np.float32), told.noise.z)
    assert np.array_equal(np.asarray(body["scene"]["vehicles"], np.float32), told.scene.vehicles)
    assert body["measures"]["severity"] == 25.0


def test_an_episode_without_a_scene_says_so(http, filled):
    assert http.get(f"{URL}/{filled}/episodes/0").json()["scene"] is None


def test_an_episode_to_come_is_not_found(http, filled, problem):
    problem(http.get(f"{URL}/{filled}/episodes/8"), 404)


def test_the_worst_come_first(http, campaign, deliver, result):
    rows = [result(i, Outcome.COLLISION) for i in range(4)]
    severities = [4.0, 25.0, 9.0, 25.0]
    worst = [
        replace(row, measures=replace(row.measures, severity=severity))
        for row, severity in zip(rows, severities, strict=True)
    ]
    deliver(campaign, *worst, result(4))
    asked = {"sort": "-severity", "limit": 2}
    first = http.get(f"{URL}/{campaign}/episodes", params=asked).json()
    second = http.get(f"{URL}/{campaign}/episodes", params={**asked, "after": first["next"]}).json()
    assert [row["index"] for row in first["items"] + second["items"]] == [3, 1, 2, 0]
    rest = http.get(f"{URL}/{campaign}/episodes", params={**asked, "after": second["next"]}).json()
    assert [row["index"] for row in rest["items"]] == [4]
    assert rest["next"] is None


CRASH = Measures(
    0.0,
    severity=25.0,
    min_ttc_s=0.1,
    ttc_violated_s=1.5,
    drac_violated_s=3.25,
    drac_at_warning_mps2=6.5,
    collided_s=3.5,
)


def test_an_episode_is_told_with_its_class_and_lead_times(http, campaign, deliver, result):
    deliver(campaign, replace(result(0, Outcome.COLLISION), measures=CRASH))
    leads = {"ttc_lead_s": 2.0, "drac_lead_s": 0.25}
    wanted = {"conflict": "planner_failure", "unresolved": False, **leads}
    one = http.get(f"{URL}/{campaign}/episodes/0").json()
    (row,) = http.get(f"{URL}/{campaign}/episodes").json()["items"]
    assert one["assessed"] == row["assessed"] == wanted
    assert one["measures"]["ttc_violated_s"] == row["ttc_violated_s"] == 1.5
    summary = http.get(f"{URL}/{campaign}/summary").json()
    assert summary["conflicts"]["planner_failures"] == 1
    assert summary["conflicts"]["ttc_lead"] == {"mean_s": 2.0, "n": 1}


def test_a_filter_and_an_outcome_hold_together(http, filled):
    asked = {"filter": "index != 5 and severity > 20", "outcome": "collision", "sort": "-index"}
    rows = http.get(f"{URL}/{filled}/episodes", params=asked).json()["items"]
    assert [row["index"] for row in rows] == [6]


def test_a_total_counts_what_matches_on_all_pages_where_it_is_asked_for(http, filled):
    asked = {"filter": "index >= 5", "limit": 1}
    without = http.get(f"{URL}/{filled}/episodes", params=asked).json()
    assert set(without) == {"items", "next"}
    for fields in ({}, {"fields": "index"}):
        page = http.get(
            f"{URL}/{filled}/episodes", params={**asked, **fields, "total": "true"}
        ).json()
        assert (len(page["items"]), page["total"]) == (1, 3)
    every = http.get(f"{URL}/{filled}/episodes", params={"total": "true"}).json()
    assert every["total"] == len(every["items"])


def test_an_index_is_not_a_file(http, filled, problem):
    problem(http.get(f"{URL}/{filled}/episodes.xls"), 404)
