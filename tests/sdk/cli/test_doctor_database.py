"""`eigenfail doctor` on a database: its accounts and its replays."""

import json
import sqlite3
from contextlib import closing

import pytest
from store_checks.examples import running

from eigenfail import plugins
from eigenfail.hosting.folder import DataFolder
from eigenfail.values.episode import EpisodeTask, PriorSource, episode_seed
from eigenfail.values.records import Delivery
from eigenfail_services.store.store import open_store

pytestmark = pytest.mark.service

PLANNED = 4


@pytest.fixture
def folder(tmp_path):
    """With a database of true episodes."""
    made = DataFolder(tmp_path)
    with closing(open_store(made.database)) as store:
        campaign = running(store, planner="idm", episodes=PLANNED)
        engine = plugins.load(plugins.ENGINES, "default")(campaign.spec.setup())
        seed = campaign.spec.seed
        tasks = [EpisodeTask(n, episode_seed(seed, n), PriorSource()) for n in range(PLANNED)]
        with closing(engine):
            delivered = [Delivery(each, "test") for each in engine.run(tasks)]
        store.episodes.commit(campaign.id, delivered)
    return made


@pytest.fixture
def doctor(eigenfail, folder):
    """What it finds in the database, by the check's name, and how it exits."""

    def ask(*words):
        told = eigenfail("doctor", "--database", folder.database, "--json", *words)
        findings = [each for each in json.loads(told.stdout) if "database" in each["what"]]
        return told.exit_code, {each["what"]: each for each in findings}

    return ask


def change(folder, statement):
    with closing(sqlite3.connect(folder.path / "eigenfail.db")) as connection:
        connection.execute(statement)
        connection.commit()


def wrong(found):
    return {what for what, finding in found.items() if finding["wrong"]}


def test_an_episode_that_no_longer_replays_is_found(doctor, folder):
    code, found = doctor("--replay", PLANNED)
    assert (code, wrong(found)) == (0, set())
    assert "4 episodes, run again, have the same digest" in found["database: replays"]["found"]
    change(folder, 'UPDATE episodes SET robustness_m = robustness_m + 1 WHERE "index" = 2')
    assert "database: replays" not in doctor()[1]
    code, found = doctor("--replay", PLANNED)
    assert (code, wrong(found)) == (3, {"database", "database: replays"})


def test_without_a_database_there_is_nothing_to_replay(eigenfail):
    told = eigenfail("doctor", "--replay", "3")
    assert told.exit_code == 2
    assert "Give --database" in str(told.exception) + told.stderr


def test_one_that_is_not_there_is_wrong_with_a_way_out(eigenfail, tmp_path):
    told = eigenfail("doctor", "--json", "--database", f"sqlite:///{tmp_path}/none.db")
    (found,) = [each for each in json.loads(told.stdout) if each["what"] == "database"]
    assert told.exit_code == 3
    assert "eigenfail db upgrade" in found["remedy"]
