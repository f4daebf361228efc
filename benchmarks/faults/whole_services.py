"""Faults by the hundred on whole services of real processes: what was lost, doubled or changed.

`python -m benchmarks.faults.whole_services --faults 24` causes so many on SQLite, and a third of
that on PostgreSQL, whose server is broken off as well; each kind as often as any other.
"""

import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import partial
from random import Random
from typing import Annotated, NamedTuple

import typer
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import ROOT, Figure
from benchmarks.truth.undisturbed import number

sys.path += [str(ROOT / "tests" / name) for name in ("chaos", "support")]
sys.path.append(str(ROOT / "tests" / "docs"))

from fault_table import read_faults
from postgresql import server
from stage import Stage, stage_on
from storm import NOTHING_MORE, SERVER_SHUTDOWN, WRITE_LOCK, Fault, Storm, hold_write_lock, verdict

SEED = 20261122
FAULTS = 90
OF_THEM_ON_POSTGRESQL = 3
"""One in so many, besides."""


class Weathered(NamedTuple):
    """What came of it.

    Attributes:
        befell: how often each kind of fault was caused.
        lost: episodes that were counted and are not there, or that nobody will run any more.
        doubled: rows beyond the first of an episode.
        complaints: what else the reader of the database says.
        campaigns: how many were run, and `equal` how many of them have the digest of a calm day.
    """

    befell: Counter[str]
    lost: int
    doubled: int
    complaints: tuple[str, ...]
    campaigns: int
    equal: int


def digests() -> dict[str, str]:
    """Of the campaigns when nothing disturbs them."""
    with stage_on("") as stage:
        stage.services()
        stage.worker()
        campaigns = stage.launch()
        found = stage.finish(*campaigns.values()).digests
        return {method: found[campaign] for method, campaign in campaigns.items()}


def run_storm(
    stage: Stage,
    faults: int,
    seed: int,
    calm: Mapping[str, str],
    more: Mapping[str, Fault] = NOTHING_MORE,
) -> Weathered:
    """A storm of so many faults, and what the reader says of it."""
    storm = Storm(stage, Random(seed), more)
    storm.rage(lambda: storm.befell.total() >= faults)
    found, differing = verdict(storm, calm)
    n = len(storm.campaigns)
    return Weathered(
        storm.befell, found.lost, found.doubled, found.complaints, n, n - len(differing)
    )


def everywhere(faults: int = FAULTS, seed: int = SEED) -> dict[str, Weathered]:
    """A storm on each database."""
    calm = digests()
    with stage_on("") as stage:
        lock = {WRITE_LOCK: partial(hold_write_lock, stage.url, Random(seed))}
        found = {"SQLite": run_storm(stage, faults, seed, calm, lock)}
    with server() as running, stage_on(running.url) as stage:
        more = {SERVER_SHUTDOWN: running.restarted}
        some = max(1, faults // OF_THEM_ON_POSTGRESQL)
        return found | {"PostgreSQL": run_storm(stage, some, seed, calm, more)}


def kinds(_crew: EpisodePool, _seed: int) -> Iterator[tuple[str, Figure]]:
    """Yield the number of kinds of faults that the tests inject, by their marks."""
    marked = read_faults()
    tests = {test for fault in marked for test in fault.tests}
    yield "faults.kinds", number(len(marked), "kinds", len(tests))


def faults(_crew: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Figures: how many faults of how many kinds, and what was lost, doubled or changed."""
    found = [*everywhere(seed=seed).values()]
    befell = sum((one.befell for one in found), Counter[str]())
    n, campaigns = befell.total(), sum(one.campaigns for one in found)
    equal = sum(one.equal for one in found) / campaigns
    yield "faults.storm.kinds", number(len(+befell), "kinds", n)
    yield "faults.injected", number(n, "faults", n)
    yield "faults.lost", number(sum(one.lost for one in found), "episodes", n)
    yield "faults.doubled", number(sum(one.doubled for one in found), "rows", n)
    yield "faults.complaints", number(sum(len(one.complaints) for one in found), "sentences", n)
    yield "faults.digest_equal", number(equal, "share", campaigns)


def main(
    faults: Annotated[int, typer.Option(min=1, help="On SQLite.")] = FAULTS,
    seed: Annotated[int, typer.Option(min=0, help="Of what is done to whom.")] = SEED,
) -> None:
    """Do it all; exit code 1 if anything was lost, doubled or changed."""
    found = everywhere(faults, seed)
    for place, one in found.items():
        print(
            f"{place:<10} {one.befell.total():>4} faults of {len(+one.befell)} kinds, "
            f"{one.lost} lost, {one.doubled} doubled, "
            f"{one.equal} of {one.campaigns} campaigns as on a calm day"
        )
        print("".join(f"    {times} × {kind}\n" for kind, times in sorted(one.befell.items())))
        print("".join(f"    {said}\n" for said in one.complaints[:10]))
    bad = any(one.lost or one.doubled or one.complaints for one in found.values())
    raise typer.Exit(bad or any(one.equal < one.campaigns for one in found.values()))


if __name__ == "__main__":
    typer.run(main)
