"""What is done with a full database, each in a process of its own, so that its memory is told.

`python -m benchmarks.speed.volume_stages NAME ADDRESS FOLDER` does one of them, and prints what it
took.
"""

import resource
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import closing
from importlib import import_module
from pathlib import Path

import msgspec
from benchmarks.speed.volume_store import GROUP, delivery, results

from eigenfail import filters
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.operations import Retention
from eigenfail_services.campaigns.analysis_jobs import run_analysis
from eigenfail_services.campaigns.validation import check_spec
from eigenfail_services.export_formats import ExportSource, Selection, write_csv, write_parquet
from eigenfail_services.store.store import Store, open_store
from eigenfail_services.upkeep.backup import backup, restore, vacuum
from eigenfail_services.upkeep.pruning import PruneSelection, prune, rehearse
from eigenfail_services.upkeep.verify import verify

LARGEST = 1
"""The campaign that is exported and analysed."""

RULE = Retention(keep_every=100)
SAVED = "backup"
BEGUN, STOP, RATE = "begun", "stop", "rate"
"""Files by which the process that writes is steered."""

PEAKS_IN = 1024.0


class Taken(msgspec.Struct, frozen=True):
    """What a stage took.

    Attributes:
        amount: rows or bytes that it made or went through; what they are is the stage's affair.
        memory_mb: the largest resident memory of its process. [MiB]
    """

    wall_s: float
    memory_mb: float
    amount: float


def analysed(address: str, _folder: Path) -> float:
    """The failures of the largest campaign; how many."""
    with closing(open_store(address)) as store:
        analysis = store.analyses.create(LARGEST, AnalysisSettings()).id
        run_analysis(store, analysis)
        found = store.analyses.get(analysis)
    if found.result is None:
        raise SystemExit(found.problem)
    return len(found.result.episodes)


def source(store: Store) -> ExportSource:
    """All episodes of the largest campaign."""
    columns = filters.list_columns(store.campaigns.get(LARGEST).spec)
    return ExportSource(store, LARGEST, Selection((), filters.BY_INDEX, columns))


def as_csv(address: str, folder: Path) -> float:
    """All rows of the largest campaign; bytes of the file."""
    file = folder / "episodes.csv"
    with closing(open_store(address)) as store, file.open("wb") as out:
        out.writelines(write_csv(source(store)))
    return size_of(file)


def as_parquet(address: str, folder: Path) -> float:
    """All rows of the largest campaign; bytes of the file."""
    return parquet(address, folder / "rows.parquet", noise=False)


def with_noise(address: str, folder: Path) -> float:
    """The same with their noise."""
    return parquet(address, folder / "noise.parquet", noise=True)


def parquet(address: str, file: Path, *, noise: bool) -> float:
    """A file of all rows; its bytes."""
    with closing(open_store(address)) as store, file.open("wb") as out:
        out.writelines(write_parquet(source(store), noise=noise))
    return size_of(file)


def size_of(file: Path) -> float:
    """In bytes; the file is gone afterwards."""
    size = file.stat().st_size
    file.unlink()
    return float(size)


def verified(address: str, _folder: Path) -> float:
    """All promises; how many are broken."""
    return verify(address).defects


def saved(address: str, folder: Path) -> float:
    """A backup; its bytes."""
    return backup(address, folder / SAVED, force=True).bytes


def restored(address: str, folder: Path) -> float:
    """The backup into an empty database; its bytes."""
    return restore(address, folder / SAVED).bytes


def rehearsed(address: str, _folder: Path) -> float:
    """What would be pruned; how many bytes."""
    return rehearse(address, RULE, PruneSelection()).weight.bytes


def pruned(address: str, _folder: Path) -> float:
    """All campaigns; how many episodes."""
    return prune(address, RULE, PruneSelection()).weight.episodes


def vacuumed(address: str, _folder: Path) -> float:
    """Room that is given back; how many bytes."""
    done = vacuum(address)
    return done.bytes_before - done.bytes_after


def writing(address: str, folder: Path) -> float:
    """Commit groups of results until a file says stop; the longest commit. [s]

    Another file says how many episodes that were each second.
    """
    made, longest_s, stop = results(), 0.0, folder / STOP
    with closing(open_store(address)) as store:
        spec = CampaignSpec(name="meanwhile", method="monte_carlo", episodes=5_000_000)
        campaign = store.campaigns.create(check_spec(spec)).id
        store.campaigns.move(campaign, CampaignState.RUNNING)
        first, begun_s = 0, time.perf_counter()
        while not stop.exists():
            group = [delivery(made, index) for index in range(first, first + GROUP)]
            before_s = time.perf_counter()
            store.episodes.commit(campaign, group)
            longest_s = max(longest_s, time.perf_counter() - before_s)
            first += GROUP
            (folder / BEGUN).touch()
        rate = first / (time.perf_counter() - begun_s)
        store.campaigns.move(campaign, CampaignState.CANCELLING)
        store.campaigns.move(campaign, CampaignState.CANCELLED)
    (folder / RATE).write_text(str(rate))
    return longest_s


STAGES: Mapping[str, Callable[[str, Path], float]] = {
    "analysis": analysed,
    "csv": as_csv,
    "parquet": as_parquet,
    "parquet_noise": with_noise,
    "verify": verified,
    "backup": saved,
    "restore": restored,
    "rehearse": rehearsed,
    "prune": pruned,
    "vacuum": vacuumed,
    "writing": writing,
}

LOADED_LATE = ("eigenfail_services.analysis.job", "pyarrow.parquet")


def take(name: str, address: str, folder: Path) -> Taken:
    """One stage, in this process; loading libraries is no part of its time."""
    for module in LOADED_LATE:
        import_module(module)
    before_s = time.perf_counter()
    amount = STAGES[name](address, folder)
    wall_s = time.perf_counter() - before_s
    return Taken(wall_s, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / PEAKS_IN, amount)


def main(name: str, address: str, folder: str) -> None:
    """Print what a stage took."""
    print(msgspec.json.encode(take(name, address, Path(folder))).decode())


if __name__ == "__main__":
    main(*sys.argv[1:])
