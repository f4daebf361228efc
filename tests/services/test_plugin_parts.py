"""What plug-ins add to the services: tables of the database, and background tasks."""

import re
import sys
from contextlib import closing
from importlib.metadata import EntryPoint
from threading import Event
from time import monotonic, sleep

import deadlines
import pytest
from accepted import accept_spec
from plugin_absence import ROOT, forget_entry_points
from sqlalchemy import inspect, text
from structlog.testing import capture_logs

from eigenfail import plugins
from eigenfail.errors import Conflict, SchemaMismatch
from eigenfail.testing.examples import spec
from eigenfail.values.campaign import CampaignState
from eigenfail_services import __main__ as process
from eigenfail_services.__main__ import BackgroundTasks
from eigenfail_services.store.engine import Database, find_backend
from eigenfail_services.store.store import open_store
from eigenfail_services.upkeep import backup

FIRST = """
import sqlalchemy as sa
from eigenfail_services.store.migrate import PluginTables

metadata = sa.MetaData()
sheep = sa.Table("plugin_sheep", metadata, sa.Column("name", sa.Text, primary_key=True))
part = PluginTables(metadata)
"""
SECOND = """
def upgrade(connection, found):
    connection.exec_driver_sql(f"ALTER TABLE plugin_sheep ADD COLUMN from_{found} TEXT")


part = PluginTables(metadata, 2, upgrade)
"""
TASK = """
from threading import Event

calls, ended = [], Event()


def part(store, stopping):
    calls.append(store)
    if len(calls) == 1:
        raise RuntimeError("not today")
    stopping.wait()
    ended.set()
"""


@pytest.fixture
def bring(tmp_path, monkeypatch):
    """Installs modules by the names of plug-ins; each has one `part`, and nothing else is there."""
    monkeypatch.syspath_prepend(tmp_path)

    def install(group, **texts):
        forget_entry_points()
        for name, code in texts.items():
            sys.modules.pop(f"eigenfail_{name}", None)
            (tmp_path / f"eigenfail_{name}.py").write_text(f"{code}\n# {monotonic()}")
        points = {name: [EntryPoint(name, f"eigenfail_{name}:part", group)] for name in texts}
        monkeypatch.setattr(plugins, "list_claims", lambda asked: points if asked == group else {})

    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    yield install
    forget_entry_points()
    for name in ("sheep", "goats", "diary"):
        sys.modules.pop(f"eigenfail_{name}", None)


@pytest.fixture(params=["sqlite", "postgres"])
def url(request, tmp_path) -> str:
    """The address of an empty database."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'a.db'}"
    return request.getfixturevalue("postgres_url")


def ask(url, question):
    """Ask a database, with nothing of the store in between."""
    with closing(Database(find_backend(url))) as database, database.writing() as connection:
        return question(connection)


def execute(url, statement):
    return ask(url, lambda connection: connection.execute(text(statement)))


def list_columns(url):
    return ask(url, lambda c: [each["name"] for each in inspect(c).get_columns("plugin_sheep")])


def test_a_plugin_that_is_installed_later_gets_its_tables_at_the_next_start(bring, url):
    bring(plugins.TABLES)
    open_store(url).close()
    bring(plugins.TABLES, sheep=FIRST)
    open_store(url, migrate=False).close()
    assert not ask(url, lambda c: inspect(c).has_table("plugin_sheep"))
    open_store(url).close()
    assert list_columns(url) == ["name"]


def test_tables_are_upgraded_with_what_is_in_them_and_refused_if_they_are_newer(bring, url):
    bring(plugins.TABLES, sheep=FIRST)
    open_store(url).close()
    execute(url, "INSERT INTO plugin_sheep VALUES ('Dolly')")
    bring(plugins.TABLES, sheep=FIRST + SECOND)
    for _ in range(2):
        open_store(url).close()
        assert list_columns(url) == ["name", "from_1"]
    assert ask(url, lambda c: c.execute(text("SELECT name FROM plugin_sheep")).scalar()) == "Dolly"
    bring(plugins.TABLES, sheep=FIRST)
    with pytest.raises(SchemaMismatch, match=r"'sheep' are of version 2.* knows version 1"):
        open_store(url)


def test_an_upgrade_of_tables_that_fails_changes_nothing(bring, url):
    bring(plugins.TABLES, sheep=FIRST)
    open_store(url).close()
    failing = SECOND.replace('TEXT")', 'TEXT")\n    raise LookupError')
    bring(plugins.TABLES, sheep=FIRST + failing)
    with pytest.raises(LookupError):
        open_store(url)
    assert list_columns(url) == ["name"]


def test_the_tables_stay_and_the_core_works_without_the_plugin(bring, url):
    bring(plugins.TABLES, sheep=FIRST)
    open_store(url).close()
    execute(url, "INSERT INTO plugin_sheep VALUES ('Dolly')")
    bring(plugins.TABLES)
    store = open_store(url)
    assert store.campaigns.create(accept_spec(spec())).id == 1
    store.close()
    # PostgreSQL has a command of its own for this.
    if url.startswith("sqlite"):
        backup.vacuum(url)
    assert ask(url, lambda c: c.execute(text("SELECT name FROM plugin_sheep")).scalar()) == "Dolly"


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("raise RuntimeError('not today')", "not today"),
        (FIRST.replace("plugin_sheep", "campaigns"), "must begin with 'plugin_sheep'"),
        (FIRST.replace("plugin_sheep", "plugin_sheepdogs"), "must begin with 'plugin_sheep'"),
        ("part = 7", "must be PluginTables"),
    ],
)
def test_tables_that_cannot_be_used_are_logged_and_left_out(bring, caplog, url, code, said):
    bring(plugins.TABLES, sheep=code, goats=FIRST.replace("sheep", "goats"))
    store = open_store(url)
    assert store.campaigns.create(accept_spec(spec())).id == 1
    store.close()
    assert ask(url, lambda c: inspect(c).has_table("plugin_goats"))
    assert "The tables of the plug-in 'sheep' are left out." in caplog.text
    assert said in caplog.text


def test_table_of_the_longer_name_belongs_to_that_plugin(bring, caplog, url):
    queue = FIRST.replace("plugin_sheep", "plugin_web_hooks_queue")
    bring(plugins.TABLES, web=queue, web_hooks=FIRST.replace("plugin_sheep", "plugin_web_hooks"))
    open_store(url).close()
    assert ask(url, lambda c: inspect(c).has_table("plugin_web_hooks"))
    assert not ask(url, lambda c: inspect(c).has_table("plugin_web_hooks_queue"))
    assert "The tables of the plug-in 'web' are left out." in caplog.text


def test_backups_have_the_tables_of_plugins_and_restoring_keeps_what_is_there(bring, tmp_path):
    bring(plugins.TABLES, sheep=FIRST)
    url, other = f"sqlite:///{tmp_path / 'a.db'}", f"sqlite:///{tmp_path / 'b.db'}"
    for each in (url, other):
        open_store(each).close()
    execute(url, "INSERT INTO plugin_sheep VALUES ('Dolly')")
    backup.backup(url, tmp_path / "kept")
    bring(plugins.TABLES)
    backup.restore(other, tmp_path / "kept")
    question = text("SELECT name FROM plugin_sheep")
    assert ask(other, lambda connection: connection.execute(question).scalar()) == "Dolly"
    with pytest.raises(Conflict, match="is not empty"):
        backup.restore(other, tmp_path / "kept")


def test_a_task_runs_again_after_an_error_until_the_service_stops(bring, store, monkeypatch):
    monkeypatch.setattr(process, "TASK_RETRY_S", 0.01)
    bring(plugins.TASKS, sheep=TASK, goats="raise RuntimeError('broken')")
    tasks = BackgroundTasks(store)
    with capture_logs() as logged:
        tasks.start()
        module = sys.modules["eigenfail_sheep"]
        until_s = monotonic() + deadlines.PROCESS_S
        while len(module.calls) < 2:
            assert monotonic() < until_s
            sleep(0.01)
        assert not module.ended.is_set()
        tasks.stop()
    assert module.ended.is_set()
    assert module.calls == [store] * 2
    found = [(each["event"], each["task"]) for each in logged]
    assert found == [
        ("a task is left out", "goats"),
        ("a task broke off and is started again", "sheep"),
    ]


def test_a_task_that_does_not_end_holds_up_the_stop_only_briefly(bring, store, monkeypatch):
    monkeypatch.setattr(process, "TASKS_STOP_S", 0.05)
    bring(
        plugins.TASKS, sheep="from time import sleep\n\n\ndef part(store, stopping):\n    sleep(2)"
    )
    tasks = BackgroundTasks(store)
    tasks.start()
    began_s = monotonic()
    tasks.stop()
    assert monotonic() - began_s < 1.0


def test_the_example_of_the_documents_reads_each_event_once(bring, tmp_path):
    page = (ROOT / "docs" / "plugins.md").read_text()
    (code,) = re.findall(
        r"^```python\n# eigenfail-diary/.*?\n(.*?)^```$", page, re.MULTILINE | re.DOTALL
    )
    url = f"sqlite:///{tmp_path / 'a.db'}"
    bring(plugins.TABLES, diary=f"{code}\npart = tables\n")
    store = open_store(url)
    campaigns = [store.campaigns.create(accept_spec(spec(name=name))).id for name in ("one", "two")]
    write_diary = sys.modules["eigenfail_diary"].write_diary
    for campaign in campaigns:
        for state in (CampaignState.RUNNING, CampaignState.DONE):
            store.campaigns.move(campaign, state)
        stopping = Event()
        answers = iter([False, True])
        stopping.wait = lambda _s, turns=answers: next(turns)
        write_diary(store, stopping)
    store.close()
    lines = ask(url, lambda c: c.execute(text("SELECT line FROM plugin_diary")).scalars().all())
    assert [line.split(" is ")[0] for line in lines] == ["Campaign 1 'one'", "Campaign 2 'two'"]
