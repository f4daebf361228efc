"""Orders and columns, as they are written."""

import pytest
from msgspec.structs import replace

from eigenfail import filters
from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.testing.examples import spec
from eigenfail.values.records import EpisodeRow
from eigenfail.values.requirements import NoCollision, TimeHeadway


@pytest.mark.parametrize("text", ["severity", "-severity", "index", "-log_probability_per_step"])
def test_an_order_is_read_and_written_alike(text):
    assert str(filters.parse_sort(text)) == text


def test_a_minus_is_largest_first():
    assert filters.parse_sort(" -severity ") == filters.SortOrder("severity", descending=True)
    assert filters.parse_sort("index") == filters.BY_INDEX


@pytest.mark.parametrize("wrong", ["", "-", "--severity", "outcome", "worst"])
def test_only_columns_with_an_order_are_sorted_by(wrong):
    with pytest.raises(UnknownName) as refusal:
        filters.parse_sort(wrong)
    assert refusal.value.field == "sort"
    assert "severity" in refusal.value.known
    assert "outcome" not in refusal.value.known


def test_fields_are_names_with_commas_or_a_sequence():
    assert filters.parse_fields("index, severity,") == filters.parse_fields(["index", "severity"])
    assert filters.parse_fields("") == filters.parse_fields(()) == ()


def test_wrong_fields_are_refused():
    with pytest.raises(UnknownName, match="Did you mean 'severity'"):
        filters.parse_fields("index,sevrity")
    with pytest.raises(InvalidValue, match="severity is named twice"):
        filters.parse_fields("severity,index,severity")


def test_everything_in_a_row_is_a_column():
    elsewhere = {"assessed", "noise_pruned_ms", "requirements"}
    assert {*EpisodeRow.__struct_fields__} - elsewhere <= {*filters.COLUMNS}


def test_requirements_are_columns_by_their_number():
    assert str(filters.parse_sort("-requirement_20")) == "-requirement_20"
    assert filters.parse_fields("index,requirement_2") == ("index", "requirement_2")
    assert filters.find_column("requirement_2", "fields").is_ordered
    for wrong in ("requirement_0", "requirement_21", "requirement_", "requirement_01"):
        with pytest.raises(UnknownName, match="Did you mean 'requirement_1'"):
            filters.parse_fields(wrong)


def test_a_campaign_has_a_column_for_each_requirement_that_it_names():
    plain = spec()
    assert filters.list_columns(plain) == tuple(filters.COLUMNS)
    judged = replace(plain, requirements=(NoCollision(), TimeHeadway()))
    assert filters.list_columns(judged)[len(filters.COLUMNS) :] == (
        "requirement_1",
        "requirement_2",
    )
