"""Figures: how far poses are from where they were once they are read back from exported files.

`python plugins/eigenfail-exchange/benchmarks/exchange.py` prints them.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

sys.path.append(str(Path(__file__).parents[3]))

import msgspec
from benchmarks.episode_pool import EpisodePool, make_setup
from benchmarks.figures import Figure
from benchmarks.samples import COMMAND
from benchmarks.targets import Target

from eigenfail import plugins
from eigenfail.contracts.recording import EgoControl, EpisodeRecording
from eigenfail.values.disturbance import AXES
from eigenfail.values.episode import EpisodeTask, PriorSource, episode_seed
from eigenfail_exchange.mcap_log import MCAP
from eigenfail_exchange.open_scenario import OPENSCENARIO

EPISODES = 20
SCENARIOS = ("cut_in", "merge_in", "lead_brake")
MM_PER_M = 1000.0


def find(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """The largest distance over all vehicles, steps, episodes and formats."""
    episodes = [(scenario, seed, index) for scenario in SCENARIOS for index in range(EPISODES)]
    errors_m = pool.each(measure_errors, *zip(*episodes, strict=True))
    worst_mm = MM_PER_M * max(map(max, errors_m))
    yield (
        "export.pose_error_mm",
        Figure(
            value=worst_mm,
            unit="mm",
            n=len(episodes),
            command=COMMAND,
            note=f"{EPISODES} episodes of `rulebook` in each of {', '.join(SCENARIOS)}",
        ),
    )


def measure_errors(scenario: str, seed: int, index: int) -> tuple[float, float]:
    """The largest error of an episode as OpenSCENARIO and as MCAP. [m]"""
    sys.path.append(str(Path(__file__).parents[1] / "tests"))
    from recording_readers import measure_error_m, read_log, read_scenario

    recording = record(scenario, seed, index)
    first, second = (
        measure_error_m(recording.scene, read(form.write(recording, EgoControl.RECORDED)))
        for form, read in ((OPENSCENARIO, read_scenario), (MCAP, read_log))
    )
    return first, second


def record(scenario: str, seed: int, index: int) -> EpisodeRecording:
    """An episode of `rulebook` with noise of p(x)."""
    setup = msgspec.structs.replace(make_setup(scenario, "rulebook"), scene_every=1)
    engine = plugins.load(plugins.ENGINES, "default")(setup)
    task = EpisodeTask(index, episode_seed(seed, index), PriorSource())
    (result,) = engine.run([task])
    return EpisodeRecording(
        campaign=1,
        campaign_name=scenario,
        index=index,
        recorded_ms=0,
        scenario=scenario,
        planner="rulebook",
        seed=task.seed,
        outcome=result.outcome,
        digest=result.digest(),
        noise=result.noise,
        channels=AXES,
        scene=result.scene,
    )


TRIALS = ((("export.",), find),)
TARGETS = {"export.pose_error_mm": Target(high=1.0)}
