"""Files of episodes, read back by the libraries of their formats: poses, and validity."""

import io
import json
from importlib.metadata import files
from math import atan2, cos, sin
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZipFile

import jsonschema
import numpy as np
from lxml import etree
from mcap.reader import make_reader
from mcap.well_known import MessageEncoding
from mcap_protobuf.decoder import DecoderFactory
from scenariogeneration.xosc import ParseOpenScenario

Poses = dict[str, dict[float, tuple[float, float, float]]]
"""By vehicle and time [s]: x [m], y [m] and heading [rad] of the centre of its footprint."""

SCHEMAS = {
    path.name: Path(path.locate()) for path in files("scenariogeneration") if path.suffix == ".xsd"
}
"""The schemas of ASAM that come with scenariogeneration."""


def unpack(archive: bytes) -> dict[str, bytes]:
    """The files of an archive by name."""
    with ZipFile(io.BytesIO(archive)) as opened:
        return {name: opened.read(name) for name in opened.namelist()}


def list_violations(document: bytes, schema: str) -> list[str]:
    """What is wrong with an XML document by a schema of ASAM."""
    checker = etree.XMLSchema(etree.parse(str(SCHEMAS[schema])))
    checker.validate(etree.fromstring(document))
    return [str(error) for error in checker.error_log]


def parse_scenario(document: bytes):
    """A scenario as scenariogeneration reads it."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "scenario.xosc")
        path.write_bytes(document)
        return ParseOpenScenario(str(path))


def list_events(scenario):
    """Each event of a scenario with the name of its actor."""
    for act in scenario.storyboard.stories[0].acts:
        for group in act.maneuvergroup:
            for maneuver in group.maneuvers:
                for event in maneuver.events:
                    yield group.actors.actors[0].entity, event


def read_scenario(archive: bytes) -> Poses:
    """The trajectories of a scenario, of the centres of the vehicles' bounding boxes."""
    scenario = parse_scenario(unpack(archive)["scenario.xosc"])
    ahead_m = {
        each.name: each.entityobject.boundingbox.center.x
        for each in scenario.entities.scenario_objects
    }
    poses: Poses = {}
    for name, event in list_events(scenario):
        for action in event.action:
            line = getattr(getattr(action.action, "trajectory", None), "shapes", None)
            if line is None:
                continue
            for time_s, place in zip(line.time, line.positions, strict=True):
                x_m = place.x + ahead_m[name] * cos(place.h)
                y_m = place.y + ahead_m[name] * sin(place.h)
                poses.setdefault(name, {})[round(time_s, 6)] = (x_m, y_m, place.h)
    return poses


class JsonDecoderFactory:
    """Decodes messages of JSON, and holds them against their schema."""

    def decoder_for(self, encoding, schema):
        if encoding != MessageEncoding.JSON:
            return None
        checker = jsonschema.Draft202012Validator(json.loads(schema.data))

        def decode(data):
            message = json.loads(data)
            checker.validate(message)
            return message

        return decode


def list_messages(log: bytes):
    """Topic, schema, time [ns] and decoded message of each message of a log."""
    reader = make_reader(
        io.BytesIO(log), decoder_factories=[DecoderFactory(), JsonDecoderFactory()]
    )
    for schema, channel, message, decoded in reader.iter_decoded_messages():
        yield channel.topic, schema, message.log_time, decoded


def read_log(log: bytes) -> Poses:
    """The poses of an MCAP log, by its transforms."""
    poses: Poses = {}
    for topic, _schema, at_ns, message in list_messages(log):
        for each in message.transforms if topic == "/tf" else ():
            turn, place = each.rotation, each.translation
            heading_rad = 2.0 * atan2(turn.z, turn.w)
            pose = (place.x, place.y, heading_rad)
            poses.setdefault(each.child_frame_id, {})[round(at_ns * 1e-9, 6)] = pose
    return poses


def measure_error_m(scene, poses: Poses) -> float:
    """Largest distance between where a vehicle was and where a file has it. [m]

    Raises:
        AssertionError: a pose is missing from the file, or is one too many.
    """
    worst_m = 0.0
    for number in range(len(scene.sizes)):
        found = poses.get(f"vehicle_{number}" if number else "ego", {})
        there = np.isfinite(scene.vehicles[:, number, :3]).all(axis=1)
        times = [round(int(step) * scene.dt_s, 6) for step in np.flatnonzero(there)]
        assert sorted(found) == times, f"vehicle {number}: poses at {sorted(found)}, not {times}"
        for time_s, truth in zip(times, scene.vehicles[there, number].astype(float), strict=True):
            x_m, y_m, _ = found[time_s]
            worst_m = max(worst_m, float(np.hypot(x_m - truth[0], y_m - truth[1])))
    return worst_m
