"""Small worlds for the tests of the workers: a short cut-in, simple drivers."""

from collections.abc import Callable, Iterator
from math import atan2, hypot
from typing import Any

import msgspec
import numpy as np
import pytest

from eigenfail import plugins
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import EpisodeSetup
from eigenfail.values.scene import Control, Mission, Perception, VehicleState
from eigenfail_workers.engine import Engine

STEPS = 60
DT_S = 0.1
CHANGE_BEGINS_S = 0.05


class SmallCutIn:
    """A slower car moves into the truck's lane; a third one stays behind in the other lane."""

    class Parameters(msgspec.Struct, frozen=True):
        gap_m: float = 30.0
        slower_mps: float = 8.0
        sway_m: float = 0.0

    class Staged(msgspec.Struct, frozen=True):
        mission: Mission
        steps: int
        ego: VehicleState
        actors: tuple[VehicleState, ...]

        def move_actor(self, actor: int, step: int, ego: VehicleState) -> VehicleState:
            start, time_s = self.actors[actor], step * DT_S
            begun_s = max(time_s - CHANGE_BEGINS_S, 0.0) if actor == 0 else 0.0
            drift = -0.9 if actor == 0 and time_s >= CHANGE_BEGINS_S and begun_s < 3.5 else 0.0
            return msgspec.structs.replace(
                start,
                x_m=start.x_m + start.speed_mps * time_s,
                y_m=start.y_m - 0.9 * min(begun_s, 3.5),
                heading_rad=atan2(drift, start.speed_mps),
                speed_mps=hypot(drift, start.speed_mps),
            )

    def __call__(self, parameters: Parameters, seed: int) -> "SmallCutIn.Staged":
        sway = parameters.sway_m * (seed % 7) / 7.0
        ahead = VehicleState(10.5 + parameters.gap_m + sway, 3.5, 0.0, 20.0, 5.0, 2.0)
        ahead = msgspec.structs.replace(ahead, speed_mps=20.0 - parameters.slower_mps)
        behind = VehicleState(-60.0, 3.5, 0.0, 18.0, 5.0, 2.0)
        return self.Staged(
            mission=Mission(DT_S, 2, 3.5, 25.0, 20.0, 500.0),
            steps=STEPS,
            ego=VehicleState(0.0, 0.0, 0.0, 20.0, 16.0, 2.5),
            actors=(ahead, behind),
        )


class NoActors(SmallCutIn):
    """Nobody is there."""

    def __call__(self, parameters: SmallCutIn.Parameters, seed: int) -> SmallCutIn.Staged:
        return msgspec.structs.replace(super().__call__(parameters, seed), actors=())


class Nervous:
    """Brakes the harder the nearer the other seems: every bit of what is perceived shows."""

    class Settings(msgspec.Struct, frozen=True):
        braking_mps2: float = 2.0

    def __init__(self, settings: Settings) -> None:
        self.settings = settings

    def reset(self, mission: Mission) -> None:
        self.smooth = 0.0

    def act(self, perception: Perception) -> Control:
        other = perception.others[0]
        gap = max(other.x_m - perception.ego.x_m - 10.5, 1.0)
        self.smooth += 0.3 * (abs(other.y_m) - self.smooth)
        share = 1.0 if self.smooth < 2.5 else 0.1
        return Control(-self.settings.braking_mps2 * share * min(20.0 / gap, 2.0), 0.0)


class Faulty(Nervous):
    """Answers with `wrong()` in the fifth step of every second episode that it is reset for."""

    episodes = 0

    @staticmethod
    def wrong() -> Any:
        raise ZeroDivisionError("on purpose")

    def reset(self, mission: Mission) -> None:
        super().reset(mission)
        type(self).episodes += 1
        self.steps = 0

    def act(self, perception: Perception) -> Control:
        self.steps += 1
        if self.steps == 5 and self.episodes % 2 == 0:
            return self.wrong()
        return super().act(perception)


@pytest.fixture
def small_cut_in() -> SmallCutIn:
    return SmallCutIn()


@pytest.fixture
def nervous() -> type[Nervous]:
    return Nervous


@pytest.fixture
def faulty() -> Callable[[Callable[[], Any]], type[Faulty]]:
    """A planner class that now and then answers with what `wrong` returns or raises."""
    return lambda wrong: type("Faulty", (Faulty,), {"wrong": staticmethod(wrong), "episodes": 0})


@pytest.fixture
def plug_in(monkeypatch: pytest.MonkeyPatch) -> Callable[[str, str, Any], None]:
    """Adds a plug-in to a group for one test."""
    added: dict[tuple[str, str], Any] = {}
    load = plugins.load
    monkeypatch.setattr(
        plugins, "load", lambda group, name: added.get((group, name)) or load(group, name)
    )

    def add(group: str, name: str, thing: Any) -> None:
        added[group, name] = thing

    return add


@pytest.fixture
def make_engine(
    plug_in: Callable[[str, str, Any], None],
) -> Iterator[Callable[..., Engine]]:
    """Engines on the small cut-in; the nervous planner drives unless another one is given."""
    engines: list[Engine] = []
    plug_in(plugins.SCENARIOS, "small", SmallCutIn)
    plug_in(plugins.SCENARIOS, "empty", NoActors)

    def make(planner: type = Nervous, **changes: Any) -> Engine:
        plug_in(plugins.PLANNERS, "driver", planner)
        setup = EpisodeSetup("point_mass", "small", {}, "driver", {}, DisturbanceModel())
        engines.append(Engine(msgspec.structs.replace(setup, **changes)))
        return engines[-1]

    yield make
    for engine in engines:
        engine.close()


class Steady(Nervous):
    """Answers the same control whatever it sees."""

    class Settings(msgspec.Struct, frozen=True):
        acceleration_mps2: float = 0.0
        steering_rad: float = 0.0

    def act(self, perception: Perception) -> Control:
        return Control(self.settings.acceleration_mps2, self.settings.steering_rad)


@pytest.fixture
def steady() -> type[Steady]:
    return Steady


def corners(vehicle: VehicleState) -> np.ndarray:
    """The corners of a footprint as complex numbers, in order around it."""
    half = 0.5 * (vehicle.length_m + 1j * vehicle.width_m)
    around = np.array([half, -half.conjugate(), -half, half.conjugate()])
    return vehicle.x_m + 1j * vehicle.y_m + around * np.exp(1j * vehicle.heading_rad)


def to_edges(points: np.ndarray, polygon: np.ndarray) -> float:
    """The smallest distance from points to the edges of a polygon."""
    begin, along = polygon, np.roll(polygon, -1) - polygon
    offset = points[:, None] - begin
    share = np.clip((offset * along.conjugate()).real / np.abs(along) ** 2, 0.0, 1.0)
    return float(np.abs(offset - share * along).min())


def inside(points: np.ndarray, polygon: np.ndarray) -> bool:
    along = np.roll(polygon, -1) - polygon
    turned = ((points[:, None] - polygon) * along.conjugate()).imag
    return bool(np.any(np.all(turned >= 0.0, axis=1) | np.all(turned <= 0.0, axis=1)))


def edges_cross(a: np.ndarray, b: np.ndarray) -> bool:
    def side(points: np.ndarray, begin: complex, end: complex) -> np.ndarray:
        return np.sign(((points - begin) * (end - begin).conjugate()).imag)

    for p, q in zip(a, np.roll(a, -1), strict=True):
        for r, s in zip(b, np.roll(b, -1), strict=True):
            first = side(np.array([r, s]), p, q)
            second = side(np.array([p, q]), r, s)
            if first[0] * first[1] < 0 and second[0] * second[1] < 0:
                return True
    return False


@pytest.fixture
def edge_distance() -> Callable[[VehicleState, VehicleState], float]:
    """The distance of two footprints by all their edges: slow, and unlike the one it checks."""

    def distance(a: VehicleState, b: VehicleState) -> float:
        one, other = corners(a), corners(b)
        if inside(one, other) or inside(other, one) or edges_cross(one, other):
            return 0.0
        return min(to_edges(one, other), to_edges(other, one))

    return distance
