"""Where a learner's words enter the hub: no number among them may be NaN or infinite."""

from collections.abc import Iterator
from math import isfinite

import msgspec
import numpy as np

from eigenfail.values import Estimate, Policy, TrajectorySource
from eigenfail.wire.messages import Diverged, Message, Proposed

REMEDY = (
    "Lower the method's learning rate, if it has one, and start a campaign like it anew; of a "
    "method of your own, let it raise LearnerDiverged where that happens."
)


def sound(message: Message) -> Message:
    """The message; of one that holds what is no number, what is told of a learner like that.

    No worker could use such a policy, and no page could show such an estimate.
    """
    if isinstance(message, Proposed):
        for what in unsound(message):
            return Diverged(f"{what} holds a number that is NaN or infinite.", REMEDY)
    return message


def unsound(message: Proposed) -> Iterator[str]:
    """What in it holds such a number."""
    for opened in message.rounds:
        if opened.policy is not None and not finite_policy(opened.policy):
            yield f"Policy {opened.policy.version}, which the learner proposed,"
        for task in opened.tasks:
            if isinstance(task.source, TrajectorySource) and not np.isfinite(task.source.z).all():
                yield f"The noise that the learner proposed for episode {task.index}"
    if message.estimate is not None and not finite_estimate(message.estimate):
        yield "The learner's estimate of the failure probability"


def finite_policy(policy: Policy) -> bool:
    """Whether all its weights are numbers, and its amplitude."""
    layers = (*policy.hidden, policy.mean, policy.log_std)
    parts = (part for layer in layers for part in (layer.weight, layer.bias))
    return isfinite(policy.amplitude) and all(np.isfinite(part).all() for part in parts)


def finite_estimate(estimate: Estimate) -> bool:
    """Whether all that it tells are numbers."""
    interval = estimate.interval
    told = [estimate.probability, estimate.cv, estimate.effective]
    ends = [] if interval is None else list(msgspec.structs.astuple(interval))
    return all(number is None or isfinite(number) for number in told + ends)
