"""The comparison with OpenTURNS, as far as it needs no OpenTURNS."""

import sys

import numpy as np
import pytest
from benchmarks.peers import openturns_beside
from benchmarks.peers.openturns_beside import NO_ESTIMATE, Comparison, Runs, format_row, run_subset
from benchmarks.truth.known_problems import half_space


def of_ratios(ratios):
    return Runs(np.array(ratios), np.full(len(ratios), 9.0))


def test_the_error_is_relative_and_a_run_without_a_number_is_worth_zero():
    assert of_ratios([0.0, 1.0, 2.0, 1.0]).error == pytest.approx(0.5**0.5)


def test_the_ratio_compares_errors_and_has_an_interval_over_seeds():
    random = np.random.default_rng(3)
    small, large = (1.0 + size * random.standard_normal(400) for size in (0.1, 0.2))
    one = Comparison("x", 2000, of_ratios(small), of_ratios(large))
    low, high = one.find_interval()
    assert low < 0.5 < high
    assert high - low < 0.15
    assert low < one.ratio < high


def test_rows_without_an_estimate_are_marked():
    lucky = of_ratios([0.0] * 39 + [300.0])
    assert NO_ESTIMATE in format_row(Comparison("x", 2000, lucky, lucky))
    assert NO_ESTIMATE not in format_row(Comparison("x", 2000, lucky, of_ratios([1.2] * 40)))


def test_the_samples_are_those_with_which_the_calls_are_the_budget(monkeypatch):
    """A program that takes 3.7 calls a sample, whatever the number of samples."""

    def run(_problem, samples, seeds):
        calls = np.full(len(seeds), 3.7 * samples)
        return openturns_beside.Runs(np.ones(len(seeds)), calls)

    monkeypatch.setattr(openturns_beside, "run_openturns", run)
    samples = openturns_beside.choose_samples(None, 2000)
    assert samples == 540
    assert abs(3.7 * samples - 2000) <= 3.7 * 5


def test_every_evaluation_of_a_campaign_is_counted(monkeypatch):
    runs = run_subset(half_space(1e-2), 600, [1, 2, 3])
    assert (runs.calls <= 600).all()
    assert (runs.calls > 300).all()
    assert 0.2 < runs.ratios.mean() < 5.0


def test_openturns_is_imported_only_where_it_runs():
    assert "openturns" not in vars(openturns_beside)
    assert "openturns" not in sys.modules
