"""An explained episode is the episode, with the planner's account beside the truth."""

import msgspec
import numpy as np
import pytest

from eigenfail import plugins
from eigenfail.values import (
    Control,
    DisturbanceModel,
    EpisodeSetup,
    EpisodeTask,
    Outcome,
    PriorSource,
    TrajectorySource,
)
from eigenfail_workers.engine import Engine
from eigenfail_workers.explain import explain
from eigenfail_workers.planners.rulebook.rules import HIERARCHY, UNOPPOSED

STEPS = 100
SIGN = np.where((np.arange(STEPS) // 20) % 2 == 0, 2.0, -2.0)
WAVE = TrajectorySource(np.stack([SIGN, 0.0 * SIGN], axis=1).astype(np.float32))


def setup(planner="rulebook", simulator="highway"):
    return EpisodeSetup(simulator, "cut_in", {}, planner, {}, DisturbanceModel(), 50)


@pytest.fixture
def plugged(monkeypatch):
    """Registers a planner class for one test."""
    load = plugins.load

    def add(planner):
        def find(group, name):
            return planner if name == "mine" else load(group, name)

        monkeypatch.setattr(plugins, "load", find)
        return setup("mine", "point_mass")

    return add


class Plain:
    class Settings(msgspec.Struct, frozen=True):
        pass

    def __init__(self, settings):
        self.steps = 0

    def reset(self, mission):
        self.steps = 0

    def act(self, perception):
        self.steps += 1
        return Control(-0.25, 0.0)


@pytest.fixture(scope="module")
def crash():
    return explain(setup(), EpisodeTask(7, 3, WAVE))


@pytest.mark.parametrize("planner", ["rulebook", "idm"])
@pytest.mark.parametrize("source", [WAVE, PriorSource()])
def test_explaining_changes_nothing(planner, source):
    task = EpisodeTask(7, 3, source)
    (plain,) = Engine(setup(planner)).run([task])
    explained = explain(setup(planner), task)
    assert explained.result.digest() == plain.digest()
    assert len(explained.steps) == plain.steps


def test_every_step_of_the_rulebook_is_accounted_for(crash):
    assert crash.result.outcome is Outcome.COLLISION
    rules = {rule.name for rule in HIERARCHY} | {UNOPPOSED}
    for step in crash.steps:
        account = step.account
        assert account["mode"] == "highway"
        assert account["override"] in {"none", "emergency_brake"}
        assert account["candidate"] in {"keep", "hold", "slow", "follow"}
        assert account["rule"] in rules
        assert account["qp_status"] == "solved"
        assert ("gap_m" in account) == (account["heeds"] != "nobody")
        assert all(type(value) in {str, float} for value in account.values())
    assert {step.account["heeds"] for step in crash.steps} == {"nobody", "neighbour", "lead"}
    assert crash.steps[-1].account["lost_tracks"] == 2.0


def test_the_belief_stands_beside_the_truth(crash):
    """A track is born with the truck's own speed, and learns the true one before it is lost."""
    assert crash.steps[0].gap_m == pytest.approx(94.0)
    assert crash.steps[0].closing_mps == pytest.approx(11.5)
    learnt, reborn = crash.steps[20], crash.steps[32]
    assert learnt.account["closing_mps"] == pytest.approx(learnt.closing_mps, abs=0.5)
    assert reborn.account["lost_tracks"] == 1.0
    assert reborn.account["closing_mps"] < 1.0
    assert reborn.closing_mps > 10.0


def test_controls_noise_and_times_are_those_of_the_episode(crash):
    controls = [(step.acceleration_mps2, step.steering_rad) for step in crash.steps]
    assert np.allclose(controls, crash.result.scene.controls, atol=1e-6)
    assert np.array_equal([step.disturbance for step in crash.steps], crash.result.noise.z)
    assert np.allclose([step.time_s for step in crash.steps], 0.1 * np.arange(len(crash.steps)))


def test_a_planner_without_an_account_is_not_asked(plugged):
    explained = explain(plugged(Plain), EpisodeTask(0, 0, PriorSource()))
    assert {len(step.account) for step in explained.steps} == {0}
    assert {step.acceleration_mps2 for step in explained.steps} == {-0.25}


def test_what_is_not_a_number_becomes_text(plugged):
    class Talkative(Plain):
        def explain(self):
            return {"steps": self.steps, "share": np.float64(0.5), "seen": ("car", 2), "new": None}

    explained = explain(plugged(Talkative), EpisodeTask(0, 0, PriorSource()))
    first = {"steps": 1.0, "share": 0.5, "seen": "('car', 2)", "new": "None"}
    assert explained.steps[0].account == first


def test_an_account_that_raises_is_the_planner_s_fault(plugged):
    class Silent(Plain):
        def explain(self):
            raise KeyError("lead")

    result = explain(plugged(Silent), EpisodeTask(0, 0, PriorSource())).result
    assert result.fault.kind == "planner"
    assert "account" in result.fault.message


def test_an_episode_that_breaks_off_is_explained_up_to_there(plugged):
    class Tires(Plain):
        def act(self, perception):
            if perception.time_s > 2.95:
                raise ZeroDivisionError
            return super().act(perception)

        def explain(self):
            return {"mode": "awake"}

    explained = explain(plugged(Tires), EpisodeTask(0, 0, PriorSource()))
    assert explained.result.outcome is Outcome.ERRORED
    assert len(explained.steps) == 30
    assert {(step.account["mode"], step.gap_m) for step in explained.steps} == {("awake", None)}


def test_the_path_of_the_rulebook_leads_ahead_from_where_the_truck_is(crash):
    for step, scene in zip(crash.steps, crash.result.scene.vehicles, strict=False):
        path = np.array(step.path)
        assert path.shape == (11, 2)
        assert path[0] == pytest.approx(scene[0, :2], abs=1e-3)
        assert np.all(np.diff(path[:, 0]) >= 0.0)
        assert path[1:, 1] == pytest.approx(np.zeros(10), abs=1e-9)


def test_the_path_of_a_change_of_lane_crosses_the_road():
    calm = TrajectorySource(np.zeros((1, 2), np.float32))
    merge = EpisodeSetup("highway", "merge_in", {}, "rulebook", {}, DisturbanceModel(), 50)
    steps = explain(merge, EpisodeTask(0, 1, calm)).steps
    across = [step.path[-1][1] - step.path[0][1] for step in steps]
    changing = [
        y for y, step in zip(across, steps, strict=True) if step.account.get("phase") == "changing"
    ]
    assert max(changing) > 2.0
    assert across[0] == pytest.approx(0.0, abs=0.1)


def test_a_planner_without_a_path_is_not_asked(plugged):
    explained = explain(plugged(Plain), EpisodeTask(0, 0, PriorSource()))
    assert {step.path for step in explained.steps} == {()}


def test_a_long_path_is_told_in_twenty_points_with_its_ends(plugged):
    class Farsighted(Plain):
        def path(self):
            return [(float(n), 0.5) for n in range(1001)]

    path = explain(plugged(Farsighted), EpisodeTask(0, 0, PriorSource())).steps[0].path
    assert len(path) == 20
    assert (path[0], path[-1]) == ((0.0, 0.5), (1000.0, 0.5))


def test_a_path_that_raises_is_the_planner_s_fault(plugged):
    class Lost(Plain):
        def path(self):
            raise KeyError("lane")

    result = explain(plugged(Lost), EpisodeTask(0, 0, PriorSource())).result
    assert result.fault.kind == "planner"
    assert "path" in result.fault.message
