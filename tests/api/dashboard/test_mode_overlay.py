"""The failures of a mode over each other: what the player gets, and the table beside it."""

import json
import re
from html import unescape

import numpy as np
import pytest
from msgspec.structs import replace
from store_checks.examples import analyse_function

from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.episode import Outcome
from eigenfail.values.scene import Scene
from eigenfail_api.dashboard import mode_page
from eigenfail_services.campaigns.recordings import OverlayBounds

STEPS = 10


def drive(steps, ahead_m, speed_mps=10.0):
    """An ego that drives up to a standing vehicle and touches it in the last moment."""
    time_s = 0.1 * np.arange(steps + 1)
    ego = np.stack([speed_mps * time_s, 0 * time_s, 0 * time_s, 0 * time_s + speed_mps], axis=1)
    other = np.tile([ego[-1, 0] + 4.0 + ahead_m, 0.0, 0.0, 0.0], (steps + 1, 1))
    far = np.tile([ego[-1, 0] + 90.0, 3.5, 0.0, 0.0], (steps + 1, 1))
    far[0] = np.nan
    return Scene(
        dt_s=0.1,
        vehicles=np.stack([ego, far, other], axis=1).astype(np.float32),
        sizes=np.full((3, 2), (4.0, 2.0), np.float32),
        perceived=np.zeros((steps, 2), np.float32),
        controls=np.zeros((steps, 2), np.float32),
    )


@pytest.fixture
def overlaid(store, campaign, deliver, result, finished):
    """Makes an analysis whose only mode has failures with these scenes, the last one its medoid."""

    def make(*scenes):
        crashes = [
            replace(result(index, Outcome.COLLISION), scene=scene)
            for index, scene in enumerate(scenes)
        ]
        deliver(campaign, *crashes)
        count = len(scenes)
        done = store.analyses.get(finished(1)).result
        analysis = store.analyses.create(campaign, AnalysisSettings()).id
        store.analyses.start(analysis)
        mode = replace(done.modes[0], failures=count, medoid=count - 1)
        whole = replace(
            done,
            episodes=tuple(range(count)),
            labels=(0,) * count,
            scores=np.ones((count, 1), np.float32),
            modes=(mode,),
        )
        store.analyses.finish(analysis, whole)
        return f"/analyses/{analysis}/modes/1"

    return make


def read_values(page):
    return json.loads(unescape(re.search(r'data-values="([^"]*)"', page)[1]))


def test_the_player_gets_the_course_of_every_failure_the_medoid_first(http, overlaid):
    page = http.get(f"{overlaid(drive(STEPS, 0.0), drive(STEPS + 2, 3.0))}/overlay").text
    values = read_values(page)
    medoid, other = values["failures"]
    assert (values["dt"], values["last"]) == (pytest.approx(0.1), STEPS + 2)
    assert [each["last"] for each in (medoid, other)] == [STEPS + 2, STEPS]
    assert [each["episode"].rpartition("/")[2] for each in (medoid, other)] == ["1", "0"]
    assert [each["struck"] for each in (medoid, other)] == [2, 2]
    assert [each["apart"][-1] for each in (medoid, other)] == [3.0, 0.0]
    assert other["tracks"][0][3 * STEPS :] == [10.0, 0.0, 0.0]
    # A vehicle that is not there yet has no pose.
    assert other["tracks"][1][:4] == [None, None, None, 100.0]
    assert "All 2 failures" in page
    assert "The medoid is opaque" in page
    assert "ego of the medoid; translucent" in page
    assert "The medoid is not drawn" not in page


def test_the_table_tells_the_same_by_time_before_the_end(http, overlaid, text_of):
    page = http.get(f"{overlaid(drive(5, 0.0, 20.0), drive(10, 2.0))}/overlay")
    rows = re.findall(r"<tr>(<td>.*?)</tr>", page.text)
    cells = [re.findall(r"<td>(.*?)</td>", row) for row in rows]
    assert [row[:5] for row in cells] == [
        ["1.00", "1", "10.0", "10.0", "10.0"],
        ["0.500", "2", "15.0", "10.0", "20.0"],
        ["0", "2", "15.0", "10.0", "20.0"],
    ]
    assert cells[-1][5:] == ["1.00", "0", "2.00"]
    assert "moment at which they are aligned" in text_of(page)


def test_of_many_failures_some_are_shown_and_the_page_says_so(http, overlaid, monkeypatch):
    address = overlaid(*(drive(STEPS, 0.1 * number) for number in range(6)))
    monkeypatch.setattr(mode_page, "BOUNDS", OverlayBounds(3, 10_000, 10_000))
    page = http.get(f"{address}/overlay").text
    assert "3 of 6 failures" in page
    found = [each["episode"].rpartition("/")[2] for each in read_values(page)["failures"]]
    assert found == ["5", "0", "4"]


def test_another_failure_is_opaque_where_the_medoid_has_no_scene(http, overlaid):
    page = http.get(f"{overlaid(drive(STEPS, 0.0), drive(STEPS, 1.0), None)}/overlay").text
    (first, *_) = read_values(page)["failures"]
    assert first["episode"] == "1/0"
    assert "Episode 1/0 is opaque" in page
    assert "ego of episode 1/0; translucent" in page
    assert "The medoid is not drawn" in page
    assert "The medoid is opaque" not in page


def test_an_ego_alone_is_apart_from_nothing(http, overlaid):
    scene = drive(STEPS, 0.0)
    alone = replace(scene, vehicles=scene.vehicles[:, :1], sizes=scene.sizes[:1])
    (failure,) = read_values(http.get(f"{overlaid(alone)}/overlay").text)["failures"]
    assert (failure["struck"], {*failure["apart"]}) == (0, {None})


def test_failures_without_scenes_leave_a_reason(overlaid, look):
    assert "has a scene that can be drawn" in look(f"{overlaid(None, None)}/overlay")


def test_a_mode_that_is_not_there_has_no_overlay(store, overlaid, look):
    assert "has no mode 2" in look(f"{overlaid(drive(STEPS, 0.0))[:-1]}2/overlay", 404)
    _, analysis = analyse_function(store, ("gust",))
    assert "no vehicles" in look(f"/analyses/{analysis}/modes/1/overlay", 422)
