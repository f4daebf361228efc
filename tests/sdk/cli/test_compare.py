"""`eigenfail compare`, `campaign course` and what `analyze` says of diversity."""

import json

import numpy as np
import pytest
from msgspec.structs import replace

from eigenfail.presentation.analyses import describe_diversity
from eigenfail.values import AnalysisResult, Comparison, Course, Diversity
from eigenfail.wire.http import decode


@pytest.fixture
def two(eigenfail, spec_file, done):
    """Two campaigns of one seed, the second with three times the noise."""
    spec_file.write_text(spec_file.read_text() + "[disturbance]\nscale = 3.0\n")
    return done, json.loads(eigenfail("run", spec_file, "--json").stdout)["campaign"]


def test_two_campaigns_are_compared_in_words(eigenfail, two, store):
    a, b = two
    told = eigenfail("compare", a, b)
    assert told.exit_code == 0, told.output
    failures = [store.campaigns.get(each).counts.failures for each in two]
    rows = [line.split() for line in told.stdout.splitlines()]
    assert [row[1:4] for row in rows if row[:1] in (["A"], ["B"]) and row[1].isdecimal()] == [
        [str(each), "24", str(count)] for each, count in zip(two, failures, strict=True)
    ]
    words = " ".join(told.stdout.split())
    assert "Both saw the same noise in 24 pairs of episodes: " in words
    assert "disturbance.scale 1.0 3.0" in words
    assert "Warning" not in words


def test_as_json_it_is_the_comparison(eigenfail, two):
    found = decode(eigenfail("compare", *two, "--json").stdout.encode(), Comparison)
    assert (found.a.campaigns, found.b.campaigns) == ((two[0],), (two[1],))
    assert found.pairs.n == found.difference.n_a == 24


def test_seeds_are_named_with_commas(eigenfail, spec_file):
    for seed in (1, 2, 3, 4):
        eigenfail("run", spec_file, "--seed", seed)
    words = " ".join(eigenfail("compare", "1,2", "3,4").stdout.split())
    assert "Vargha–Delaney A12, n = 2 and 2 campaigns" in words
    assert "not paired: their seeds differ." in words
    assert "Warning: A and B were asked for the same thing" in words


@pytest.mark.parametrize("wrong", ["x", "1,", "0", "1;2"])
def test_ids_are_checked_before_anything_is_asked(eigenfail, wrong):
    refused = eigenfail("compare", wrong, 1)
    assert refused.exit_code == 2
    assert f"'{wrong}' is not of the form 1 or 1,2,3." in refused.stderr


@pytest.mark.parametrize("words", [("compare", 1, 99), ("campaign", "course", 99)])
def test_what_does_not_exist_exits_with_2(eigenfail, done, words):
    refused = eigenfail(*words)
    assert refused.exit_code == 2
    assert "99" in refused.stderr


def test_a_course_is_a_table_of_blocks(eigenfail, done, store):
    told = eigenfail("campaign", "course", done, "--per", 10)
    assert told.exit_code == 0, told.output
    title, _, _, *rows = told.stdout.splitlines()
    assert title.strip() == f"Failures over episodes of campaign {done} (monte_carlo)"
    assert [row.split()[:2] for row in rows] == [["0–9", "10"], ["10–19", "10"], ["20–23", "4"]]
    found = decode(eigenfail("campaign", "course", done, "--json").stdout.encode(), Course)
    assert found.per == 3
    failures = sum(block.failure_rate.k for block in found.blocks)
    assert failures == store.campaigns.get(done).counts.failures > 0
    assert eigenfail("campaign", "course", done, "--per", 0).exit_code == 2


def test_a_campaign_is_shown_with_rate_likelihood_severity_and_cost(eigenfail, done, store):
    words = " ".join(eigenfail("campaign", "show", done).stdout.split())
    failures = store.campaigns.get(done).counts.failures
    assert f"failure rate {100 * failures / 24:.1f} % [" in words
    assert "(n = 24)" in words
    for name in ("log p per step −", "severity ", "cost per failure "):
        assert name in words
    assert f"(n = {failures})" in words


def test_an_analysis_says_how_diverse_the_failures_are(eigenfail, done):
    told = eigenfail("analyze", done, "--clusters", 2)
    words = " ".join(told.stdout.split())
    assert "No distinct modes: clusters cannot be distinguished from noise (silhouette 0." in words
    assert "sigma about its mean; that of p(x) has 1." in words
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
    assert warning == "Warning: mode collapse: try `ensemble`."
