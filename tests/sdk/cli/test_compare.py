"""`eigenfail compare`, `campaign course` and what `analyze` says of diversity."""

import json

import numpy as np
import pytest
from msgspec.structs import replace

from eigenfail.presentation.analyses import describe_diversity
from eigenfail.values.analysis import AnalysisResult, Diversity
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


def test_modes_that_are_distinct_are_told_with_when_they_were_seen():
    nothing = np.zeros((0, 0), np.float32)
    fields = dict.fromkeys(("explained", "components", "scores", "influence"), nothing)
    found = AnalysisResult(
        **fields, episodes=(), labels=(), modes=(), silhouette=None, noise_silhouette=None
    )
    assert list(describe_diversity(found)) == []
    diversity = Diversity(
        failures=40,
        modes=2,
        largest_share=0.95,
        effective_modes=1.2,
        spread=0.8,
        coverage=(1,) * 9 + (2,),
        verdict="2 modes.",
        warning="mode collapse: try `ensemble`.",
    )
    spread, coverage, warning = describe_diversity(replace(found, diversity=diversity))
    assert "40 failures has a standard deviation of 0.800 sigma about its mean" in spread
    assert coverage.endswith("each tenth of the campaign: 1, 1, 1, 1, 1, 1, 1, 1, 1, 2.")
    assert warning.startswith("Warning: Mode collapse: 95 % of the failures are of one mode. Try ")
    assert "`" not in warning
