"""Count failures without noise, under Monte Carlo and under a search, in as many episodes each.

    python compare.py merge.toml
    python compare.py merge.toml --model merge_dqn.zip --algorithm DQN

It runs in this process, on the episodes that a service would run.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from eigenfail import plugins
from eigenfail.cli.specs import read_spec
from eigenfail.settings import read_settings
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeResult, learner_seed
from eigenfail.values.learning import LearnerContext
from eigenfail.worlds import world_of
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_workers.engine import Engine

NOTHING = 1e-9
"""Smallest scale of noise that a campaign may have: it is below what single precision tells."""


def run(spec: CampaignSpec) -> list[EpisodeResult]:
    """Return the episodes of a campaign."""
    spec, form = world_of(spec.simulator).resolve(spec)
    shape = 0, form.steps, len(form.channels)
    context = LearnerContext(
        learner_seed(spec.seed), spec.episodes, form.steps, np.zeros(shape, np.float32)
    )
    method = plugins.load(plugins.METHODS, spec.method)
    learner = method(context, read_settings(method.Settings, spec.settings, "settings"))
    rounds = Rounds(learner, spec.seed, spec.episodes)
    return list(run_in_process(rounds, Engine(spec.setup())))


def describe(results: list[EpisodeResult]) -> str:
    """Return the failures among episodes, and errors if there are any."""
    failures = sum(result.is_failure for result in results)
    faults = [result.fault for result in results if result.fault is not None]
    return f"{failures} of {len(results)}" + (
        f", {len(faults)} errored: {faults[0]}" if faults else ""
    )


def compare(spec: CampaignSpec) -> None:
    """Print the failures of each row."""
    chance = replace(spec, method="monte_carlo", settings={})
    calm = replace(chance, disturbance=replace(chance.disturbance, scale=NOTHING))
    for name, each in (("without noise", calm), ("Monte Carlo", chance), (spec.method, spec)):
        print(f"{name:14} {describe(run(each))}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("campaign", type=Path)
    parser.add_argument("--model")
    parser.add_argument("--algorithm", default="DQN")
    parser.add_argument("--episodes", type=int)
    given = parser.parse_args()
    campaign = read_spec(given.campaign)
    changes: dict[str, Any] = {}
    if given.model:
        changes["planner_settings"] = {"model": given.model, "algorithm": given.algorithm}
    if given.episodes:
        changes["episodes"] = given.episodes
    compare(replace(campaign, **changes))
