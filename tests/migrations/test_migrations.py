"""The schema: made, compared, and brought forward, on both databases."""

import hashlib
import shutil
from contextlib import closing
from pathlib import Path

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Column, Integer, MetaData, Table, inspect, text
from store_checks.conflicts import every_class
from store_checks.examples import deliver, running

import eigenfail_services
from eigenfail.errors import SchemaMismatch
from eigenfail.testing.examples import collision
from eigenfail_services.store import migrate, schema
from eigenfail_services.store.engine import Database, find_backend
from eigenfail_services.store.store import open_store

NEXT, AFTER_NEXT = (f"{int(schema.VERSION) + more:04}" for more in (1, 2))

LATER = '''"""A later schema."""

import sqlalchemy as sa
from alembic import op

revision = "{revision}"
down_revision = "{down_revision}"


def upgrade() -> None:
    with op.batch_alter_table("campaigns") as campaigns:
        campaigns.add_column(sa.Column("colour", sa.Text(), nullable=False, server_default=""))
        campaigns.alter_column("digest", type_=sa.String(64))
    {fault}


def downgrade() -> None:
    with op.batch_alter_table("campaigns") as campaigns:
        campaigns.alter_column("digest", type_=sa.Text())
        campaigns.drop_column("colour")
'''


@pytest.fixture
def tomorrow(tmp_path, monkeypatch):
    """Makes this program one of a later release, with one more migration."""

    def become(fault="pass") -> None:
        folder = tmp_path / "migrations"
        shutil.copytree(migrate.find_migrations(), folder)
        words = {"revision": NEXT, "down_revision": schema.VERSION, "fault": fault}
        (folder / "versions" / f"{NEXT}_later.py").write_text(LATER.format(**words))
        monkeypatch.setattr(migrate, "find_migrations", lambda: folder)
        monkeypatch.setattr(migrate, "VERSION", NEXT)

    return become


def downgrade(url, revision) -> None:
    """Take a database back, as developers do: eigenfail itself only goes forward."""
    with migrate.schema_transaction(find_backend(url)) as connection:
        command.downgrade(migrate.alembic_config(connection), revision)


def tables(connection) -> set[str]:
    return set(inspect(connection).get_table_names())


def differences(connection, metadata=schema.metadata):
    options = {"version_table": schema.VERSION_TABLE}
    context = MigrationContext.configure(connection, opts=options)
    return compare_metadata(context, metadata)


def contents(connection) -> dict[str, list[tuple]]:
    """Every row of every table."""
    found = MetaData()
    found.reflect(connection)
    return {
        table.name: sorted(map(tuple, connection.execute(table.select())), key=str)
        for table in found.sorted_tables
    }


def test_the_migrations_lead_to_the_tables_of_the_program(url, look) -> None:
    migrate.upgrade(url)
    assert look(url, differences) == []
    assert look(url, tables) == set(schema.metadata.tables) | {schema.VERSION_TABLE}
    assert look(url, migrate.find_version) == migrate.read_version(url) == schema.VERSION


COLUMNS = {"1004": "1d7111ea50eb3f2e3cd137d26a58d17b00ff54d30c21c3df3cab0c551e940066"}
"""SHA-256 of the names of all columns, by the version of the schema."""


def test_other_columns_are_another_version() -> None:
    """A database that lacks a column would be opened, and fail later, if its version were equal."""
    names = sorted(str(each) for one in schema.metadata.sorted_tables for each in one.columns)
    digest = hashlib.sha256("\n".join(names).encode()).hexdigest()
    assert {schema.VERSION: digest} == COLUMNS, "other columns: a new version, and its digest here"


def test_a_difference_would_be_seen(url, look) -> None:
    migrate.upgrade(url)
    changed = MetaData()
    for table in schema.metadata.sorted_tables:
        table.to_metadata(changed)
    changed.tables["jobs"].append_column(Column("colour", Integer))
    found = look(url, lambda connection: differences(connection, changed))
    assert [kind for kind, *_ in found] == ["add_column"]


def test_columns_allow_nothing_only_where_the_program_does(url, look) -> None:
    migrate.upgrade(url)
    wanted = {
        (table.name, column.name): column.nullable
        for table in schema.metadata.sorted_tables
        for column in table.columns
    }
    found = {
        (name, column["name"]): column["nullable"]
        for name in {table for table, _ in wanted}
        for column in look(url, lambda c, name=name: inspect(c).get_columns(name))
    }
    assert found == wanted
    assert {True, False} == set(wanted.values())


@pytest.mark.fault(
    "more ended episodes than planned",
    group="storage",
    outcome="The schema itself refuses them.",
)
def test_more_ended_episodes_than_planned_are_refused_by_the_database_itself(url) -> None:
    store = open_store(url)
    campaign = running(store)
    store.close()
    change = text("UPDATE campaigns SET completed = planned + 1 WHERE id = :id")

    def spoil(database: Database) -> None:
        with database.writing() as connection:
            connection.execute(change, {"id": campaign.id})

    with (
        closing(Database(find_backend(url))) as database,
        pytest.raises(Exception, match="accounted"),
    ):
        spoil(database)


def test_everything_can_be_taken_back(url, look) -> None:
    open_store(url).close()
    downgrade(url, "base")
    assert look(url, tables) == {schema.VERSION_TABLE}
    assert migrate.read_version(url) is None
    store = open_store(url)
    assert running(store).id == 1
    store.close()


def test_upgrading_twice_changes_nothing(url, look) -> None:
    store = open_store(url)
    deliver(store, running(store), collision(0))
    store.close()
    before = look(url, contents)
    migrate.upgrade(url)
    assert look(url, contents) == before


def test_an_older_database_is_upgraded_with_all_that_is_in_it(url, look, tomorrow) -> None:
    store = open_store(url)
    campaign = running(store)
    deliver(store, campaign, collision(0))
    store.close()
    before = look(url, contents)
    tomorrow()
    with pytest.raises(
        SchemaMismatch, match=rf"{schema.VERSION}, not {NEXT}.*eigenfail db upgrade"
    ):
        open_store(url, migrate=False)
    assert look(url, contents) == before
    open_store(url).close()
    after = look(url, contents)
    assert after["episodes"] == before["episodes"]
    assert after["scenes"] == before["scenes"]
    assert after["campaigns"] == [(*row, "") for row in before["campaigns"]]
    downgrade(url, schema.VERSION)
    assert look(url, contents) == before


def test_episodes_without_stated_brakes_keep_their_classes(url) -> None:
    """Version 1003 judged all episodes by the paper's 7 m/s²."""
    store = open_store(url)
    campaign, given = running(store, episodes=50), every_class()
    older = [each for each in given if each.measures.peak_braking_mps2 is None]
    deliver(store, campaign, *older)
    before = store.figures.totals([campaign.id]), store.episodes.page(campaign.id, 100).items
    store.close()
    downgrade(url, "1003")
    store = open_store(url)
    after = store.figures.totals([campaign.id]), store.episodes.page(campaign.id, 100).items
    assert after == before
    assert before[0][campaign.id].conflicts.unavoidable > 0
    assert before[0][campaign.id].conflicts.unresolved > 0
    store.close()


@pytest.mark.fault(
    "database with an older schema",
    group="storage",
    outcome="It is upgraded completely or not at all; where an upgrade is not allowed, the "
    "message names the command.",
)
def test_an_upgrade_that_fails_leaves_everything_as_it_was(url, look, tomorrow) -> None:
    store = open_store(url)
    deliver(store, running(store), collision(0))
    store.close()
    before = look(url, contents)
    tomorrow('raise LookupError("half way")')
    with pytest.raises(LookupError, match="half way"):
        open_store(url)
    assert look(url, contents) == before


@pytest.mark.fault(
    "database of another version of eigenfail",
    group="storage",
    outcome="If no migration leads from its schema, it is refused and left unchanged.",
)
@pytest.mark.parametrize("other", ["0029", "1001", "9999"])
def test_a_database_of_another_version_is_refused_and_left_alone(url, look, other) -> None:
    store = open_store(url)
    running(store)
    store.close()
    with closing(Database(find_backend(url))) as database, database.writing() as connection:
        connection.exec_driver_sql(f"UPDATE {schema.VERSION_TABLE} SET version_num = '{other}'")
    before = look(url, contents)
    for refused in (
        lambda: open_store(url),
        lambda: open_store(url, migrate=False),
        lambda: migrate.upgrade(url),
    ):
        with pytest.raises(SchemaMismatch, match=other):
            refused()
    assert look(url, contents) == before
    assert migrate.read_version(url) == other


def test_somebody_elses_tables_are_left_alone(url, look) -> None:
    theirs = Table("campaigns", MetaData(), Column("slogan", Integer))
    backend = find_backend(url)
    backend.prepare()
    with closing(Database(backend)) as database, database.writing() as connection:
        theirs.create(connection)
    with pytest.raises(SchemaMismatch, match="a database of its own"):
        open_store(url)
    assert look(url, tables) == {"campaigns"}


def test_the_program_knows_its_newest_migration() -> None:
    script = ScriptDirectory.from_config(migrate.alembic_config())
    assert script.get_heads() == [schema.VERSION]
    assert all(len(revision.revision) == 4 for revision in script.walk_revisions())


def test_migrations_are_found_in_a_checkout_and_in_a_wheel(tmp_path, monkeypatch) -> None:
    root = Path(eigenfail_services.__file__).parents[2]
    assert migrate.find_migrations() == root / "migrations"
    installed = tmp_path / "site-packages" / "eigenfail_services"
    (installed / "migrations").mkdir(parents=True)
    monkeypatch.setattr(eigenfail_services, "__file__", str(installed / "__init__.py"))
    assert migrate.find_migrations() == installed / "migrations"


def test_developers_have_alembics_own_command_line(url) -> None:
    from alembic.config import main

    arguments = ["-c", str(migrate.find_migrations() / "alembic.ini"), "-x", f"database={url}"]
    main([*arguments, "upgrade", "head"])
    main([*arguments, "check"])
    main([*arguments, "downgrade", "base"])
    with pytest.raises(SystemExit):
        main([*arguments, "check"])


def test_new_migrations_do_not_depend_on_the_program(url, tomorrow, monkeypatch) -> None:
    tomorrow()
    open_store(url).close()
    metadata = MetaData()
    Table("notes", metadata, Column("note", schema.Prose), Column("id", schema.Number))
    monkeypatch.setattr(schema, "metadata", metadata)
    with migrate.schema_transaction(find_backend(url)) as connection:
        config = migrate.alembic_config(connection)
        written = command.revision(config, "notes", rev_id=AFTER_NEXT, autogenerate=True)
    code = Path(written.path).read_text()
    assert "sa.Column('note', sa.Text()" in code
    assert "sa.Column('id', sa.BigInteger().with_variant(sa.Integer()" in code
    assert "eigenfail_services" not in code
