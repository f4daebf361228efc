"""The power goes: what was written and not synced is gone, and nothing else (SQLite)."""

import re
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from random import Random
from typing import NamedTuple

import deadlines
import pytest
import reader
from power import Disk, Event, recorded, recorder
from store_checks.examples import deliver

from eigenfail.testing.examples import result
from eigenfail_services.store.store import open_store

pytestmark = pytest.mark.service

PATIENCE_S = deadlines.PROCESS_S
SEED = 20261122
EACH = 8
COMMITS = 24
EPISODES = EACH * COMMITS
FILE = "a.db"
AMONG_WRITES = 0.03
GONE_ON = 10
"""Every so-manyth database is gone on with to the end."""

COMMIT = f"""
import sqlite3, sys
from eigenfail.testing.examples import result
from store_checks.examples import deliver, running
from eigenfail_services.store import sqlite
from eigenfail_services.store.store import open_store
if sys.argv[2:]:
    sqlite.PRAGMAS = ("journal_mode = WAL", f"synchronous = {{sys.argv[2]}}")
store = open_store("sqlite:///" + sys.argv[1])
campaign = running(store, episodes={EPISODES})
for first in range(0, {EPISODES}, {EACH}):
    deliver(store, campaign, *map(result, range(first, first + {EACH})))
    sys.stdout.write(f"kept {{first + {EACH}}}\\n")
    sys.stdout.flush()
    if first % {5 * EACH} == 0:  # as SQLite does by itself when the log is long
        sqlite3.connect(sys.argv[1]).execute("PRAGMA wal_checkpoint").close()
"""
KEPT = re.compile(rb"kept (\d+)\n")


class Life(NamedTuple):
    """What a process did to a database, and what lay in its folder before."""

    folder: Path
    image: Path
    events: list[Event]

    def cuts(self) -> Iterator[tuple[Disk, int]]:
        """The disk at telling moments, and how many results were acknowledged by then.

        They lie before every sync, behind every acknowledgement, and here and there among writes.
        """
        disk, kept, random = Disk(self.folder, self.image), 0, Random(SEED)
        for event in self.events:
            if event.what != "write" or random.random() < AMONG_WRITES:
                yield disk, kept
            disk.take(event)
            if told := KEPT.fullmatch(event.data):
                kept = int(told[1])
                yield disk, kept
        yield disk, kept


@pytest.fixture
def live(sqlite_template: Path, tmp_path: Path) -> Callable[..., Life]:
    """Lets a process commit results, one after the other, and tells what it did."""

    def live(*synchronous: str) -> Life:
        folder, image, log = (tmp_path / name for name in ("now", "before", "log"))
        words = recorder(log)
        folder.mkdir()
        shutil.copy(sqlite_template, folder / FILE)
        shutil.copytree(folder, image)
        command = [*words, sys.executable, "-c", COMMIT, str(folder / FILE), *synchronous]
        subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE_S)
        return Life(folder, image, recorded(log))

    return live


def stored(folder: Path) -> int:
    """How many results there are; the file is sound, and they are the first ones, all whole."""
    with closing(sqlite3.connect(folder / FILE)) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        found = connection.execute('SELECT "index" FROM episodes ORDER BY "index"').fetchall()
    assert [index for (index,) in found] == [*range(len(found))]
    assert len(found) % EACH == 0
    assert reader.read(f"sqlite:///{folder / FILE}").sound
    return len(found)


def gone_on(folder: Path) -> str:
    """The digest once every result was brought again, as workers do it."""
    with closing(open_store(f"sqlite:///{folder / FILE}")) as store:
        campaign = store.campaigns.get(1)
        deliver(store, campaign, *map(result, range(EPISODES)))
        assert store.campaigns.get(1).counts.completed == EPISODES
        return store.episodes.digest(1)


@pytest.mark.fault(
    "power cut",
    group="storage",
    outcome="Everything that was acknowledged is there, the file is sound, and the campaign "
    "keeps its digest. Unsynced writes may be gone, whole or by sectors (SQLite: "
    "before every sync, after every acknowledgement and during writes).",
)
@pytest.mark.parametrize("chance", [None, Random(SEED)], ids=["all", "some"])
def test_what_was_acknowledged_survives_a_power_cut_at_any_moment(
    live: Callable[..., Life], tmp_path: Path, chance: Random | None
) -> None:
    """All that was not synced is lost, or some of it, sector by sector."""
    life, lost, digests = live(), 0, set[str]()
    digests.add(gone_on(life.folder))
    for number, (disk, kept) in enumerate(life.cuts()):
        folder = tmp_path / f"{number}"
        disk.lay_out(folder, chance)
        lost += stored(folder) < kept
        if kept and number % GONE_ON == 0:
            digests.add(gone_on(folder))
        shutil.rmtree(folder)
    assert lost == 0
    assert len(digests) == 1
    assert kept == EPISODES
    assert number > 2 * COMMITS


def test_who_does_not_sync_is_found_out(live: Callable[..., Life], tmp_path: Path) -> None:
    *_, (disk, kept) = (cut for cut in live("OFF").cuts() if cut[1] < EPISODES)
    disk.lay_out(tmp_path / "cut")
    assert stored(tmp_path / "cut") < kept
