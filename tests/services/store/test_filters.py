"""Whatever is asked for: a database finds what the conditions say, in the order that is asked."""

import shutil
from contextlib import closing

import pytest
from accepted import accept_spec
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from sqlalchemy import Engine, event
from sqlalchemy.dialects import sqlite
from store_checks.episode_filters import WITHOUT_ORDER, in_order, indices
from store_checks.examples import deliver, running

from eigenfail.filters import (
    BY_INDEX,
    COLUMNS,
    ORDERED,
    ColumnKind,
    Condition,
    Operator,
    SortOrder,
    parse_filter,
)
from eigenfail.testing.examples import collision, make_errored_result, result, spec
from eigenfail.values.campaign import CampaignFilter
from eigenfail.values.episode import Outcome
from eigenfail.values.measures import MEASURES, Measures
from eigenfail_services.store.campaigns import CampaignStore
from eigenfail_services.store.engine import Database, find_backend
from eigenfail_services.store.listing import page_queries
from eigenfail_services.store.store import open_store

FEW = st.sampled_from([-1.0, -0.0, 0.0, 0.5, 1.5, 2.0, 7.0, 7.5, 1e300, 5e-324])
WORDS = st.sampled_from(["prior", "policy", "'", '"; --', "", "ß", "Prior"])
VALUES = {
    ColumnKind.NUMBER: FEW,
    ColumnKind.WHOLE: st.sampled_from([-1, 0, 1, 2, 3, 5, 101, 2**62 + 1, 2**63 - 1]),
    ColumnKind.TEXT: WORDS,
    ColumnKind.FLAG: st.booleans(),
}


@st.composite
def conditions(draw):
    column = COLUMNS[draw(st.sampled_from(sorted(COLUMNS)))]
    value = st.sampled_from(column.choices) if column.choices else VALUES[column.kind]
    sign = draw(st.sampled_from(Operator if column.is_ordered else WITHOUT_ORDER))
    return Condition(column.name, sign, draw(value))


def measures():
    def draw(measure):
        return WORDS if measure.is_text else st.integers(0, 3) if measure.is_count else FEW

    maybe = {name: st.none() | draw(each) for name, each in MEASURES.items()}
    return st.builds(Measures, **maybe | {"robustness_m": FEW})


@st.composite
def episodes(draw, index):
    make = draw(st.sampled_from([result, collision, make_errored_result]))
    made = make(index, source=draw(WORDS))
    ran = made.outcome is not Outcome.ERRORED
    return replace(made, measures=draw(st.none() | measures()) if ran else None)


some_episodes = st.integers(1, 8).flatmap(lambda n: st.tuples(*(episodes(i) for i in range(n))))
orders = st.builds(SortOrder, st.sampled_from(ORDERED), st.booleans())


def test_a_database_finds_what_the_conditions_say(sqlite_template, tmp_path):
    shutil.copy(sqlite_template, tmp_path / "eigenfail.db")

    @settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
    @given(
        given_=some_episodes, where=st.lists(conditions(), max_size=2), sort=orders,
        limit=st.integers(1, 4),
    )  # fmt: skip
    def check(given_, where, sort, limit):
        campaign = running(store)
        deliver(store, campaign, *given_)
        rows = list(store.episodes.page(campaign.id, 100).items)
        assert len(rows) == len(given_)
        wanted = [
            row.index for row in in_order(rows, sort) if all(each.holds(row) for each in where)
        ]
        assert indices(store, campaign.id, limit, tuple(where), sort) == wanted

    with closing(open_store(f"sqlite:///{tmp_path / 'eigenfail.db'}")) as store:
        check()


INDEXED = (*("index", "severity", "min_ttc_s", "robustness_m", "log_probability", "max_drac_mps2"),)


@pytest.mark.parametrize("where", ["", "min_ttc_s < 2 and outcome = collision and steps > 3"])
@pytest.mark.parametrize("name", INDEXED)
def test_pages_along_an_index_sort_nothing(sqlite_url, name, where):
    with closing(Database(find_backend(sqlite_url))) as database, database.reading() as connection:
        for sort in (SortOrder(name), SortOrder(name, descending=True)):
            for query in page_queries(connection, 1, None, parse_filter(where), sort):
                plan = connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {plain(query)}").all()
                assert all("TEMP B-TREE" not in step[3] for step in plan), (sort, plan)


def plans(url, ask):
    """Steps of the plan of SQLite for each query of rows that is asked."""
    statements = []

    def note(_connection, _cursor, statement, parameters, *_more):
        statements.append((statement, parameters))

    with closing(Database(find_backend(url))) as database:
        event.listen(Engine, "before_cursor_execute", note)
        ask(database)
        event.remove(Engine, "before_cursor_execute", note)
        asked = [(text, given) for text, given in statements if "FROM " in text]
        with database.reading() as connection:
            for text, given in asked:
                plan = connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {text}", given).all()
                yield [step[3] for step in plan]


def test_the_newest_campaigns_are_read_without_sorting(sqlite_url):
    for before in (None, 3):
        (steps,) = plans(sqlite_url, lambda it, at=before: CampaignStore(it).page(5, at))
        assert all("TEMP B-TREE" not in step for step in steps), steps


def test_campaigns_with_a_version_are_read_alone(sqlite_url):
    (steps,) = plans(sqlite_url, lambda it: CampaignStore(it).list_versioned(5))
    assert steps == ["SCAN campaigns USING INDEX ix_campaigns_versioned"]


def plain(query):
    return query.limit(5).compile(dialect=sqlite.dialect(), compile_kwargs={"literal_binds": True})


@pytest.mark.parametrize("word", ["3000000000", "9223372036854775807"])
def test_a_whole_number_larger_than_its_column_is_compared(store, word):
    campaign = running(store)
    deliver(store, campaign, collision(0), make_errored_result(1))
    for column, found in (("steps", [0, 1]), ("hard_brakings", [0])):
        assert indices(store, campaign.id, 9, parse_filter(f"{column} < {word}"), BY_INDEX) == found
        assert indices(store, campaign.id, 9, parse_filter(f"{column} > {word}"), BY_INDEX) == []


@pytest.mark.parametrize("words", ["Übung", "übung", "ÜBUNG ä", "_%", "\x00", "\x00_"])
def test_names_are_searched_in_small_and_large_letters(store, words):
    for name in ("Übung Ä_%", "plain"):
        store.campaigns.create(accept_spec(spec(name=name)))
    found = store.campaigns.page(9, where=CampaignFilter(search=words)).items
    assert [each.id for each in found] == ([] if "\x00" in words else [1])
    assert not store.campaigns.page(9, where=CampaignFilter(method=words)).items
