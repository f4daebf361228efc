"""Migration 0022: modes of earlier analyses get names, and their failures know them."""

from textwrap import shorten

from msgspec.structs import replace
from sqlalchemy import inspect
from store_checks.modes import WORDS, analysed, crashed

from eigenfail.testing.examples import analysis_result
from eigenfail.values import AnalysisSettings, Mode
from eigenfail_services.store import migrate, open_store


def tables(connection) -> set[str]:
    return set(inspect(connection).get_table_names())


def test_modes_of_earlier_analyses_are_filled_in(url, look) -> None:
    store = open_store(url)
    campaign, other = crashed(store), crashed(store, 1)
    described = analysed(store, campaign, replace(analysis_result(), words=WORDS))
    pooled = replace(
        analysis_result(),
        episodes=(0, 3, 0, 1),
        campaigns=(campaign.id, campaign.id, other.id, campaign.id),
    )
    bare = analysed(store, campaign, pooled)
    unfinished = store.analyses.create(campaign.id, AnalysisSettings()).id
    before = [store.analyses.modes(each) for each in (described, bare)]
    store.close()
    migrate.downgrade(url, "0021")
    assert not {"modes", "mode_members"} & look(url, tables)
    store = open_store(url)  # brings the schema up again
    first, second = before[0]
    # The migration keeps the words that it had: names that are proposed today may be shorter.
    filled = replace(second, name=shorten(WORDS[1].removeprefix("Mode 2: "), 80, placeholder=" …"))
    assert [store.analyses.modes(each) for each in (described, bare)] == [
        (first, filled),
        before[1],
    ]
    assert store.analyses.modes(unfinished) == ()
    rows = store.episodes.page(campaign.id, 10).items
    assert [row.mode for row in rows] == [1, 2, None, 2]
    assert [mode.analysis for mode in store.analyses.find_modes(other.id, 0)] == [bare]
    assert store.analyses.modes(described)[0] == Mode(described, 1, 2, "It brakes late")
    store.close()
