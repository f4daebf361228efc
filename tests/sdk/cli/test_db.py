"""`eigenfail db`: a database of one's own, made, checked, backed up and restored."""

import json
import re
import sqlite3
from contextlib import closing

from store_checks.examples import deliver, running

from eigenfail.hosting.folder import DataFolder
from eigenfail.testing.examples import result
from eigenfail_services.store.store import open_store

SAYS = {
    "upgrade": r"The database's schema is at revision \d{4}, which is this program's\.\n",
    "check": r"The database's schema is this program's: revision \d{4}\.\n",
    "current": r"\d{4}\n",
}


def test_a_database_is_made_and_found_to_be_this_programs(eigenfail, tmp_path):
    for action, words in SAYS.items():
        told = eigenfail("db", action, "--data", tmp_path)
        assert told.exit_code == 0, told.output
        assert re.fullmatch(words, told.stdout)
    said = json.loads(eigenfail("db", "current", "--data", tmp_path, "--json").stdout)
    assert re.fullmatch(r"\d{4}", said["said"])


def test_one_that_is_not_there_is_trouble_with_a_way_out(eigenfail, tmp_path):
    told = eigenfail("db", "check", "--data", tmp_path)
    assert told.exit_code == 3
    assert f"Make it: eigenfail db upgrade --database sqlite:///{tmp_path}" in told.stderr


def test_an_address_that_is_none_is_wrong_usage(eigenfail):
    told = eigenfail("db", "check", "--database", "nonsense")
    assert told.exit_code == 2
    assert "Write it as sqlite:///" in told.stderr


def test_what_is_wrong_is_said_with_the_way_out(eigenfail, tmp_path):
    folder = DataFolder(tmp_path)
    with closing(open_store(folder.database)) as store:
        deliver(store, running(store), result(0), result(1))
    sound = eigenfail("db", "verify", "--data", tmp_path)
    assert sound.exit_code == 0, sound.output
    assert "ok accounts" in sound.stdout

    with closing(sqlite3.connect(tmp_path / "eigenfail.db")) as connection:
        connection.execute("UPDATE campaigns SET completed = 1")
        connection.commit()
    told = eigenfail("db", "verify", "--data", tmp_path)
    assert told.exit_code == 1
    assert "accounts: campaign 1: It counts 1 completed" in told.stdout
    assert "its rows are 2 completed" in told.stdout

    checked = eigenfail("doctor", "--database", folder.database)
    assert checked.exit_code == 3
    assert re.search(r"wrong database +sqlite.*: 1 defects +eigenfail db verify", checked.stdout)


def test_a_backup_is_made_and_restored(eigenfail, tmp_path):
    file = tmp_path / "backup"
    with closing(open_store(DataFolder(tmp_path / "a").database)) as store:
        running(store)
    made = eigenfail("db", "backup", file, "--data", tmp_path / "a")
    assert made.exit_code == 0, made.output
    assert f"{file} holds all of sqlite:///" in made.stdout
    assert eigenfail("db", "backup", file, "--data", tmp_path / "a").exit_code == 2

    with DataFolder(tmp_path / "b").claimed():
        used = eigenfail("db", "restore", file, "--data", tmp_path / "b")
    assert used.exit_code == 3
    assert "A service runs on" in used.stderr
    done = eigenfail("db", "restore", file, "--data", tmp_path / "b", "--json")
    assert json.loads(done.stdout)["file"] == str(file)
    with closing(open_store(DataFolder(tmp_path / "b").database)) as store:
        assert store.campaigns.get(1).spec.name == "example"


def filled(url, count=20):
    """A database with a campaign that is done."""
    with closing(open_store(url)) as store:
        campaign = running(store, episodes=count)
        deliver(store, campaign, *map(result, range(count)))
        store.campaigns.move(campaign.id, "done")


def test_noise_is_pruned_and_its_room_given_back(eigenfail, tmp_path):
    filled(DataFolder(tmp_path).database)
    here = ("--data", tmp_path, "--keep-every", 10)
    would = eigenfail("db", "prune", *here, "--dry-run")
    assert would.exit_code == 0, would.output
    assert "18 episodes would lose their noise and 0 scenes" in would.stdout
    assert (
        json.loads(eigenfail("db", "prune", *here, "--older-than", 1, "--json").stdout)["campaigns"]
        == []
    )
    assert eigenfail("db", "prune", *here, "--campaign", 7).exit_code == 2
    done = eigenfail("db", "prune", *here)
    assert "18 episodes lost their noise" in done.stdout
    assert "0 episodes lost" in eigenfail("db", "prune", *here).stdout

    with DataFolder(tmp_path).claimed():
        assert "A service runs on" in eigenfail("db", "vacuum", "--data", tmp_path).stderr
    swept = eigenfail("db", "vacuum", "--data", tmp_path)
    assert swept.exit_code == 0, swept.output
    assert re.search(r"takes [\d,]+ bytes; [\d,]+ were given back", swept.stdout)
