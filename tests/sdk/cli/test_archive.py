"""`eigenfail campaign archive` and `restore`, and lists with `--archived`."""

import json


def listed(eigenfail, *options):
    return [each["id"] for each in json.loads(eigenfail("campaign", "list", *options).stdout)]


def test_a_campaign_is_archived_and_restored(eigenfail, done):
    told = eigenfail("campaign", "archive", done)
    assert told.exit_code == 0
    assert "lists omit it" in told.stdout
    assert listed(eigenfail, "--json") == []
    assert listed(eigenfail, "--archived", "--json") == [done]
    assert eigenfail("campaign", "show", done).exit_code == 0
    assert eigenfail("campaign", "restore", done).exit_code == 0
    assert listed(eigenfail, "--json") == [done]


def test_what_was_archived_before_an_error_is_told(eigenfail, done):
    told = eigenfail("campaign", "archive", done, done, 99)
    assert told.exit_code == 2
    lines = told.stderr.splitlines()
    assert lines[0] == f"Campaign {done} 'quick' is archived: lists omit it."
    assert "99" in lines[-1]
    assert len(lines) == 2
    assert listed(eigenfail, "--json") == []


def test_a_suite_keeps_its_archived_members(eigenfail, spec_file, store):
    asked = ("run", spec_file, "--seeds", 2)
    assert eigenfail(*asked).exit_code == 0
    made = [campaign.id for campaign in store.campaigns.page(10).items]
    told = eigenfail("campaign", "archive", *made)
    assert told.exit_code == 0
    assert [line.rpartition(":")[0] for line in told.stdout.splitlines()] == [
        f"Campaign {campaign} '{store.campaigns.get(campaign).spec.name}' is archived"
        for campaign in made
    ]
    assert eigenfail(*asked).exit_code == 0
    assert [campaign.id for campaign in store.campaigns.page(10).items] == made
