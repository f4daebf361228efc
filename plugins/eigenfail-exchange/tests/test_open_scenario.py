"""Episodes as OpenSCENARIO: valid, and read back by scenariogeneration and lxml."""

import csv
import io
import json
from xml.etree import ElementTree as ET
from zipfile import ZipFile

import numpy as np
import pytest
from made_recordings import MISSION, STEPS, drive, record
from msgspec.structs import replace
from recording_readers import (
    list_events,
    list_violations,
    measure_error_m,
    parse_scenario,
    read_scenario,
    unpack,
)

from eigenfail.contracts.recording import EgoControl
from eigenfail.errors import InvalidValue
from eigenfail.values.scene import Mission
from eigenfail_exchange.open_scenario import write_open_scenario
from eigenfail_exchange.road import MAX_LANES, find_road

SCENARIOS = ("OpenSCENARIO_1_1.xsd", "OpenSCENARIO_1_2.xsd", "OpenSCENARIO_1_3_1.xsd")
MILLIMETRE = 1e-3


@pytest.mark.parametrize("ego", EgoControl)
@pytest.mark.parametrize("schema", SCENARIOS)
def test_scenarios_are_valid(ego, schema):
    files = unpack(write_open_scenario(record(), ego))
    assert list_violations(files["scenario.xosc"], schema) == []


def test_a_wrong_scenario_is_not_valid():
    scenario = unpack(write_open_scenario(record()))["scenario.xosc"]
    wrong = scenario.replace(b'followingMode="position"', b'followingMode="by_hand"')
    assert list_violations(wrong, SCENARIOS[1])


@pytest.mark.parametrize("known", [True, False])
def test_roads_are_valid(known):
    archive = write_open_scenario(record(mission=MISSION if known else None))
    assert list_violations(unpack(archive)["road.xodr"], "opendrive_17_core.xsd") == []


@pytest.mark.parametrize("seed", range(3))
def test_poses_come_back_within_a_millimetre(seed):
    recording = record(drive(seed=seed))
    poses = read_scenario(write_open_scenario(recording))
    assert measure_error_m(recording.scene, poses) < MILLIMETRE
    headings = recording.scene.vehicles[:, 0, 2]
    assert [heading for _, _, heading in poses["ego"].values()] == pytest.approx(headings, abs=1e-6)


def test_an_ego_that_is_left_to_a_controller_has_a_start_and_no_course():
    recording = record()
    archive = write_open_scenario(recording, EgoControl.CONTROLLER)
    assert set(read_scenario(archive)) == {"vehicle_1", "vehicle_2"}
    root = ET.fromstring(unpack(archive)["scenario.xosc"])
    assert root.find(".//ScenarioObject[@name='ego']/ObjectController/Controller") is not None
    start = root.find(".//Private[@entityRef='ego']")
    speed = start.find(".//AbsoluteTargetSpeed").get("value")
    assert float(speed) == pytest.approx(recording.scene.vehicles[0, 0, 3], abs=1e-5)
    active = start.find(".//ActivateControllerAction").attrib
    assert active == {"lateral": "true", "longitudinal": "true"}


@pytest.mark.parametrize("schema", SCENARIOS[1:])
@pytest.mark.parametrize("vehicles", [1, 2])
def test_an_ego_without_other_vehicles_has_no_story(vehicles, schema):
    """Whether the scene has no other vehicle, or one that is never there."""
    scene = drive()
    scene.vehicles[:, 1:] = np.nan
    alone = replace(scene, vehicles=scene.vehicles[:, :vehicles], sizes=scene.sizes[:vehicles])
    files = unpack(write_open_scenario(record(alone), EgoControl.CONTROLLER))
    assert list_violations(files["scenario.xosc"], schema) == []
    assert b"<Story " not in files["scenario.xosc"]


@pytest.mark.parametrize("schema", SCENARIOS)
def test_vehicles_are_of_the_kinds_that_the_scene_tells(schema):
    recording = record(replace(drive(), kinds=("bus", "pedestrian", "unknown")))
    archive = write_open_scenario(recording)
    scenario = unpack(archive)["scenario.xosc"]
    assert list_violations(scenario, schema) == []
    root = ET.fromstring(scenario)
    kinds = [vehicle.get("vehicleCategory") for vehicle in root.iter("Vehicle")]
    assert kinds == ["bus", "car"]
    walker = root.find(".//ScenarioObject[@name='vehicle_1']/Pedestrian")
    assert walker.get("pedestrianCategory") == "pedestrian"
    # The reference point of a pedestrian is the centre of its footprint.
    vertex = root.find(".//Trajectory[@name='vehicle_1_course_0']//WorldPosition")
    assert float(vertex.get("x")) == pytest.approx(recording.scene.vehicles[0, 1, 0], abs=1e-3)
    assert measure_error_m(recording.scene, read_scenario(archive)) < MILLIMETRE


def test_ego_has_the_brakes_of_its_mission():
    weak = replace(MISSION, peak_braking_mps2=3.2)
    found = {}
    for name, mission in {"stated": weak, "unknown": None}.items():
        scenario = unpack(write_open_scenario(record(mission=mission)))["scenario.xosc"]
        limits = ET.fromstring(scenario).iter("Performance")
        found[name] = [float(one.get("maxDeceleration")) for one in limits]
    assert found == {"stated": [3.2, 7.0, 7.0], "unknown": [7.0, 7.0, 7.0]}


def test_a_vehicle_comes_and_goes_when_it_did():
    scenario = parse_scenario(unpack(write_open_scenario(record()))["scenario.xosc"])
    names = [event.name for name, event in list_events(scenario) if name == "vehicle_2"]
    assert names == [
        *("vehicle_2_from_2", "vehicle_2_until_4"),
        *("vehicle_2_from_7", f"vehicle_2_until_{STEPS - 1}"),
    ]
    root = ET.fromstring(unpack(write_open_scenario(record()))["scenario.xosc"])
    away = root.findall(".//Init//EntityAction[@entityRef='vehicle_2']/DeleteEntityAction")
    added = root.findall(".//Story//EntityAction[@entityRef='vehicle_2']/AddEntityAction")
    removed = root.findall(".//Story//EntityAction[@entityRef='vehicle_2']/DeleteEntityAction")
    assert (len(away), len(added), len(removed)) == (1, 2, 2)


def test_the_scenario_ends_with_the_episode():
    root = ET.fromstring(unpack(write_open_scenario(record()))["scenario.xosc"])
    ends = root.find("./Storyboard/StopTrigger//SimulationTimeCondition")
    assert float(ends.get("value")) == pytest.approx(STEPS * 0.1)


def list_lane_centres(road):
    """The y of the centre of each lane of each section of a straight road, from the right."""
    left_m = float(road.find(".//geometry").get("y"))
    for section in road.iter("laneSection"):
        centres, edge_m = [], left_m
        for lane in section.findall("./right/lane"):
            width_m = float(lane.find("width").get("a"))
            centres.append(edge_m - width_m / 2)
            edge_m -= width_m
        yield float(section.get("s")), centres[::-1]


def test_lanes_are_where_the_scenario_has_them():
    road = ET.fromstring(unpack(write_open_scenario(record(mission=MISSION)))["road.xodr"])
    (whole, both), (later, one) = list_lane_centres(road)
    starts_m = float(road.find(".//geometry").get("x"))
    assert (whole, both) == (0.0, pytest.approx([0.0, 3.5]))
    assert starts_m + later == pytest.approx(MISSION.lane_0_ends_x_m)
    assert one == pytest.approx([3.5])


def test_a_road_that_is_not_known_lies_under_every_vehicle():
    recording = record()
    archive = unpack(write_open_scenario(recording))
    ((_, centres),) = list_lane_centres(ET.fromstring(archive["road.xodr"]))
    y_m = recording.scene.vehicles[..., 1]
    assert centres[0] - 1.75 <= np.nanmin(y_m)
    assert centres[-1] + 1.75 >= np.nanmax(y_m)
    assert min(map(abs, centres)) == pytest.approx(0.0)
    assert json.loads(archive["episode.json"])["road_from"] == "vehicles"


def shift(offset_m, spread_m=0.0):
    """A drive whose vehicles are moved to the side, the second one further than the others."""
    scene = drive()
    scene.vehicles[..., 1] += offset_m
    scene.vehicles[:, 1, 1] += spread_m
    return record(scene)


@pytest.mark.parametrize("offset_m", [-5e6, 35.0, 5e6])
def test_a_road_that_is_not_known_lies_near_the_vehicles_alone(offset_m):
    """As on a bridge, where positions may be those of a map."""
    recording, road = shift(offset_m), find_road(shift(offset_m))
    y_m = recording.scene.vehicles[..., 1]
    assert road.lanes <= 8
    assert road.right_edge_y_m == pytest.approx(np.nanmin(y_m), abs=3.5)
    assert road.left_edge_y_m == pytest.approx(np.nanmax(y_m), abs=3.5)


@pytest.mark.parametrize("spread_m", [300.0, 1e9])
def test_vehicles_too_far_beside_each_other_are_refused(spread_m):
    with pytest.raises(InvalidValue, match="beside each other"):
        write_open_scenario(shift(0.0, spread_m))
    assert find_road(shift(0.0, 150.0)).lanes < MAX_LANES


def test_the_noise_stands_beside_it():
    recording = record()
    archive = unpack(write_open_scenario(recording))
    rows = list(csv.DictReader(io.StringIO(archive["noise.csv"].decode())))
    injected = [[float(row["longitudinal_m"]), float(row["lateral_m"])] for row in rows]
    seen = [[float(row["perceived_x_m"]), float(row["perceived_y_m"])] for row in rows]
    assert injected == pytest.approx(recording.noise.injected)
    assert seen == pytest.approx(recording.scene.perceived)
    assert float(rows[3]["time_s"]) == pytest.approx(0.3)
    facts = json.loads(archive["episode.json"])
    assert (facts["campaign"], facts["index"], facts["planner"]) == (2, 7, recording.planner)


def test_equal_episodes_give_equal_archives():
    archives = {write_open_scenario(record(mission=MISSION)) for _ in range(2)}
    assert len(archives) == 1
    with ZipFile(io.BytesIO(archives.pop())) as archive:
        assert {each.date_time for each in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_an_episode_of_one_step_is_valid():
    scenario = unpack(write_open_scenario(record(drive(steps=1))))["scenario.xosc"]
    assert list_violations(scenario, SCENARIOS[1]) == []


def test_lanes_that_do_not_end_on_the_road_go_on():
    endless = Mission(0.1, 3, 3.0, 25.0, 24.0, 1000.0, lane_0_ends_x_m=1e6)
    road = ET.fromstring(unpack(write_open_scenario(record(mission=endless)))["road.xodr"])
    ((_, centres),) = list_lane_centres(road)
    assert centres == pytest.approx([0.0, 3.0, 6.0])
