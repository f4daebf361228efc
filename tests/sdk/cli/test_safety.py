"""`eigenfail campaign safety`: the paper's table at a prompt."""

from eigenfail.values import Safety
from eigenfail.wire.http import decode


def test_the_table_of_a_campaign(eigenfail, done, store):
    told = eigenfail("campaign", "safety", done)
    assert told.exit_code == 0, told.output
    failures = store.campaigns.get(done).counts.failures
    words = " ".join(told.stdout.split())
    assert "(monte_carlo): 24 episodes" in words
    assert f"Collision {failures} {100 * failures / 24:.1f} % [" in words
    for name in (
        "Near miss ",
        "MinTTC below 1.5 s ",
        "DRAC above 7 m/s² ",
        "mean lead time ",
        ", ρ ",
    ):
        assert name in words
    assert f"{failures} failures leave" in words


def test_as_json_it_is_the_value(eigenfail, done):
    found = decode(eigenfail("campaign", "safety", done, "--json").stdout.encode(), Safety)
    assert found.completed == 24
    assert found.ttc.beyond.k == found.collisions.k + found.near_misses.k


def test_what_cannot_be_is_refused(eigenfail, done):
    assert eigenfail("campaign", "safety", 99).exit_code == 2
    refused = eigenfail("campaign", "safety", done, "--level", 2)
    assert refused.exit_code == 2
    assert "level" in refused.stderr
