"""What notebooks show of a report: what it is on, escaped and small."""

import pytest
from html_tags import ALLOWED, NASTY, tags

from eigenfail_reports.client import write_report


@pytest.fixture
def report(client, fields, tmp_path):
    """A report on two campaigns, the first of which has markup in its name."""
    campaigns = [client.campaigns.create(**fields | {"name": name}) for name in (NASTY, "other")]
    return write_report(client, campaigns, tmp_path / "report")


def test_a_report_is_small_well_formed_and_escaped(report):
    text = report._repr_html_()
    assert tags(text) <= ALLOWED
    assert "<script" not in text
    assert f"{report.campaigns[0].id}: &lt;script&gt;" in text
    assert len(text) < 4_000


def test_as_the_last_line_of_a_cell_it_is_one_line(report):
    ids = tuple(campaign.id for campaign in report.campaigns)
    assert f"campaigns={ids}, sections=" in repr(report)
    assert len(repr(report)) < 400
