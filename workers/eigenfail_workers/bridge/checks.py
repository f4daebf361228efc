"""What a bridge has to do, question by question, over the wire."""

from collections.abc import Callable
from contextlib import closing
from itertools import pairwise

from eigenfail.errors import EigenfailError
from eigenfail.testing.expectations import expect
from eigenfail.testing.simulation import (
    SEED,
    calm,
    counts_steps,
    course,
    ends_at_a_collision,
    repeats_itself,
    shows_finite_numbers,
    starts_at_step_zero,
    wave,
)
from eigenfail.values import Observation
from eigenfail_workers.bridge.connection import Connection
from eigenfail_workers.bridge.messages import Push, Reset, Seen, Start, Step
from eigenfail_workers.bridge.observing import after_step, asked_for, at_start
from eigenfail_workers.bridge.simulation import BridgeSimulation, answers

MOST_BESIDE = 7

Check = Callable[[Connection, Start], None]


def of_simulations(check: Callable[..., None]) -> Check:
    """A check of the conformance suite, that does not ask for a planner of its own."""

    def run(connection: Connection, start: Start) -> None:
        check(lambda _planner: BridgeSimulation(connection, start))

    run.__name__, run.__doc__ = check.__name__, check.__doc__
    return run


def disturbs_the_nearest(connection: Connection, start: Start) -> None:
    """A disturbance moves the nearest vehicle where the planner sees it, and so what it does."""
    with closing(BridgeSimulation(connection, start)) as simulation:
        disturbed, undisturbed = course(simulation, wave), course(simulation, calm)
    for before, after in pairwise(disturbed):
        due = asked_for(before, wave(after.step))
        said = f"Step {after.step} tells {after.perceived} as the perceived position, not {due}."
        expect(after.perceived == due, said)
    moved = [each.ego for each in disturbed] != [each.ego for each in undisturbed]
    expect(moved, "Disturbances of metres change nothing: the planner is not shown them.")


def keeps_slots_apart(connection: Connection, start: Start) -> None:
    """Episodes side by side in one request are what each is by itself, bit for bit."""
    beside = min(connection.welcome.slots, MOST_BESIDE)
    seeds = [SEED + slot for slot in range(beside)]
    with closing(BridgeSimulation(connection, start)) as simulation:
        alone = [course(simulation, seed=seed) for seed in seeds]
    together = courses(connection, start, seeds)
    expect(together == alone, f"Of {beside} episodes side by side, some are others than alone.")


def courses(connection: Connection, start: Start, seeds: list[int]) -> list[list[Observation]]:
    """Whole episodes, a slot for each seed, all of one step in one request."""
    starts = tuple(start_at(start, slot, seed) for slot, seed in enumerate(seeds))
    request: Reset | Step = Reset(connection.session, connection.next_id(), starts)
    found = [[at_start(seen)] for seen in asked(connection, request)]
    dt_s = BridgeSimulation(connection, start).dt_s
    while going := [slot for slot, seen in enumerate(found) if not seen[-1].ended]:
        pushes = tuple(Push(slot, wave(len(found[slot]))) for slot in going)
        request = Step(connection.session, connection.next_id(), pushes)
        for push, seen in zip(pushes, asked(connection, request), strict=True):
            course_so_far = found[push.slot]
            now = after_step(seen, course_so_far[-1], push.disturbance, dt_s)
            course_so_far.append(now)
    return found


def refuses_what_is_over(connection: Connection, start: Start) -> None:
    """No step before a reset, or after the end: it answers with a fault."""
    push = (Push(start.slot, (0.0, 0.0)),)
    (seen,) = asked(connection, Step(connection.session, connection.next_id(), push))
    expect(seen.fault is not None, "A step before any reset must be answered with a fault.")
    with closing(BridgeSimulation(connection, start)) as simulation:
        course(simulation)
    (seen,) = asked(connection, Step(connection.session, connection.next_id(), push))
    expect(seen.fault is not None, "A step after the end must be answered with a fault.")


def refuses_unknown_names(connection: Connection, start: Start) -> None:
    """What it does not know is the fault of the input, and the next episode begins as usual."""
    unknown = Start(start.slot, SEED, "no such scenario", {}, start.planner, {}, start.steps)
    (seen,) = asked(connection, Reset(connection.session, connection.next_id(), (unknown,)))
    said = "A scenario that it does not have must be answered with the fault 'input'."
    expect(seen.fault == "input", said)
    with closing(BridgeSimulation(connection, start)) as simulation:
        simulation.reset(SEED)


def asked(connection: Connection, request: Reset | Step) -> tuple[Seen, ...]:
    """What comes of a request, for each of its slots."""
    connection.send(request)
    return answers(connection, request)


def start_at(start: Start, slot: int, seed: int) -> Start:
    """The same in another slot, with another seed."""
    return Start(
        slot, seed, start.scenario, start.parameters, start.planner, start.settings, start.steps
    )


counts_each_step = of_simulations(counts_steps)

CHECKS: tuple[Check, ...] = (
    of_simulations(starts_at_step_zero),
    counts_each_step,
    of_simulations(ends_at_a_collision),
    of_simulations(shows_finite_numbers),
    of_simulations(repeats_itself),
    disturbs_the_nearest,
    keeps_slots_apart,
    refuses_what_is_over,
    refuses_unknown_names,
)


def what_breaks(address: str, start: Start, check: Check) -> str:
    """What a check found, in words; nothing if the bridge does as it should."""
    try:
        with closing(Connection(address)) as connection:
            check(connection, start)
    except (AssertionError, EigenfailError) as error:
        return str(error)
    return ""
