"""The method `splitting`: what it prints, and what it refuses to print."""

import msgspec
import numpy as np
import pytest

from eigenfail.errors import InvalidValue, LearnerFailed, ProtocolError
from eigenfail.testing.learner import Corridor, ToyEngine
from eigenfail.values.episode import EpisodeTask, Importance
from eigenfail.values.learning import LearnerContext
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods import archive
from eigenfail_services.methods.splitting import MultilevelSplitting, SplittingSettings
from eigenfail_services.statistics.multilevel_splitting import pool_runs

CORRIDOR = Corridor(steps=30, gain=0.1, wall=0.9)
NOTHING = np.zeros((0, CORRIDOR.steps, 2), np.float32)


def make_learner(seed=0, episodes=3200, **settings):
    context = LearnerContext(seed, episodes, CORRIDOR.steps, NOTHING)
    return MultilevelSplitting(context, SplittingSettings(**settings))


def run(seed, episodes=3200, engine=None, **settings):
    rounds = Rounds(make_learner(seed, episodes, **settings), seed, episodes)
    count = sum(1 for _ in run_in_process(rounds, engine or ToyEngine(CORRIDOR)))
    return rounds.estimate(), count


class ForgetfulEngine(ToyEngine):
    """Runs each episode with noise of its own, whatever noise it is given."""

    def _noise(self, task, random, states):
        return random.standard_normal((len(states), 2), np.float32)


class DeafEngine(ToyEngine):
    """Returns no importance."""

    def run(self, tasks):
        return super().run([EpisodeTask(t.index, t.seed, strip(t.source)) for t in tasks])


def strip(source):
    return type(source)(source.z)


def test_its_interval_holds_the_probability_at_a_fraction_of_the_budget():
    rng = np.random.default_rng(4)
    draws = [rng.standard_normal((50_000, CORRIDOR.steps, 2)) for _ in range(8)]
    counted = sum(int((CORRIDOR.course(z).max(axis=1) >= CORRIDOR.wall).sum()) for z in draws)
    truth = counted / 400_000
    assert 40 <= counted <= 400
    found = [run(seed)[0] for seed in range(12)]
    held = sum(one.interval.low <= truth <= one.interval.high for one in found)
    # Of 12 intervals of 95 %, 3 or more miss by chance once in 50 tests, 4 once in 450.
    assert held >= 9
    mean = np.mean([one.probability for one in found])
    assert 0.75 < mean / truth < 1.3
    assert np.std([one.probability for one in found]) / mean < 0.5


def test_it_stops_where_all_runs_have_reached_failures():
    estimate, count = run(3)
    assert estimate.by == "multilevel splitting"
    assert estimate.bound is None
    assert count == estimate.episodes < 3200
    assert "Mean of 10 independent runs" in estimate.note
    assert f"worth {estimate.effective:.1f} independent ones" in estimate.note


def test_before_the_end_it_says_what_is_missing():
    learner = make_learner()
    assert "0 of 10 runs have reached failures" in learner.estimate().problem


def test_a_budget_that_ends_before_the_runs_gives_no_number():
    estimate, count = run(3, 900, particles=60)
    assert count == 900
    assert estimate.probability is None
    assert "give more episodes" in estimate.problem


def test_runs_that_died_out_count_as_0_and_are_named():
    rare = ToyEngine(Corridor(steps=30, gain=0.1, wall=1.1))
    found = [run(seed, particles=20, engine=rare)[0] for seed in range(3)]
    by_splitting = [one for one in found if one.by == "multilevel splitting"]
    assert any("died out" in one.note or "died out" in one.problem for one in by_splitting)


class MisledEngine(ToyEngine):
    """Returns an importance that only falls: no continuation comes higher than its parent."""

    def run(self, tasks):
        for result in super().run(tasks):
            falling = -np.arange(result.steps, dtype=np.float32)
            told = None if result.importance is None else falling
            yield msgspec.structs.replace(result, importance=told)


def test_where_all_runs_died_out_more_episodes_are_no_advice_and_the_rest_is_drawn_plainly():
    estimate, count = run(3, engine=MisledEngine(CORRIDOR))
    assert count == estimate.episodes == 3200
    words = estimate.problem or estimate.note
    assert "All 10 runs died out, each with 20 episodes" in words
    assert "take another `importance`, or method subset or monte_carlo" in words
    assert "Give it more episodes" not in words
    assert "3000 episodes that were left" in words


def test_plain_draws_after_a_refusal_are_an_estimate_with_an_exact_interval():
    often = Corridor(steps=30, gain=0.1, wall=0.75)
    estimate, _ = run(3, engine=MisledEngine(often))
    assert (estimate.by, estimate.problem, estimate.bound) == ("Monte Carlo", "", None)
    rng = np.random.default_rng(4)
    z = rng.standard_normal((50_000, often.steps, 2))
    truth = float((often.course(z).max(axis=1) >= often.wall).mean())
    assert estimate.interval.low <= truth <= estimate.interval.high
    left = int(estimate.note.split(" among the ")[1].split()[0])
    failures = estimate.probability * left
    assert failures == pytest.approx(round(failures))
    assert estimate.cv == pytest.approx(np.sqrt((1.0 - estimate.probability) / failures))
    assert "Multilevel splitting gave no number. " in estimate.note


def test_plain_draws_without_a_failure_bound_the_probability_in_words():
    never = ToyEngine(Corridor(steps=30, gain=0.1, wall=9.0))
    misled = MisledEngine(Corridor(steps=30, gain=0.1, wall=9.0))
    for engine in (never, misled):
        estimate, _ = run(3, engine=engine, particles=20)
        assert (estimate.probability, estimate.interval) == (None, None)
    bound = 1.0 - 0.05 ** (1.0 / 3000)
    assert f"failed: P is at most {bound:.1e} with 95 % confidence" in estimate.problem


def test_a_simulation_that_does_not_repeat_itself_is_left_for_plain_draws():
    estimate, count = run(3, engine=ForgetfulEngine(CORRIDOR))
    words = estimate.problem + estimate.note
    assert "did not repeat the course" in words
    assert "subset" in words
    assert estimate.by == "Monte Carlo" or estimate.probability is None
    assert count == 3200


def test_plain_draws_go_on_from_a_state():
    engine = MisledEngine(CORRIDOR, faulty=(600, 2000))
    one, first = make_learner(5, round_size=70), 0

    def advance(learner, at):
        sources = learner.propose(3200).sources
        tasks = [EpisodeTask(at + i, at + i, source) for i, source in enumerate(sources)]
        learner.observe(list(engine.run(tasks)))
        return at + len(tasks)

    while first < 1500:
        first = advance(one, first)
    other = make_learner(5, round_size=70)
    other.restore(one.state())
    assert other.state() == one.state()
    left = first
    while (now := advance(one, first)) > first:
        assert advance(other, left) == now
        first = left = now
    assert first == 3200
    assert other.estimate() == one.estimate()


def test_few_families_are_refused_with_their_number():
    learner = make_learner()
    large_and_small = [np.array([1.0, 0.0]), *[np.array([0.0, 0.1])] * 5, *[np.zeros(2)] * 4]
    problem = learner._explain_doubt(pool_runs(large_and_small))
    assert problem.startswith("The failures descend from few of the first episodes: they are worth")
    assert "worth 2.1 independent ones, and 2.5 are needed" in problem
    assert learner._explain_doubt(pool_runs([np.array([1.0])] * 10)) == ""


def test_a_state_with_families_that_do_not_exist_is_refused():
    learner = make_learner()
    facts, arrays = archive.read("splitting", learner.state(), MultilevelSplitting._Facts)
    arrays["families"][0, 0] = 999
    with pytest.raises(ProtocolError, match="descends from none of the first ones"):
        make_learner().restore(archive.write("splitting", facts, arrays))


def test_errored_episodes_make_the_estimate_a_lower_bound():
    estimate, count = run(3, engine=ToyEngine(CORRIDOR, faulty=range(0, 400, 50)))
    assert estimate.episodes == count - 8
    bounded = estimate.bound_below(8)
    assert bounded.note.startswith("8 episodes errored and may hide failures")
    assert (bounded.bound, bounded.interval) == ("lower", None)
    assert estimate.bound_below(0) == estimate


def test_workers_without_importance_are_refused():
    with pytest.raises(LearnerFailed, match="Episode 0 came without the importance"):
        run(3, engine=DeafEngine(CORRIDOR))


def test_it_asks_for_its_importance():
    sources = make_learner(importance=Importance.DISTANCE).propose(5).sources
    assert {one.importance for one in sources} == {Importance.DISTANCE}


def test_a_budget_that_is_too_small_is_refused():
    with pytest.raises(InvalidValue, match="they take 3200"):
        make_learner(episodes=3199)
    with pytest.raises(InvalidValue, match="they take 1600"):
        make_learner(episodes=1599, runs=5)
    with pytest.raises(InvalidValue, match="they take 16000"):
        make_learner(episodes=999, particles=100)


def test_particles_follow_from_the_budget():
    assert SplittingSettings().choose_particles(16_000) == 100
    assert SplittingSettings(particles=30).choose_particles(16_000) == 30


def test_a_state_that_does_not_fit_is_refused():
    with pytest.raises(ProtocolError, match="should have shape"):
        make_learner(runs=5, particles=30).restore(make_learner(runs=6, particles=30).state())
    with pytest.raises(ProtocolError):
        make_learner().restore(archive.write("splitting", SplittingSettings(), {}))
