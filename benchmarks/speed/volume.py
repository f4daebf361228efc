"""A million episodes in SQLite and in PostgreSQL: what each thing takes that is done with them.

`python -m benchmarks.speed.volume` writes benchmarks/results/volume.json, in half an hour and with
15 GB of disk; `python -m benchmarks.speed.volume 10000` does the same with fewer. Databases are
made in a temporary folder, and are gone afterwards; there must be about ten times the room of one
of them.
"""

import os
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import msgspec
from benchmarks.figures import RESULTS, ROOT, Figure, show, write
from benchmarks.speed.pages import serving
from benchmarks.speed.volume_places import Place, postgres, sqlite
from benchmarks.speed.volume_stages import BEGUN, LARGEST, RATE, STOP, Taken
from benchmarks.speed.volume_store import Filled, fill, sizes_of

from eigenfail.processes import NUMERIC_ENVIRONMENT
from eigenfail_services.store.engine import find_backend

TOTAL = 1_000_000
COMMAND = "python -m benchmarks.speed.volume"
OUTPUT = RESULTS / "volume.json"
AGAIN = 10
DEEP = 0.9
"""How deep in a list pages are asked for, as a share of it."""

MILLI, POLL_S = 1_000.0, 0.05
Figures = dict[str, Figure]


def stage(name: str, place: Place, address: str = "") -> Taken:
    """One thing done, in a process of its own."""
    done = started(name, place, address)
    out, _ = done.communicate()
    if done.returncode:
        raise SystemExit(f"{name} failed")
    taken = msgspec.json.decode(out, type=Taken)
    print(f"{place.name} {name}: {taken.wall_s:.1f} s, {taken.memory_mb:.0f} MiB", flush=True)
    return taken


def started(name: str, place: Place, address: str = "") -> "subprocess.Popen[bytes]":
    """The process that does it."""
    script = [sys.executable, "-m", "benchmarks.speed.volume_stages"]
    return subprocess.Popen(
        [*script, name, address or place.address, str(place.folder)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        env=os.environ | NUMERIC_ENVIRONMENT,
    )


def while_writing(name: str, place: Place) -> tuple[Taken, Taken, float]:
    """A stage beside a process that commits: both, and episodes that were committed each second."""
    begun, stop = place.folder / BEGUN, place.folder / STOP
    for file in (begun, stop):
        file.unlink(missing_ok=True)
    writer = started("writing", place)
    while not begun.exists() and writer.poll() is None:
        time.sleep(POLL_S)
    taken = stage(name, place)
    stop.touch()
    out, _ = writer.communicate()
    rate = float((place.folder / RATE).read_text())
    return taken, msgspec.json.decode(out, type=Taken), rate


def size(place: Place) -> int:
    """What the database takes on the disk, by its own account. [bytes]"""
    in_file = "SELECT page_count * page_size FROM pragma_page_count(), pragma_page_size()"
    at_server = "SELECT pg_database_size(current_database())"
    engine = find_backend(place.address).schema_engine()
    with engine.connect() as connection:
        asked = in_file if engine.dialect.name == "sqlite" else at_server
        return int(connection.exec_driver_sql(asked).scalar_one())


def figures_of(place: Place, total: int) -> Iterator[Figures]:
    """All of it, on one database, part by part."""
    filled = fill(place.address, total)
    print(f"{place.name} filled: {total / filled.commits_s:.0f} episodes/s", flush=True)
    largest = sizes_of(total)[0]
    yield ingest(filled, total, size(place))
    yield pages(place, largest)
    yield reading(place, largest)
    yield verifying(place, total)
    if place.name == "sqlite":  # PostgreSQL has programs of its own for backups.
        yield saving(place, total)
    yield thinning(place, total)


def ingest(filled: Filled, total: int, taken: int) -> Figures:
    """How episodes come in."""
    slowest = (min(filled.rates), max(filled.rates))
    return {
        "ingest_per_s": told(total / filled.commits_s, "episodes/s", total, spread=slowest),
        "bytes_per_episode": told(taken / total, "bytes", total),
    }


def pages(place: Place, largest: int) -> Figures:
    """What the API takes over a list, deep inside, and over sums; each question asked again."""
    api, deep = f"/api/v1/campaigns/{LARGEST}", int(largest * DEEP)
    with serving(place.address) as url:
        asked(f"{url}/api/v1/campaigns/{LARGEST + 1}/summary")
        first = {"summary_first_ms": asked(f"{url}{api}/summary")}
        paths = {
            "summary_ms": f"{api}/summary",
            "page_by_index_ms": f"{api}/episodes?limit=100&after={deep}",
            "page_by_robustness_ms": f"{api}/episodes?limit=100&sort=robustness_m&after={deep}",
            "page_filtered_ms": f"{api}/episodes?limit=100&after={deep}"
            "&filter=min_ttc_s%20%3C%201.5",
            "failures_by_severity_ms": f"{api}/episodes?limit=100&sort=-severity&outcome=collision",
            "course_ms": f"{api}/course",
            "safety_ms": f"{api}/safety",
            "overview_ms": "/",
        }
        times = {
            name: [asked(f"{url}{path}") for _ in range(AGAIN)] for name, path in paths.items()
        }
    return {
        **{name: told(one, "ms", 1) for name, one in first.items()},
        **{
            name: told(median(each), "ms", AGAIN, spread=(min(each), max(each)))
            for name, each in times.items()
        },
    }


def asked(url: str) -> float:
    """How long an answer takes, to its last byte. [ms]"""
    before_s = time.perf_counter()
    with urllib.request.urlopen(url, timeout=600) as answer:
        answer.read()
    return (time.perf_counter() - before_s) * MILLI


def reading(place: Place, largest: int) -> Figures:
    """Analysis of the failures, and exports of all episodes, of the largest campaign."""
    analysis = stage("analysis", place)
    found = {
        "analysis_s": told(analysis.wall_s, "s", int(analysis.amount)),
        "analysis_mb": told(analysis.memory_mb, "MiB", int(analysis.amount)),
    }
    for name in ("csv", "parquet", "parquet_noise"):
        taken = stage(name, place)
        found |= {
            f"{name}_per_s": told(largest / taken.wall_s, "episodes/s", largest),
            f"{name}_mb": told(taken.memory_mb, "MiB", largest),
        }
    return found


def verifying(place: Place, total: int) -> Figures:
    """Measure a check of the whole database."""
    verify = stage("verify", place)
    require_promises(verify.amount)
    return {
        "verify_s": told(verify.wall_s, "s", total),
        "verify_mb": told(verify.memory_mb, "MiB", total),
    }


def require_promises(amount: float) -> None:
    """Raise SystemExit if more promises are broken than this script itself leaves open."""
    if amount > PROMISES_OPEN:
        raise SystemExit("The databases are not what was promised.")


def saving(place: Place, total: int) -> Figures:
    """Measure a backup while another process writes, and its restoration."""
    backup, writer, rate = while_writing("backup", place)
    restore = stage("restore", place, place.other)
    again = stage("verify", place, place.other)
    place.forget()
    require_promises(again.amount)
    return {
        "backup_s": told(backup.wall_s, "s", total, note=BESIDE),
        "backup_bytes": told(backup.amount, "bytes", total),
        "writing_while_backup_per_s": told(rate, "episodes/s", total),
        "longest_commit_while_backup_s": told(writer.amount, "s", total),
        "restore_s": told(restore.wall_s, "s", total),
    }


BESIDE = "another process commits results meanwhile"
PROMISES_OPEN = 10
"""Jobs of campaigns that this script ends without a service: the only defects there are."""


def thinning(place: Place, total: int) -> Figures:
    """Noise pruned beside one who writes, and its room given back."""
    rehearsal = stage("rehearse", place)
    prune, writer, rate = while_writing("prune", place)
    swept = stage("vacuum", place)
    return {
        "rehearse_s": told(rehearsal.wall_s, "s", total),
        "prune_per_s": told(prune.amount / prune.wall_s, "episodes/s", int(prune.amount)),
        "prune_mb": told(prune.memory_mb, "MiB", int(prune.amount)),
        "writing_while_prune_per_s": told(rate, "episodes/s", int(prune.amount)),
        "longest_commit_while_prune_s": told(writer.amount, "s", int(prune.amount)),
        "vacuum_s": told(swept.wall_s, "s", total),
        "vacuum_bytes": told(swept.amount, "bytes", total),
        "verify_pruned_s": told(stage("verify", place).wall_s, "s", total),
    }


def told(
    value: float, unit: str, n: int, spread: tuple[float, float] | None = None, note: str = ""
) -> Figure:
    """A figure of this script."""
    return Figure(value=value, unit=unit, n=n, spread=spread, note=note, command=COMMAND)


def main(total: int = TOTAL) -> None:
    """Measure, write, show."""
    found: Figures = {}
    for kind in (sqlite, postgres):
        with kind() as place:
            for part in figures_of(place, total):
                found |= {f"{place.name}_{name}": figure for name, figure in part.items()}
                write(OUTPUT if total == TOTAL else Path(os.devnull), found)
    show(found)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
