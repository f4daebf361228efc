"""`eigenfail episode failures`."""

import json

from store_checks.failures import fill

FAILURES = ("episode", "failures")


def test_failures_of_all_campaigns_are_listed(store, check_session):
    fill(store)
    check_session(
        "cli/failures/listed",
        (*FAILURES, "--limit", 3),
        (*FAILURES, "--planner", "idm", "--sort", "severity", "--limit", 2),
        (*FAILURES, "--project", "none"),
        (*FAILURES, "--sort", "steps"),
    )


def test_archived_campaigns_are_listed_on_request(store, eigenfail):
    fill(store)
    store.campaigns.archive(2)
    for field, command in (("id", ("campaign", "list")), ("campaign", FAILURES)):
        asked = (*command, "--limit", 99, "--json")
        narrowed, shown = (
            {row[field] for row in json.loads(ran.stdout)}
            for ran in (eigenfail(*asked), eigenfail(*asked, "--archived"))
        )
        assert shown - narrowed == {2}
