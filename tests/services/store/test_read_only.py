"""A database on a medium that nobody can write is read as it is; a path that SQLite cannot open."""

import os
import subprocess
from contextlib import closing, nullcontext

import pytest
from small_disks import mount_small_disk
from store_checks.examples import deliver, running

from eigenfail.errors import StoreUnavailable
from eigenfail.testing.examples import collision
from eigenfail_services.store.migrate import read_version
from eigenfail_services.store.schema import VERSION
from eigenfail_services.store.store import open_store
from eigenfail_services.upkeep.backup import backup, restore
from eigenfail_services.upkeep.verify import verify


@pytest.fixture(params=["mounted", "refused"])
def sealed(request, tmp_path, monkeypatch):
    """The address of a database in a folder that cannot be written."""
    folder = tmp_path / "medium"
    folder.mkdir()
    is_mounted = request.param == "mounted"
    address = f"sqlite:///{folder}/eigenfail.db"
    with mount_small_disk(folder, "32m") if is_mounted else nullcontext():
        with closing(open_store(address)) as store:
            deliver(store, running(store), collision(0))
        if is_mounted:
            subprocess.run(["mount", "-o", "remount,ro", str(folder)], check=True)
        else:
            # An administrator's user writes whatever the mode of a folder says.
            monkeypatch.setattr(os, "access", lambda path, *_, **__: path != folder)
        yield address


def test_database_on_a_read_only_medium_is_verified(sealed, tmp_path):
    before = sorted(path.name for path in (tmp_path / "medium").iterdir())
    checks = verify(sealed).checks
    assert len(checks) > 5
    assert [check.name for check in checks if check.defects] == []
    assert sorted(path.name for path in (tmp_path / "medium").iterdir()) == before


def test_database_on_a_read_only_medium_is_read(sealed):
    assert read_version(sealed) == VERSION
    with closing(open_store(sealed, migrate=False)) as store:
        (campaign,) = store.campaigns.page(10).items
        assert campaign.counts.failures == 1


def test_database_on_a_read_only_medium_is_backed_up_and_restored(sealed, tmp_path):
    copy = tmp_path / "copy.db"
    backup(sealed, copy)
    again = f"sqlite:///{tmp_path}/again.db"
    restore(again, tmp_path / "medium" / "eigenfail.db")
    for address in (f"sqlite:///{copy}", again):
        with closing(open_store(address)) as store:
            assert store.campaigns.page(10).items[0].counts.failures == 1


def test_service_does_not_start_on_a_read_only_medium(sealed):
    with pytest.raises(StoreUnavailable, match="may not be written"):
        open_store(sealed)


def test_database_with_a_log_is_not_read_without_it(tmp_path, monkeypatch):
    """What the log holds is part of the database: reading the file alone would lose it."""
    from eigenfail_services.store import sqlite

    monkeypatch.setattr(os, "access", lambda *_, **__: False)
    log = tmp_path / "other.db-wal"
    log.touch()
    assert sqlite.find_mode(tmp_path / "other.db") == "rw"


def test_path_beyond_the_limit_of_sqlite_is_named_as_the_cause(tmp_path):
    folder = tmp_path.joinpath(*("x" * 200 for _ in range(3)))
    with pytest.raises(StoreUnavailable, match=r"more than 504 bytes; this one has \d{3}"):
        open_store(f"sqlite:///{folder}/eigenfail.db")
