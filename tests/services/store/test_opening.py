"""Opening a store: what is made, what is refused, how quickly, and what is never said."""

import socket
import sqlite3
import sys
import time
from contextlib import closing

import pytest
from accepted import accept_spec

from eigenfail.errors import InvalidValue, SchemaMismatch, StoreUnavailable
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_services.store import migrate
from eigenfail_services.store.store import open_store

SECRET = "hunter2sesame"
SPEC = CampaignSpec(name="example", method="monte_carlo", episodes=3)


@pytest.fixture
def silent_port():
    """A server that takes connections and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener.getsockname()[1]


@pytest.fixture
def free_port() -> int:
    """A port where nobody listens."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return listener.getsockname()[1]


def chain(error: BaseException | None) -> str:
    """Everything that a traceback would show of an error and of what led to it."""
    said = []
    while error is not None:
        said.append(f"{error!s} {error!r}")
        error = error.__cause__ or (None if error.__suppress_context__ else error.__context__)
    return "\n".join(said)


def test_a_new_file_gets_its_folder_and_its_tables(tmp_path) -> None:
    url = f"sqlite:///{tmp_path / 'new' / 'deep' / 'a.db'}"
    store = open_store(url)
    campaign = store.campaigns.create(accept_spec(SPEC))
    store.close()
    again = open_store(url)
    assert again.campaigns.get(campaign.id) == campaign
    assert again.events.last() == 1
    again.close()


def test_an_empty_postgres_database_gets_its_tables(postgres_url) -> None:
    store = open_store(postgres_url)
    campaign = store.campaigns.create(accept_spec(SPEC))
    store.close()
    again = open_store(postgres_url.replace("postgresql:", "postgres:"))
    assert again.campaigns.get(campaign.id) == campaign
    again.close()


def test_memory_is_gone_when_let_go() -> None:
    store = open_store("memory://")
    store.campaigns.create(accept_spec(SPEC))
    assert open_store("memory://").campaigns.page(1).items == ()


def test_a_relative_path_stays_where_it_was(tmp_path, monkeypatch) -> None:
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    store = open_store("sqlite:///data/a.db")
    store.close()
    monkeypatch.chdir(tmp_path / "elsewhere")
    store.campaigns.create(accept_spec(SPEC))
    store.close()
    assert [path.name for path in tmp_path.rglob("a.db")] == ["a.db"]


@pytest.mark.fault("database with an older schema")
def test_what_may_not_be_changed_is_refused_with_the_command(tmp_path, postgres_url) -> None:
    with closing(sqlite3.connect(tmp_path / "a.db")) as connection:
        connection.execute("PRAGMA journal_mode = WAL")  # a database without tables
    for url in (f"sqlite:///{tmp_path / 'a.db'}", postgres_url):
        with pytest.raises(
            SchemaMismatch, match=r"eigenfail db upgrade --database \S*(sqlite|post)"
        ):
            open_store(url, migrate=False)
        open_store(url).close()
        open_store(url, migrate=False).close()


def test_whoever_only_looks_makes_no_file(tmp_path) -> None:
    url = f"sqlite:///{tmp_path / 'folder' / 'a.db'}"
    for look in (lambda: open_store(url, migrate=False), lambda: migrate.read_version(url)):
        with pytest.raises(StoreUnavailable, match=r"There is no .*eigenfail db upgrade"):
            look()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform != "linux", reason="/proc is Linux's")
def test_a_folder_that_cannot_be_written_is_named_with_the_remedy() -> None:
    for path in ("/proc/eigenfail.db", "/proc/new/eigenfail.db"):
        with pytest.raises(StoreUnavailable, match=rf"{path}.*Check that its folder"):
            open_store(f"sqlite:///{path}")


@pytest.mark.parametrize(
    "address",
    [
        "",
        "nonsense",
        "sqlite://",
        "sqlite:///:memory:",
        f"mysql://user:{SECRET}@host/db",
        f"postgresql+asyncpg9://user:{SECRET}@host:port/db",
        f"postgresql://user:{SECRET}@host:54x/db",
        f"postgresql://user:p@{SECRET}@host/db",
        f"postgresql//user:{SECRET}@host/db",
    ],
)
def test_addresses_that_make_no_sense_are_refused_without_repeating_them(address) -> None:
    with pytest.raises(InvalidValue) as caught:
        open_store(address)
    assert caught.value.remedy
    assert SECRET not in chain(caught.value)


@pytest.mark.parametrize("place", ["user:{}@{}/db", "user@{1}/db?password={0}"])
def test_nobody_there_is_said_at_once_and_without_the_password(place, free_port) -> None:
    url = "postgresql://" + place.format(SECRET, f"127.0.0.1:{free_port}")
    began_s = time.monotonic()
    with pytest.raises(StoreUnavailable, match=r"127\.0\.0\.1") as caught:
        open_store(url)
    assert time.monotonic() - began_s < 5.0
    assert SECRET not in chain(caught.value)
    assert "Check that the server runs" in caught.value.remedy


def test_a_server_that_says_nothing_is_given_up_soon(silent_port) -> None:
    began_s = time.monotonic()
    with pytest.raises(StoreUnavailable) as caught:
        open_store(f"postgresql://user:{SECRET}@127.0.0.1:{silent_port}/db")
    assert time.monotonic() - began_s < 8.0
    assert SECRET not in chain(caught.value)


def test_a_database_that_is_not_there_is_said(postgres_url) -> None:
    with pytest.raises(StoreUnavailable, match="no_such"):
        open_store(postgres_url.replace("/test_", "/no_such_"))


def test_a_right_that_is_missing_is_said(postgres, postgres_url) -> None:
    database = postgres_url.split("?")[0].rsplit("/", 1)[1]
    postgres.run(f"CREATE ROLE reader_{database} LOGIN", "SELECT 1")
    url = postgres_url.replace("postgres:@", f"reader_{database}:{SECRET}@")
    with pytest.raises(StoreUnavailable, match="permission denied") as caught:
        open_store(url)
    assert SECRET not in chain(caught.value)
