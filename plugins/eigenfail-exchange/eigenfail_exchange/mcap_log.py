"""Episodes as MCAP logs, with the schemas of Foxglove (protobuf): transforms, poses and a 3D scene.

The container is MCAP, version 0 (mcap.dev/spec). Times count from the start of the episode. Frames
are `map`, the plane of the road, and one for each vehicle, whose origin is the centre of its
footprint on the ground.
"""

import io
from collections.abc import Iterator, Mapping
from math import cos, isfinite, sin
from typing import Any

import msgspec
import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from eigenfail.contracts.recording import EgoControl, EpisodeRecording, RecordingFormat
from eigenfail.values.disturbance import list_noise
from eigenfail.versions import PACKAGE, read_version
from eigenfail_exchange.road import StraightRoad, find_height, find_road, name_vehicle

MAP_FRAME = "map"
TRANSFORMS_TOPIC, SCENE_TOPIC, PERCEIVED_TOPIC = "/tf", "/scene", "/perceived"
NOISE_TOPIC, CONTROL_TOPIC = "/noise", "/ego/control"


NS_PER_S = 1_000_000_000


LINE_WIDTH_M = 0.15
"""Width of a painted line. [m]"""


Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, each from 0 to 1."""


_EGO: Colour = (0.15, 0.45, 0.9, 1.0)
_OTHER: Colour = (0.6, 0.6, 0.65, 1.0)
_SEEN: Colour = (0.95, 0.6, 0.1, 0.6)
_PAINT: Colour = (0.9, 0.9, 0.9, 1.0)


class _Log:
    """Writes messages of protobuf and of JSON to an MCAP log, each with its schema."""

    def __init__(self, buffer: io.BytesIO) -> None:
        self._writer = Writer(buffer)
        self._writer.start(library=f"{PACKAGE} {read_version(PACKAGE)}")
        self._channels: dict[str, int] = {}

    def write(self, topic: str, at_ns: int, message: Any) -> None:
        """Write a message of protobuf."""
        if topic not in self._channels:
            schema = register_schema(self._writer, type(message))
            self._channels[topic] = self._writer.register_channel(topic, "protobuf", schema)
        self._write_bytes(topic, at_ns, message.SerializeToString(deterministic=True))

    def write_json(self, topic: str, at_ns: int, row: Mapping[str, float]) -> None:
        """Write an object of numbers, null if a number is not finite."""
        if topic not in self._channels:
            name = f"{PACKAGE}.{topic.rpartition('/')[2].capitalize()}"
            text = msgspec.json.encode(_make_json_schema(name, row))
            schema = self._writer.register_schema(name, "jsonschema", text)
            self._channels[topic] = self._writer.register_channel(topic, "json", schema)
        self._write_bytes(topic, at_ns, msgspec.json.encode(row))

    def close(self, facts: dict[str, str]) -> None:
        """End the log with metadata under the name `eigenfail`."""
        self._writer.add_metadata(PACKAGE, facts)
        self._writer.finish()  # type: ignore[no-untyped-call]  # mcap's own way

    def _write_bytes(self, topic: str, at_ns: int, data: bytes) -> None:
        self._writer.add_message(self._channels[topic], at_ns, data, at_ns)


def write_mcap(recording: EpisodeRecording) -> bytes:
    """Return the MCAP log of an episode.

    Topics of protobuf: `/tf` (foxglove.FrameTransforms), `/<vehicle>/pose` (foxglove.PoseInFrame),
    `/scene` (foxglove.SceneUpdate) and `/perceived` (foxglove.PoseInFrame), the perceived position
    of the nearest vehicle. Topics of JSON: `/noise`, the injected noise, and `/ego/control`, the
    planner's command. The metadata says which episode it is.

    Args:
        recording: the episode.
    """
    buffer = io.BytesIO()
    log = _Log(buffer)
    scene = recording.scene
    noise = list(list_noise(recording.noise, recording.channels))
    for step in range(len(scene.vehicles)):
        at_ns = round(step * scene.dt_s * NS_PER_S)
        _write_vehicles(log, recording, step, at_ns)
        if step < len(scene.perceived):
            _write_perceived(log, recording, step, at_ns)
        if step < len(scene.controls):
            acceleration, steering = map(float, scene.controls[step])
            row = {"acceleration_mps2": acceleration, "steering_rad": steering}
            log.write_json(CONTROL_TOPIC, at_ns, row)
        if step < len(noise):
            log.write_json(NOISE_TOPIC, at_ns, noise[step])
    log.close(_list_facts(recording))
    return buffer.getvalue()


def _make_json_schema(title: str, row: Mapping[str, float]) -> dict[str, object]:
    numbers = {name: {"type": ["number", "null"]} for name in row}
    return {
        "title": title,
        "type": "object",
        "properties": numbers,
        "required": list(row),
        "additionalProperties": False,
    }


def _list_facts(recording: EpisodeRecording) -> dict[str, str]:
    return {
        "campaign": str(recording.campaign),
        "campaign_name": recording.campaign_name,
        "index": str(recording.index),
        "seed": str(recording.seed),
        "scenario": recording.scenario,
        "planner": recording.planner,
        "outcome": recording.outcome.word,
        "digest": recording.digest,
    }


def _write_vehicles(log: _Log, recording: EpisodeRecording, step: int, at_ns: int) -> None:
    transforms, moment = [], _make_timestamp(at_ns)
    for number, pose in _list_poses(recording, step):
        name = name_vehicle(number)
        framed = PoseInFrame(timestamp=moment, frame_id=MAP_FRAME, pose=pose)
        log.write(f"/{name}/pose", at_ns, framed)
        place = pose.position
        transforms.append(
            FrameTransform(
                timestamp=moment,
                parent_frame_id=MAP_FRAME,
                child_frame_id=name,
                translation=Vector3(x=place.x, y=place.y, z=place.z),
                rotation=pose.orientation,
            )
        )
    log.write(TRANSFORMS_TOPIC, at_ns, FrameTransforms(transforms=transforms))
    log.write(SCENE_TOPIC, at_ns, _make_scene_update(recording, step, moment))


def _list_poses(recording: EpisodeRecording, step: int) -> Iterator[tuple[int, Pose]]:
    """Yield number and pose of each vehicle that is there after a step."""
    for number, state in enumerate(recording.scene.vehicles[step]):
        x_m, y_m, heading_rad = map(float, state[:3])
        if isfinite(x_m) and isfinite(y_m) and isfinite(heading_rad):
            yield number, _make_pose(x_m, y_m, 0.0, heading_rad)


def _make_pose(x_m: float, y_m: float, z_m: float, heading_rad: float = 0.0) -> Pose:
    half = 0.5 * heading_rad
    return Pose(
        position=Vector3(x=x_m, y=y_m, z=z_m),
        orientation=Quaternion(x=0.0, y=0.0, z=sin(half), w=cos(half)),
    )


def _make_timestamp(at_ns: int) -> Timestamp:
    seconds, nanos = divmod(at_ns, NS_PER_S)
    return Timestamp(seconds=seconds, nanos=nanos)


def _make_scene_update(recording: EpisodeRecording, step: int, moment: Timestamp) -> SceneUpdate:
    present = dict(_list_poses(recording, step))
    entities = [_make_vehicle(recording, number, pose) for number, pose in present.items()]
    if step == 0:
        entities.append(_make_road(find_road(recording)))
    if step == len(recording.scene.vehicles) - 1:
        entities.append(_make_caption(recording, present.get(0)))
    for entity in entities:
        entity.timestamp.CopyFrom(moment)
    left = dict(_list_poses(recording, step - 1)).keys() - present.keys() if step else ()
    deletions = [
        SceneEntityDeletion(
            timestamp=moment,
            type=SceneEntityDeletion.Type.MATCHING_ID,
            id=name_vehicle(number),
        )
        for number in sorted(left)
    ]
    return SceneUpdate(entities=entities, deletions=deletions)


def _make_vehicle(recording: EpisodeRecording, number: int, pose: Pose) -> SceneEntity:
    length_m, width_m = map(float, recording.scene.sizes[number])
    height_m = find_height(length_m)
    middle = Pose()
    middle.CopyFrom(pose)
    middle.position.z = height_m / 2
    cube = CubePrimitive(
        pose=middle,
        size=Vector3(x=length_m, y=width_m, z=height_m),
        color=_make_colour(_OTHER if number else _EGO),
    )
    return SceneEntity(frame_id=MAP_FRAME, id=name_vehicle(number), cubes=[cube])


def _make_road(road: StraightRoad) -> SceneEntity:
    ends = road.lane_0_ends_x_m
    points = []
    for edge in range(road.lanes + 1):
        y_m = road.right_edge_y_m + edge * road.lane_width_m
        end_m = ends if edge == 0 and ends is not None else road.ends_x_m
        points += [Point3(x=road.starts_x_m, y=y_m), Point3(x=end_m, y=y_m)]
    lines = LinePrimitive(
        type=LinePrimitive.Type.LINE_LIST,
        pose=_make_pose(0.0, 0.0, 0.0),
        thickness=LINE_WIDTH_M,
        points=points,
        color=_make_colour(_PAINT),
    )
    return SceneEntity(frame_id=MAP_FRAME, id="road", lines=[lines])


def _make_caption(recording: EpisodeRecording, ego: Pose | None) -> SceneEntity:
    place = ego.position if ego is not None else _make_pose(0.0, 0.0, 0.0).position
    text = TextPrimitive(
        pose=_make_pose(place.x, place.y, 2.0 * find_height(float(recording.scene.sizes[0, 0]))),
        billboard=True,
        font_size=2.0,
        color=_make_colour(_SEEN),
        text=recording.title,
    )
    return SceneEntity(frame_id=MAP_FRAME, id="outcome", texts=[text])


def _make_colour(colour: Colour) -> Any:
    red, green, blue, opacity = colour
    return Color(r=red, g=green, b=blue, a=opacity)


def _write_perceived(log: _Log, recording: EpisodeRecording, step: int, at_ns: int) -> None:
    """Write the perceived position of the nearest vehicle; nothing if that was missed."""
    x_m, y_m = map(float, recording.scene.perceived[step])
    if np.isfinite([x_m, y_m]).all():
        moment = _make_timestamp(at_ns)
        pose = _make_pose(x_m, y_m, 0.0)
        seen = PoseInFrame(timestamp=moment, frame_id=MAP_FRAME, pose=pose)
        log.write(PERCEIVED_TOPIC, at_ns, seen)


def _write(recording: EpisodeRecording, ego: EgoControl) -> bytes:  # noqa: ARG001 - the contract's
    return write_mcap(recording)


MCAP = RecordingFormat(
    title="MCAP", suffix=".mcap", media_type="application/octet-stream", write=_write
)
