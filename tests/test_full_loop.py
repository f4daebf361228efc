"""The whole product in one process and under a second: search, group, take back, prove, price."""

import numpy as np

from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeTask, TrajectorySource, learner_seed
from eigenfail.values.learning import LearnerContext
from eigenfail.values.records import Failures
from eigenfail_services.analysis.campaign_figures import price_failures
from eigenfail_services.analysis.job import analyse
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods.monte_carlo import MonteCarlo
from eigenfail_services.methods.replay import Replay
from eigenfail_services.statistics.intervals import rate
from eigenfail_workers.engine import Engine

SPEC = CampaignSpec(
    name="full loop", method="monte_carlo", episodes=40, planner="idm", simulator="point_mass"
)
HORIZON = 100


def run(learner, seed: int, episodes: int):
    engine = Engine(SPEC.setup())
    return list(run_in_process(Rounds(learner, seed, episodes), engine))


def context(trajectories: np.ndarray) -> LearnerContext:
    return LearnerContext(learner_seed(1), SPEC.episodes, HORIZON, trajectories)


def test_the_full_loop_in_one_process() -> None:
    nothing = np.zeros((0, HORIZON, 2), np.float32)
    results = run(MonteCarlo(context(nothing), MonteCarlo.Settings()), 1, SPEC.episodes)
    assert [result.index for result in results] == list(range(SPEC.episodes))

    failures = [result for result in results if result.is_failure]
    found = rate(len(failures), len(results))
    assert 0 < found.interval.low < found.value < found.interval.high < 1
    price = price_failures(1.2, 1.0, rate(len(failures), len(results)))
    assert price.per_failure_usd == 1.2 / len(failures)

    noise = Failures(tuple(r.index for r in failures), tuple(r.noise.z for r in failures))
    modes = analyse(noise, HORIZON, AnalysisSettings(clusters=2)).modes
    assert sum(mode.failures for mode in modes) == len(failures)

    eigenfailures = np.stack([mode.eigenfailure for mode in modes])
    replayed = run(Replay(context(eigenfailures), Replay.Settings()), 2, len(modes))
    assert [result.source for result in replayed] == ["trajectory"] * len(modes)

    again = [EpisodeTask(r.index, r.seed, TrajectorySource(r.noise.z)) for r in results[:5]]
    replays = Engine(SPEC.setup()).run(again)
    assert [replay.digest() for replay in replays] == [r.digest() for r in results[:5]]
