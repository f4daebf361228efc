"""What a learner takes for a round, in one process: without the hub, and with made-up results.

`python -m benchmarks.speed.learner_cost CASE` prints, as JSON, seconds of processor time of the
learner for a round, seconds of the hub for keeping the checkpoint, and the bytes of that. Made up
are measures and noise, of real size: what is learnt from them is of no use, and takes as long. Half
of the episodes are failures.
"""

import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from benchmarks.speed.simulated_workers import examples
from msgspec.structs import replace

from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeResult, EpisodeTask
from eigenfail.values.learning import STATE, LearnerContext
from eigenfail.wire.messages import (
    Observed,
    Proposed,
    Start,
    encode,
    read_learner_command,
    read_learner_message,
)
from eigenfail_services.campaigns.validation import check_spec
from eigenfail_services.hub.learner_link import check_numbers
from eigenfail_services.hub.learner_process import create_rounds, make_proposal
from eigenfail_services.store.store import Store, open_store

HORIZON = 100
ROUNDS = 5
"""How many are measured; the middle one counts."""


class Case(NamedTuple):
    """A method as a campaign of so many episodes has it.

    Attributes:
        skipped: the rounds of other kinds, before those that are measured.
        parallel: episodes that the campaign wants to run at a time; None where it does not say.
    """

    method: str
    settings: dict[str, Any]
    episodes: int
    skipped: int = 1
    parallel: int | None = None


CASES = {
    "monte_carlo": Case("monte_carlo", {}, 1_000_000),
    "many": Case("monte_carlo", {"round_size": 2_000}, 1_000_000),
    "ast": Case("ast", {}, 1_000, skipped=8),
    "difs": Case("difs", {}, 1_000),
    "monte_carlo_parallel": Case("monte_carlo", {}, 1_000_000, parallel=1_000),
    "ast_parallel": Case("ast", {}, 2_000, skipped=8, parallel=100),
}


class Took(NamedTuple):
    """Of one round."""

    learner_s: float
    hub_s: float
    checkpoint_bytes: int
    round_size: int


def rounds(case: Case, store: Store) -> Iterator[Took]:
    """One after the other, as hub and learner go through them."""
    spec = CampaignSpec(name="learner", method="monte_carlo", episodes=case.episodes)
    campaign = store.campaigns.create(check_spec(spec)).id
    nothing = np.zeros((0, HORIZON, 2), np.float32)
    context = LearnerContext(1, case.episodes, HORIZON, nothing, parallel=case.parallel)
    learner = create_rounds(Start(case.method, case.settings, context, 1, None))
    opened, made_up = make_proposal(learner).rounds, MadeUp()
    while True:
        told = encode(Observed(tuple(map(made_up, opened[0].tasks))))
        began_s = time.process_time()
        observed = read_learner_command(told)
        assert isinstance(observed, Observed)
        learner.complete(observed.results)
        said = encode(make_proposal(learner))
        learner_s = time.process_time() - began_s
        began_s = time.perf_counter()
        message = check_numbers(read_learner_message(said))
        assert isinstance(message, Proposed)
        store.checkpoints.save(campaign, message.checkpoint, message.estimate)
        hub_s = time.perf_counter() - began_s
        yield Took(learner_s, hub_s, len(message.checkpoint), len(opened[0].tasks))
        opened = message.rounds


class MadeUp:
    """Results whose noise and robustness are drawn."""

    def __init__(self) -> None:
        self._plain, _ = examples()
        self._random = np.random.default_rng(1)

    def __call__(self, task: EpisodeTask) -> EpisodeResult:
        """Of one task."""
        z = self._random.standard_normal((HORIZON, 2)).astype(np.float32)
        states = self._random.uniform(-1.0, 1.0, (HORIZON, len(STATE))).astype(np.float32)
        sigma = np.ones_like(z)
        measures = replace(self._plain.measures, robustness_m=self._random.uniform(-5.0, 5.0))
        return replace(
            self._plain,
            index=task.index,
            seed=task.seed,
            steps=HORIZON,
            noise=replace(self._plain.noise, z=z, sigma=sigma),
            states=states,
            measures=measures,
            source=task.source_kind,
        )


def main() -> None:
    """Measure and print."""
    case = CASES[sys.argv[1]]
    with TemporaryDirectory() as folder:
        store = open_store(f"sqlite:///{Path(folder) / 'eigenfail.db'}")
        course = rounds(case, store)
        taken = [next(course) for _ in range(case.skipped + ROUNDS)][case.skipped :]
        store.close()
    names = Took._fields
    print(json.dumps({name: median(getattr(each, name) for each in taken) for name in names}))


if __name__ == "__main__":
    main()
