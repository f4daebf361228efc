"""The shipped suites are worth something: each breach of a contract is caught."""

from collections.abc import Callable
from math import inf
from typing import Any

import msgspec
import pytest

from eigenfail.contracts import Planner, Simulation
from eigenfail.errors import EpisodeError, SimulatorError
from eigenfail.testing import planner as planners
from eigenfail.testing import scenario as scenarios
from eigenfail.testing import simulation as simulations
from eigenfail.values.disturbance import POSITION
from eigenfail.values.scene import Control, Mission, Observation, Perception, VehicleState
from eigenfail_workers.scenarios.highway_drive import HighwayDrive, HighwayDriveParameters
from eigenfail_workers.simulators.point_mass import PointMassSimulator

replace = msgspec.structs.replace


class Bent:
    """A simulation that does everything right; those below bend one thing."""

    def __init__(self, real: Simulation) -> None:
        self.real = real
        self.dt_s, self.steps = real.dt_s, real.steps
        self.episodes = 0

    def reset(self, seed: int) -> Observation:
        self.episodes += 1
        return self.real.reset(seed)

    def step(self, disturbance: tuple[float, float]) -> Observation:
        return self.real.step(disturbance)

    def close(self) -> None:
        self.real.close()


class StartsLate(Bent):
    def reset(self, seed: int) -> Observation:
        return replace(super().reset(seed), step=1)


class Skips(Bent):
    def step(self, disturbance: tuple[float, float]) -> Observation:
        seen = super().step(disturbance)
        return seen if seen.ended else super().step(disturbance)


class DrivesOn(Bent):
    def step(self, disturbance: tuple[float, float]) -> Observation:
        seen = super().step(disturbance)
        return replace(seen, collided=seen.collided or seen.step == 20)


class Denies(Bent):
    def step(self, disturbance: tuple[float, float]) -> Observation:
        seen = super().step(disturbance)
        struck = replace(seen.others[0], x_m=seen.ego.x_m, y_m=seen.ego.y_m)
        return replace(seen, others=(struck, *seen.others[1:]), collided=False)


class Vanishes(Bent):
    def step(self, disturbance: tuple[float, float]) -> Observation:
        seen = super().step(disturbance)
        return replace(seen, ego=replace(seen.ego, x_m=inf))


class Wears(Bent):
    def step(self, disturbance: tuple[float, float]) -> Observation:
        seen = super().step(disturbance)
        return replace(seen, ego=replace(seen.ego, x_m=seen.ego.x_m + 1e-9 * self.episodes))


class Calms(Bent):
    def step(self, disturbance: tuple[float, float]) -> Observation:
        return super().step((disturbance[0], 0.0))


class Moves(Bent):
    def step(self, disturbance: tuple[float, float]) -> Observation:
        seen = super().step(disturbance)
        moved = replace(seen.others[0], x_m=seen.others[0].x_m + disturbance[0])
        return replace(seen, others=(moved, *seen.others[1:]))


class Reverses(Bent):
    def step(self, disturbance: tuple[float, float]) -> Observation:
        seen = super().step(disturbance)
        return replace(seen, ego=replace(seen.ego, speed_mps=seen.ego.speed_mps - 1.0))


class Shrugs(Bent):
    def step(self, disturbance: tuple[float, float]) -> Observation:
        try:
            return super().step(disturbance)
        except EpisodeError as error:
            raise SimulatorError("something") from error


class StaysOpen(Bent):
    def close(self) -> None:
        """Nothing."""


BREACHES = (
    (simulations.starts_at_step_zero, StartsLate),
    (simulations.counts_steps, Skips),
    (simulations.ends_at_a_collision, DrivesOn),
    (simulations.ends_at_a_collision, Denies),
    (simulations.shows_finite_numbers, Vanishes),
    (simulations.repeats_itself, Wears),
    (simulations.disturbs_the_nearest, Calms),
    (simulations.leaves_the_truth_alone, Moves),
    (simulations.obeys_the_planner, Reverses),
    (simulations.blames_the_planner, Shrugs),
    (simulations.refuses_what_is_over, StaysOpen),
)


def test_every_check_has_its_breach() -> None:
    assert {check for check, _ in BREACHES} == set(simulations.SIMULATION_CHECKS)


@pytest.mark.parametrize(("check", "bent"), BREACHES, ids=lambda one: one.__name__)
def test_simulation_suite(
    check: Callable[[Any], None], bent: type[Bent], small_cut_in: Any
) -> None:
    def opened(planner: Planner, wrap: type[Bent]) -> Bent:
        real = PointMassSimulator().open(small_cut_in, small_cut_in.Parameters(), planner, POSITION)
        return wrap(real)

    check(lambda planner: opened(planner, Bent))
    with pytest.raises(AssertionError):
        check(lambda planner: opened(planner, bent))


class Good:
    """A planner that is all right; those below are not."""

    made = 0

    def __init__(self) -> None:
        type(self).made += 1

    def reset(self, mission: Mission) -> None:
        self.total = 0.0

    def act(self, perception: Perception) -> Control:
        self.total += perception.others[0].x_m
        return Control(-1e-6 * self.total, 0.0)


class NoControl(Good):
    def act(self, perception: Perception) -> Any:
        return (0.0, 0.0)


class Infinite(Good):
    def act(self, perception: Perception) -> Control:
        return Control(inf, 0.0)


class Unlike(Good):
    def act(self, perception: Perception) -> Control:
        return Control(1e-9 * self.made, 0.0)


class Remembers(Good):
    total = 0.0

    def reset(self, mission: Mission) -> None:
        """Nothing."""


class Tampers(Good):
    def act(self, perception: Perception) -> Control:
        msgspec.structs.force_setattr(perception.ego, "speed_mps", 0.0)
        return super().act(perception)


@pytest.mark.parametrize(
    ("check", "planner"),
    [
        (planners.returns_finite_controls, NoControl),
        (planners.returns_finite_controls, Infinite),
        (planners.is_deterministic, Unlike),
        (planners.forgets_at_reset, Remembers),
        (planners.leaves_its_input_alone, Tampers),
    ],
)
def test_planner_suite(check: Callable[[Any], None], planner: type[Good]) -> None:
    check(Good)
    with pytest.raises(AssertionError):
        check(planner)


@pytest.fixture
def bend(small_cut_in: Any) -> Callable[[Callable[[Any, int], Any]], Any]:
    """The small scenario with its situations changed."""

    class Changed(type(small_cut_in)):
        def __init__(self, change: Callable[[Any, int], Any]) -> None:
            self.change = change

        def __call__(self, parameters: Any, seed: int) -> Any:
            return self.change(super().__call__(parameters, seed), seed)

    return Changed


CALLS = iter(range(1000))

SCENARIO_BREACHES = (
    (scenarios.is_plausible, lambda s, _: replace(s, steps=0)),
    (scenarios.is_plausible, lambda s, _: replace(s, actors=())),
    (scenarios.is_plausible, lambda s, _: replace(s, ego=replace(s.ego, x_m=inf))),
    (scenarios.starts_without_overlap, lambda s, _: replace(s, actors=(replace(s.ego, x_m=15.9),))),
    (scenarios.repeats_itself, lambda s, _: replace(s, steps=60 + next(CALLS))),
    (scenarios.has_a_steady_horizon, lambda s, seed: replace(s, steps=60 + seed % 5)),
    (scenarios.moves_actors_as_they_say, lambda s, _: Jumps(s)),
)


class Jumps:
    """A situation whose first actor leaps at step 30."""

    def __init__(self, real: Any) -> None:
        self.real = real
        self.mission, self.steps, self.ego, self.actors = (
            real.mission,
            real.steps,
            real.ego,
            real.actors,
        )

    def move_actor(self, actor: int, step: int, ego: VehicleState) -> VehicleState:
        moved = self.real.move_actor(actor, step, ego)
        return replace(moved, x_m=moved.x_m + (0.2 if step >= 30 else 0.0))


class BentTraffic:
    """Traffic of a highway drive that is changed at some steps."""

    def __init__(self, real: Any, change: Callable[[int, VehicleState, dict[int, Any]], Any]):
        self.real, self.change = real, change

    def advance(self, step: int, ego: VehicleState) -> dict[int, VehicleState]:
        there = self.real.advance(step, ego)
        self.change(step, ego, there)
        return there


def appear_on_the_ego(step: int, ego: VehicleState, there: dict[int, Any]) -> None:
    if step == 70:
        there[3] = replace(there[3], x_m=ego.x_m + 10.0)


def miss_a_step(step: int, _: VehicleState, there: dict[int, Any]) -> None:
    if step == 20:
        del there[1]


def come_without_a_challenge(step: int, _: VehicleState, there: dict[int, Any]) -> None:
    if step == 70:
        there[6] = there[3]


def leave_all(step: int, _: VehicleState, there: dict[int, Any]) -> None:
    if step == 150:
        there.clear()


class ReactiveBent:
    """The highway drive with its situations, or the traffic of these, changed."""

    Parameters = HighwayDriveParameters

    def __init__(self, change: Any, **changes: Callable[[], object]) -> None:
        self.change, self.changes = change, changes

    def __call__(self, parameters: HighwayDriveParameters, seed: int) -> Any:
        real = HighwayDrive()(parameters, seed)
        changed = replace(real, steps=200, **{name: make() for name, make in self.changes.items()})
        return ReactiveTwin(changed, self.change)


class ReactiveTwin:
    def __init__(self, real: Any, change: Any) -> None:
        self.real, self.change = real, change
        self.mission, self.steps, self.ego = real.mission, real.steps, real.ego
        self.actors, self.challenges = real.actors, real.challenges

    def start_traffic(self) -> BentTraffic:
        return BentTraffic(self.real.start_traffic(), self.change)


def keep(step: int, ego: VehicleState, there: dict[int, Any]) -> None:
    """Change nothing."""


REACTIVE_BREACHES = (
    (scenarios.is_plausible, keep, {"challenges": lambda: ("phantom",)}),
    (scenarios.repeats_itself, keep, {"challenges": lambda: (str(next(CALLS)),) * 5}),
    (scenarios.starts_without_overlap, appear_on_the_ego, {}),
    (scenarios.moves_actors_as_they_say, miss_a_step, {}),
    (scenarios.moves_actors_as_they_say, come_without_a_challenge, {}),
    (scenarios.moves_actors_as_they_say, leave_all, {}),
)


@pytest.mark.parametrize(("check", "change", "changes"), REACTIVE_BREACHES)
def test_scenario_suite_with_traffic(
    check: Callable[[Any], None], change: Any, changes: dict[str, Callable[[], object]]
) -> None:
    check(ReactiveBent(keep))
    with pytest.raises(AssertionError):
        check(ReactiveBent(change, **changes))


def test_scenario_suite_finds_vehicles_that_are_left_out(small_cut_in: Any) -> None:
    class Partial(type(small_cut_in)):
        left_out = ("'7': It has no rectangle.",)

    scenarios.leaves_no_vehicle_out(small_cut_in)
    with pytest.raises(AssertionError, match=r"1 of the vehicles. '7': It has no rectangle"):
        scenarios.leaves_no_vehicle_out(Partial())


@pytest.mark.parametrize(("check", "change"), SCENARIO_BREACHES)
def test_scenario_suite(
    check: Callable[[Any], None], change: Callable[[Any, int], Any], bend: Any, small_cut_in: Any
) -> None:
    check(small_cut_in)
    with pytest.raises(AssertionError):
        check(bend(change))
