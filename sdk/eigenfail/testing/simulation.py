"""Conformance suite of `Simulation`.

    @pytest.mark.parametrize("check", SIMULATION_CHECKS)
    def test_my_simulator(check):
        check(lambda planner: MySimulator().open(CutIn(), CutIn.Parameters(), planner, POSITION))

Each check opens simulations with its own planners, which record their perceptions.
"""

from collections.abc import Callable
from contextlib import closing
from math import cos, hypot, inf, isfinite, nan

import msgspec

from eigenfail.contracts import Planner, Simulation
from eigenfail.errors import EpisodeError, PlannerError
from eigenfail.testing import expect, expect_error
from eigenfail.testing.scenario import are_apart
from eigenfail.values.scene import Control, Mission, Observation, Perception, VehicleState
from eigenfail.values.shapes import Pair, Row

OpenSimulation = Callable[[Planner], Simulation]

SEED = 7
NONE: Pair = (0.0, 0.0)


class Cruise:
    """A planner with a constant answer that records its perceptions."""

    def __init__(self, answer: object = None) -> None:
        self.answer = Control(0.0, 0.0) if answer is None else answer
        self.seen: list[Perception] = []

    def reset(self, mission: Mission) -> None:  # noqa: ARG002 - of the contract
        """Clear the record."""
        self.seen.clear()

    def act(self, perception: Perception) -> Control:
        """Return the constant answer, which may be invalid."""
        self.seen.append(perception)
        return self.answer  # type: ignore[return-value]  # wrong answers are checked too


class Follower(Cruise):
    """A planner whose controls depend on every bit of the perceived position."""

    def act(self, perception: Perception) -> Control:
        """Brake slightly, depending on the perceived position."""
        super().act(perception)
        other = perception.others[0]
        ahead_m = other.x_m - perception.ego.x_m
        return Control(-1.0 - 0.01 * cos(ahead_m), 1e-4 * cos(other.y_m))


class Broken(Cruise):
    """A planner that fails."""

    def act(self, perception: Perception) -> Control:  # noqa: ARG002 - of the contract
        """Raise an error that no contract mentions."""
        raise ZeroDivisionError("on purpose")


def wave(step: int) -> Pair:
    """Return a disturbance that depends on the step. [m]"""
    return 2.0 * cos(3.0 * step), 0.5 * cos(5.0 * step)


def calm(_step: int) -> Pair:
    """Return no disturbance. [m]"""
    return NONE


def course(
    simulation: Simulation, disturb: Callable[[int], Row] = wave, seed: int = SEED
) -> list[Observation]:
    """Return the observations of one episode."""
    observations = [simulation.reset(seed)]
    while not observations[-1].ended:
        observations.append(simulation.step(disturb(len(observations))))
        expect(len(observations) <= simulation.steps + 1, "The episode outlives its horizon.")
    return observations


def starts_at_step_zero(open_simulation: OpenSimulation) -> None:
    """A reset shows the start: step 0, without a collision, with another vehicle."""
    with closing(open_simulation(Cruise())) as simulation:
        start = simulation.reset(SEED)
    expect(start.step == 0, f"The start is step {start.step}.")
    expect(not (start.collided or start.ended), "The episode is over before it begins.")
    expect(start.perceived is None and start.control is None, "Something was decided at the start.")
    expect(len(start.others) >= 1, "There is no vehicle beside the ego.")


def counts_steps(open_simulation: OpenSimulation) -> None:
    """Steps are counted one by one, and the last possible one is the horizon."""
    with closing(open_simulation(Follower())) as simulation:
        seen = course(simulation)
        expect(simulation.dt_s > 0.0, "A step takes no time.")
        steps = [observation.step for observation in seen]
        expect(steps == list(range(len(seen))), f"The steps were counted {steps}.")
        full = seen[-1].collided or seen[-1].step == simulation.steps
        expect(full, f"The episode ended at step {seen[-1].step} of {simulation.steps}.")


def ends_at_a_collision(open_simulation: OpenSimulation) -> None:
    """A collision ends the episode, and no vehicle was touched before."""
    # It accelerates, and so runs into the vehicle ahead in most scenarios.
    with closing(open_simulation(Cruise(Control(3.0, 0.0)))) as simulation:
        for seen in course(simulation):
            apart = all(are_apart(seen.ego, other) for other in seen.others)
            said = f"At step {seen.step} the ego overlaps a vehicle, and no collision is reported."
            expect(apart or seen.collided, said)
            ended = seen.ended or not seen.collided
            expect(ended, f"The episode goes on after the collision at step {seen.step}.")


def shows_finite_numbers(open_simulation: OpenSimulation) -> None:
    """Every pose and speed is a finite number; footprints have a size and keep it."""
    with closing(open_simulation(Follower())) as simulation:
        seen = course(simulation)
    known: dict[int, tuple[float, float]] = {}
    for observation in seen:
        for vehicle in (observation.ego, *observation.others):
            finite = isfinite(sum(msgspec.structs.astuple(vehicle)))
            expect(finite, f"Step {observation.step} shows {vehicle}.")
            expect(min(_size(vehicle)) > 0.0, f"{vehicle} has no footprint.")
        numbered = zip(observation.numbers, observation.others, strict=True)
        sizes = {number: _size(vehicle) for number, vehicle in numbered}
        kept = sizes == {number: known.setdefault(number, sizes[number]) for number in sizes}
        same = observation.ids is not None or len(sizes) == len(known)
        said = f"At step {observation.step} the others are not those of the start."
        expect(kept and same, said)


def repeats_itself(open_simulation: OpenSimulation) -> None:
    """Equal seeds and disturbances give equal episodes, bit for bit."""
    with closing(open_simulation(Follower())) as simulation:
        first = course(simulation)
        expect(course(simulation) == first, "The second episode differs from the first.")
        # An episode that is left before its end.
        simulation.reset(SEED + 1)
        simulation.step(wave(1))
        expect(course(simulation) == first, "An abandoned episode leaves something behind.")
    with closing(open_simulation(Follower())) as another:
        expect(course(another) == first, "Another simulation of the same differs.")


def disturbs_the_nearest(open_simulation: OpenSimulation) -> None:
    """The planner perceives the true state, with a disturbed position of the nearest vehicle."""
    planner = Follower()
    with closing(open_simulation(planner)) as simulation:
        seen = course(simulation)
    expect(len(planner.seen) == len(seen) - 1, "The planner was not asked once for every step.")
    for before, after, shown in zip(seen, seen[1:], planner.seen, strict=False):
        a = wave(before.step + 1)
        expected = _disturbed(before, a)
        expect(shown.ego == before.ego, f"At step {before.step} the ego sees itself elsewhere.")
        expect(shown.others == expected, f"At step {before.step} the planner saw {shown.others}.")
        actor = expected[_nearest(before)]
        agrees = after.perceived == (actor.x_m, actor.y_m)
        expect(agrees, f"Step {after.step} reports {after.perceived} as the perceived position.")


def leaves_the_truth_alone(open_simulation: OpenSimulation) -> None:
    """A disturbance that the planner ignores changes nothing."""
    with closing(open_simulation(Cruise())) as simulation:
        disturbed, undisturbed = course(simulation, wave), course(simulation, calm)
    same = [(o.ego, o.others) for o in disturbed] == [(o.ego, o.others) for o in undisturbed]
    expect(same, "A disturbance moved a vehicle although the planner ignored it.")


def obeys_the_planner(open_simulation: OpenSimulation) -> None:
    """Braking slows the ego down, ends at rest, and is reported as requested."""
    asked = Control(-6.0, 0.0)
    with closing(open_simulation(Cruise(asked))) as simulation:
        seen = course(simulation, calm)
    speeds = [observation.ego.speed_mps for observation in seen]
    expect(speeds[1] < speeds[0], "Braking does not slow the ego down.")
    expect(min(speeds) >= 0.0, "Braking makes the ego go backwards.")
    agrees = all(observation.control == asked for observation in seen[1:])
    expect(agrees, "The reported control is not the one that the planner asked for.")


def blames_the_planner(open_simulation: OpenSimulation) -> None:
    """A planner's failure is a PlannerError, and does not affect the next episode."""
    answers = ("go", Control(nan, 0.0), Control(0.0, inf))
    for planner in (Broken(), *(Cruise(answer) for answer in answers)):
        with closing(open_simulation(planner)) as simulation:
            start = simulation.reset(SEED)
            with expect_error(PlannerError, "A planner's failure must be a PlannerError."):
                simulation.step(NONE)
            expect(simulation.reset(SEED) == start, "After a failure the reset is another.")


def refuses_what_is_over(open_simulation: OpenSimulation) -> None:
    """A step before a reset or after the end is refused, as is any use after closing."""
    simulation = open_simulation(Cruise())
    with expect_error(EpisodeError, "A step before any reset must be an EpisodeError."):
        simulation.step(NONE)
    course(simulation)
    with expect_error(EpisodeError, "A step after the end must be an EpisodeError."):
        simulation.step(NONE)
    # Twice: clean-up code may close what is closed already.
    simulation.close()
    simulation.close()
    with expect_error(EpisodeError, "A reset after the close must be an EpisodeError."):
        simulation.reset(SEED)


def _nearest(observation: Observation) -> int:
    ego = observation.ego
    ways = [hypot(other.x_m - ego.x_m, other.y_m - ego.y_m) for other in observation.others]
    return ways.index(min(ways))


def _disturbed(truth: Observation, a: Pair) -> tuple[VehicleState, ...]:
    actor = _nearest(truth)
    others = list(truth.others)
    x_m, y_m = others[actor].x_m + a[0], others[actor].y_m + a[1]
    others[actor] = msgspec.structs.replace(others[actor], x_m=x_m, y_m=y_m)
    return tuple(others)


def _size(vehicle: VehicleState) -> Pair:
    return vehicle.length_m, vehicle.width_m


SIMULATION_CHECKS: tuple[Callable[[OpenSimulation], None], ...] = (
    starts_at_step_zero,
    counts_steps,
    ends_at_a_collision,
    shows_finite_numbers,
    repeats_itself,
    disturbs_the_nearest,
    leaves_the_truth_alone,
    obeys_the_planner,
    blames_the_planner,
    refuses_what_is_over,
)
