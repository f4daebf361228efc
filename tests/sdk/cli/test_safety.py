"""`eigenfail campaign safety`: the paper's table at a prompt."""

from eigenfail.values.safety import Safety
from eigenfail.wire.http import decode


def test_the_table_of_a_campaign(check_session, done):
    check_session(
        "cli/safety",
        ("campaign", "safety", done),
        ("campaign", "safety", 99),
        ("campaign", "safety", done, "--level", 2),
    )


def test_as_json_it_is_the_value(eigenfail, done):
    found = decode(eigenfail("campaign", "safety", done, "--json").stdout.encode(), Safety)
    assert found.completed == 24
    assert found.ttc.beyond.k == found.collisions.k + found.near_misses.k
