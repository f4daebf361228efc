"""Searches of other tools, each a function that calls an objective until its calls are spent.

They need packages of the group of extras `peers`, which nothing else of the project needs: each is
imported where it is used.
"""

from collections.abc import Callable, Sequence
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


class CallsSpent(Exception):
    """Ends a tool's search: it has had its calls, each of which counted."""


class Answer(NamedTuple):
    """Answer to a call: robustness, 0 or less of a failure, and the sum of z² as injected."""

    robustness: float
    squares: float


class Task(NamedTuple):
    """What a tool is to minimise.

    Attributes:
        call: answer to a vector, shape (dimension,); raises `CallsSpent` after `calls` calls.
        bound: bounded tools look for vectors within ±bound. [sigma]
    """

    call: Callable[[Vector], Answer]
    dimension: int
    bound: float
    calls: int
    seed: int

    def find_robustness(self, x: Sequence[float]) -> float:
        """Return the robustness at a vector."""
        return self.call(np.asarray(x, float)).robustness


class Peer(NamedTuple):
    """A search of another tool, and the packages that it needs, by the names of their imports."""

    packages: tuple[str, ...]
    search: Callable[[Task], None]

    def list_missing(self) -> list[str]:
        """Return those of its packages that are not installed."""
        return [name for name in self.packages if find_spec(name) is None]


def rank_likely(answer: Answer) -> float:
    """Return a value whose order is: robustness, then among failures the sum of z²."""
    return answer.robustness if answer.robustness > 0.0 else -1.0 / (1.0 + answer.squares)


def search_by_verifai(task: Task, sampler: str, sampler_module: str) -> None:
    """VerifAI: a sampler over buckets of each number, told of every robustness.

    Its threshold is 0.5 in place of 0: with 0 it learns from no failure, as these have r = 0.
    """
    from importlib import import_module

    from verifai.features import Box
    from verifai.samplers.feature_sampler import default_sampler_params

    np.random.seed(task.seed % 2**32)  # noqa: NPY002 - VerifAI draws from NumPy's global generator
    given = default_sampler_params("ce")
    given.thres = 0.5
    make = getattr(import_module(f"verifai.samplers.{sampler_module}"), sampler)
    search = make(Box(*[(-task.bound, task.bound)] * task.dimension), given)
    for _ in range(task.calls):
        point, told = search.getSample()
        search.update(point, told, task.find_robustness(point))


def search_by_verifai_ce(task: Task) -> None:
    """VerifAI's cross-entropy sampler."""
    search_by_verifai(task, "CrossEntropySampler", "cross_entropy")


def search_by_verifai_bandit(task: Task) -> None:
    """VerifAI's multi-armed bandit sampler."""
    search_by_verifai(task, "MultiArmedBanditSampler", "multi_armed_bandit")


def search_by_taliro(task: Task) -> None:
    """Dual annealing of psy-taliro."""
    from staliro.optimizers import DualAnnealing, Optimizer
    from staliro.signals import Interval

    class Objective:
        @staticmethod
        def eval_sample(sample: Any) -> float:
            return task.find_robustness(sample.values)

    bounds = [Interval(-task.bound, task.bound)] * task.dimension
    DualAnnealing().optimize(Objective(), Optimizer.Params(task.seed, task.calls, bounds))


def search_by_optuna(task: Task, make_sampler: Callable[[Any], Any]) -> None:
    """A study of Optuna in memory, from the sampler that is made."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(sampler=make_sampler(optuna.samplers))
    space = {
        f"x{i}": optuna.distributions.FloatDistribution(-task.bound, task.bound)
        for i in range(task.dimension)
    }
    for _ in range(task.calls):
        trial = study.ask(space)
        study.tell(trial, task.find_robustness([trial.params[name] for name in space]))


def search_by_optuna_tpe(task: Task) -> None:
    """Optuna's default: the tree-structured Parzen estimator."""
    search_by_optuna(task, lambda samplers: samplers.TPESampler(seed=task.seed % 2**32))


def search_by_optuna_cma(task: Task) -> None:
    """CMA-ES of Optuna, which is that of the library cmaes."""
    search_by_optuna(task, lambda samplers: samplers.CmaEsSampler(seed=task.seed % 2**32))


def search_by_nevergrad(task: Task, optimizer: str) -> None:
    """An optimiser of nevergrad's registry."""
    import nevergrad

    instrumentation = nevergrad.p.Array(shape=(task.dimension,))
    instrumentation.set_bounds(-task.bound, task.bound)
    instrumentation.random_state.seed(task.seed % 2**32)
    search = nevergrad.optimizers.registry[optimizer](instrumentation, budget=task.calls)
    for _ in range(task.calls):
        candidate = search.ask()
        search.tell(candidate, task.find_robustness(candidate.value))


def search_by_one_plus_one(task: Task) -> None:
    """The (1+1) evolution strategy of nevergrad."""
    search_by_nevergrad(task, "OnePlusOne")


def search_by_nevergrad_de(task: Task) -> None:
    """Differential evolution of nevergrad."""
    search_by_nevergrad(task, "DE")


def search_by_pymoo(task: Task, make_algorithm: Callable[[], Any]) -> None:
    """An algorithm of pymoo, with its defaults."""
    from pymoo.core.problem import ElementwiseProblem
    from pymoo.optimize import minimize

    class Objective(ElementwiseProblem):
        def __init__(self) -> None:
            super().__init__(n_var=task.dimension, n_obj=1, xl=-task.bound, xu=task.bound)

        def _evaluate(self, x: Vector, out: dict[str, float], *_args: Any, **_more: Any) -> None:
            out["F"] = task.find_robustness(x)

    # A run that its own criterion ends, such as no progress, would leave calls unused.
    minimize(Objective(), make_algorithm(), ("n_eval", 10 * task.calls), seed=task.seed % 2**32)


def search_by_pymoo_ga(task: Task) -> None:
    """The genetic algorithm of pymoo."""
    from pymoo.algorithms.soo.nonconvex.ga import GA

    search_by_pymoo(task, GA)


def search_by_pymoo_de(task: Task) -> None:
    """Differential evolution of pymoo."""
    from pymoo.algorithms.soo.nonconvex.de import DE

    search_by_pymoo(task, DE)


def search_by_pycma(task: Task, value_of: Callable[[Answer], float]) -> None:
    """The library cma, without bounds, from z = 0 with a standard deviation of 1."""
    import cma

    options = {"seed": task.seed % 2**31 + 1, "verbose": -9}  # seed 0 would mean the time of day
    search = cma.CMAEvolutionStrategy(np.zeros(task.dimension), 1.0, options)
    while True:
        candidates = search.ask()
        search.tell(candidates, [value_of(task.call(np.asarray(one))) for one in candidates])


def search_by_pycma_raw(task: Task) -> None:
    """The library cma, which ranks candidates by robustness."""
    search_by_pycma(task, lambda answer: answer.robustness)


def search_by_pycma_likely(task: Task) -> None:
    """The library cma with the ranks of our method: by robustness, failures by likelihood."""
    search_by_pycma(task, rank_likely)


def search_by_openturns(task: Task) -> None:
    """Subset simulation of OpenTURNS, 200 calls a level, over standard normal numbers."""
    import openturns

    openturns.RandomGenerator.SetSeed(task.seed % 2**31)
    openturns.Log.Show(openturns.Log.NONE)
    normal = openturns.Normal(task.dimension)

    def evaluate(x: Sequence[float]) -> list[float]:
        return [task.find_robustness(x)]

    function = openturns.PythonFunction(task.dimension, 1, evaluate)
    output = openturns.CompositeRandomVector(function, openturns.RandomVector(normal))
    event = openturns.ThresholdEvent(output, openturns.LessOrEqual(), 0.0)
    search = openturns.SubsetSampling(event)
    search.setMaximumOuterSampling(200)
    search.setBlockSize(1)
    search.run()


PEERS = {
    "verifai_ce": Peer(("verifai",), search_by_verifai_ce),
    "verifai_bandit": Peer(("verifai",), search_by_verifai_bandit),
    "taliro": Peer(("staliro",), search_by_taliro),
    "optuna_tpe": Peer(("optuna",), search_by_optuna_tpe),
    "optuna_cma": Peer(("optuna", "cmaes"), search_by_optuna_cma),
    "nevergrad_one": Peer(("nevergrad",), search_by_one_plus_one),
    "nevergrad_de": Peer(("nevergrad",), search_by_nevergrad_de),
    "pymoo_ga": Peer(("pymoo",), search_by_pymoo_ga),
    "pymoo_de": Peer(("pymoo",), search_by_pymoo_de),
    "pycma": Peer(("cma",), search_by_pycma_raw),
    "pycma_likely": Peer(("cma",), search_by_pycma_likely),
    "openturns": Peer(("openturns",), search_by_openturns),
}
"""Searches of other tools by the name in figures."""
