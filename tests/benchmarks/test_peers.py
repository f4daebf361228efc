"""Searches of other tools: what a call is, and which points dominate; without their packages."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from benchmarks.claims import read_other_figures
from benchmarks.figures import Figure, write
from benchmarks.learning_figures import of_seeds
from benchmarks.peers.comparison import (
    COUNTS,
    POINT,
    Calls,
    compare_searches,
    count_cells,
    count_points,
    dominates,
)
from benchmarks.peers.peer_tools import PEERS, Answer, Peer, rank_likely
from benchmarks.trials import Trial

from eigenfail.functions import of_batch
from eigenfail_workers.functions import FunctionEngine

ROOT = Path(__file__).parents[2]


def push(z):
    """Below 0 beyond a longitudinal push of 1 at each step."""
    return 1.0 - z[:, :, 0].mean(axis=1)


def make_calls(limit, steps=25, hold=10, find_raw=push):
    return Calls(FunctionEngine(of_batch(push), steps), steps, hold, limit, find_raw)


def test_a_point_dominates_if_it_is_no_worse_and_somewhere_better():
    assert dominates((2.0, 1.0, 1.0), (1.0, 1.0, 1.0))
    assert not dominates((1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
    assert not dominates((2.0, 1.0, 0.9), (1.0, 1.0, 1.0))


OURS = [(5.0, -2.0, 1.0), (9.0, -4.0, 0.5)]


@pytest.mark.parametrize(
    ("peer", "counts"),
    [
        ((9.0, -2.0, 1.0), (1, 1, 1)),  # better than both
        ((5.0, -1.0, 1.0), (0, 1, 1)),  # better than the first one
        ((4.0, -3.0, 2.0), (0, 0, 1)),  # neither better nor worse than any
        ((4.0, -3.0, 0.9), (0, 0, 0)),  # worse than the first one
        ((5.0, -2.0, 1.0), (0, 0, 1)),  # the same as the first one
        ((9.0, -4.0, 0.4), (0, 0, 0)),  # worse than the second one
    ],
)
def test_points_that_dominate_are_counted(peer, counts):
    assert tuple(count([peer], OURS) for count in COUNTS.values()) == counts
    assert tuple(count([peer, peer], OURS) for count in COUNTS.values()) == tuple(
        2 * count for count in counts
    )
    assert COUNTS["dominated"]([peer], []) == 0, "nothing of ours was measured"


def make_figures(place, name, point):
    return {
        f"search.{place}.{name}.{what}": Figure(value=value, unit="", n=1, command="")
        for what, value in zip(POINT, point, strict=True)
    }


def test_counts_come_from_the_figures_of_all_places():
    figures = (
        make_figures("cut_in", "held", (5.0, -2.0, 1.0))
        | make_figures("cut_in", "pycma", (6.0, -2.0, 1.0))
        | make_figures("cut_in", "taliro", (0.0, None, None))
        | make_figures("walk", "held", (5.0, -2.0, 1.0))
        | make_figures("walk", "pycma", (4.0, -2.0, 1.0))
    )
    counted = dict(count_points(figures))
    assert {name: figure.value for name, figure in counted.items()} == {
        "search.dominated": 1.0,
        "search.dominating": 1.0,
        "search.undominated_peers": 1.0,
    }
    assert {figure.n for figure in counted.values()} == {2}, (
        "a search without failures has no point"
    )
    assert "cut_in 1 of 1, merge_in 0 of 0, walk 0 of 1" in counted["search.dominated"].note
    assert list(count_points({})) == []


def make_seeds(place, name, measure, *values):
    figure = of_seeds(values, "", 1000, "; regions of some size")
    assert isinstance(figure, Figure)
    return {f"search.{place}.{name}.{measure}": figure}


def count_outcomes(*figures):
    found = dict(count_cells({name: one for each in figures for name, one in each.items()}))
    return {name.rpartition(".")[2]: figure.value for name, figure in found.items()}


def test_cells_are_better_or_worse_only_where_a_test_shows_it():
    ours = make_seeds("walk", "held", "failures", *range(20, 30))
    worse = make_seeds("walk", "pycma", "failures", *range(10, 20))
    better = make_seeds("walk", "pycma", "failures", *range(30, 40))
    alike = make_seeds("walk", "pycma", "failures", *range(19, 29))
    assert count_outcomes(ours, worse) == {"better": 1, "worse": 0, "undecided": 0}
    assert count_outcomes(ours, better) == {"better": 0, "worse": 1, "undecided": 0}
    assert count_outcomes(ours, alike) == {"better": 0, "worse": 0, "undecided": 1}
    assert count_outcomes(alike) == {}, "nothing of ours was measured"


def test_a_better_median_alone_is_no_success():
    ours = make_seeds("walk", "held", "failures", 5, 6, 7)
    theirs = make_seeds("walk", "pycma", "failures", 4, 6, 6)
    assert count_outcomes(ours, theirs)["undecided"] == 1


def test_earlier_is_better_and_a_seed_without_a_failure_is_the_worst():
    early = make_seeds("walk", "held", "first_failure", 3, 4, 5, 6, 7)
    late = make_seeds("walk", "pycma", "first_failure", 1, None, None, None, None)
    assert count_outcomes(early, late)["worse"] == 0
    assert count_outcomes(early, make_seeds("walk", "pycma", "first_failure", *[None] * 5)) == {
        "better": 1,
        "worse": 0,
        "undecided": 0,
    }


@pytest.mark.parametrize("measure", ["failures", "distance", "regions"])
def test_searches_count_where_their_failures_are_likely_enough(measure):
    def make(name, value, log_p):
        return make_seeds("walk", name, measure, *[value] * 5) | make_seeds(
            "walk", name, "log_p_per_step", *[log_p] * 5
        )

    ours = make("held", 1.5, -3.0)
    for log_p, worse in ((-17.0, 1), (-18.0, 0)):
        found = count_outcomes(ours, make("pycma", 1e6, log_p))
        # The other cell is that of log p, in which ours is the best.
        assert found == {"better": 1, "worse": worse, "undecided": 0}


def test_the_counts_in_the_claims_are_those_of_the_points_in_them():
    stored = (ROOT / "benchmarks/results/claims.json").read_bytes()
    claims = msgspec.json.decode(stored, type=dict[str, Figure])
    for name, figure in compare_searches(claims):
        assert (claims[name].value, claims[name].n) == (figure.value, figure.n)


def test_a_call_holds_its_values_and_answers_with_the_raw_robustness():
    calls = make_calls(10)
    assert calls.dimension == 6
    x = np.array([1.5, 0.0, 2.0, 0.5, 4.0, 0.0])
    answer = calls.call(x)
    held = np.repeat(x.reshape(-1, 2), 10, axis=0)[:25]
    assert answer.robustness == pytest.approx(1.0 - held[:, 0].mean())
    assert answer.robustness < 0.0
    assert answer.squares == pytest.approx(np.sum(held**2))
    assert make_calls(10, find_raw=None).call(x).robustness == 0.0


def test_a_search_ends_with_its_last_call_and_every_failure_is_kept():
    """Also where a library wraps what its objective raises."""

    def search(task):
        random = np.random.default_rng(task.seed)
        while True:
            try:
                task.find_robustness(random.uniform(-task.bound, task.bound, task.dimension))
            except Exception as error:
                raise RuntimeError("wrapped") from error

    run = make_calls(300).run(search, bound=4.0, seed=1)
    assert len(run.crashed) == 300
    assert 20 < sum(run.crashed) == len(run.crashes) < 200
    for one in run.crashes:
        assert push(one.z[None].astype(float)) <= 0.0
        expected = -np.log(2.0 * np.pi) * 25 - np.sum(one.z.astype(float) ** 2) / 2.0
        assert one.log_probability == pytest.approx(expected, rel=1e-5)


def test_what_a_search_raises_before_its_last_call_is_raised():
    def search(task):
        task.find_robustness(np.zeros(task.dimension))
        raise ValueError("a flaw")

    with pytest.raises(ValueError, match="a flaw"):
        make_calls(300).run(search, bound=4.0, seed=1)


def test_likely_failures_rank_first():
    answers = [Answer(-1.0, 4.0), Answer(0.0, 9.0), Answer(0.1, 0.0), Answer(3.0, 0.0)]
    assert sorted(answers, key=rank_likely) == answers


def test_a_peer_says_which_of_its_packages_are_missing():
    assert Peer(("msgspec", "no_such_package"), print).list_missing() == ["no_such_package"]
    assert {package for peer in PEERS.values() for package in peer.packages} >= {
        *("verifai", "staliro", "optuna", "nevergrad", "pymoo", "openturns"),
    }


def test_figures_of_a_tool_that_is_not_installed_are_kept(tmp_path, monkeypatch):
    path = tmp_path / "claims.json"
    old = make_figures("walk", "pycma", (4.0, -2.0, 1.0)) | make_figures("walk", "held", (1, -2, 1))
    write(path, old)
    trials = (
        Trial(("search.walk.pycma.",), print, missing=("cma",)),
        Trial(("search.walk.held.",), lambda _crew, _seed: []),
    )
    monkeypatch.setattr("benchmarks.claims.TRIALS", trials)
    assert {name.split(".")[2] for name in read_other_figures(path, "")} == {"pycma"}
    assert {name.split(".")[2] for name in read_other_figures(path, "search.walk.held.")} == {
        "pycma"
    }
