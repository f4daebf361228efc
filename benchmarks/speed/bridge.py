"""What the way over a bridge costs: the same episodes behind one as built in."""

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager

from benchmarks.episode_loop import tasks
from benchmarks.figures import ROOT, Figure, show, summarize_runs

from eigenfail.contracts import EpisodeEngine
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import EpisodeSetup
from eigenfail_workers.bridge.connection import SharedConnection
from eigenfail_workers.bridge.engine import BridgeEngine
from eigenfail_workers.engine import Engine

EPISODES = 400
WARM_UP = 64
PAIRS = 5
BRIDGE = ROOT / "examples" / "bridge" / "minimal.py"


def bridge_figures() -> dict[str, Figure]:
    """Episodes per second of `highway` with `rulebook` behind a bridge ÷ built in, in turn."""
    with program() as address, closing(SharedConnection(address)) as line:
        behind = BridgeEngine(setup("bridge", {"steps": 100}), line)
        built_in = Engine(setup("highway", {}))
        for engine in (behind, built_in):
            rate(engine, WARM_UP, seed=99)
        pairs = [
            rate(behind, EPISODES, seed) / rate(built_in, EPISODES, seed) for seed in range(PAIRS)
        ]
    return {"bridge_over_builtin": summarize_runs(pairs, "ratio", ">= 0.85")}


def setup(simulator: str, parameters: dict[str, int]) -> EpisodeSetup:
    """`cut_in` with `rulebook`, behind the bridge or here."""
    return EpisodeSetup(simulator, "cut_in", parameters, "rulebook", {}, DisturbanceModel())


def rate(engine: EpisodeEngine, episodes: int, seed: int) -> float:
    """Episodes per second of Monte Carlo."""
    began_s = time.perf_counter()
    failed = sum(result.fault is not None for result in engine.run(tasks(0, episodes, seed)))
    if failed:
        raise SystemExit(f"bench: {failed} episodes could not be run.")
    return episodes / (time.perf_counter() - began_s)


@contextmanager
def program() -> Iterator[str]:
    """The reference bridge as a program of its own; where it listens."""
    with tempfile.TemporaryDirectory() as folder:
        address = f"ipc://{folder}/bridge"
        process = subprocess.Popen([sys.executable, str(BRIDGE), address])
        try:
            yield address
        finally:
            process.kill()
            process.wait()


if __name__ == "__main__":
    show(bridge_figures())
