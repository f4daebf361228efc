"""Figures: programs that users would write without eigenfail, compared with eigenfail.

A search for failures is compared with soft actor-critic of stable-baselines3, with its own settings
and a gymnasium environment whose episodes, decisions, bounds and reward are those of `ast`. A
campaign of a Python function is compared with Optuna, which stores its trials in SQLite.

`python -m benchmarks.peers.handwritten_programs sac SEED PROCESSES` and `python -m
benchmarks.peers.handwritten_programs trials` run one of the two other programs, and print what it
took as JSON.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from math import log, pi
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from benchmarks.figures import ROOT, Figure, summarize_runs

from eigenfail import plugins
from eigenfail.client import Client
from eigenfail.functions import of_trajectory
from eigenfail.hosting.service import Launcher, LocalService, Plan, local_service
from eigenfail.processes import ONE_THREAD
from eigenfail.values.campaign_spec import CampaignSpec, StopRules
from eigenfail.values.disturbance import POSITION
from eigenfail.values.learning import STATE
from eigenfail.values.scene import Observation, VehicleState
from eigenfail.values.shapes import Pair
from eigenfail_services.methods.ast.settings import REWARD_SCALE, AstSettings
from eigenfail_workers.episode import EpisodeDriver
from eigenfail_workers.measures.geometry import find_nearest
from eigenfail_workers.measures.recorder import Recorder
from eigenfail_workers.noise.policy import state_vector

FAILURES, WORKERS = 50, 2
SEEDS = (1, 2, 3)
MOST_EPISODES = 5_000
STEPS, TRIALS = 10, 2_000
"""Two numbers in each step: 20 parameters."""


@of_trajectory
def robustness(z: Any) -> float:
    """A function that costs nothing: how far the largest number is from 4 sigma."""
    return float(4.0 - z.max())


class NoiseEnvironment:
    """Episodes of `cut_in` with `rulebook`, for learners that act on gymnasium's environments.

    An action is z ÷ amplitude of both axes and is held for ten steps, as a decision of `ast`; the
    reward is the paper's with the weights of `ast`, at the scale of its trainer.
    """

    def __init__(self) -> None:
        setup = CampaignSpec(name="by hand", method="ast", episodes=1).setup()
        scenario = plugins.load(plugins.SCENARIOS, setup.scenario)
        planner = plugins.load(plugins.PLANNERS, setup.planner)
        world = plugins.load(plugins.SIMULATORS, setup.simulator)()
        self._model, self._settings = setup.disturbance, AstSettings()
        parameters = scenario.Parameters()
        self._simulation = world.open(scenario(), parameters, planner(planner.Settings()), POSITION)
        self._episode = 0
        self._z: Pair = (0.0, 0.0)

    def begin(self) -> Any:
        """Reset the simulation, and return the state."""
        self._recorder = Recorder(self._model)
        steps, dt_s = self._simulation.steps, self._simulation.dt_s
        self._driver = EpisodeDriver(self._model, self, self._recorder, steps, dt_s)
        self._z = (0.0, 0.0)
        self._observation = self._simulation.reset(self._episode)
        self._episode += 1
        return self._observe()

    def draw(self, _observation: Observation, _actor: VehicleState) -> Pair:
        """Return the noise of this step, for the driver. [sigma]"""
        return self._z

    def states(self) -> Any:
        """Return no states: the learner has them."""
        return np.zeros((0, len(STATE)), np.float32)

    def decide(self, action: Any) -> tuple[Any, float, bool, bool]:
        """Hold an action; return the next state, the reward, and whether all ended in a failure."""
        amplitude = self._settings.amplitude
        self._z = (amplitude * float(action[0]), amplitude * float(action[1]))
        log_p = -0.5 * (self._z[0] ** 2 + self._z[1] ** 2) - log(2.0 * pi)
        reward = 0.0
        for _ in range(self._settings.hold):
            disturbance = self._driver.disturb(self._observation)
            assert disturbance is not None
            self._observation = self._simulation.step(disturbance)
            if self._observation.ended:
                return self._observe(), (reward + self._end()) * REWARD_SCALE, True, self._failed
            reward += log_p
        return self._observe(), reward * REWARD_SCALE, False, False

    def _end(self) -> float:
        """Record the end, and return its reward."""
        self._driver.disturb(self._observation)
        self._failed = self._observation.collided
        if self._failed:
            return 0.0
        left_m = self._recorder.measures(self._simulation.dt_s).robustness_m
        return -self._settings.alpha - self._settings.c_dist * left_m

    def _observe(self) -> Any:
        now = self._observation
        actor = now.others[find_nearest(now.ego, now.others)]
        return state_vector(now, actor, self._z, self._simulation.steps)


def make_environment() -> Any:
    """Return `NoiseEnvironment` as gymnasium has environments."""
    import gymnasium

    class CutIn(gymnasium.Env[Any, Any]):
        observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (len(STATE),), np.float32)
        action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)

        def __init__(self) -> None:
            self._noise = NoiseEnvironment()

        def reset(self, **given: Any) -> Any:
            super().reset(**given)
            return self._noise.begin(), {}

        def step(self, action: Any) -> Any:
            state, reward, ended, failed = self._noise.decide(action)
            return state, reward, ended, False, {"failed": failed}

    return CutIn()


def search_by_sb3(seed: int, processes: int) -> dict[str, float]:
    """Train until there are 50 failures; the time without what is loaded and started before."""
    from stable_baselines3 import SAC
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

    class Count(BaseCallback):  # type: ignore[misc]
        failures = episodes = 0

        def _on_step(self) -> bool:
            self.failures += sum(info.get("failed", False) for info in self.locals["infos"])
            self.episodes += int(sum(self.locals["dones"]))
            return self.failures < FAILURES

    several = [make_environment] * processes
    environment = DummyVecEnv(several) if processes == 1 else SubprocVecEnv(several)
    learner, count = SAC("MlpPolicy", environment, seed=seed, device="cpu"), Count()
    began_s = time.perf_counter()
    learner.learn(MOST_EPISODES * 10, callback=count)
    wall_s = time.perf_counter() - began_s
    environment.close()
    return {"wall_s": wall_s, "failures": count.failures, "episodes": count.episodes}


def store_by_optuna() -> dict[str, float]:
    """Trials of random parameters in SQLite; processor time of each."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    places = [f"x{i}" for i in range(2 * STEPS)]

    def objective(trial: Any) -> float:
        return 4.0 - max(trial.suggest_float(name, -5.0, 5.0) for name in places)

    with tempfile.TemporaryDirectory() as folder:
        storage = f"sqlite:///{folder}/trials.db"
        study = optuna.create_study(storage=storage, sampler=optuna.samplers.RandomSampler(seed=1))
        study.optimize(objective, n_trials=20)
        began_s = time.process_time()
        study.optimize(objective, n_trials=TRIALS // 10)
        return {"cpu_ms": 1000 * (time.process_time() - began_s) / (TRIALS // 10)}


def run_theirs(*words: object) -> dict[str, float]:
    """Run one of the two other programs, and return what it took.

    It has one thread: with networks of this size more threads take longer.
    """
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.peers.handwritten_programs", *map(str, words)],
        cwd=ROOT,
        env=os.environ | ONE_THREAD,
        stdout=subprocess.PIPE,
        check=True,
    )
    found: dict[str, float] = json.loads(done.stdout)
    return found


@contextmanager
def open_service(workers: int) -> Iterator[tuple[LocalService, Client]]:
    """A service in a fresh folder. Its workers load the simulator with their first campaign."""
    with tempfile.TemporaryDirectory() as folder:
        plan = Plan(Path(folder), port=0, workers=workers, launcher=Launcher.LOCAL)
        with local_service(plan) as service, Client(service.address.url) as client:
            yield service, client


def search_by_ast(client: Client, seed: int) -> float:
    """Return the time that a campaign takes for 50 failures. [s]"""
    began_s = time.perf_counter()
    made = client.campaigns.create(
        name="ast",
        method="ast",
        episodes=MOST_EPISODES,
        seed=seed,
        stop=StopRules(failures=FAILURES),
    )
    ended = client.campaigns.wait(made.id, timeout_s=600)
    if ended.counts.failures < FAILURES:
        raise SystemExit(f"bench: {ended.state}, {ended.counts}: {ended.stopped_because}")
    return time.perf_counter() - began_s


def store_by_campaign(service: LocalService, client: Client, seed: int) -> float:
    """Return the processor time of all processes of a service for each trial. [ms]"""
    before_s = sum_processor_time(service)
    made = client.campaigns.create(
        name="trials",
        method="monte_carlo",
        episodes=TRIALS,
        seed=seed,
        simulator="function",
        scenario="function",
        planner="handwritten_programs:robustness",
        scenario_parameters={"steps": STEPS},
    )
    ended = client.campaigns.wait(made.id, timeout_s=600)
    if ended.counts.completed != TRIALS:
        raise SystemExit(f"bench: {ended.state}, {ended.counts}: {ended.stopped_because}")
    return 1000 * (sum_processor_time(service) - before_s) / TRIALS


def sum_processor_time(service: LocalService) -> float:
    """Return the processor time of all processes of a service so far, ended ones included. [s]"""
    total_s = 0.0
    for part in (psutil.Process(part.process.pid) for part in service.parts):
        for each in (part, *part.children(recursive=True)):
            with suppress(psutil.NoSuchProcess):
                times = each.cpu_times()
                total_s += times.user + times.system + times.children_user + times.children_system
    return total_s


def failure_figures() -> dict[str, Figure]:
    """Their time to 50 failures ÷ ours, by seed; theirs in the faster of their two ways."""
    ratios, said = [], []
    with open_service(WORKERS) as (_, client):
        search_by_ast(client, seed=99)
        for seed in SEEDS:
            ours_s = search_by_ast(client, seed)
            theirs = [run_theirs("sac", seed, processes) for processes in (1, WORKERS)]
            ratios.append(min(one["wall_s"] for one in theirs) / ours_s)
            said.append(
                f"ast {ours_s:.2f} s; stable-baselines3 {theirs[0]['wall_s']:.1f} s in one process"
                f" ({theirs[0]['episodes']:.0f} episodes), {theirs[1]['wall_s']:.1f} s in {WORKERS}"
            )
    note = f"time to {FAILURES} failures on cut_in, {WORKERS} workers: " + "; ".join(said)
    return {"ast_over_sb3_wall": summarize_runs(ratios, "ratio", ">= 3", note)}


def ledger_figures() -> dict[str, Figure]:
    """Optuna's processor time for a stored trial ÷ ours; nothing where there is no Optuna."""
    if find_spec("optuna") is None:
        return {}
    os.environ["EIGENFAIL_FUNCTIONS"] = "handwritten_programs"
    os.environ["PYTHONPATH"] = f"{ROOT / 'benchmarks'}:{os.environ.get('PYTHONPATH', '')}"
    ratios, said = [], []
    with open_service(1) as (service, client):
        store_by_campaign(service, client, seed=99)
        for seed in SEEDS:
            ours_ms = store_by_campaign(service, client, seed)
            theirs_ms = run_theirs("trials")["cpu_ms"]
            ratios.append(theirs_ms / ours_ms)
            said.append(f"campaign {ours_ms:.3g} ms, Optuna {theirs_ms:.3g} ms")
    note = f"random trials of {2 * STEPS} parameters in SQLite, one worker: " + "; ".join(said)
    return {"stored_over_optuna": summarize_runs(ratios, "ratio", ">= 20", note)}


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["sac", seed, processes]:
            print(json.dumps(search_by_sb3(int(seed), int(processes))))
        case ["trials"]:
            print(json.dumps(store_by_optuna()))
