"""Any function of a noise trajectory as a system under test. docs/any_function.md"""

from eigenfail.functions import of_trajectory


@of_trajectory
def robustness(z):
    """How far an error stays below its limit: noise z, shape (steps, 2) [sigma], low-passed."""
    error = largest = 0.0
    for longitudinal, _lateral in z.tolist():
        error += 0.3 * (longitudinal - error)
        largest = max(largest, error)
    return 1.8 - largest


# In a service: eigenfail run any_function.toml. In this process: python any_function.py
STEPS, EPISODES, SEED = 20, 400, 1


def search(method="cem"):
    """A whole campaign of a method; its results, one for each call of the function."""
    import numpy as np

    from eigenfail import plugins
    from eigenfail.values.episode import learner_seed
    from eigenfail.values.learning import LearnerContext
    from eigenfail_services.campaigns.rounds import Rounds, run_in_process
    from eigenfail_workers.functions import FunctionEngine

    plugin = plugins.load(plugins.METHODS, method)
    nothing = np.zeros((0, STEPS, 2), np.float32)
    learner = plugin(
        LearnerContext(learner_seed(SEED), EPISODES, STEPS, nothing), plugin.Settings()
    )
    engine = FunctionEngine(robustness, STEPS)
    return list(run_in_process(Rounds(learner, SEED, EPISODES), engine))


if __name__ == "__main__":
    results = search()
    failures = [result for result in results if result.is_failure]
    print(f"{len(failures)} failures in {len(results)} calls")
