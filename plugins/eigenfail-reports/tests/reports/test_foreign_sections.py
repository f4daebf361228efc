"""Sections of other plug-ins: found by entry point, and shown as those of this one."""

import sys
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from types import ModuleType
from typing import Any

import pytest

from eigenfail import plugins
from eigenfail.presentation.tables import Block, Table, TableColumn, name_columns
from eigenfail.values.estimates import Interval, Rate
from eigenfail_reports.foreign_sections import GROUP, make_part
from eigenfail_reports.page import to_csv
from eigenfail_reports.report import make
from eigenfail_services.store.store import Store

MODULE = "sheep_sections"
NOW_MS = 1_760_000_000_000
COLUMNS = (*name_columns("Where"), TableColumn("Failure rate inside", "share"), TableColumn("n"))
SAMPLED = Rate(0.25, 25, 100, Interval(0.175, 0.343))
ROWS = (("near", SAMPLED, 100), ("far", None, 7))


def describe_sheep(_store: Store, campaigns: Any) -> tuple[Block, ...]:
    """A section, as another plug-in makes it."""
    assert [campaign.id for campaign in campaigns] == [2]
    return ("There are sheep.", Table("Sheep", COLUMNS, ROWS), Table("None", COLUMNS, ()))


def describe_nothing(_store: Store, _campaigns: Any) -> tuple[Block, ...]:
    """A section that has nothing to say."""
    return ()


def describe_failing(_store: Store, _campaigns: Any) -> tuple[Block, ...]:
    """A section that cannot be made."""
    raise RuntimeError


@pytest.fixture(autouse=True)
def forget() -> Iterator[None]:
    """Has plug-ins loaded anew, before and after."""
    caches = (plugins.list_entry_points, plugins.load)
    for cache in caches:
        cache.cache_clear()
    yield
    for cache in caches:
        cache.cache_clear()


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Installs sections by name; those of other plug-ins are not there."""
    known = plugins.list_claims
    module = ModuleType(MODULE)
    for each in (describe_sheep, describe_nothing, describe_failing):
        setattr(module, each.__name__, each)
    monkeypatch.setitem(sys.modules, MODULE, module)

    def register(**sections: str) -> None:
        points = {
            name.replace("_", "-"): [EntryPoint(name, f"{MODULE}:{function}", GROUP)]
            for name, function in sections.items()
        }
        monkeypatch.setattr(
            plugins, "list_claims", lambda group: points if group == GROUP else known(group)
        )

    return register


def test_a_section_stands_before_provenance(install: Any, store: Store, parse: Any) -> None:
    install(black_sheep="describe_sheep", quiet="describe_nothing")
    made = make(store, (2,), NOW_MS)
    names = [section.name for section in made.report.sections]
    assert names[-2:] == ["black-sheep", "provenance"]
    (section,) = [each for each in made.report.sections if each.name == "black-sheep"]
    assert (section.title, section.words) == ("Black sheep", ("There are sheep.",))
    text = parse(made.html()).text
    assert "There are sheep." in text
    assert "95 %: [17.5, 34.3]" in text
    assert "All numbers, unrounded: tables/black-sheep.csv" in text


def test_a_rate_has_its_bounds_in_columns_of_their_own() -> None:
    part = make_part("sheep", (Table("Sheep", COLUMNS, ROWS), Table("None", COLUMNS, ())))
    first, second = part.tables
    assert (first.name, second.name) == ("sheep", "sheep-2")
    assert to_csv(first).decode().splitlines() == [
        "where,failure_rate_inside,failure_rate_inside_low,failure_rate_inside_high,n",
        "near,0.25,0.175,0.343,100",
        "far,,,,7",
    ]
    assert list(part.grids) == ["sheep"]


def test_a_section_that_cannot_be_loaded_is_left_out(
    install: Any, store: Store, caplog: pytest.LogCaptureFixture
) -> None:
    install(absent="nothing_of_this_name")
    names = [section.name for section in make(store, (2,), NOW_MS).report.sections]
    assert "absent" not in names
    assert names[-1] == "provenance"
    assert "The section 'absent' is left out of reports." in caplog.text


@pytest.mark.parametrize("name", ["results", "Black Sheep", "failing"])
def test_a_section_that_fails_or_has_no_name_of_its_own_is_left_out(
    install: Any, store: Store, caplog: pytest.LogCaptureFixture, name: str
) -> None:
    install(**{name: "describe_failing" if name == "failing" else "describe_sheep"})
    names = [section.name for section in make(store, (2,), NOW_MS).report.sections]
    assert names.count("results") == 1
    assert not {"Black Sheep", "failing"} & set(names)
    assert f"The section '{name}' is left out of reports." in caplog.text
