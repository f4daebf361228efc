"""An explained episode is the episode, with the planner's account beside the truth."""

import re
import tomllib
from pathlib import Path

import msgspec
import numpy as np
import pytest

from eigenfail import plugins
from eigenfail.explanations import tell_story
from eigenfail.testing.scenario import are_apart
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import (
    EpisodeSetup,
    EpisodeTask,
    Outcome,
    PriorSource,
    TrajectorySource,
)
from eigenfail.values.scene import Control, VehicleState
from eigenfail.worlds import resolve_disturbance
from eigenfail_workers.engine import Engine
from eigenfail_workers.explain import explain
from eigenfail_workers.planners.rulebook.rules import HIERARCHY, UNOPPOSED

STEPS = 100
SIGN = np.where((np.arange(STEPS) // 20) % 2 == 0, 2.0, -2.0)
WAVE = TrajectorySource(np.stack([SIGN, 0.0 * SIGN], axis=1).astype(np.float32))


def setup(planner="rulebook", simulator="highway"):
    return EpisodeSetup(simulator, "cut_in", {}, planner, {}, DisturbanceModel(), 50)


@pytest.fixture
def plugged(plug_in):
    """Registers a planner class for one test."""

    def add(planner):
        plug_in(plugins.PLANNERS, "mine", planner)
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


def test_a_planner_without_an_account_or_a_path_is_not_asked(plugged):
    explained = explain(plugged(Plain), EpisodeTask(0, 0, PriorSource()))
    assert {len(step.account) for step in explained.steps} == {0}
    assert {step.path for step in explained.steps} == {()}
    assert {step.acceleration_mps2 for step in explained.steps} == {-0.25}


def test_what_is_not_a_number_becomes_text(plugged):
    class Talkative(Plain):
        def explain(self):
            return {"steps": self.steps, "share": np.float64(0.5), "seen": ("car", 2), "new": None}

    explained = explain(plugged(Talkative), EpisodeTask(0, 0, PriorSource()))
    first = {"steps": 1.0, "share": 0.5, "seen": "('car', 2)", "new": "None"}
    assert explained.steps[0].account == first


@pytest.mark.parametrize(("asked", "named"), [("explain", "account"), ("path", "path")])
def test_an_account_or_path_that_raises_is_the_planner_s_fault(plugged, asked, named):
    def fail(_planner):
        raise KeyError("lead")

    planner = type("Silent", (Plain,), {asked: fail})
    result = explain(plugged(planner), EpisodeTask(0, 0, PriorSource())).result
    assert result.fault.kind == "planner"
    assert named in result.fault.message


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


def test_a_long_path_is_told_in_twenty_points_with_its_ends(plugged):
    class Farsighted(Plain):
        def path(self):
            return [(float(n), 0.5) for n in range(1001)]

    path = explain(plugged(Farsighted), EpisodeTask(0, 0, PriorSource())).steps[0].path
    assert len(path) == 20
    assert (path[0], path[-1]) == ((0.0, 0.5), (1000.0, 0.5))


DRIVE = Path(__file__).parents[2] / "examples" / "highway_drive.toml"
DRIVE_STEPS, HELD = 450, 5
SPAN = r"(?:At (?P<at>[\d.]+) s|From (?P<since>[\d.]+) s to (?P<until>[\d.]+) s)"
OFTEN = r"(?:, (?P<times>\d+) times and (?P<steps>\d+) steps in all,)?"


@pytest.fixture(scope="module", params=[1, 2, 3, 4, 7, 13, 16])
def drive(request):
    """A drive among several vehicles that ends in a collision, under noise that is held."""
    spec = msgspec.convert(tomllib.loads(DRIVE.read_text()), CampaignSpec)
    channels = len(resolve_disturbance(spec.setup()).list_channels())
    random = np.random.default_rng(request.param)
    z = random.uniform(-3.0, 3.0, (DRIVE_STEPS // HELD, channels)).repeat(HELD, axis=0)
    source = TrajectorySource(z.astype(np.float32))
    found = explain(spec.setup(), EpisodeTask(request.param, request.param, source))
    assert found.result.outcome is Outcome.COLLISION
    return found


class StoredTruth:
    """What the stored scene of a drive says, worked out apart from the product."""

    def __init__(self, episode):
        self.episode, self.scene = episode, episode.result.scene
        self.steps = episode.steps

    def places(self, told):
        """The steps that a sentence is about."""
        since, until = (told["at"] or told["since"], told["at"] or told["until"])
        return [
            n
            for n, step in enumerate(self.steps)
            if since <= f"{step.time_s:.1f}"
            and float(since) - 0.05 < step.time_s < float(until) + 0.05
        ]

    def vehicle(self, step, number):
        return VehicleState(
            *map(float, self.scene.vehicles[step, number]), *map(float, self.scene.sizes[number])
        )

    def gap_m(self, step, number):
        ego, other = self.vehicle(step, 0), self.vehicle(step, number)
        return (other.x_m - 0.5 * other.length_m) - (ego.x_m + 0.5 * ego.length_m)

    def closing_mps(self, step, number):
        """Change of the gap, from the positions of both sides of the step."""
        return (self.gap_m(step, number) - self.gap_m(step + 1, number)) / self.scene.dt_s

    def is_there(self, step, number):
        return bool(np.isfinite(self.scene.vehicles[step, number]).all())

    def check_loss(self, told):
        step, number = self.places(told)[-1], int(told["vehicle"])
        assert str(number) in self.steps[step].account["lost_vehicles"].split()
        if told["gap"] is None:
            assert not self.is_there(step, number)
        else:
            assert float(told["gap"]) == pytest.approx(self.gap_m(step, number), abs=0.51)
            assert float(told["closing"]) == pytest.approx(self.closing_mps(step, number), abs=0.4)

    def check_blindness(self, told):
        number = int(told["vehicle"])
        blind = [n for n in self.places(told) if self.steps[n].account["heeds"] == "nobody"]
        ends = [blind[0], blind[-1]]
        for step in ends:
            ahead = {
                other: self.vehicle(step, other).x_m
                for other in range(1, len(self.scene.sizes))
                if self.is_there(step, other) and self.in_path(step, other)
            }
            assert min(ahead, key=ahead.get) == number

    def in_path(self, step, number):
        ego, other = self.vehicle(step, 0), self.vehicle(step, number)
        if other.x_m <= ego.x_m:
            return False
        widths = [self.half_width(each) for each in (ego, other)]
        aside = abs(other.y_m - ego.y_m) - sum(widths)
        drift = other.speed_mps * np.sin(other.heading_rad) - ego.speed_mps * np.sin(
            ego.heading_rad
        )
        towards = -drift if other.y_m > ego.y_m else drift
        return aside <= max(towards, 0.0) * 1.0

    def half_width(self, vehicle):
        turned = abs(np.sin(vehicle.heading_rad)) * vehicle.length_m
        return 0.5 * (turned + abs(np.cos(vehicle.heading_rad)) * vehicle.width_m)

    def check_belief(self, told):
        number, places = int(told["vehicle"]), self.places(told)
        assert {self.steps[n].account["vehicle"] for n in places} == {float(number)}
        believed = np.mean([self.steps[n].account["closing_mps"] for n in places])
        true = np.mean([self.closing_mps(n, number) for n in places])
        assert float(told["believed"]) == pytest.approx(believed, abs=0.06)
        assert float(told["true"]) == pytest.approx(true, abs=0.4)

    def check_lead(self, told):
        number = float(told["vehicle"])
        leads = [
            n
            for n in self.places(told)
            if self.steps[n].account["heeds"] == "lead"
            and self.steps[n].account["vehicle"] == number
        ]
        assert len(leads) == int(told["steps"] or len(self.places(told)))
        # A track may outlive its vehicle, which has left.
        assert self.is_there(leads[0], int(number))

    def check_override(self, told):
        names = {self.steps[n].account["override"].replace("_", " ") for n in self.places(told)}
        assert told["name"] in names

    def check_braking(self, told):
        controls = self.scene.controls[:, 0]
        assert float(told["braking"]) == pytest.approx(-controls.min(), abs=0.006)
        assert controls[self.places(told)].min() == controls.min()

    def check_end(self, told):
        last, number = len(self.scene.vehicles) - 1, int(told["vehicle"])
        assert float(told["after"]) == pytest.approx(last * self.scene.dt_s, abs=0.051)
        ego, other = self.vehicle(last, 0), self.vehicle(last, number)
        # The scene holds float32: a footprint that only touches may be apart by rounding.
        wider = msgspec.structs.replace(
            other, length_m=other.length_m + 1e-3, width_m=other.width_m + 1e-3
        )
        assert not are_apart(ego, wider)
        velocities = [each.speed_mps * np.exp(1j * each.heading_rad) for each in (ego, other)]
        severity = abs(velocities[0] - velocities[1]) ** 2
        assert float(told["severity"]) == pytest.approx(severity, abs=0.06)


TRUE_GAP = r"(?:; the true gap: (?P<gap>-?[\d.]+) m, closing at (?P<closing>-?[\d.]+) m/s)?"
VEHICLE = r"vehicle (?P<vehicle>\d+)"
BELIEVED = r"(?P<believed>-?[\d.]+) m/s on average; in truth (?P<true>-?[\d.]+) m/s"
SEVERITY = r"severity (?P<severity>[\d.]+) m²/s²"
SENTENCES = (
    (rf"{SPAN} the track of {VEHICLE} was lost{TRUE_GAP}", StoredTruth.check_loss),
    (rf"{SPAN}{OFTEN} it ignored {VEHICLE}, the next one ahead", StoredTruth.check_blindness),
    (rf"{SPAN} it believed to close in on {VEHICLE} at {BELIEVED}", StoredTruth.check_belief),
    (rf"{SPAN}{OFTEN} it took {VEHICLE} for its lead", StoredTruth.check_lead),
    (rf"{SPAN}{OFTEN} the plan was overridden: (?P<name>[\w ]+)", StoredTruth.check_override),
    (
        rf"{SPAN} it asked for its hardest braking: (?P<braking>[\d.]+) m/s²",
        StoredTruth.check_braking,
    ),
    (
        rf"After (?P<after>[\d.]+) s collision with {VEHICLE}: {SEVERITY}",
        StoredTruth.check_end,
    ),
)


def test_each_sentence_of_a_drive_agrees_with_its_scene(drive):
    truth, story = StoredTruth(drive), tell_story(drive)
    assert story[-1].startswith("After ")
    for sentence in story:
        found = [(re.fullmatch(rf"{way}\.", sentence), check) for way, check in SENTENCES]
        ((told, check),) = [(match, check) for match, check in found if match]
        check(truth, told.groupdict())


def test_true_figures_of_a_drive_are_of_the_vehicle_that_the_account_names(drive):
    truth = StoredTruth(drive)
    named = [n for n, step in enumerate(drive.steps) if "vehicle" in step.account]
    assert named
    for number, step in enumerate(drive.steps):
        if number not in named:
            assert (step.vehicle, step.gap_m, step.closing_mps) == (None, None, None)
        elif step.gap_m is None:
            assert not truth.is_there(number, step.vehicle)
        else:
            assert step.vehicle == step.account["vehicle"]
            assert step.gap_m == pytest.approx(truth.gap_m(number, step.vehicle), abs=1e-3)
            # The estimate is of the same vehicle: a filter follows it within tens of metres.
            assert abs(step.gap_m - step.account["gap_m"]) < 40.0


def test_account_that_names_no_vehicle_has_no_truth_among_several(plugged):
    class Mute(Plain):
        def explain(self):
            return {"heeds": "lead", "gap_m": 20.0, "closing_mps": 1.0}

    plugged(Mute)
    spec = msgspec.convert(tomllib.loads(DRIVE.read_text()), CampaignSpec)
    among_several = msgspec.structs.replace(spec.setup(), planner="mine")
    found = explain(among_several, EpisodeTask(0, 0, PriorSource()))
    assert {(step.vehicle, step.gap_m) for step in found.steps} == {(None, None)}
    assert not [line for line in tell_story(found) if "in truth" in line]
