"""How late a stop rule may come, in words that are true of the learner."""

import numpy as np
import pytest
from resolved import resolve_campaign

from eigenfail import plugins
from eigenfail.settings import read_settings
from eigenfail.values.campaign_spec import CampaignSpec, StopRules
from eigenfail.values.learning import LearnerContext, RoundSizes
from eigenfail_services.campaigns.rounds import Rounds
from eigenfail_services.campaigns.validation import (
    RoundPace,
    describe_stop_rules,
    find_pace,
)

TEN = StopRules(failures=10)


def spec(searching="monte_carlo", /, episodes=1000, stop=TEN, **settings):
    fields = {"name": "n", "method": searching, "episodes": episodes, "stop": stop}
    return CampaignSpec(**fields, settings=settings)


def note(*given, **more):
    return " ".join(describe_stop_rules(resolve_campaign(spec(*given, **more))))


def test_a_rule_says_how_many_episodes_may_follow_it():
    assert note() == (
        "The rule failures = 10 is judged after whole rounds, of 100 episodes here: once it holds, "
        "up to 199 more are run, as the next round is open by then."
    )
    assert "of 20 episodes here: once it holds, up to 19 more are run." in note("cem")


def test_a_budget_of_one_round_ends_nothing_early():
    assert note(episodes=200) == (
        "The rule failures = 10 is judged after whole rounds, and two rounds, which are open "
        "together, hold all of the budget: nothing ends early. Give it more episodes, or a smaller "
        "settings.round_size."
    )
    words = note("cem", episodes=20)
    assert "one round holds all of the budget" in words
    assert "settings.batch" in words


@pytest.mark.parametrize(
    ("stop", "told"),
    [
        (StopRules(half_width=0.01, failures=3), "The rules failures = 3, half_width = 0.01 are"),
        (StopRules(wall_s=3.0, cost_usd=1.0), ""),
        (StopRules(), ""),
        (StopRules(failures=3, wall_s=3.0), "The rule failures = 3 is"),
    ],
)
def test_rules_on_time_are_not_of_rounds(stop, told):
    assert told in note(stop=stop)
    assert bool(note(stop=stop)) == bool(told)


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        (spec(round_size=7), RoundPace(7, 7, 1, "settings.round_size")),
        (spec("ast"), RoundPace(10, 10, 1, "settings.round_size")),
        (spec("difs"), RoundPace(67, 67, 0, "settings.round_size")),
        (spec("difs", final_share=0.3), RoundPace(67, 300, 0, "settings.round_size")),
        (
            spec("ensemble", method="cem", members=2, settings={"batch": 5}),
            RoundPace(5, 5, 0, "settings.settings.batch"),
        ),
        (
            spec("ensemble", method="difs", members=2),
            RoundPace(40, 40, 0, "settings.settings.round_size"),
        ),
    ],
    ids=lambda given: getattr(given, "method", ""),
)
def test_rounds_are_as_large_as_settings_say(given, wanted):
    assert find_pace(resolve_campaign(given)) == wanted


@pytest.mark.parametrize("method", ["monte_carlo", "cem", "ast"])
def test_the_learner_keeps_that_pace(method):
    given = spec(method)
    pace, kind = find_pace(resolve_campaign(given)), plugins.load(plugins.METHODS, method)
    nothing = np.zeros((0, 5, 2), np.float32)
    context = LearnerContext(horizon=5, episodes=1000, seed=0, trajectories=nothing)
    learner = kind(context, read_settings(kind.Settings, given.settings, ""))
    opened = Rounds(learner, 0, given.episodes, TEN).open()
    assert [len(each.tasks) for each in opened] == [pace.first, pace.later][: 1 + pace.ahead]


def add_method(monkeypatch, strange):
    """Have every name of a method stand for a class."""
    load = plugins.load
    monkeypatch.setattr(
        plugins,
        "load",
        lambda group, name: strange if group == plugins.METHODS else load(group, name),
    )


def test_of_a_method_that_does_not_say_the_words_are_general(monkeypatch):
    class Strange:
        class Settings(StopRules):
            pass

    add_method(monkeypatch, Strange)
    assert "as large as the method makes them" in note("strange")


def test_a_strangers_method_may_say_how_large_its_rounds_are(monkeypatch):
    class Strange:
        class Settings(StopRules):
            pass

        lookahead = 0

        @staticmethod
        def round_sizes(_settings, episodes, /):
            return RoundSizes(episodes // 10, 30, "swarm")

    add_method(monkeypatch, Strange)
    assert find_pace(resolve_campaign(spec("strange"))) == RoundPace(100, 30, 0, "settings.swarm")
