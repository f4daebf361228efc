"""Episodes and failure modes as files, over HTTP, on pages and from the command line."""

import io
import json
from zipfile import ZipFile

import pytest
from PIL import Image
from recording_readers import measure_error_m, read_log, read_scenario

from eigenfail_exchange.animation import GIF
from eigenfail_exchange.mcap_log import MCAP
from eigenfail_exchange.open_scenario import OPENSCENARIO

MILLIMETRE = 1e-3
FORMATS = {"openscenario": OPENSCENARIO, "mcap": MCAP, "gif": GIF}
MEDIA = {
    "openscenario": "application/zip",
    "mcap": "application/octet-stream",
    "gif": "image/gif",
}
ENDINGS = {"openscenario": "zip", "mcap": "mcap", "gif": "gif"}
MAGIC = {"zip": b"PK\x03\x04", "mcap": b"\x89MCAP0\r\n", "gif": b"GIF89a"}


def fetch(http, campaign, index=0, **asked):
    return http.get(f"/api/v1/campaigns/{campaign}/episodes/{index}/recording", params=asked)


@pytest.mark.parametrize("form", MEDIA)
def test_an_episode_is_a_file_of_each_format(http, played, form):
    campaign, _ = played()
    response = fetch(http, campaign, format=form)
    assert response.status_code == 200, response.text
    assert response.headers["content-type"] == MEDIA[form]
    name = f'filename="episode-{campaign}-0.{ENDINGS[form]}"'
    assert name in response.headers["content-disposition"]
    assert response.content.startswith(MAGIC[ENDINGS[form]])


@pytest.mark.parametrize("scenario", ["cut_in", "merge_in", "lead_brake"])
def test_stored_poses_come_back_within_a_millimetre(http, played, scenario):
    campaign, (result,) = played(scenario=scenario)
    readers = {"openscenario": read_scenario, "mcap": read_log}
    for form, read in readers.items():
        poses = read(fetch(http, campaign, format=form).content)
        assert measure_error_m(result.scene, poses) < MILLIMETRE


def test_the_lanes_are_those_of_the_scenario(http, played):
    campaign, _ = played(scenario="merge_in", scenario_parameters={"ramp_m": 400.0})
    archive = ZipFile(io.BytesIO(fetch(http, campaign, format="openscenario").content))
    assert b'"road_from": "scenario"' in archive.read("episode.json")
    assert archive.read("road.xodr").count(b"<laneSection") == 2


def test_the_ego_may_be_left_to_a_controller(http, played):
    campaign, _ = played()
    left = fetch(http, campaign, format="openscenario", ego="controller")
    assert set(read_scenario(left.content)) == {"vehicle_1"}


@pytest.mark.parametrize("form", ["gif", "mcap"])
def test_only_openscenario_leaves_the_ego_to_a_controller(http, played, form):
    campaign, _ = played()
    response = fetch(http, campaign, format=form, ego="controller")
    assert response.status_code == 422
    assert response.json()["field"] == "ego"
    assert response.json()["remedy"] == "Use the format openscenario."


def test_the_page_of_an_episode_has_a_button_for_each_format(http, played):
    campaign, _ = played()
    page = http.get(f"/campaigns/{campaign}/episodes/0").text
    links = [f'recording?format={name}" download>{form.title}<' for name, form in FORMATS.items()]
    places = [page.index(link) for link in links]
    assert places == sorted(places)


def test_the_failures_of_a_mode_are_one_animation(http, analysed):
    address = f"/api/v1/analyses/{analysed}/modes/1/animation"
    response = http.get(address)
    assert response.status_code == 200, response.text
    assert response.headers["content-type"] == "image/gif"
    with Image.open(io.BytesIO(response.content)) as picture:
        assert picture.n_frames > 5
    assert address in http.get(f"/analyses/{analysed}").text
    assert address in http.get(f"/analyses/{analysed}/modes/1").text


@pytest.mark.parametrize("name", ["one.zip", "one.mcap", "one.gif"])
def test_an_episode_is_exported_by_a_command(eigenfail, played, tmp_path, name):
    campaign, _ = played()
    path = tmp_path / name
    done = eigenfail("episode", "export", f"{campaign}/0", "-o", path, "--json")
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout) == {"file": str(path), "size_bytes": path.stat().st_size}
    assert path.read_bytes().startswith(MAGIC[path.suffix[1:]])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("-o", "a.csv"), "format: 'csv' is not known. Known: gif, mcap, openscenario."),
        (
            ("-o", "a.gif", "--ego", "controller"),
            "ego: gif shows what happened, and has no controller. Use the format openscenario.",
        ),
        (
            ("-o", "a.xosc"),
            "OpenSCENARIO is written as a ZIP archive of scenario, road and noise. Name the file",
        ),
    ],
)
def test_what_cannot_be_exported_of_an_episode_ends_with_2(eigenfail, played, words, said):
    campaign, _ = played()
    refused = eigenfail("episode", "export", f"{campaign}/0", *words)
    assert refused.exit_code == 2
    assert said in refused.stderr
