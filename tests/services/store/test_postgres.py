"""What only PostgreSQL can do to a store."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from uuid import uuid4

import deadlines
import pytest
from accepted import accept_spec
from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import URL, make_url
from store_checks.examples import deliver, running

from eigenfail.errors import InvalidValue, StoreUnavailable
from eigenfail.testing.examples import result, spec
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign import CampaignState
from eigenfail_services.store import engine, events
from eigenfail_services.store.campaign_rows import lock_campaign
from eigenfail_services.store.engine import Database, find_backend
from eigenfail_services.store.postgres import limit_statement
from eigenfail_services.store.store import open_store

CUT = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = '{}'"


def append_then(database: Database, fault: Callable[[], object]) -> None:
    """Log an event in a transaction in which something goes wrong."""
    with database.writing() as connection:
        events.append_event(connection, "campaign.progress", "never seen")
        fault()


def fail() -> None:
    raise LookupError


@pytest.fixture
def database(prepared_postgres_url):
    with closing(Database(find_backend(prepared_postgres_url))) as database:
        yield database


@pytest.fixture
def store(prepared_postgres_url):
    store = open_store(prepared_postgres_url)
    yield store
    store.close()


@pytest.fixture
def cut(postgres, prepared_postgres_url):
    """Cuts every connection to the test's database."""
    name = prepared_postgres_url.split("?")[0].rsplit("/", 1)[1]
    return lambda: postgres.run(CUT.format(name))


@pytest.mark.parametrize(
    ("setting", "wanted"),
    [
        ("synchronous_commit", "on"),
        ("transaction_isolation", "read committed"),
        ("lock_timeout", "10s"),
        ("idle_in_transaction_session_timeout", "10s"),
        ("transaction_timeout", "30s"),
    ],
)
def test_every_connection_is_durable_and_bounded(database, setting, wanted) -> None:
    with database.writing() as connection:
        assert connection.exec_driver_sql(f"SHOW {setting}").scalar() == wanted


def test_a_database_that_knows_no_text_is_refused_with_what_to_do(postgres) -> None:
    with postgres.database("template0 ENCODING 'SQL_ASCII' LOCALE 'C'") as url:
        command = [sys.executable, "-m", "eigenfail", "db", "upgrade", "--database", url]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        with pytest.raises(InvalidValue, match="SQL_ASCII"):
            open_store(url)
    assert (done.returncode, "Traceback" in done.stderr) == (2, False)
    assert "keeps text in no encoding" in done.stderr
    assert "ENCODING 'UTF8'" in done.stderr


def test_a_server_is_asked_for_what_it_knows_alone() -> None:
    assert "transaction_timeout" not in limit_statement((16, 9))
    assert "idle_in_transaction_session_timeout" in limit_statement((16, 9))
    assert "transaction_timeout" in limit_statement((17, 0))


@pytest.mark.fault(
    "host of a service that disappears during a transaction",
    group="time",
    outcome="The PostgreSQL server notices within about 10 s and releases its locks. That the"
    " limits are requested is tested, not the disappearance.",
)
def test_a_server_that_is_far_away_notices_that_this_host_is_gone(prepared_postgres_url) -> None:
    """On a socket of the same machine it knows no such limits: what is asked for is looked at."""
    options = find_backend(prepared_postgres_url).engine().url.query["options"]
    for limit in ("keepalives_idle=5", "keepalives_interval=2", "keepalives_count=3"):
        assert f"-c tcp_{limit}" in options
    assert "-c tcp_user_timeout=10000" in options


HANDS_OVER = """
import os, signal, sys
from eigenfail_services.store import postgres
postgres.LIMITS.update({"idle_in_transaction_session_timeout": "1s", "transaction_timeout": "8s"})
from eigenfail_services.store.campaigns import lock_campaign
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import Database, find_backend

def rows():
    for row in range(20_000):
        if row == 15_000:
            os.kill(os.getpid(), signal.SIGSTOP)
        yield (row,)

with Database(find_backend(sys.argv[1])).writing() as connection:
    lock_campaign(connection, int(sys.argv[2]))
    cursor = connection.connection.driver_connection.cursor()
    cursor.executemany("SELECT %s::int", rows())
"""


@pytest.mark.fault("SIGSTOP of the services")
@pytest.mark.timeout(deadlines.TEST_S)
def test_who_stands_still_as_it_hands_over_rows_holds_nobody_up(prepared_postgres_url, store):
    """It is not between two statements: only the whole change has a limit there."""
    campaign = running(store)
    command = [sys.executable, "-c", HANDS_OVER, prepared_postgres_url, str(campaign.id)]
    with subprocess.Popen(command, stderr=subprocess.PIPE) as stopped:
        try:
            os.waitpid(stopped.pid, os.WUNTRACED)
            assert store.campaigns.move(campaign.id, CampaignState.DONE).state == "done"
        finally:
            stopped.send_signal(signal.SIGCONT)
        assert b"the connection is lost" in stopped.stderr.read()
    assert stopped.returncode == 1


def test_an_earlier_event_never_appears_after_a_later_one(database, store) -> None:
    """The transaction that took an id first is slow to end; the next one must not overtake it."""
    with ThreadPoolExecutor(1) as pool:
        with database.writing() as connection:
            slow = events.append_event(connection, "campaign.progress", "slow")
            quick = pool.submit(store.events.append, "campaign.progress", "quick")
            time.sleep(0.3)
            assert not quick.done()
            assert store.events.after(0, 10) == []
        assert quick.result(deadlines.PROCESS_S).id == slow.id + 1
    assert [event.message for event in store.events.after(0, 10)] == ["slow", "quick"]


def test_an_event_that_is_undone_leaves_no_gap(database, store) -> None:
    with pytest.raises(LookupError):
        append_then(database, fail)
    assert store.events.append("campaign.progress", "done").id == 1


def test_a_mover_waits_for_a_commit_and_loses_none_of_it(database, store) -> None:
    campaign = running(store)
    with ThreadPoolExecutor(1) as pool:
        with database.writing() as connection:
            lock_campaign(connection, campaign.id)
            move = pool.submit(store.campaigns.move, campaign.id, CampaignState.DONE)
            time.sleep(0.3)
            assert not move.done()
        assert move.result(deadlines.PROCESS_S).state is CampaignState.DONE


def test_no_analysis_begins_while_its_campaign_loses_noise(database, store) -> None:
    campaign = running(store)
    with ThreadPoolExecutor(1) as pool:
        with database.writing() as connection:
            lock_campaign(connection, campaign.id)  # as long as a slice takes
            analysis = pool.submit(store.analyses.create, campaign.id, AnalysisSettings())
            time.sleep(0.3)
            assert not analysis.done()
        assert analysis.result(deadlines.PROCESS_S).campaign == campaign.id


def test_a_claimed_row_holds_up_nobody_else(database, store) -> None:
    first, second = (store.campaigns.create(accept_spec(spec())).id for _ in range(2))
    with database.writing() as connection:
        connection.exec_driver_sql(f"SELECT 1 FROM jobs WHERE subject = {first} FOR UPDATE")
        assert store.jobs.claim("somebody", 60.0).subject == second


@pytest.mark.fault(
    "idle database connection cut",
    group="storage",
    outcome="The next request uses another connection.",
)
def test_a_connection_that_was_cut_while_idle_is_not_noticed(store, cut) -> None:
    campaign = running(store)
    cut()
    assert deliver(store, campaign, result(0)) == ["kept"]


@pytest.mark.fault(
    "database connection cut within a transaction",
    group="storage",
    outcome="The transaction is rolled back and tried again.",
)
def test_a_connection_that_is_cut_within_a_transaction_undoes_it(database, store, cut) -> None:
    with pytest.raises(StoreUnavailable):
        append_then(database, cut)
    assert store.events.last() == 0


def test_a_reader_of_another_programs_options_keeps_ours(prepared_postgres_url) -> None:
    url = f"{prepared_postgres_url}&options=-c%20work_mem%3D7MB"
    with closing(Database(find_backend(url))) as database, database.reading() as connection:
        assert connection.exec_driver_sql("SHOW work_mem").scalar() == "7MB"
        assert connection.exec_driver_sql("SHOW lock_timeout").scalar() == "10s"


@pytest.mark.fault("database lock held by another program")
@pytest.mark.parametrize("mode", ["ACCESS EXCLUSIVE", "EXCLUSIVE", "SHARE"])
@pytest.mark.parametrize("table", ["event_counter", "episodes", "campaigns", "keys"])
def test_a_probe_behind_a_held_lock_is_bounded(prepared_postgres_url, store, table, mode) -> None:
    import psycopg

    with psycopg.connect(prepared_postgres_url) as other:
        other.execute(f"LOCK TABLE {table} IN {mode} MODE")
        began_s = time.monotonic()
        with pytest.raises(StoreUnavailable, match="pg_stat_activity"):
            store.ping()
        assert time.monotonic() - began_s < 5.0
        other.rollback()
    store.ping()


def test_probe_waits_for_no_other_user_of_the_tables(prepared_postgres_url, store) -> None:
    import psycopg

    with psycopg.connect(prepared_postgres_url) as other:
        other.execute("LOCK TABLE campaigns, episodes IN ROW EXCLUSIVE MODE")
        store.ping()


@pytest.fixture
def crowded_url(postgres, prepared_postgres_url):
    """The address of a database at which one user may have three connections."""
    import psycopg

    user = f"crowded_{uuid4().hex[:8]}"
    with psycopg.connect(prepared_postgres_url, autocommit=True) as owner:
        owner.execute(f"CREATE ROLE {user} LOGIN CONNECTION LIMIT 3 PASSWORD 'x'")
        owner.execute(f"GRANT ALL ON ALL TABLES IN SCHEMA public TO {user}")
        owner.execute(f"GRANT ALL ON ALL SEQUENCES IN SCHEMA public TO {user}")
    url = make_url(prepared_postgres_url).set(username=user, password="x")
    yield url.render_as_string(hide_password=False)
    with psycopg.connect(prepared_postgres_url, autocommit=True) as owner:
        owner.execute(f"DROP OWNED BY {user}")
        owner.execute(f"DROP ROLE {user}")


def test_reads_wait_for_a_connection_that_the_server_does_not_grant(crowded_url) -> None:
    with closing(open_store(crowded_url, migrate=False)) as store:

        def read(_number):
            return len(store.campaigns.page(10).items)

        with ThreadPoolExecutor(20) as pool:
            assert list(pool.map(read, range(200))) == [0] * 200


def test_crowded_server_is_an_error_with_its_remedy_after_a_while(crowded_url, monkeypatch) -> None:
    import psycopg

    monkeypatch.setattr(engine, "CROWDED_WAIT_S", 0.2)
    with closing(open_store(crowded_url, migrate=False)) as store:
        with ExitStack() as others:
            store.database._reader.dispose()
            for _ in range(3):
                others.enter_context(psycopg.connect(crowded_url))
            with pytest.raises(StoreUnavailable, match="max_connections"):
                store.campaigns.page(10)
        assert store.campaigns.page(10).items == ()


def test_a_writer_behind_a_held_lock_waits_as_long_as_it_was_told(prepared_postgres_url) -> None:
    import psycopg

    with (
        closing(open_store(prepared_postgres_url, wait_s=0.5)) as store,
        psycopg.connect(prepared_postgres_url) as other,
    ):
        other.execute("LOCK TABLE campaigns IN ACCESS EXCLUSIVE MODE")
        began_s = time.monotonic()
        with pytest.raises(StoreUnavailable, match="pg_stat_activity"):
            store.campaigns.create(accept_spec(spec()))
        assert time.monotonic() - began_s < 5.0
        other.rollback()


@given(
    name=st.text("ab @:/?#%&=+'ü", min_size=1, max_size=8),
    password=st.text("ab @:/?#%&=+'ü", min_size=1, max_size=8),
    options=st.text("ab =+-%&", min_size=1, max_size=8).map(str.strip).filter(bool),
)
def test_other_programs_read_an_address_as_we_do(name, password, options) -> None:
    from psycopg.conninfo import conninfo_to_dict

    url = URL.create("postgresql", "me", password, "host", 5433, name, {"options": options})
    backend = find_backend(url.render_as_string(hide_password=False))
    assert backend.secrets == (password,)
    told = conninfo_to_dict(backend.address)
    assert told == {
        "user": "me",
        "host": "host",
        "port": "5433",
        "dbname": name,
        "options": options,
    }
