"""What a bridge does not report of contacts and ends, against what it shows."""

from typing import Any, ClassVar

import pytest

from eigenfail.cli.plugin_checks import CheckVerdict
from eigenfail.values.episode import EpisodeTask, Outcome, PriorSource
from eigenfail.values.scene import Control, Observation, VehicleState
from eigenfail_workers.bridge import checks

STEPS = 50
TASKS = [EpisodeTask(index, index + 1, PriorSource()) for index in range(3)]


class Through:
    """An ego at 20 m/s, and a car that stands 60 m ahead in its lane. It reports no collision."""

    ids: ClassVar[tuple[int | str, ...] | None] = ("far", "car")
    dt_s: ClassVar[float] = 0.1
    car_mps: ClassVar[float] = 0.0
    report_at: ClassVar[int | None] = None
    gone_from: ClassVar[int] = 99
    ends_at: ClassVar[int] = STEPS
    swaps: ClassVar[bool] = False
    road_m: ClassVar[float] = 60.0
    far_m: ClassVar[float] = 500.0

    def __init__(self, _asked: dict[str, Any]) -> None:
        self._step = 0

    def reset(self, _seed: int) -> Observation:
        self._step = 0
        return self._show()

    def step(self, _disturbances: tuple[float, ...]) -> Observation:
        self._step += 1
        return self._show()

    def _show(self) -> Observation:
        k = self._step
        at_s = k * self.dt_s
        ego = VehicleState(20.0 * at_s, 0.0, 0.0, 20.0, 5.0, 2.0)
        car = VehicleState(self.road_m + self.car_mps * at_s, 0.0, 0.0, self.car_mps, 5.0, 2.0)
        far = VehicleState(self.far_m + 20.0 * at_s, 3.5, 0.0, 20.0, 5.0, 2.0)
        others: tuple[VehicleState, ...] = (far,) if k >= self.gone_from else (far, car)
        if self.swaps and k % 2:
            others = others[::-1]
        begun = {} if k == 0 else {"perceived": (car.x_m, car.y_m), "control": Control(0.0, 0.0)}
        reported = k == self.report_at
        ids = None if self.ids is None else self.ids[: len(others)]
        return Observation(k, ego, others, reported, k == self.ends_at, ids=ids, **begun)


def run(serving, on_bridge, way: type[Through]):
    scenarios = [{"name": "cut_in", "dt_s": way.dt_s, "steps": STEPS, "parameters": {}}]
    with serving(way, scenarios=scenarios) as address:
        engine = on_bridge(
            address, scenario_parameters={"steps": STEPS, "dt_s": way.dt_s}, scene_every=1
        )
        return list(engine.run(TASKS))


def test_unreported_overlap_is_a_collision(serving, on_bridge) -> None:
    for result in run(serving, on_bridge, Through):
        assert result.outcome is Outcome.COLLISION
        assert result.measures.robustness_m == 0.0
        assert result.measures.severity == pytest.approx(400.0)
        # the fronts meet after 55 m, at 2 m a step: step 28 is the first that overlaps
        assert result.steps == 28
        assert result.measures.collided_s == pytest.approx(2.8)
        assert len(result.scene.vehicles) == 29


def test_contact_between_samples_is_a_collision(serving, on_bridge) -> None:
    class HeadOn(Through):
        dt_s = 0.5
        car_mps = -20.0
        road_m = 70.0  # 70, 50, 30, 10, -10: fronts meet at 5 m, and tails part at -5 m

    for result in run(serving, on_bridge, HeadOn):
        assert result.outcome is Outcome.COLLISION
        assert result.steps == 4
        assert result.measures.severity == pytest.approx(1600.0)
        ego, _far, car = result.scene.vehicles[-1]
        assert car[0] - ego[0] == pytest.approx(5.0, abs=1e-3)


def test_reported_collision_ends_the_episode_if_the_bridge_goes_on(serving, on_bridge) -> None:
    class GoesOn(Through):
        report_at = 28

    for result in run(serving, on_bridge, GoesOn):
        assert (result.outcome, result.steps) == (Outcome.COLLISION, 28)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"report_at": 5}, "a collision is reported, and the nearest vehicle, 2, is 45 m away"),
        ({"gone_from": 28}, "Vehicle 2 vanishes"),
        ({"ends_at": 10}, "ended after 10 of 50 steps"),
        ({"ids": None, "swaps": True, "far_m": -50.0}, "Vehicle 1 jumps across the ego"),
        ({"road_m": 3.0}, "starts in a collision"),
    ],
)
def test_contradiction_fails_the_episode(serving, on_bridge, changes, said) -> None:
    way = type("Contradicts", (Through,), changes)
    for result in run(serving, on_bridge, way):
        assert result.outcome is Outcome.ERRORED
        assert said in result.fault.message


def test_struck_vehicle_that_is_taken_away_is_put_back_for_its_collision(
    serving, on_bridge
) -> None:
    way = type("TakesAway", (Through,), {"gone_from": 28, "report_at": 28})
    for result in run(serving, on_bridge, way):
        assert result.outcome is Outcome.COLLISION
        assert result.measures.severity == pytest.approx(400.0)


def check(serving, way: type[Through]) -> dict[str, tuple[CheckVerdict, str]]:
    scenarios = [{"name": "cut_in", "dt_s": way.dt_s, "steps": STEPS, "parameters": {}}]
    with serving(way, scenarios=scenarios) as address:
        found = checks.check_bridge(address)
    return {each.check: (each.verdict, each.said) for each in found}


def test_doctor_names_unreported_contacts(serving) -> None:
    class Passes(Through):
        dt_s = 0.5
        car_mps = -20.0
        road_m = 70.0

    for way, name in ((Through, "ends at a collision"), (Passes, "reports each collision")):
        verdict, said = check(serving, way)[name]
        assert verdict is CheckVerdict.BROKEN
        assert "no collision is reported" in said
    far = type("Far", (Through,), {"report_at": 5, "ends_at": 5})
    assert check(serving, far)["reports each collision"][0] is CheckVerdict.BROKEN
