"""Episodes as OpenSCENARIO 1.2 on a road in OpenDRIVE 1.7, with the noise in another file.

ASAM OpenSCENARIO XML 1.2.0 and ASAM OpenDRIVE 1.7.0: the reference point of a vehicle is the middle
of its rear axle, on the ground; for a pedestrian it is the centre of the footprint. A scene has the
centres of the footprints; `find_reference_offset` gives the offset.
"""

import csv
import io
from collections.abc import Iterator
from datetime import UTC, datetime
from math import cos, sin
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element, SubElement
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import msgspec
import numpy as np
from msgspec import UnsetType

from eigenfail.contracts.recording import EgoControl, EpisodeRecording, RecordingFormat
from eigenfail.values.disturbance import list_noise
from eigenfail.values.scene import PEAK_BRAKING_MPS2, UNKNOWN_KIND, Scene
from eigenfail.versions import PACKAGE, read_version
from eigenfail_exchange.road import (
    TRUCK_LENGTH_M,
    StraightRoad,
    find_height,
    find_presence,
    find_road,
    name_vehicle,
)

SCENARIO_FILE, ROAD_FILE = "scenario.xosc", "road.xodr"
NOISE_FILE, EPISODE_FILE = "noise.csv", "episode.json"


REAR_AXLE_SHARE = 0.3
"""How far the rear axle is behind the centre, as a share of the length; the front axle is as far
ahead of it. The world has no axles, so that this is an assumption."""


TOP_SPEED_MPS = 70.0
"""Speed that no vehicle exceeds: the format asks for one. [m/s]"""


PEDESTRIAN_KINDS = ("pedestrian", "animal")
PEDESTRIAN_MASS_KG = 75.0
"""The format asks for a mass, which no scene has. [kg]"""


FULL_STEERING_RAD = 0.5
WHEEL_DIAMETER_M = 0.8


def write_open_scenario(
    recording: EpisodeRecording, ego: EgoControl = EgoControl.RECORDED
) -> bytes:
    """Return a ZIP archive of scenario, road, noise and facts.

    `scenario.xosc` names `road.xodr` in the same archive. `noise.csv` has the injected noise at
    each step, and the perceived position of the nearest vehicle. `episode.json` says which episode
    it is.

    Args:
        recording: the episode.
        ego: whether the ego repeats its course or is left to a controller.
    """
    contents = {
        SCENARIO_FILE: _serialise(_make_scenario(recording, ego)),
        ROAD_FILE: _serialise(_make_road(find_road(recording), recording.name)),
        NOISE_FILE: _write_noise(recording).encode(),
        EPISODE_FILE: _describe_recording(recording, ego),
    }
    buffer = io.BytesIO()
    with ZipFile(buffer, "w", ZIP_DEFLATED) as archive:
        for name, content in contents.items():
            # An entry has no time of its own, so that equal episodes give equal archives.
            archive.writestr(ZipInfo(name), content, ZIP_DEFLATED)
    return buffer.getvalue()


def find_kind(scene: Scene, number: int) -> str:
    """Return one of `VEHICLE_KINDS` for a vehicle, by its length if its kind is unknown."""
    kind = UNKNOWN_KIND if isinstance(scene.kinds, UnsetType) else scene.kinds[number]
    if kind != UNKNOWN_KIND:
        return kind
    return "truck" if float(scene.sizes[number, 0]) > TRUCK_LENGTH_M else "car"


def find_reference_offset(scene: Scene, number: int) -> float:
    """Return how far the centre of a vehicle is ahead of its reference point. [m]"""
    has_axles = find_kind(scene, number) not in PEDESTRIAN_KINDS
    return REAR_AXLE_SHARE * float(scene.sizes[number, 0]) if has_axles else 0.0


def _serialise(root: Element) -> bytes:
    ET.indent(root)
    content: bytes = ET.tostring(root, "utf-8", xml_declaration=True)
    return content + b"\n"


def _format_metres(value: float) -> str:
    return f"{value:.6f}"


def _format_angle(value: float) -> str:
    return f"{value:.9f}"


def _write_noise(recording: EpisodeRecording) -> str:
    text = io.StringIO()
    scene = recording.scene
    rows = list(list_noise(recording.noise, recording.channels))
    names = tuple(rows[0]) if rows else ("step",)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow((*names, "time_s", "perceived_x_m", "perceived_y_m"))
    for step, (row, seen) in enumerate(zip(rows, scene.perceived, strict=False)):
        writer.writerow((*row.values(), step * scene.dt_s, *map(float, seen)))
    return text.getvalue()


def _describe_recording(recording: EpisodeRecording, ego: EgoControl) -> bytes:
    facts = {
        "campaign": recording.campaign,
        "campaign_name": recording.campaign_name,
        "index": recording.index,
        "seed": recording.seed,
        "scenario": recording.scenario,
        "planner": recording.planner,
        "outcome": recording.outcome.word,
        "digest": recording.digest,
        "ego": ego.value,
        "road_from": "scenario" if find_road(recording).is_known else "vehicles",
        "reference_offset_m": {
            name_vehicle(number): find_reference_offset(recording.scene, number)
            for number in range(len(recording.scene.sizes))
        },
        "eigenfail": read_version(PACKAGE),
    }
    return msgspec.json.format(msgspec.json.encode(facts), indent=2) + b"\n"


def _make_scenario(recording: EpisodeRecording, ego: EgoControl) -> Element:
    scene = recording.scene
    root = Element("OpenSCENARIO")
    made = datetime.fromtimestamp(recording.recorded_ms / 1000.0, UTC)
    SubElement(
        root,
        "FileHeader",
        revMajor="1",
        revMinor="2",
        date=made.strftime("%Y-%m-%dT%H:%M:%S"),
        author=PACKAGE,
        description=f"{recording.title}; planner {recording.planner}, digest {recording.digest}",
    )
    SubElement(root, "CatalogLocations")
    SubElement(SubElement(root, "RoadNetwork"), "LogicFile", filepath=ROAD_FILE)
    entities = SubElement(root, "Entities")
    for number in range(len(scene.sizes)):
        entity = SubElement(entities, "ScenarioObject", name=name_vehicle(number))
        mission = recording.mission if number == 0 else None
        braking_mps2 = mission.peak_braking_mps2 if mission else PEAK_BRAKING_MPS2
        _add_vehicle(entity, scene, number, braking_mps2)
        if number == 0 and ego is EgoControl.CONTROLLER:
            _add_controller(entity, recording)
    storyboard = SubElement(root, "Storyboard")
    _add_init(storyboard, scene, ego)
    _add_story(storyboard, scene, ego)
    _add_time_trigger(storyboard, "StopTrigger", (len(scene.vehicles) - 1) * scene.dt_s)
    return root


def _add_vehicle(entity: Element, scene: Scene, number: int, braking_mps2: float) -> None:
    name, kind = name_vehicle(number), find_kind(scene, number)
    if kind in PEDESTRIAN_KINDS:
        mass = str(PEDESTRIAN_MASS_KG)
        walker = SubElement(entity, "Pedestrian", name=name, mass=mass, pedestrianCategory=kind)
        _add_box(walker, scene, number)
        SubElement(walker, "Properties")
        return
    vehicle = SubElement(entity, "Vehicle", name=name, vehicleCategory=kind)
    _add_box(vehicle, scene, number)
    SubElement(
        vehicle,
        "Performance",
        maxSpeed=str(TOP_SPEED_MPS),
        maxAcceleration=str(PEAK_BRAKING_MPS2),
        maxDeceleration=str(braking_mps2),
    )
    width_m, ahead_m = float(scene.sizes[number, 1]), find_reference_offset(scene, number)
    axles = SubElement(vehicle, "Axles")
    for name, steering_rad, place_m in (
        ("FrontAxle", FULL_STEERING_RAD, 2.0 * ahead_m),
        ("RearAxle", 0.0, 0.0),
    ):
        SubElement(
            axles,
            name,
            maxSteering=str(steering_rad),
            wheelDiameter=str(WHEEL_DIAMETER_M),
            trackWidth=_format_metres(width_m),
            positionX=_format_metres(place_m),
            positionZ=str(WHEEL_DIAMETER_M / 2),
        )
    SubElement(vehicle, "Properties")


def _add_box(parent: Element, scene: Scene, number: int) -> None:
    length_m, width_m = map(float, scene.sizes[number])
    height_m, ahead_m = find_height(length_m), find_reference_offset(scene, number)
    box = SubElement(parent, "BoundingBox")
    SubElement(box, "Center", x=_format_metres(ahead_m), y="0", z=_format_metres(height_m / 2))
    SubElement(
        box,
        "Dimensions",
        width=_format_metres(width_m),
        length=_format_metres(length_m),
        height=_format_metres(height_m),
    )


def _add_controller(entity: Element, recording: EpisodeRecording) -> None:
    controller = SubElement(SubElement(entity, "ObjectController"), "Controller", name="planner")
    properties = SubElement(controller, "Properties")
    SubElement(properties, "Property", name="eigenfail_planner", value=recording.planner)


def _add_init(storyboard: Element, scene: Scene, ego: EgoControl) -> None:
    actions = SubElement(SubElement(storyboard, "Init"), "Actions")
    present = [
        number
        for number in range(len(scene.sizes))
        if np.isfinite(scene.vehicles[0, number, :3]).all()
    ]
    for number in sorted({*range(len(scene.sizes))} - {*present}):
        away = SubElement(SubElement(actions, "GlobalAction"), "EntityAction")
        away.set("entityRef", name_vehicle(number))
        SubElement(away, "DeleteEntityAction")
    for number in present:
        private = SubElement(actions, "Private", entityRef=name_vehicle(number))
        teleport = SubElement(SubElement(private, "PrivateAction"), "TeleportAction")
        _add_position(teleport, scene, number, 0)
        _add_speed(private, float(scene.vehicles[0, number, 3]))
        if number == 0 and ego is EgoControl.CONTROLLER:
            action = SubElement(SubElement(private, "PrivateAction"), "ControllerAction")
            SubElement(action, "ActivateControllerAction", lateral="true", longitudinal="true")


def _add_speed(private: Element, speed_mps: float) -> None:
    longitudinal = SubElement(SubElement(private, "PrivateAction"), "LongitudinalAction")
    action = SubElement(longitudinal, "SpeedAction")
    SubElement(
        action,
        "SpeedActionDynamics",
        dynamicsShape="step",
        value="0",
        dynamicsDimension="time",
    )
    target = SubElement(action, "SpeedActionTarget")
    SubElement(target, "AbsoluteTargetSpeed", value=_format_metres(speed_mps))


def _add_position(parent: Element, scene: Scene, number: int, step: int) -> None:
    x_m, y_m, heading_rad = map(float, scene.vehicles[step, number, :3])
    ahead_m = find_reference_offset(scene, number)
    SubElement(
        SubElement(parent, "Position"),
        "WorldPosition",
        x=_format_metres(x_m - ahead_m * cos(heading_rad)),
        y=_format_metres(y_m - ahead_m * sin(heading_rad)),
        z="0",
        h=_format_angle(heading_rad),
        p="0",
        r="0",
    )


def _add_story(storyboard: Element, scene: Scene, ego: EgoControl) -> None:
    first = 0 if ego is EgoControl.RECORDED else 1
    spans = {number: find_presence(scene, number) for number in range(first, len(scene.sizes))}
    moving = {number: found for number, found in spans.items() if found}
    if not moving:  # An act has at least one group.
        return
    story = SubElement(storyboard, "Story", name="recorded_course")
    act = SubElement(story, "Act", name="recorded_act")
    for number, found in moving.items():
        name = name_vehicle(number)
        group = SubElement(act, "ManeuverGroup", name=f"{name}_group", maximumExecutionCount="1")
        actors = SubElement(group, "Actors", selectTriggeringEntities="false")
        SubElement(actors, "EntityRef", entityRef=name)
        maneuver = SubElement(group, "Maneuver", name=f"{name}_maneuver")
        for span in found:
            _add_span(maneuver, scene, number, span)
    _add_time_trigger(act, "StartTrigger", 0.0)


def _add_span(maneuver: Element, scene: Scene, number: int, span: tuple[int, int]) -> None:
    """Add the course of a vehicle while it is there, and that it comes and goes."""
    name, (first, last) = name_vehicle(number), span
    event = SubElement(maneuver, "Event", name=f"{name}_from_{first}", priority="parallel")
    if first > 0:
        entering = SubElement(event, "Action", name=f"{name}_enters_{first}")
        entity = SubElement(SubElement(entering, "GlobalAction"), "EntityAction", entityRef=name)
        _add_position(SubElement(entity, "AddEntityAction"), scene, number, first)
    action = SubElement(event, "Action", name=f"{name}_follows_{first}")
    private = SubElement(action, "PrivateAction")
    _add_trajectory(SubElement(private, "RoutingAction"), scene, number, span)
    _add_time_trigger(event, "StartTrigger", first * scene.dt_s)
    if last < len(scene.vehicles) - 1:
        event = SubElement(maneuver, "Event", name=f"{name}_until_{last}", priority="parallel")
        leaving = SubElement(event, "Action", name=f"{name}_leaves_{last}")
        entity = SubElement(SubElement(leaving, "GlobalAction"), "EntityAction", entityRef=name)
        SubElement(entity, "DeleteEntityAction")
        _add_time_trigger(event, "StartTrigger", last * scene.dt_s)


def _add_trajectory(routing: Element, scene: Scene, number: int, span: tuple[int, int]) -> None:
    first, last = span
    follow = SubElement(routing, "FollowTrajectoryAction")
    timing = SubElement(SubElement(follow, "TimeReference"), "Timing")
    timing.attrib.update(domainAbsoluteRelative="absolute", scale="1", offset="0")
    reference = SubElement(follow, "TrajectoryRef")
    trajectory = SubElement(
        reference, "Trajectory", name=f"{name_vehicle(number)}_course_{first}", closed="false"
    )
    line = SubElement(SubElement(trajectory, "Shape"), "Polyline")
    # A polyline has two vertices at least: a vehicle that is there for one step stays there.
    for step in range(first, max(last, first + 1) + 1):
        vertex = SubElement(line, "Vertex", time=_format_metres(step * scene.dt_s))
        _add_position(vertex, scene, number, min(step, last))
    SubElement(follow, "TrajectoryFollowingMode", followingMode="position")


def _add_time_trigger(parent: Element, kind: str, time_s: float) -> None:
    group = SubElement(SubElement(parent, kind), "ConditionGroup")
    condition = SubElement(group, "Condition")
    condition.attrib.update(name=f"time_{time_s:g}", delay="0", conditionEdge="none")
    value = SubElement(condition, "ByValueCondition")
    SubElement(
        value, "SimulationTimeCondition", value=_format_metres(time_s), rule="greaterOrEqual"
    )


def _make_road(road: StraightRoad, name: str) -> Element:
    root = Element("OpenDRIVE")
    SubElement(root, "header", revMajor="1", revMinor="7", name=name, version="1", vendor=PACKAGE)
    drawn = SubElement(
        root,
        "road",
        name=name,
        length=_format_metres(road.length_m),
        id="1",
        junction="-1",
        rule="RHT",
    )
    geometry = SubElement(
        SubElement(drawn, "planView"),
        "geometry",
        s="0",
        x=_format_metres(road.starts_x_m),
        y=_format_metres(road.left_edge_y_m),
        hdg="0",
        length=_format_metres(road.length_m),
    )
    SubElement(geometry, "line")
    lanes = SubElement(drawn, "lanes")
    # The reference line is the left edge, so that all lanes are on its right: -1 is the leftmost.
    for starts_m, count in _list_sections(road):
        section = SubElement(lanes, "laneSection", s=_format_metres(starts_m))
        centre = SubElement(SubElement(section, "center"), "lane", id="0", type="none")
        _add_mark(centre, "solid")
        right = SubElement(section, "right")
        for number in range(1, count + 1):
            lane = SubElement(right, "lane", id=str(-number), type="driving", level="false")
            _add_links(lane, road, number, starts_m)
            width = SubElement(lane, "width", sOffset="0", a=_format_metres(road.lane_width_m))
            width.attrib.update(b="0", c="0", d="0")
            _add_mark(lane, "solid" if number == count else "broken")
    return root


def _list_sections(road: StraightRoad) -> Iterator[tuple[float, int]]:
    """Yield where along the road a number of lanes begins [m], and that number."""
    yield 0.0, road.lanes
    end_m = road.lane_0_ends_x_m
    if end_m is not None and road.starts_x_m < end_m < road.ends_x_m and road.lanes > 1:
        yield end_m - road.starts_x_m, road.lanes - 1


def _add_links(lane: Element, road: StraightRoad, number: int, starts_m: float) -> None:
    sections = list(_list_sections(road))
    if len(sections) == 1 or number > sections[1][1]:
        return
    kind = "predecessor" if starts_m > 0.0 else "successor"
    SubElement(SubElement(lane, "link"), kind, id=str(-number))


def _add_mark(lane: Element, kind: str) -> None:
    mark = SubElement(lane, "roadMark", sOffset="0", type=kind, weight="standard", width="0.15")
    mark.set("color", "standard")


OPENSCENARIO = RecordingFormat(
    title="OpenSCENARIO",
    suffix=".zip",
    media_type="application/zip",
    write=write_open_scenario,
    has_controller=True,
)
