"""Lanes, kinds of vehicles and the ego's brakes, as a bridge shows them, in an episode."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec.msgpack import decode
from msgspec.msgpack import encode as pack

from eigenfail.errors import SimulatorError
from eigenfail.values.disturbance import POSITION
from eigenfail.values.episode import EpisodeTask, PriorSource
from eigenfail.values.scene import Scene
from eigenfail_services.store.codec import pack as pack_scene
from eigenfail_services.store.codec import to_scene
from eigenfail_workers import bridge
from eigenfail_workers.bridge.episode import ObservationReader
from eigenfail_workers.bridge.messages import SlotObservation, read_answer

GOLDEN = Path(bridge.__file__).parent / "golden"
STEPS = 5
EGO = (0.0, 0.0, 0.0, 20.0, 12.0, 2.5)
CARS = ((40.0, 0.0, 0.0, 20.0, 4.5, 1.8), (40.0, 4.0, 0.0, 10.0, 0.5, 0.5))
NEAR, FAR = ((0.0, -2.0), (50.0, -2.0), (90.0, 8.0)), ((0.0, 2.0), (90.0, 12.0))


def answer(**changes: object) -> bytes:
    """Observations of two slots, of which the first one is changed."""
    said = decode((GOLDEN / "observations_at_start.msgpack").read_bytes())
    said["slots"][0] |= changes
    return pack(said)


@pytest.fixture
def show(serving, on_bridge, minimal, monkeypatch):
    """Runs an episode of two vehicles, of which the reference bridge shows more in each step."""

    def run(*shown: dict[str, object], **changes: object):
        def decorate(step: int) -> dict[str, object]:
            return shown[min(step, len(shown) - 1)] if shown else {}

        plain = minimal.shown
        monkeypatch.setattr(
            minimal,
            "shown",
            lambda seen: plain(seen) | {"others": CARS} | decorate(seen.step),
        )
        with serving() as address:
            engine = on_bridge(
                address, scenario_parameters={"steps": STEPS}, scene_every=1, **changes
            )
            (result,) = engine.run([EpisodeTask(0, 7, PriorSource())])
        return result

    return run


def test_the_road_of_the_start_and_the_kinds_are_in_the_scene(show) -> None:
    kinds = ["car", "pedestrian"]
    result = show({"road": (NEAR, FAR), "kinds": kinds}, {"kinds": ["car", "hovercraft"]})
    assert result.fault is None
    assert [border.tolist() for border in result.scene.road] == [
        [list(point) for point in border] for border in (NEAR, FAR)
    ]
    assert result.scene.kinds == ("unknown", "car", "pedestrian")
    stored = to_scene(pack_scene(result.scene))
    assert stored.kinds == result.scene.kinds
    assert all(map(np.array_equal, stored.road, result.scene.road))


def test_the_brakes_of_the_start_judge_the_episode(show) -> None:
    assert show().measures.peak_braking_mps2 is None
    result = show({"peak_braking_mps2": 4.5}, {"peak_braking_mps2": 9.0})
    assert result.measures.peak_braking_mps2 == 4.5


def test_without_them_the_episode_is_the_same_and_its_scene_has_the_same_bytes(show) -> None:
    plain, decorated = show(), show({"road": (NEAR,), "kinds": ["car", "bus"]})
    assert plain.digest() == decorated.digest()
    scene = plain.scene
    assert (scene.road, scene.kinds) == (msgspec.UNSET, msgspec.UNSET)
    bare = {name: getattr(scene, name) for name in Scene.__struct_fields__[:5]}
    assert decode(pack_scene(scene)).keys() == bare.keys()
    stripped = msgspec.structs.replace(decorated.scene, road=msgspec.UNSET, kinds=msgspec.UNSET)
    assert pack_scene(stripped) == pack_scene(scene)


def test_a_road_that_comes_later_is_ignored(show) -> None:
    assert show({}, {"road": (NEAR,)}).scene.road is msgspec.UNSET


def test_a_kind_is_that_of_the_first_time_and_unknown_words_are_unknown(show) -> None:
    result = show({}, {"kinds": ["hovercraft", "van"]}, {"kinds": ["car", "bus"]})
    assert result.scene.kinds == ("unknown", "unknown", "van")


def test_kinds_for_some_vehicles_alone_are_the_simulators_fault(show) -> None:
    result = show({"kinds": ["car"]})
    assert result.fault.kind == "simulator"
    assert "The 2 other vehicles have 1 kinds." in result.fault.message


def test_vehicles_that_come_and_go_keep_their_kinds() -> None:
    reader = ObservationReader(POSITION, 0.1)
    reader.read(SlotObservation(0, EGO, CARS[:1], ids=("a",), kinds=("truck",)), ())
    both = SlotObservation(1, EGO, CARS[::-1], ids=("b", "a"), kinds=("bicycle", "car"))
    reader.read(both, (0.0, 0.0))
    reader.read(SlotObservation(2, EGO, CARS[1:], ids=("b",), kinds=("bicycle",)), (0.0, 0.0))
    nothing = np.zeros((0, 2), np.float32)
    scene = Scene(0.1, np.zeros((3, 3, 4), np.float32), np.ones((3, 2)), nothing, nothing)
    assert reader.complete_scene(scene).kinds == ("unknown", "truck", "bicycle")


NAN, LINE = float("nan"), [[0.0, 0.0], [1.0, 0.0]]
BENT_ROADS = {
    "NaN": [[[0.0, NAN], [1.0, 0.0]]],
    "infinity": [[[0.0, 0.0], [float("inf"), 0.0]]],
    "too far": [[[0.0, 0.0], [2e9, 0.0]]],
    "one point": [[[0.0, 0.0]]],
    "no point": [[]],
    "three numbers": [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]],
    "flat": LINE,
    "text": "straight",
    "points of text": [["a", "b"]],
    "map": {"borders": [LINE]},
    "too many borders": [LINE] * 65,
    "too many points": [[[0.0, 0.0]] * 2_001],
    "too many points together": [[[0.0, 0.0]] * 1_001] * 2,
}
BENT_KINDS = {
    "text": "car",
    "number": [1],
    "truth value": [True],
    "nil": [None],
    "bytes": [b"car"],
    "list": [["car"]],
    "map": {"car": 1},
    "empty text": [""],
    "long text": ["x" * 201],
    "crowd": ["car"] * 257,
}


@pytest.mark.fault("malformed, nested or false answers of a bridge")
@pytest.mark.parametrize(
    ("key", "value"),
    [("road", value) for value in BENT_ROADS.values()]
    + [("kinds", value) for value in BENT_KINDS.values()],
    ids=[*(f"road: {name}" for name in BENT_ROADS), *(f"kinds: {name}" for name in BENT_KINDS)],
)
def test_a_bent_road_or_kind_is_the_fault_of_its_slot_alone(key, value) -> None:
    first, second = read_answer(answer(**{key: value})).slots
    assert first.fault == "simulator"
    assert ("cannot be read" in first.message) or ("2000 are the most" in first.message)
    assert second.fault is None


def test_the_largest_road_is_read() -> None:
    border = [[float(x), 0.0] for x in range(1_000)]
    assert len(read_answer(answer(road=[border, border])).slots[0].road) == 2


def test_a_wrong_number_of_kinds_is_found_at_the_start() -> None:
    reader = ObservationReader(POSITION, 0.1)
    with pytest.raises(SimulatorError, match="have 3 kinds"):
        reader.read(SlotObservation(0, EGO, CARS, kinds=("car",) * 3), ())
