"""An ensemble keeps to the contract, and each of its members goes as it would alone."""

from types import MappingProxyType

import msgspec
import numpy as np
import pytest

from eigenfail import plugins
from eigenfail.contracts import Exploiter
from eigenfail.errors import InvalidValue, ProtocolError, UnknownName
from eigenfail.settings import read_settings
from eigenfail.testing.learner import Corridor, LearnerSuite, ToyEngine
from eigenfail.values.episode import Outcome, PolicySource, TrajectorySource, learner_seed
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import Layer, LearnerContext, Policy, Proposal
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods.cem import CrossEntropyMethod
from eigenfail_services.methods.ensemble import Ensemble, make_member_seed

CORRIDOR = Corridor()
AST = {"round_size": 4, "warm_up": 4, "buffer_size": 70, "gradient_steps": 2}
CEM = {"batch": 5, "elite_share": 0.3}


class TestEnsembleOfAst(LearnerSuite):
    method = Ensemble
    settings = MappingProxyType({"members": 2, "settings": AST})
    rounds = 5


class TestEnsembleOfCem(LearnerSuite):
    method = Ensemble
    settings = MappingProxyType({"method": "cem", "members": 3, "settings": CEM})
    rounds = 5


class TestEnsembleThatPassesOverWhoHasEnded(LearnerSuite):
    """Each member replays its 40 trajectories once."""

    method = Ensemble
    settings = MappingProxyType({"method": "replay", "members": 2, "settings": {"round_size": 6}})
    budget = 40


class TestEnsembleThatJudgesItsMembers(LearnerSuite):
    method = Ensemble
    settings = MappingProxyType({"members": 2, "settings": AST, "judged": 14})
    rounds = 8
    budget = 40


def context(episodes=40, seed=7):
    nothing = np.zeros((0, CORRIDOR.steps, 2), np.float32)
    return LearnerContext(seed, episodes, CORRIDOR.steps, nothing)


def ensemble(episodes=40, seed=7, **settings):
    return Ensemble(context(episodes, seed), read_settings(Ensemble.Settings, settings, "settings"))


def course(learner, episodes):
    """The rounds of a campaign, each with its results."""
    rounds, engine = Rounds(learner, 1, episodes), ToyEngine(CORRIDOR)
    while opened := rounds.open():
        if opened[0].policy:
            engine.add_policy(opened[0].policy)
        results = list(engine.run(opened[0].tasks))
        yield opened[0], results
        rounds.complete(results)


class Scripted:
    """Proposes rounds of the sizes in the script of its campaign, and remembers what it saw."""

    class Settings(msgspec.Struct):
        pass

    lookahead = 0

    def __init__(self, context, made, sizes):
        self.context = context
        self.made = made
        self.sizes = list(sizes)
        self.open = 0
        self.most_open = 0
        self.seen = []
        self.made.append(self)

    def propose(self, n):
        size = min(n, self.sizes.pop(0)) if self.sizes else 0
        self.open += bool(size)
        self.most_open = max(self.most_open, self.open)
        mark = np.full((CORRIDOR.steps, 2), self.made.index(self), np.float32)
        return Proposal((TrajectorySource(mark),) * size)

    def observe(self, results):
        self.open -= 1
        self.seen.append([(result.index, result.noise.z[0, 0]) for result in results])


class Scripts:
    """A method that makes a learner for each script, one after the other."""

    Settings = Scripted.Settings

    def __init__(self, kind, scripts, lookahead):
        self.kind = kind
        self.scripts = scripts
        self.lookahead = lookahead
        self.made = []

    def __call__(self, context, settings):
        one = self.kind(context, self.made, self.scripts[len(self.made)])
        one.lookahead = self.lookahead
        return one


@pytest.fixture
def scripted(monkeypatch):
    def make(*scripts, lookahead=0, episodes=1000, kind=Scripted):
        method = Scripts(kind, scripts, lookahead)
        monkeypatch.setattr(plugins, "load", lambda group, name: method)
        return ensemble(episodes, method="monte_carlo", members=len(scripts)), method.made

    return make


@pytest.mark.parametrize("lookahead", [0, 1, 2])
def test_rounds_go_round_and_come_back_to_who_proposed_them(scripted, lookahead):
    learner, members = scripted((1, 1, 1, 1), (2,), (3, 3), lookahead=lookahead)
    sizes = [len(round_.tasks) for round_, _ in course(learner, 1000)]
    assert sizes == [1, 2, 3, 1, 3, 1, 1]
    for number, one in enumerate(members):
        assert {mark for seen in one.seen for _, mark in seen} == {number}
        assert one.most_open <= lookahead + 1
        assert one.open == 0
    assert [len(seen) for seen in members[2].seen] == [3, 3]


def test_who_has_proposed_nothing_once_is_not_asked_again(scripted):
    learner, members = scripted((1, 0, 5), (1, 1, 1))
    assert [len(round_.tasks) for round_, _ in course(learner, 1000)] == [1, 1, 1, 1]
    assert members[0].sizes == [5]


def test_members_share_the_episodes_evenly_and_spend_them_all(scripted):
    learner, members = scripted((100,), (100,), (100,), episodes=11)
    results = [result for _, results in course(learner, 11) for result in results]
    assert [one.context.episodes for one in members] == [4, 4, 3]
    assert [len(one.seen[0]) for one in members] == [4, 4, 3]
    assert [result.index for result in results] == list(range(11))


def test_each_member_finds_what_it_would_find_alone():
    """CEM draws trajectories: what comes of them is the same wherever they are run."""
    settings = read_settings(CrossEntropyMethod.Settings, CEM, "settings")
    found = {0: [], 1: []}
    for number, (round_, _) in enumerate(
        course(ensemble(60, method="cem", members=2, settings=CEM), 60)
    ):
        found[number % 2].append([task.source.z for task in round_.tasks])
    for number in (0, 1):
        own = msgspec.structs.replace(context(30), seed=make_member_seed(7, number))
        alone = course(CrossEntropyMethod(own, settings), 30)
        drawn = [[task.source.z for task in round_.tasks] for round_, _ in alone]
        np.testing.assert_array_equal(drawn, found[number])


def test_members_draw_from_seeds_of_their_own():
    seeds = {make_member_seed(seed, number) for seed in range(20) for number in range(16)}
    assert len(seeds) == 320
    assert make_member_seed(3, 5) == make_member_seed(3, 5)


def test_policies_are_numbered_by_round_and_differ_from_member_to_member():
    settings = {**AST, "warm_up": 60}
    rounds = [round_ for round_, _ in course(ensemble(40, members=2, settings=settings), 40)]
    versions = [round_.policy.version for round_ in rounds]
    assert versions == list(range(len(rounds)))
    assert all(task.source == PolicySource(r.policy.version) for r in rounds for task in r.tasks)
    first, second, third = (round_.policy.mean.weight for round_ in rounds[:3])
    assert not np.array_equal(first, second)
    assert np.array_equal(first, third)  # untrained: its warm-up is not over


class Forgetful(Scripted):
    """Sends its policy with its first proposal alone, as learners may."""

    def propose(self, n):
        plain = super().propose(n)
        layer = Layer(np.full((2, 6), self.made.index(self), np.float32), np.zeros(2, np.float32))
        policy = Policy(0, (), layer, layer, 3.0, 5) if len(self.sizes) == 2 else None
        return Proposal((PolicySource(0),) * len(plain.sources), policy)

    def state(self):
        return msgspec.json.encode(self.sizes)

    def restore(self, state):
        self.sizes = msgspec.json.decode(state)


def test_a_member_that_sends_its_policy_once_keeps_it_also_over_a_restart(scripted):
    learner, _ = scripted((1, 1, 1), (1, 1, 1), kind=Forgetful)
    another, _ = scripted((), (), kind=Forgetful)
    before = [learner.propose(20) for _ in range(3)]
    another.restore(learner.state())
    after = [another.propose(20) for _ in range(2)]
    assert [p.policy.mean.weight[0, 0] for p in before + after] == [0, 1, 0, 1, 0]
    assert [p.sources for p in before + after] == [(PolicySource(i),) for i in range(5)]


def test_it_exploits_one_member_after_the_other_as_many_episodes_as_asked():
    learner = ensemble(method="cem", members=2, settings=CEM)
    for _ in range(4):
        learner.observe(results_of(learner.propose(40)))
    assert isinstance(learner, Exploiter)
    drawn = [learner.exploit(300) for _ in range(3)]
    means = [np.mean([source.z for source in one.sources], axis=0) for one in drawn]
    wanted = [one.proposal.mean for one in learner._members]
    assert [len(one.sources) for one in drawn] == [300, 300, 300]
    for number, mean in enumerate(means):
        assert np.abs(mean - wanted[number % 2]).max() < 0.25
    assert np.abs(wanted[0] - wanted[1]).max() > 0.5


class Judged(Scripted):
    """Exploits noise that tells the member, and remembers what it had seen by then."""

    def __init__(self, context, made, sizes):
        super().__init__(context, made, sizes)
        self.known = []

    def exploit(self, n):
        self.known.append(sum(map(len, self.seen)))
        mark = np.full((CORRIDOR.steps, 2), 10 + self.made.index(self), np.float32)
        return Proposal((TrajectorySource(mark),) * n)


@pytest.fixture
def judged(monkeypatch):
    def make(*scripts, judged, lookahead=0, episodes=1000):
        method = Scripts(Judged, scripts, lookahead)
        method.exploit = None
        monkeypatch.setattr(plugins, "load", lambda group, name: method)
        settings = {"method": "cem", "members": len(scripts), "judged": judged}
        return ensemble(episodes, **settings), method.made

    return make


def end_with(failures, z):
    """What a member's episodes come to, by member: how many fail, and how large their noise is."""

    def end(results):
        one = int(results[0].noise.z[0, 0]) - 10
        noise = np.full((CORRIDOR.steps, 2), z[one], np.float32)
        return [
            msgspec.structs.replace(
                result,
                noise=msgspec.structs.replace(result.noise, z=noise),
                outcome=Outcome.COLLISION if i < failures[one] else Outcome.SAFE,
            )
            for i, result in enumerate(results)
        ]

    return end


def judge_members(learner, episodes, end):
    """Run a campaign whose judged episodes end as told; the sizes of its rounds."""
    rounds, engine = Rounds(learner, 1, episodes), ToyEngine(CORRIDOR)
    sizes = []
    while opened := rounds.open():
        results = list(engine.run(opened[0].tasks))
        sizes.append(len(results))
        is_judged = results[0].noise.z[0, 0] >= 10
        rounds.complete(end(results) if is_judged else results)
    return sizes


@pytest.mark.parametrize("lookahead", [0, 1, 2])
def test_members_are_judged_after_all_of_their_rounds_in_equal_shares(judged, lookahead):
    learner, members = judged((4, 9), (5, 9), judged=7, lookahead=lookahead, episodes=27)
    end = end_with((1, 2), (2.0, 2.0))
    assert judge_members(learner, 27, end) == [4, 5, 6, 5, 4, 3]
    assert [one.known for one in members] == [[10], [10]]
    assert [sum(map(len, one.seen)) for one in members] == [10, 10]


@pytest.mark.parametrize(
    ("failures", "z", "best"),
    [
        ((3, 5, 4), (0.0, 3.0, 0.0), 1),
        ((3, 5, 5), (0.0, 3.0, 1.0), 2),
        ((0, 0, 1), (0.0, 0.0, 9.0), 2),
        ((0, 0, 0), (0.0, 0.0, 0.0), 0),
    ],
)
def test_the_member_with_most_failures_is_used_then_the_one_with_likelier_ones(
    judged, failures, z, best
):
    learner, _ = judged((2,), (2,), (2,), judged=18, episodes=24)
    judge_members(learner, 24, end_with(failures, z))
    marks = [learner.exploit(4).sources[0].z[0, 0] for _ in range(3)]
    assert marks == [10 + best] * 3


def test_a_member_that_was_judged_in_one_episode_more_has_no_advantage(judged):
    learner, _ = judged((2,), (2,), judged=5, episodes=9)
    judge_members(learner, 9, end_with((2, 2), (0.0, 3.0)))
    assert learner.exploit(1).sources[0].z[0, 0] == 11


def results_of(proposal):
    _, results = next(course(Given(proposal), len(proposal.sources)))
    return results


class Given:
    lookahead = 0

    def __init__(self, proposal):
        self.proposal = proposal

    def propose(self, n):
        return self.proposal


def test_what_no_member_can_do_the_ensemble_cannot_either():
    learner = ensemble(method="monte_carlo", members=2)
    assert not isinstance(learner, Exploiter)
    assert learner.estimate() is None


def test_estimates_are_pooled_once_every_member_has_one(scripted):
    learner, members = scripted((1,), (1,))
    estimates = [None, Estimate(by="subset simulation", episodes=10, probability=0.2)]
    for one, number in zip(members, (0, 1), strict=True):
        one.estimate = lambda number=number: estimates[number]
    assert learner.estimate() is None
    estimates[0] = Estimate(by="subset simulation", episodes=30, probability=0.4)
    assert learner.estimate() == Estimate(
        by="subset simulation", episodes=40, probability=pytest.approx(0.35)
    )


@pytest.mark.parametrize(
    ("settings", "error", "text"),
    [
        ({"members": 1}, InvalidValue, "settings.members"),
        ({"members": 17}, InvalidValue, "settings.members"),
        ({"method": "atr"}, UnknownName, "settings.method: 'atr'.*Did you mean 'ast'"),
        ({"settings": {"tau": 0.0}}, InvalidValue, "settings.settings.tau"),
        ({"settings": {"tua": 0.1}}, UnknownName, "settings.settings: 'tua'"),
        ({"method": "ensemble"}, InvalidValue, "settings.method: .*no ensembles"),
        ({"judged": 3}, InvalidValue, "settings.judged: 3 episodes do not judge each of 4"),
        ({"method": "subset", "judged": 80}, InvalidValue, "settings.judged: subset learns"),
    ],
)
def test_settings_that_cannot_be_are_refused_where_they_stand(settings, error, text):
    with pytest.raises(error, match=text):
        read_settings(Ensemble.Settings, settings, "settings")


def test_members_tell_together_how_many_episodes_they_were_trained_with():
    quick = {"warm_up": 4, "round_size": 4, "gradient_steps": 1, "buffer_size": 70}
    context = LearnerContext(learner_seed(1), 40, 40, np.zeros((0, 40, 2), np.float32))
    both = (("ast", quick), ("monte_carlo", {}))
    ast, plain = (
        Ensemble(context, Ensemble.Settings(method=name, members=2, settings=settings))
        for name, settings in both
    )
    rounds = Rounds(ast, 1, 40)
    list(run_in_process(rounds, ToyEngine(Corridor())))
    assert rounds.trained_episodes() == sum(one.trained_episodes for one in ast._members) == 40
    assert Rounds(plain, 1, 40).trained_episodes() is None
    assert Rounds(plain._members[0], 1, 40).trained_episodes() is None


def test_judging_takes_no_episode_that_a_member_needs():
    settings = read_settings(Ensemble.Settings, {"members": 2, "judged": 30}, "settings")
    assert settings.divide_training(61) == [16, 15]
    with pytest.raises(InvalidValue, match=r"2 members cannot share 1 episodes"):
        settings.divide_training(31)
    with pytest.raises(InvalidValue, match=r"judging takes 30 of 30 episodes, and leaves none"):
        settings.check_budget(30)


def test_a_campaign_that_stops_before_all_are_judged_uses_its_members_in_turn(judged):
    learner, _ = judged((2,), (2,), judged=8, episodes=12)
    rounds, engine = Rounds(learner, 1, 12), ToyEngine(CORRIDOR)
    for _ in range(3):
        rounds.complete(list(engine.run(rounds.open()[0].tasks)))
    marks = [learner.exploit(1).sources[0].z[0, 0] for _ in range(4)]
    assert sorted(set(marks)) == [10, 11]


def test_a_state_of_another_number_of_members_or_of_another_method_is_refused():
    learner = ensemble(method="cem", members=2)
    state = learner.state()
    with pytest.raises(ProtocolError, match="they are of 2 members, not 3"):
        ensemble(method="cem", members=3).restore(state)
    with pytest.raises(ProtocolError, match="not a state of ast"):
        ensemble(members=2).restore(state)
