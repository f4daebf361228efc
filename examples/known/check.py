"""Check the failure probabilities that a method prints against known ones.

python check.py --method subset --episodes 2000 --seeds 5 four_branches walk
"""

import argparse
from collections.abc import Sequence

import numpy as np
from known import PROBLEMS, Problem

from eigenfail import plugins
from eigenfail.errors import InputError
from eigenfail.values.episode import learner_seed
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import LearnerContext
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.statistics.intervals import log_normal
from eigenfail_workers.functions import FunctionEngine


def estimate(problem: Problem, method: str, episodes: int, seed: int) -> Estimate | None:
    """Run a campaign in this process; return what it says of the failure probability."""
    plugin = plugins.load(plugins.METHODS, method)
    nothing = np.zeros((0, problem.steps, 2), np.float32)
    context = LearnerContext(learner_seed(seed), episodes, problem.steps, nothing)
    rounds = Rounds(plugin(context, plugin.Settings()), seed, episodes)
    for _ in run_in_process(rounds, FunctionEngine(problem.robustness, problem.steps)):
        pass
    return rounds.estimate()


def is_right(found: Estimate, truth: float) -> bool:
    """Return whether an interval holds the truth.

    A lower bound has no interval. It may exceed the truth by its random error, and miss any part.
    """
    if found.probability is None or found.cv is None:
        return False
    around = found.interval or log_normal(found.probability, found.cv)
    return around.low <= truth and (found.bound is not None or truth <= around.high)


def format_row(name: str, truth: float, found: Sequence[Estimate | None]) -> str:
    """Return the row of a problem, from the estimates of several seeds."""
    numbers = [one for one in found if one is not None and one.probability is not None]
    if not numbers:
        return f"{name:16} {truth:9.3e}   no number"
    mean = np.mean([one.probability for one in numbers]) / truth
    right = sum(is_right(one, truth) for one in numbers)
    bounds = "bounds" if numbers[0].bound else "intervals"
    told = f"{len(numbers)} of {len(found)} print a number"
    return f"{name:16} {truth:9.3e}   {told}, mean {mean:4.2f} of P, {right} {bounds} hold"


def main() -> None:
    """Print a row for each problem."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", nargs="*", help=f"of {', '.join(PROBLEMS)}; none: all")
    parser.add_argument("--method", default="subset")
    parser.add_argument("--episodes", type=int, default=2000)
    parser.add_argument("--seeds", type=int, default=5, help="number of campaigns on each problem")
    given = parser.parse_args()
    if unknown := set(given.problems) - PROBLEMS.keys():
        parser.error(f"no such problem: {', '.join(sorted(unknown))}")
    for name in given.problems or PROBLEMS:
        problem = PROBLEMS[name]
        try:
            found = [
                estimate(problem, given.method, given.episodes, seed)
                for seed in range(1, given.seeds + 1)
            ]
        except InputError as error:
            parser.error(str(error))
        print(format_row(name, problem.probability, found), flush=True)


if __name__ == "__main__":
    main()
