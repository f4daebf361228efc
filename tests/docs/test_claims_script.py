"""`benchmarks/claims.py`: what it holds figures against, and how a part of them is found anew."""

import subprocess
import sys

import numpy as np
import pytest
from benchmarks.claims import read_other_figures
from benchmarks.figures import Figure, commit, write
from benchmarks.samples import mean, median
from benchmarks.targets import add_target, list_missed
from benchmarks.truth.shapes import draw_held_noise, shuffles, square_wave, square_waves


def figure(value, **changes):
    return Figure(value=value, unit="share", n=10, command="python -m benchmarks.claims", **changes)


def test_a_prefix_leaves_the_other_figures_and_their_commits_as_they_are(tmp_path):
    path = tmp_path / "claims.json"
    write(path, {"a.rate": figure(0.5, commit="old"), "b.rate": figure(0.1, commit="old")})
    write(path, read_other_figures(path, "b.") | {"b.rate": figure(0.2)})
    found = read_other_figures(path, "nothing")
    assert (found["a.rate"].value, found["a.rate"].commit) == (0.5, "old")
    assert (found["b.rate"].value, found["b.rate"].commit) == (0.2, commit())
    assert read_other_figures(tmp_path / "none.json", "") == {}


def test_targets_say_what_is_missed():
    name, other = "cut_in.idm.mc2000.failure_rate", "cut_in.rulebook.mc2000.failures"
    figures = {name: figure(0.24), other: figure(0), "cut_in.rulebook.held2.rate": figure(0.3)}
    assert list_missed(figures, "cut_in.idm.mc") == [name]
    assert list_missed(figures | {name: figure(0.25)}, "cut_in.idm.mc") == []
    assert list_missed(figures, other) == []
    assert "cut_in.rulebook.p_fail" in list_missed(figures, "cut_in.rulebook."), "it was not found"
    told = add_target(name, figures[name], seed=5)
    assert (told.target, told.paper, told.note) == (
        *("0.25 … 0.55", 0.401),
        "the paper gives no number of episodes; seed 5",
    )


def test_an_unknown_prefix_is_a_usage_error(root, tmp_path):
    script = [sys.executable, "-m", "benchmarks.claims", "--only", "cut_out"]
    done = subprocess.run(
        [*script, "--to", tmp_path / "x.json"],
        cwd=root,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "cut_in.rulebook.p_fail" in done.stdout
    assert not (tmp_path / "x.json").exists()


def test_held_noise_stands_still_and_shuffles_keep_the_values():
    rng = np.random.default_rng(1)
    z = draw_held_noise(rng, 4, 103, sigma=3.0, hold=5)
    assert z.shape == (4, 103, 2)
    assert (z[:, 5:10] == z[:, 5:6]).all()
    assert (z[:, 5] != z[:, 4]).all()
    assert np.abs(z).max() <= 3.0
    wave = square_wave(100, 2.0, half_period=20)
    assert wave[19:21].tolist() == [[2.0, 0.0], [-2.0, 0.0]]
    for shuffled in shuffles(rng, wave, 5):
        assert sorted(shuffled[:, 0]) == sorted(wave[:, 0])
        assert (shuffled != wave).any()
    waves = square_waves(100, 3.0)
    assert waves.shape == (78, 100, 2)
    assert len(np.unique(waves, axis=0)) == 78
    assert set(np.unique(waves)) <= {-3.0, 0.0, 3.0}


def test_intervals_of_means_and_medians_hold_the_truth_in_nineteen_of_twenty_cases():
    rng = np.random.default_rng(3)
    inside = np.zeros(2)
    for _ in range(400):
        values = rng.normal(size=200).tolist()
        for place, found in enumerate((mean(values, "m"), median(values, "m"))):
            low, high = found.interval
            inside[place] += low <= 0.0 <= high
    assert inside / 400.0 == pytest.approx([0.95, 0.95], abs=0.03)
    assert mean([], "m").value is None
    assert mean([2.0], "m").interval is None
