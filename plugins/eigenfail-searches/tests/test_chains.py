"""The method `chains`, on problems whose failures are known."""

import sys
from pathlib import Path

import numpy as np
import pytest

from eigenfail.errors import InvalidValue, LearnerFailed
from eigenfail.settings import read_settings
from eigenfail.testing.learner import Corridor, ToyEngine
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.learning import LearnerContext
from eigenfail_searches.chains.diagnostics import judge_projections, measure_projections
from eigenfail_searches.chains.method import (
    ChainSettings,
    FailureChains,
    choose_starts,
    count_steps,
    read_state,
)
from eigenfail_searches.chains.projections import (
    find_directions,
    name_channels,
    rename_channels,
)
from eigenfail_searches.chains.sampler import MoveKind
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_workers.functions import FunctionEngine

sys.path.append(str(Path(__file__).parents[3] / "tests" / "services" / "methods" / "toys"))

from problems import HalfSpace, TwoModes
from problems import steady as steady_noise

CORRIDOR = Corridor(steps=20, wall=0.55)

NO_MOVES = {kind.value: 0 for kind in MoveKind}


def make(trajectories, episodes=400, seed=1, **settings):
    trajectories = np.asarray(trajectories, np.float32)
    given = read_settings(ChainSettings, {"campaign": 1} | settings, "settings")
    context = LearnerContext(seed, episodes, trajectories.shape[1], trajectories)
    return FailureChains(context, given)


def run(learner, episodes, engine, seed=1):
    return list(run_in_process(Rounds(learner, seed, episodes), engine))


def steady(level, n=12):
    """Trajectories that push all the time, shape (n, steps, 2)."""
    z = np.random.default_rng(0).normal(0.0, 0.3, (n, CORRIDOR.steps, 2))
    return z + np.array([level, 0.0])


def step_through(learner, outcomes, ends=20):
    """Have the next round observed with these outcomes; what was proposed."""
    sources = learner.propose(len(outcomes)).sources
    sigma = np.ones((ends, 2), np.float32)
    learner.observe(
        [
            EpisodeResult(
                i, 0, outcome, ends, NoiseTrajectory(source.z[:ends], sigma), "trajectory"
            )
            for i, (source, outcome) in enumerate(zip(sources, outcomes, strict=True))
        ]
    )
    return np.stack([source.z for source in sources])


COLLISION, SAFE, ERRORED = Outcome.COLLISION, Outcome.SAFE, Outcome.ERRORED


def test_samples_are_distributed_as_failures_of_monte_carlo():
    """From starts that push throughout, far less likely than the failures of p(z)."""
    random = np.random.default_rng(5)
    z = random.standard_normal((40_000, CORRIDOR.steps, 2))
    beyond = CORRIDOR.course(z) >= CORRIDOR.wall
    ends = np.argmax(beyond, axis=1)[beyond.any(axis=1)] + 1
    truth = [each[:end] for each, end in zip(z[beyond.any(axis=1)], ends, strict=True)]
    starts = steady(2.0)
    episodes = 6000
    learner = make(starts, episodes, redraw=1, window=1, pcn=1, chains=20)
    run(learner, episodes, ToyEngine(CORRIDOR))
    facts, trace = read_state(learner.state())
    columns = dict(zip(facts.projections, np.moveaxis(trace, 2, 0), strict=True))
    assert columns["steps to the collision"].mean() == pytest.approx(ends.mean(), rel=0.06)
    square = np.mean([np.square(each).mean() for each in truth])
    assert columns["mean z²"].mean() == pytest.approx(square, rel=0.05)
    assert np.square(starts).mean() > 1.5 * square


def test_chains_of_a_plane_border_mix():
    problem = HalfSpace(0.1, steady_noise(2))
    small = NO_MOVES | {"pcn": 1, "acceptance": 0.4, "burn_in": 0.2}
    learner = make(1.2 * problem.likeliest[None], 4800, chains=8, **small)
    run(learner, 4800, FunctionEngine(problem.function, problem.steps))
    facts, trace = read_state(learner.state())
    projections = measure_projections(facts.projections, trace)
    assert judge_projections(projections)[0], projections
    assert facts.accepted / facts.tried > 0.2


def corner_starts(*sides):
    return np.array([[[side * 3.1, 3.1]] for side in sides], np.float32)


def run_corners(*sides):
    problem = TwoModes()
    learner = make(corner_starts(*sides), 4000, chains=8, **NO_MOVES | {"pcn": 1})
    results = run(learner, 4000, FunctionEngine(problem.function, problem.steps))
    facts, trace = read_state(learner.state())
    projections = measure_projections(facts.projections, trace)
    return results, projections, judge_projections(projections)


def test_chains_in_two_corners_keep_the_shares_of_their_starts_and_say_so():
    results, projections, (mixed, verdict) = run_corners(1, 1, 1, 1, 1, 1, -1, -1)
    late = [one.noise.z[0, 0] > 0 for one in results[2000:] if one.is_failure]
    assert np.mean(late) == pytest.approx(0.75, abs=0.06)  # the truth is one half
    assert not mixed
    assert verdict.startswith("Not mixed. R-hat of ")
    assert projections[0].r_hat > 1.5


def test_chains_from_one_corner_never_show_the_other():
    results, _, _ = run_corners(1, 1, 1)
    assert all(one.noise.z[0, 0] > 0 for one in results if one.is_failure)


def test_each_family_of_failures_has_its_share_of_the_starts():
    """Failures that share their first step descend from one episode."""
    rng = np.random.default_rng(1)
    families = np.repeat([3.0, -1.0, 0.5, 2.0], [50, 25, 20, 5])
    failures = rng.standard_normal((100, 3, 2)).astype(np.float32)
    failures[:, 0] = families[:, None]
    failures = rng.permutation(failures)
    starts = choose_starts(failures, 20, 1)
    counts = [int((starts[:, 0, 0] == value).sum()) for value in (3.0, -1.0, 0.5, 2.0)]
    assert counts == pytest.approx([10, 5, 4, 1], abs=0.99)
    assert (choose_starts(failures, 20, 1) == starts).all()
    assert not all((choose_starts(failures, 20, seed) == starts).all() for seed in range(2, 6))


def test_each_failure_is_as_likely_a_start():
    failures = np.random.default_rng(2).standard_normal((30, 3, 2)).astype(np.float32)
    chosen = np.concatenate([choose_starts(failures, 4, seed) for seed in range(1500)])
    counts = [(chosen == each).all(axis=(1, 2)).sum() for each in failures]
    assert counts == pytest.approx([200] * 30, abs=55)


def test_of_few_failures_each_starts_several_chains():
    starts = choose_starts(corner_starts(1, -1), 6, 3)
    assert sorted(starts[:, 0, 0].round(1).tolist()) == pytest.approx([-3.1] * 3 + [3.1] * 3)


def test_recorded_noise_ends_with_its_episode():
    z = np.ones((2, 4, 2), np.float32)
    z[1, 2:] = 0.0
    assert count_steps(z).tolist() == [4, 2]
    assert count_steps(np.zeros((1, 4, 2), np.float32)).tolist() == [0]


def test_the_first_round_runs_the_starts_and_others_begin_where_one_failed():
    learner = make(steady(2.0, n=3), chains=3)
    starts = step_through(learner, [SAFE, COLLISION, ERRORED])
    assert len(np.unique(starts[:, 0, 0])) == 3
    facts, _ = read_state(learner.state())
    assert (facts.started, facts.moved) == (1, 0)
    proposed = step_through(learner, [SAFE] * 3)
    same = (proposed == starts[1]).mean(axis=(1, 2))
    assert not (proposed == starts).all(axis=(1, 2)).any()
    assert same.sum() > 0.5


def test_without_a_failing_start_there_is_nothing_to_move():
    learner = make(steady(2.0, n=3), chains=3)
    with pytest.raises(LearnerFailed, match=r"None of the 2 failures .* fails here"):
        step_through(learner, [SAFE, SAFE, ERRORED])


def test_starts_that_could_not_be_run_are_tried_again():
    learner = make(steady(2.0, n=3), chains=3)
    starts = step_through(learner, [ERRORED] * 3)
    assert (step_through(learner, [COLLISION] * 3) == starts).all()


def test_moves_that_are_safe_or_errored_are_not_accepted():
    learner = make(steady(2.0, n=2), 60, chains=2, burn_in=0.0)
    step_through(learner, [COLLISION] * 2)
    step_through(learner, [SAFE, ERRORED])
    step_through(learner, [COLLISION, ERRORED])
    facts, trace = read_state(learner.state())
    assert (facts.moved, facts.tried, facts.accepted) == (2, 2, 1)
    assert (trace[0, 1] == trace[1, 1])[:2].all()
    assert (trace[0, 0] != trace[1, 0]).any()


def test_sizes_change_in_burn_in_only_and_samples_come_after_it():
    settings = ChainSettings(campaign=1, chains=4, burn_in=0.5)
    assert settings.count_moves(44) == (5, 10)
    assert settings.first_sample(44) == 24
    learner = make(steady(2.0, n=4), 44, chains=4, burn_in=0.5, redraw=2, pcn=2)
    sizes = []
    for _ in range(11):
        step_through(learner, [COLLISION] * 4)
        facts, trace = read_state(learner.state())
        sizes.append((facts.redraw, facts.pcn))
    assert len(set(sizes[:6])) > 2
    assert len(set(sizes[5:])) == 1
    assert trace.shape[:2] == (5, 4)
    assert facts.tried == facts.accepted == 20


@pytest.mark.parametrize(
    ("settings", "episodes", "words"),
    [
        (NO_MOVES, 400, r"settings.redraw: the weights of all kinds of moves are 0"),
        ({"chains": 50}, 400, r"episodes: 400 are fewer than 10 rounds of 50 chains"),
        ({"chains": 1}, 400, r"settings.chains"),
        ({"burn_in": 0.95}, 400, r"settings.burn_in"),
    ],
)
def test_settings_that_allow_no_chains_are_refused(settings, episodes, words):
    with pytest.raises(InvalidValue, match=words):
        read_settings(ChainSettings, {"campaign": 1} | settings, "settings").check_budget(episodes)


def test_a_campaign_without_failures_is_refused():
    with pytest.raises(InvalidValue, match="campaign 1 has no failure"):
        make(np.zeros((0, 5, 2)))


@pytest.mark.parametrize(
    ("channels", "names"),
    [
        (1, ["channel 1"]),
        (2, ["longitudinal", "lateral"]),
        (5, ["channel 1", "channel 2", "channel 3", "channel 4", "channel 5"]),
    ],
)
def test_the_noise_of_each_channel_is_watched(channels, names):
    z = np.random.default_rng(3).normal(size=(6, 20, channels)).astype(np.float32)
    directions = find_directions(z)
    found = dict(
        zip(
            directions.list_projections(),
            directions.measure(z, np.full(6, 20), np.full(6, 0.5)).T,
            strict=True,
        )
    )
    assert found["mean z²"] == pytest.approx(np.square(z).mean(axis=(1, 2)))
    for part in range(5):
        for channel, name in enumerate(names):
            watched = found[f"mean {name} noise in fifth {part + 1}"]
            own = z[:, 4 * part : 4 * part + 4, channel]
            assert watched == pytest.approx(own.sum(axis=1), abs=1e-5)


@pytest.mark.parametrize("names", [("bias",), ("gust", "drift"), ("x", "y", "z")])
def test_projections_get_the_names_of_a_functions_channels(names):
    z = np.random.default_rng(3).normal(size=(6, 20, len(names))).astype(np.float32)
    own = find_directions(z).list_projections()
    found = rename_channels(own, names)
    assert [name for name in found if name.endswith("in fifth 2")] == [
        f"mean {name} noise in fifth 2" for name in names
    ]
    assert found[:3] == own[:3]
    assert rename_channels(own, name_channels(len(names))) == own


def test_other_directions_of_the_noise_are_watched():
    facts, trace = read_state(make(steady(2.0)).state())
    assert trace.shape == (0, 5, len(facts.projections))
    assert "component 1 of the known failures" in facts.projections
    alike, _ = read_state(make(steady(2.0, n=1)).state())
    assert not any(name.startswith("component") for name in alike.projections)
