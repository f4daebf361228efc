"""The bare loop: episodes in one process, with nothing of the service around them.

Prints, as JSON, episodes per second, CPU milliseconds per episode, and whether it is compiled:
`python -m benchmarks.episode_loop EPISODES SEED`.
"""

import json
import sys
import time
from importlib.machinery import EXTENSION_SUFFIXES

from eigenfail import plugins
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeTask, PriorSource, episode_seed
from eigenfail_workers import episode

WARM_UP = 5


def tasks(first: int, n: int, seed: int) -> list[EpisodeTask]:
    """Monte Carlo episodes of a campaign."""
    return [
        EpisodeTask(index, episode_seed(seed, index), PriorSource())
        for index in range(first, first + n)
    ]


def main() -> None:
    """Run and print."""
    n, seed = int(sys.argv[1]), int(sys.argv[2])
    spec = CampaignSpec(name="bare", method="monte_carlo", episodes=n, seed=seed)
    engine = plugins.load(plugins.ENGINES, "default")(spec.setup())
    list(engine.run(tasks(0, WARM_UP, seed)))
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    list(engine.run(tasks(WARM_UP, n, seed)))
    wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
    compiled = episode.__file__.endswith(tuple(EXTENSION_SUFFIXES))
    measured = {"episodes_per_s": n / wall_s, "cpu_ms": 1000 * cpu_s / n, "compiled": compiled}
    print(json.dumps(measured))


if __name__ == "__main__":
    main()
