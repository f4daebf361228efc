"""Stop rules on results: judged at whole rounds, the same whoever runs them, said in words."""

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eigenfail.values.campaign_spec import StopRules
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeFault, EpisodeResult, Outcome, PriorSource, unrunnable
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import Proposal
from eigenfail.values.measures import Measures
from eigenfail_services.campaigns.rounds import Rounds, Tally, judge_results, judge_time
from eigenfail_services.statistics.intervals import bound_sequence, confidence_sequence


class Steady:
    """Proposes rounds of one size; its estimate gets better with every round."""

    def __init__(self, size, lookahead=0, rounds=10_000):
        self.size, self.lookahead, self.left, self.seen = size, lookahead, rounds, 0

    def propose(self, n):
        self.left -= 1
        return Proposal((PriorSource(),) * (min(n, self.size) if self.left >= 0 else 0))

    def observe(self, results):
        self.seen += 1

    def estimate(self):
        return Estimate(by="test", episodes=self.seen, probability=0.1, cv=1.0 / self.seen)

    def state(self):
        return msgspec.json.encode([self.left, self.seen])

    def restore(self, state):
        self.left, self.seen = msgspec.json.decode(state)


def result(task, collides):
    nothing = np.zeros((1, 2), np.float32)
    outcome = Outcome.COLLISION if collides(task.index) else Outcome.SAFE
    return EpisodeResult(
        task.index, task.seed, outcome, 1, NoiseTrajectory(nothing, nothing), "prior"
    )


def run(rounds, collides):
    """The indices of all episodes that were run."""
    indices = []
    while opened := rounds.open():
        indices += [task.index for task in opened[0].tasks]
        rounds.complete([result(task, collides) for task in opened[0].tasks])
    assert rounds.stopped_because
    return indices


def every_third(index):
    return index % 3 == 2


@pytest.mark.parametrize("lookahead", [1, 3])
def test_no_round_is_proposed_after_the_rule_and_the_open_one_is_finished(lookahead):
    rounds = Rounds(Steady(4, lookahead), 0, 400, StopRules(failures=2))
    assert run(rounds, every_third) == list(range(12))  # 2 in episodes 0 … 7, then 8 … 11
    words = "2 failures were found (rule: failures = 2). The round that was open was finished."
    assert rounds.stopped_because == words


@pytest.mark.parametrize(("rules", "opened"), [(StopRules(), 4), (StopRules(wall_s=1.0), 4)])
def test_rules_on_time_leave_the_lookahead_alone(rules, opened):
    assert len(Rounds(Steady(3, lookahead=3), 0, 400, rules).open()) == opened


@pytest.mark.parametrize(
    ("learner", "because"),
    [
        (Steady(5), "The budget of 12 episodes was spent."),
        (Steady(5, rounds=2), "The method had no more to propose."),
    ],
)
def test_without_a_rule_that_holds_the_end_is_told_all_the_same(learner, because):
    rounds = Rounds(learner, 0, 12, StopRules(failures=100))
    assert rounds.stopped_because == ""
    run(rounds, every_third)
    assert rounds.stopped_because == because


def test_a_rule_that_holds_only_with_the_last_episode_stopped_nothing():
    rounds = Rounds(Steady(6, lookahead=1), 0, 12, StopRules(failures=4))
    assert len(run(rounds, every_third)) == 12
    assert rounds.stopped_because == "The budget of 12 episodes was spent."


def test_an_interval_that_is_narrow_enough_stops_at_the_first_such_round():
    rounds = Rounds(Steady(10), 0, 1000, StopRules(half_width=0.1))
    episodes = len(run(rounds, every_third))

    def half_width(n):
        interval = confidence_sequence(sum(map(every_third, range(n))), n)
        return (interval.high - interval.low) / 2.0

    assert half_width(episodes) <= 0.1 < half_width(episodes - 10)
    known = f"known to ± {half_width(episodes):.4g} (rule: half_width = 0.1)."
    assert rounds.stopped_because == f"The failure rate is {known}"


def test_doubtful_episodes_widen_the_interval_that_stops():
    rules = StopRules(half_width=0.1)
    # 30 of 300 failed: alone they are known to ± 0.05, which 60 errored episodes hide.
    assert judge_results(rules, Tally(300, 30), None)
    for tally in (Tally(300, 30, errored=60), Tally(300, 30, unresolved=60)):
        trials = tally.completed + tally.errored
        shown = bound_sequence(30, trials, 60)
        assert tally.half_width() == (shown.high - shown.low) / 2.0
        assert judge_results(rules, tally, None) == ""


def test_tally_counts_errored_and_unresolved_episodes():
    tasks = Rounds(Steady(4), 0, 4).open()[0].tasks
    hopeless = Measures(1.0, max_drac_mps2=9.0, final_drac_mps2=9.0)
    ended = [result(task, lambda index: index == 0) for task in tasks[:3]]
    ended[2] = msgspec.structs.replace(ended[2], measures=hopeless)
    errored = unrunnable(tasks[3], EpisodeFault("simulator", "test"))
    assert Tally().after([*ended, errored]) == Tally(3, 1, errored=1, unresolved=1)


def test_an_estimate_that_is_sure_enough_stops():
    rounds = Rounds(Steady(2), 0, 100, StopRules(cv=0.25))
    assert len(run(rounds, every_third)) == 8
    words = "The failure probability has a coefficient of variation of 0.25 (rule: cv = 0.25)."
    assert rounds.stopped_because == words


@pytest.mark.parametrize("estimate", [None, Estimate(by="t", episodes=9, problem="too few")])
def test_without_an_estimate_nobody_is_sure(estimate):
    assert judge_results(StopRules(cv=0.5), Tally(9, 3), estimate) == ""


def test_episodes_that_could_not_be_run_count_for_nothing():
    tasks = Rounds(Steady(3), 0, 3).open()[0].tasks
    failed = [unrunnable(task, EpisodeFault("simulator", "test")) for task in tasks]
    tally = Tally().after(failed)
    assert tally == Tally(0, 0, errored=len(failed))
    assert judge_results(StopRules(half_width=0.4, failures=1), tally, None) == ""


RULES = st.one_of(
    st.builds(lambda n: StopRules(failures=n), st.integers(1, 30)),
    st.builds(lambda w: StopRules(half_width=w), st.floats(0.05, 0.4)),
    st.builds(lambda cv: StopRules(cv=cv), st.floats(0.05, 0.9)),
)


@settings(deadline=None, max_examples=50)
@given(RULES, st.integers(1, 7), st.integers(0, 3), st.sets(st.integers(0, 79)), st.integers(0, 12))
def test_a_restored_campaign_stops_at_the_same_episode_in_the_same_words(
    rules, size, lookahead, failures, interrupted
):
    def born():
        return Rounds(Steady(size, lookahead), 0, 80, rules)

    whole, first, second = born(), born(), born()
    episodes = run(whole, failures.__contains__)
    begun = []
    while len(begun) < interrupted and (opened := first.open()):
        begun += [task.index for task in opened[0].tasks]
        first.complete([result(task, failures.__contains__) for task in opened[0].tasks])
    second.restore(first.checkpoint())
    assert begun + run(second, failures.__contains__) == episodes
    assert second.stopped_because == whole.stopped_because != ""


def test_a_checkpoint_from_before_there_were_rules_is_read():
    rounds = Rounds(Steady(4), 0, 8)
    rounds.open()
    old = msgspec.msgpack.decode(rounds.checkpoint()) | {"format": 1}
    del old["tally"], old["stopped"]
    again = Rounds(Steady(4), 0, 8)
    again.restore(msgspec.msgpack.encode(old))
    assert run(again, every_third) == list(range(8))


def test_time_and_cost_are_judged_in_words_too():
    rules = StopRules(wall_s=60.0, cost_usd=0.5)
    assert judge_time(rules, 59.9, 0.49) == ""
    assert judge_time(rules, 61.23, 0.1) == "It ran for 61.23 s (rule: wall_s = 60.0)."
    assert judge_time(rules, 1.0, 0.5) == "It cost 0.5 USD (rule: cost_usd = 0.5)."
    assert judge_time(StopRules(), 1e9, 1e9) == ""
