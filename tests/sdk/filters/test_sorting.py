"""Orders and columns, as they are written."""

import pytest

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.filters import BY_INDEX, COLUMNS, SortOrder, parse_fields, parse_sort
from eigenfail.values.records import EpisodeRow


@pytest.mark.parametrize("text", ["severity", "-severity", "index", "-log_probability_per_step"])
def test_an_order_is_read_and_written_alike(text):
    assert str(parse_sort(text)) == text


def test_a_minus_is_largest_first():
    assert parse_sort(" -severity ") == SortOrder("severity", descending=True)
    assert parse_sort("index") == BY_INDEX


@pytest.mark.parametrize("wrong", ["", "-", "--severity", "outcome", "worst"])
def test_only_columns_with_an_order_are_sorted_by(wrong):
    with pytest.raises(UnknownName) as refusal:
        parse_sort(wrong)
    assert refusal.value.field == "sort"
    assert "severity" in refusal.value.known
    assert "outcome" not in refusal.value.known


def test_fields_are_names_with_commas_or_a_sequence():
    assert parse_fields("index, severity,") == parse_fields(["index", "severity"])
    assert parse_fields("") == parse_fields(()) == ()


def test_wrong_fields_are_refused():
    with pytest.raises(UnknownName, match="Did you mean 'severity'"):
        parse_fields("index,sevrity")
    with pytest.raises(InvalidValue, match="severity is named twice"):
        parse_fields("severity,index,severity")


def test_everything_in_a_row_is_a_column():
    assert {*EpisodeRow.__struct_fields__} - {"assessed", "noise_pruned_ms"} <= {*COLUMNS}
