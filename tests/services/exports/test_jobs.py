"""Exports while they end, are removed by others, and where others could put things."""

import os
import shutil
import stat
import threading
import time

import deadlines
import pytest

from eigenfail.errors import NotFound, ServiceError
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.export import ExportRequest
from eigenfail_services import export_jobs
from eigenfail_services.export_jobs import ExportJobs, find_export_folder
from eigenfail_services.store import open_store

WITHIN_S = deadlines.PROCESS_S
JOIN_S = 0.2
"""Enough for a thread that nothing holds."""


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "exports"


@pytest.fixture
def make(folder):
    """Exports of a campaign without episodes, and how to ask for one."""
    store = open_store("memory://")
    campaign = store.campaigns.create(CampaignSpec(name="one", method="monte_carlo", episodes=1)).id
    made = ExportJobs(store, folder)
    yield made, lambda: made.create(campaign, ExportRequest()).id
    at_rest()
    store.close()


def workers():
    """The threads that work on exports."""
    return [thread for thread in threading.enumerate() if "_run" in thread.name]


def at_rest():
    for thread in workers():
        thread.join()


@pytest.fixture
def gate(monkeypatch):
    """What every file waits for before it is written."""
    opened, write = threading.Event(), export_jobs.export_formats.write_parquet

    def wait(*given, **named):
        opened.wait()
        write(*given, **named)

    monkeypatch.setattr(export_jobs.export_formats, "write_parquet", wait)
    yield opened
    opened.set()
    at_rest()


def test_a_file_that_becomes_whole_while_it_is_asked_for_is_not_made_twice(
    make, folder, gate, monkeypatch
):
    made, ask = make
    export = ask()
    (worker,), begun, look = workers(), [], made._shelf.look

    def look_as_it_ends(name):
        seen = look(name)
        gate.set()
        while not (folder / name / export_jobs.EPISODES_FILE).exists():
            time.sleep(0.001)
        worker.join(JOIN_S)
        return seen

    monkeypatch.setattr(made._shelf, "look", look_as_it_ends)
    monkeypatch.setattr(made, "_begin", begun.append)
    assert made.get(export).state == "running"
    worker.join()
    assert made.get(export).state == "done"
    assert begun == []


def test_two_services_that_make_one_file_both_make_it_whole(make, folder, monkeypatch):
    made, ask = make
    written, write = (
        threading.Barrier(2, timeout=WITHIN_S),
        export_jobs.export_formats.write_parquet,
    )

    def write_together(*given, **named):
        write(*given, **named)
        written.wait()

    monkeypatch.setattr(export_jobs.export_formats, "write_parquet", write_together)
    export = ask()
    other = ExportJobs(made._store, folder)
    assert other.get(export).state == "running"
    at_rest()
    assert made.get(export).state == other.get(export).state == "done"
    assert {path.name for path in (folder / export).iterdir()} == {
        export_jobs.REQUEST_FILE,
        export_jobs.EPISODES_FILE,
    }


def test_what_is_removed_while_it_is_asked_for_is_not_there_any_more(make, folder, monkeypatch):
    made, ask = make
    export = ask()
    at_rest()
    read = export_jobs._read_bytes

    def read_as_it_goes(path):
        content = read(path)
        shutil.rmtree(folder / export, ignore_errors=True)
        return content

    monkeypatch.setattr(export_jobs, "_read_bytes", read_as_it_goes)
    assert made.get(export).state == "running"
    at_rest()
    with pytest.raises(NotFound, match="create a new export"):
        made.get(export)
    with pytest.raises(NotFound):
        made.file(export)


def test_what_is_gone_from_a_list_of_folders_is_the_first_to_make_room(make, folder, monkeypatch):
    made, ask = make
    monkeypatch.setattr(export_jobs, "MAX_EXPORTS", 3)
    exports = [ask()]
    (folder / "gone").symlink_to("nowhere")
    for _ in range(2):
        at_rest()
        exports.append(ask())
    at_rest()
    assert [made.get(export).state for export in exports] == ["done"] * 3


def test_what_is_fetched_makes_room_last(make, monkeypatch):
    made, ask = make
    monkeypatch.setattr(export_jobs, "MAX_EXPORTS", 2)
    old, new = ask(), ask()
    at_rest()
    for age_s, export in ((20, old), (10, new)):
        long_ago = time.time() - age_s
        os.utime(made._shelf.home(export), (long_ago, long_ago))
    assert made.file(old).name == export_jobs.EPISODES_FILE
    ask()
    assert made.get(old).state == "done"
    with pytest.raises(NotFound):
        made.get(new)


@pytest.fixture
def known(make, folder):
    """An export that is done, in a folder that is opened to everybody."""
    made, ask = make
    export = ask()
    at_rest()
    folder.chmod(0o755)
    return made, ask, export


def test_nobody_else_can_look_into_the_folder(known, folder):
    made, _, export = known
    assert made.get(export).state == "done"
    for path in (folder, folder / export):
        assert stat.S_IMODE(path.stat().st_mode) == 0o700


def test_a_folder_of_somebody_else_is_refused(known, monkeypatch):
    made, ask, export = known
    mine = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: mine + 1)
    for use in (ask, lambda: made.get(export), lambda: made.file(export)):
        with pytest.raises(ServiceError, match=r"belongs to another user.*Remove it"):
            use()


def test_a_link_in_the_place_of_the_folder_is_refused(known, folder, tmp_path):
    made, ask, export = known
    folder.rename(tmp_path / "elsewhere")
    folder.symlink_to(tmp_path / "elsewhere")
    for use in (ask, lambda: made.get(export)):
        with pytest.raises(ServiceError, match="it is a link"):
            use()
    assert len([*(tmp_path / "elsewhere").iterdir()]) == 1


def test_databases_keep_their_exports_apart(tmp_path):
    assert find_export_folder(f"sqlite:///{tmp_path}/a.db") == tmp_path / "exports"
    first, second = (
        find_export_folder(f"postgresql+psycopg://me:secret@here/{name}") for name in ("one", "two")
    )
    assert first != second
    assert find_export_folder("postgresql+psycopg://me:changed@here/one") == first
