"""`eigenfail compare`, `campaign course` and what `analyze` says of diversity."""

import json

import pytest

from eigenfail.values.comparison import Comparison
from eigenfail.values.summary import Course
from eigenfail.wire.http import decode


@pytest.fixture
def two(eigenfail, spec_file, done):
    """Two campaigns of one seed, the second with three times the noise."""
    spec_file.write_text(spec_file.read_text() + "[disturbance]\nscale = 3.0\n")
    return done, json.loads(eigenfail("run", spec_file, "--json").stdout)["campaign"]


def test_two_campaigns_are_compared_in_words(check_session, two):
    check_session("cli/compare/two", ("compare", *two))


def test_as_json_it_is_the_comparison(eigenfail, two):
    found = decode(eigenfail("compare", *two, "--json").stdout.encode(), Comparison)
    assert (found.a.campaigns, found.b.campaigns) == ((two[0],), (two[1],))
    assert found.pairs.n == found.difference.n_a == 24


def test_seeds_are_named_with_commas(check_session, eigenfail, spec_file):
    for seed in (1, 2, 3, 4):
        eigenfail("run", spec_file, "--seed", seed)
    check_session("cli/compare/seeds", ("compare", "1,2", "3,4"))


def test_wrong_ids_exit_with_2(check_session, done):
    wrong = (*(("compare", each, 1) for each in ("x", "1,", "0", "1;2")), ("compare", 1, 99))
    courses = (("campaign", "course", 99), ("campaign", "course", done, "--per", 0))
    check_session("cli/errors/compare", *wrong, *courses)


def test_a_course_is_a_table_of_blocks(check_session, eigenfail, done, store):
    check_session("cli/course", ("campaign", "course", done, "--per", 10))
    found = decode(eigenfail("campaign", "course", done, "--json").stdout.encode(), Course)
    assert found.per == 3
    failures = sum(block.failure_rate.k for block in found.blocks)
    assert failures == store.campaigns.get(done).counts.failures > 0


def test_an_analysis_says_how_diverse_the_failures_are(eigenfail, done):
    found = json.loads(eigenfail("analyze", done, "--clusters", 2, "--json").stdout)
    assert found["analysis"]["result"]["diversity"]["modes"] == 1
