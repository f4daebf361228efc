"""Whole drives out of a ramp and behind a braking car: calm undisturbed, and with noise."""

from collections.abc import Callable
from itertools import product

import msgspec
import numpy as np
import pytest

from eigenfail import plugins
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import (
    EpisodeResult,
    EpisodeSetup,
    EpisodeTask,
    PriorSource,
    TrajectorySource,
)
from eigenfail.values.proof import ExplainedEpisode
from eigenfail_workers.engine import Engine
from eigenfail_workers.explain import explain

CALM = EpisodeTask(0, 0, TrajectorySource(np.zeros((0, 2), np.float32)))
RAMP_M = 350.0
TRUCK_M = 16.0
CAR_M = 5.0


def setup(scenario: str, planner: str, simulator: str = "point_mass", **parameters: float):
    return EpisodeSetup(simulator, scenario, parameters, planner, {}, DisturbanceModel(), 1)


def levels(scenario: str) -> dict[str, tuple[float, float, float]]:
    """Smallest, default and largest value of each parameter."""
    kind = plugins.load(plugins.SCENARIOS, scenario).Parameters
    (schema,) = msgspec.json.schema(kind)["$defs"].values()
    return {
        name: (field["minimum"], field["default"], field["maximum"])
        for name, field in schema["properties"].items()
    }


def corners(scenario: str) -> list[dict[str, float]]:
    """All combinations of extremes, and each extreme alone."""
    grid = levels(scenario)
    ends = [(low, high) for low, _, high in grid.values()]
    every = [dict(zip(grid, values, strict=True)) for values in product(*ends)]
    alone = [{name: end} for name, (low, _, high) in grid.items() for end in (low, high)]
    return [{}, *alone, *every]


def has_merged(result: EpisodeResult) -> bool:
    return bool(result.scene.vehicles[-1, 0, 1] > 2.5)


def never_left_the_road(result: EpisodeResult, ramp_m: float) -> bool:
    x, y = result.scene.vehicles[:, 0, 0], result.scene.vehicles[:, 0, 1]
    return bool(np.all((y > 1.75) | (x < TRUCK_M / 2 + ramp_m)) and np.all(np.abs(y - 1.75) < 2.5))


@pytest.fixture(scope="session")
def drive() -> Callable[..., EpisodeResult]:
    def run(scenario: str, planner: str, **parameters: float) -> EpisodeResult:
        engine = Engine(setup(scenario, planner, **parameters))
        (result,) = engine.run([CALM])
        engine.close()
        assert result.fault is None, result.fault
        return result

    return run


@pytest.fixture(scope="session")
def merge() -> ExplainedEpisode:
    """The default merge, undisturbed, on the real simulator."""
    return explain(setup("merge_in", "rulebook", "highway"), CALM)


def test_at_the_defaults_the_baseline_waits_until_both_cars_have_passed():
    result = explain(setup("merge_in", "idm", "highway"), CALM).result
    assert not result.is_failure
    y, x = result.scene.vehicles[:, 0, 1], result.scene.vehicles[:, :, 0]
    assert np.all(x[y > 0.5, 1:] > x[y > 0.5, :1] + (TRUCK_M + CAR_M) / 2)
    assert y[-1] > 0.5


def test_nobody_drives_beside_the_rulebook_in_the_default_merge(merge):
    x_m = merge.result.scene.vehicles[:, :, 0]
    assert np.all(np.abs(x_m[:, 1:] - x_m[:, :1]) > (TRUCK_M + CAR_M) / 2)


@pytest.mark.parametrize("scenario", ["cut_in", "lead_brake", "merge_in"])
def test_noise_moves_the_robustness_of_the_rulebook(scenario):
    """A search that is guided by a constant has no guide."""
    robustness = {r.measures.robustness_m for r in episodes("rulebook", 10, scenario)}
    assert len(robustness) >= 5


@pytest.mark.parametrize("parameters", corners("merge_in"), ids=str)
def test_undisturbed_the_rulebook_leaves_the_ramp_calmly_or_waits(drive, parameters):
    result = drive("merge_in", "rulebook", **parameters)
    acceleration = result.scene.controls[:, 0]
    assert not result.is_failure
    assert never_left_the_road(result, parameters.get("ramp_m", RAMP_M))
    assert acceleration.min() > -2.5
    assert np.abs(np.diff(acceleration)).max() <= 0.4 + 1e-6
    assert has_merged(result) or result.scene.vehicles[-1, 0, 3] < 18.0


@pytest.mark.parametrize("parameters", corners("merge_in"), ids=str)
def test_undisturbed_the_baseline_leaves_the_ramp_safely_or_waits(drive, parameters):
    result = drive("merge_in", "idm", **parameters)
    assert not result.is_failure
    assert never_left_the_road(result, parameters.get("ramp_m", RAMP_M))


@pytest.mark.parametrize("planner", ["rulebook", "idm"])
@pytest.mark.parametrize("parameters", corners("lead_brake"), ids=str)
def test_undisturbed_a_braking_lead_is_no_danger(drive, planner, parameters):
    result = drive("lead_brake", planner, **parameters)
    assert not result.is_failure
    assert result.measures.robustness_m > 4.0
    if planner == "rulebook":
        acceleration = result.scene.controls[:, 0]
        assert acceleration.min() > -3.0
        assert np.abs(np.diff(acceleration)).max() <= 0.4 + 1e-6


def test_the_default_merge_ends_on_the_main_lane_between_the_two_cars(merge):
    ego, first, second = merge.result.scene.vehicles[-1]
    assert ego[1] == pytest.approx(3.5, abs=0.1)
    assert second[0] < ego[0] < first[0]
    assert ego[2] == pytest.approx(0.0, abs=0.01)


def test_every_step_of_it_is_explained(merge):
    accounts = [step.account for step in merge.steps]
    assert {account["override"] for account in accounts} == {"none"}
    assert {account["qp_status"] for account in accounts} == {"solved"}
    on_ramp = [account for account in accounts if "phase" in account]
    phases = list(dict.fromkeys(account["phase"] for account in on_ramp))
    assert phases == ["approaching", "changing", "in_lane"]
    order = list(dict.fromkeys(account["candidate"] for account in accounts))
    assert order[:2] == ["keep", "merge_early"]
    chosen = [account for account in on_ramp if account["candidate"] == "merge_early"]
    assert all({"ahead_m", "behind_m", "lane_end_m"} <= account.keys() for account in chosen)


def test_it_comes_over_smoothly(merge):
    y = merge.result.scene.vehicles[:, 0, 1].astype(float)
    speed = np.diff(y) / 0.1
    assert speed.min() > -0.1
    assert speed.max() < 1.5
    assert y.max() < 3.6
    yaw = np.diff(merge.result.scene.vehicles[:, 0, 2].astype(float)) / 0.1
    assert np.abs(yaw * merge.result.scene.vehicles[1:, 0, 3]).max() < 1.0  # [m/s²]


def episodes(planner: str, count: int, scenario: str = "merge_in") -> list[EpisodeResult]:
    engine = Engine(setup(scenario, planner))
    tasks = [EpisodeTask(index, 1000 + index, PriorSource()) for index in range(count)]
    results = list(engine.run(tasks))
    engine.close()
    return results


def test_with_noise_the_rulebook_merges_and_hits_nobody():
    results = episodes("rulebook", 15)
    assert not any(result.is_failure for result in results)
    assert np.mean([has_merged(result) for result in results]) >= 0.9


def test_with_noise_one_wrong_look_is_enough_for_the_baseline(drive):
    assert not drive("merge_in", "idm").is_failure
    share = np.mean([result.is_failure for result in episodes("idm", 60)])
    assert 0.1 <= share <= 0.4
