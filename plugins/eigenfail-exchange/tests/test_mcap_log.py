"""Episodes as MCAP: valid by Foxglove's schemas, and read back by mcap."""

import io
from math import nan

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from made_recordings import MISSION, STEPS, drive, record
from mcap.reader import make_reader
from mcap_protobuf.schema import build_file_descriptor_set
from msgspec.structs import replace
from recording_readers import list_messages, measure_error_m, read_log

from eigenfail_exchange.mcap_log import write_mcap

MILLIMETRE = 1e-3
FOXGLOVE = {
    "/tf": FrameTransforms,
    "/scene": SceneUpdate,
    "/perceived": PoseInFrame,
    **{f"/{name}/pose": PoseInFrame for name in ("ego", "vehicle_1", "vehicle_2")},
}


@pytest.fixture(scope="module")
def recording():
    return record(mission=MISSION)


@pytest.fixture(scope="module")
def messages(recording):
    """Topic, schema, time [ns] and message of each."""
    return list(list_messages(write_mcap(recording)))


def of_topic(messages, topic):
    return [(at_ns, message) for name, _, at_ns, message in messages if name == topic]


@pytest.mark.parametrize("seed", range(3))
def test_poses_come_back_within_a_millimetre(seed):
    recording = record(drive(seed=seed))
    assert measure_error_m(recording.scene, read_log(write_mcap(recording))) < MILLIMETRE


def test_schemas_are_those_of_foxglove(messages):
    found = {topic: schema for topic, schema, _, _ in messages}
    assert found.keys() == FOXGLOVE.keys() | {"/noise", "/ego/control"}
    for topic, kind in FOXGLOVE.items():
        descriptors = build_file_descriptor_set(kind).SerializeToString()
        assert found[topic].name == kind.DESCRIPTOR.full_name
        assert (found[topic].encoding, found[topic].data) == ("protobuf", descriptors)


def test_messages_have_no_field_that_their_schema_lacks(messages):
    for topic, _, at_ns, message in messages:
        if topic not in FOXGLOVE:
            continue
        again = FOXGLOVE[topic].FromString(message.SerializeToString())
        again.DiscardUnknownFields()
        assert again.SerializeToString(deterministic=True) == message.SerializeToString(
            deterministic=True
        )
        times = {each.timestamp.ToNanoseconds() for each in list_stamped(again)}
        assert times <= {at_ns}


def list_stamped(message):
    """What of a message has a time."""
    for parts in ("transforms", "entities", "deletions"):
        yield from getattr(message, parts, ())
    if hasattr(message, "timestamp"):
        yield message


def test_a_cube_is_the_vehicle(messages, recording):
    scene = recording.scene
    for step, (_, update) in enumerate(of_topic(messages, "/scene")):
        cubes = {each.id: each.cubes[0] for each in update.entities if each.cubes}
        cube, state = cubes["vehicle_1"], scene.vehicles[step, 1]
        place, size = cube.pose.position, cube.size
        assert (place.x, place.y) == pytest.approx(tuple(state[:2]), abs=MILLIMETRE)
        assert (size.x, size.y) == pytest.approx(tuple(scene.sizes[1]))
        assert place.z == pytest.approx(size.z / 2)
        assert ("vehicle_2" in cubes) == bool(np.isfinite(scene.vehicles[step, 2, 0]))


def test_a_vehicle_that_leaves_is_deleted_at_once(messages):
    deleted = [
        (step, each.id)
        for step, (_, update) in enumerate(of_topic(messages, "/scene"))
        for each in update.deletions
    ]
    assert deleted == [(5, "vehicle_2"), (STEPS, "vehicle_2")]


def test_lanes_are_lines_and_the_outcome_a_text(messages):
    scenes = [update for _, update in of_topic(messages, "/scene")]
    (road,) = [each for each in scenes[0].entities if each.id == "road"]
    points = road.lines[0].points
    assert [point.y for point in points[::2]] == pytest.approx([-1.75, 1.75, 5.25])
    assert points[1].x == pytest.approx(MISSION.lane_0_ends_x_m)
    (end,) = [each for each in scenes[-1].entities if each.id == "outcome"]
    assert end.texts[0].text == "Episode 2/7: collision"


def test_noise_and_control_are_json_by_their_own_schema(messages, recording):
    noise = [message for _, message in of_topic(messages, "/noise")]
    injected = [[each["longitudinal_m"], each["lateral_m"]] for each in noise]
    assert injected == pytest.approx(recording.noise.injected)
    controls = [message for _, message in of_topic(messages, "/ego/control")]
    asked = [[each["acceleration_mps2"], each["steering_rad"]] for each in controls]
    assert asked == pytest.approx(recording.scene.controls)


def test_what_was_not_seen_has_no_message_and_no_number():
    scene = drive()
    scene.perceived[3] = nan
    scene.controls[4, 0] = nan
    messages = list(list_messages(write_mcap(record(scene))))
    steps = [round(at_ns / 1e8) for at_ns, _ in of_topic(messages, "/perceived")]
    assert steps == [step for step in range(STEPS) if step != 3]
    assert of_topic(messages, "/ego/control")[4][1]["acceleration_mps2"] is None


def test_the_log_says_which_episode_it_is(recording):
    log = write_mcap(recording)
    (facts,) = make_reader(io.BytesIO(log)).iter_metadata()
    assert facts.name == "eigenfail"
    assert (facts.metadata["campaign"], facts.metadata["index"]) == ("2", "7")
    assert facts.metadata["outcome"] == "collision"
    assert write_mcap(replace(recording)) == log
