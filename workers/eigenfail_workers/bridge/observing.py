"""What a bridge shows, as the observation that everything else is made of."""

from eigenfail.errors import SimulatorError
from eigenfail.values import Control, Observation, VehicleState
from eigenfail_workers.bridge.faults import error_of
from eigenfail_workers.bridge.messages import Pair, Seen, Vehicle
from eigenfail_workers.measures.geometry import nearest


def at_start(seen: Seen) -> Observation:
    """The start of an episode.

    Raises:
        EpisodeError: it did not begin.
        InvalidValue: what the campaign asks for cannot be done.
    """
    ego = checked(seen, 0)
    return Observation(
        0,
        VehicleState(*ego),
        others(seen),
        bool(seen.collided),
        bool(seen.ended),
        off_road=bool(seen.off_road),
    )


def after_step(seen: Seen, before: Observation, disturbance: Pair, dt_s: float) -> Observation:
    """The truth after a step, and what of the planner can be told.

    What the bridge does not tell is what it was asked to do, of the perceived position; and of the
    control what the motion shows: the change of speed over `dt_s`, and no steering.

    Raises:
        EpisodeError: the episode cannot go on.
        InvalidValue: what the campaign asks for cannot be done.
    """
    ego = VehicleState(*checked(seen, before.step + 1))
    if len(seen.others) != len(before.others):
        problem = f"There were {len(before.others)} other vehicles, and now {len(seen.others)}."
        raise SimulatorError(problem, "A bridge shows all of them in every observation.")
    control = seen.control or ((ego.speed_mps - before.ego.speed_mps) / dt_s, 0.0)
    return Observation(
        before.step + 1,
        ego,
        others(seen),
        bool(seen.collided),
        bool(seen.ended),
        seen.perceived or asked_for(before, disturbance),
        Control(*control),
        Control(*seen.applied) if seen.applied else None,
        bool(seen.off_road),
    )


def checked(seen: Seen, step: int) -> Vehicle:
    """The ego, of an observation that is one of the right step; raises as `after_step` does."""
    if seen.fault is not None:
        raise error_of(seen.fault, seen.message)
    if seen.ego is None or not seen.others:
        missing = "no ego" if seen.ego is None else "no other vehicles"
        problem = f"The bridge's observation has {missing}."
        raise SimulatorError(problem, "docs/bridge.md says what an observation holds.")
    if seen.step != step:
        problem = f"The bridge shows step {seen.step} where step {step} is due."
        raise SimulatorError(problem, "It counts the steps since the reset, from 0.")
    return seen.ego


def others(seen: Seen) -> tuple[VehicleState, ...]:
    """Everybody else."""
    return tuple([VehicleState(*vehicle) for vehicle in seen.others])


def asked_for(before: Observation, disturbance: Pair) -> Pair:
    """Where the nearest vehicle was to be seen."""
    actor = before.others[nearest(before.ego, before.others)]
    return actor.x_m + disturbance[0], actor.y_m + disturbance[1]
