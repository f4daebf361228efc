"""How `ast` finds failures and transfers with several amounts of training, by seed, on `cut_in`.

`python -m benchmarks.truth.ast_training settings FIRST_SEED SEEDS` prints a line for each choice of
settings; the defaults were chosen with `settings 7021 12`. `python -m benchmarks.truth.ast_training
members FIRST_SEED SEEDS` trains single members of the ensemble of `examples/transfer.toml`, and
prints what each of them does at its worst place.
"""

import sys
from statistics import mean
from typing import Any

import msgspec
from benchmarks.episode_pool import EpisodePool, open_pool
from benchmarks.learning_figures import log_p_per_step
from benchmarks.searches import evaluations, side_by_side
from benchmarks.truth.transfer import list_transfers, read_example

from eigenfail.values.campaign_spec import CampaignSpec

EPISODES, ELSEWHERE = 1000, 25

CHOICES: dict[str, dict[str, Any]] = {
    "1 step": {"gradient_steps": 1},
    "2 steps": {"gradient_steps": 2},
    "2 steps, batches of 32": {"gradient_steps": 2, "batch_size": 32},
    "4 steps after 60 episodes": {"gradient_steps": 4, "warm_up": 60},
}

ENDS = {
    "distance_m": (52.0, 64.0),
    "actor_speed_mps": (12.0, 14.0),
    "ego_speed_mps": (22.0, 25.0),
}
"""Ends of the ranges that `transfer` judges."""


def compare_choices(hands: EpisodePool, seeds: range) -> None:
    """Train with each choice from each seed, and evaluate at the ends of the ranges."""
    for name, settings in CHOICES.items():
        specs = [
            CampaignSpec(
                name="ast",
                method="ast",
                episodes=EPISODES,
                scenario="cut_in",
                seed=seed,
                settings=settings,
            )
            for seed in seeds
        ]
        trained = side_by_side(hands, specs)
        found = [sum(run.crashed) for run in trained]
        likelihoods = [one for run in trained if (one := log_p_per_step(run)) is not None]
        shares = [
            mean(run.crashed)
            for parameter, ends in ENDS.items()
            for end in ends
            for run in evaluations(hands, trained, ELSEWHERE, **{parameter: end})
        ]
        print(
            f"{name}: {mean(found):.0f} failures (fewest {min(found)}), log p per step "
            f"{mean(likelihoods):.2f}, elsewhere {mean(shares):.3f} failed",
            flush=True,
        )


def show_worst_places(hands: EpisodePool, seeds: range) -> None:
    """Print the smallest share of failures of members of the example's ensemble."""
    example = read_example()
    members, judged = example.settings["members"], example.settings["judged"]
    spec = msgspec.structs.replace(
        example,
        method=example.settings["method"],
        settings=example.settings["settings"],
        episodes=(example.episodes - judged) // members,
    )
    for found in list_transfers(hands, spec, seeds):
        place = found.find_worst()
        print(f"{found.shares[place].value:.3f} at {place}", flush=True)


if __name__ == "__main__":
    with open_pool() as everybody:
        match sys.argv[1:]:
            case ["settings", first_seed, number]:
                compare_choices(everybody, range(int(first_seed), int(first_seed) + int(number)))
            case ["members", first_seed, number]:
                show_worst_places(everybody, range(int(first_seed), int(first_seed) + int(number)))
            case _:
                raise SystemExit(__doc__)
