"""`eigenfail episode explain`: the verdict, the table, the story."""

import json

import numpy as np
import pytest
from accepted import accept_spec

from eigenfail import plugins, replays
from eigenfail.errors import InvalidValue
from eigenfail.explanations import tell_story
from eigenfail.values import episode
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.measures import Measures
from eigenfail.values.proof import ExplainedEpisode, ExplainedStep
from eigenfail.values.records import Delivery

SIGN = np.where((np.arange(100) // 20) % 2 == 0, 2.0, -2.0)
WAVE = np.stack([SIGN, 0.0 * SIGN], axis=1).astype(np.float32)
NOTHING = np.zeros((0, 2), np.float32)
LATER = ("--from", 2, "--every", 20)


@pytest.fixture
def crash(store):
    """The id of a stored collision of the rulebook planner, index 3 of its campaign."""
    spec = CampaignSpec(name="wave", method="monte_carlo", episodes=9)
    campaign = store.campaigns.create(accept_spec(spec)).id
    store.campaigns.move(campaign, "running")
    engine = plugins.load(plugins.ENGINES, "default")(spec.setup())
    (result,) = engine.run([episode.EpisodeTask(3, 5, episode.TrajectorySource(WAVE))])
    fault = episode.EpisodeFault("infrastructure", "Three workers were lost while they ran it.")
    lost = episode.unrunnable(episode.EpisodeTask(4, 6, episode.TrajectorySource(NOTHING)), fault)
    store.episodes.commit(campaign, [Delivery(result, "by hand"), Delivery(lost, "by hand")])
    store.campaigns.move(campaign, "pausing")
    store.campaigns.move(campaign, "paused")
    return f"{campaign}/3"


def ending(crashed):
    """What the story of a collision ends with; a step takes 0.1 s."""
    severity = crashed.measures.severity
    return f"After {0.1 * crashed.steps:.1f} s collision: severity {severity:.1f} m²/s²."


def test_the_story_stands_before_the_steps(check_session, crash):
    check_session("cli/explain/collision", ("episode", "explain", crash, *LATER))


def test_steps_are_shown_only_where_they_are_asked_for(eigenfail, crash, store):
    def explain(*options):
        return eigenfail("episode", "explain", crash, *options).stdout

    story, steps = explain(), store.episodes.get(1, 3).steps
    assert ending(store.episodes.get(1, 3)) in story
    assert "candidate" not in story
    assert "--steps" in story
    assert len(story.splitlines()) < 20
    whole = explain("--steps")
    assert whole.startswith(story.rpartition("\n\n")[0])
    assert len(whole.splitlines()) > steps
    for option in (("--every", 5), ("--from", 1), ("--to", 5)):
        assert "candidate" in explain(*option)


def test_as_json_it_has_every_step(eigenfail, crash, store):
    told = json.loads(eigenfail("episode", "explain", crash, "--json").stdout)
    assert told["replayed"]["same"]
    assert len(told["steps"]) == store.episodes.get(1, 3).steps
    assert told["steps"][0]["account"]["candidate"] == "keep"
    assert told["note"] == ""


def test_a_window_shows_fewer_steps_and_the_whole_story(eigenfail, crash, store):
    words = ("episode", "explain", crash, "--json", "--from", 2, "--to", 4, "--every", 5)
    told = json.loads(eigenfail(*words).stdout)
    assert [round(step["time_s"], 1) for step in told["steps"]] == [2.0, 2.5, 3.0, 3.5, 4.0]
    assert told["story"][-1] == ending(store.episodes.get(1, 3))


def test_a_planner_that_explains_nothing_is_said_to(check_session, done):
    asked = ("episode", "explain", f"{done}/3", "--every", 10)
    check_session("cli/explain/without_explanation", asked)


def test_another_result_exits_with_1_and_says_so(check_session, crash, monkeypatch):
    load = replays.load_here
    monkeypatch.setattr(replays, "load_here", lambda group: mirrored(load(group)))
    check_session("cli/explain/differs", ("episode", "explain", crash, *LATER))


def mirrored(explain):
    """Another version of the world: the noise comes the other way round."""
    return lambda setup, task: explain(
        setup,
        episode.EpisodeTask(task.index, task.seed, episode.TrajectorySource(-0.1 * task.source.z)),
    )


def test_an_episode_that_never_ran_has_nothing_to_explain(check_session, crash):
    check_session("cli/explain/never_ran", ("episode", "explain", "1/4"))


def test_without_the_world_it_says_what_to_install(check_session, crash, monkeypatch):
    def missing(group, name):
        raise InvalidValue("explainer", "'default' cannot be loaded: No module named 'osqp'.")

    monkeypatch.setattr(replays.plugins, "load", missing)
    check_session("cli/explain/without_world", ("episode", "explain", crash))


def result(outcome, **more):
    noise = NoiseTrajectory(NOTHING, NOTHING)
    return episode.EpisodeResult(0, 0, outcome, 10, noise, "trajectory", **more)


def tell(accounts, ended=None, accelerations=None):
    """The story of steps a second apart, behind a vehicle at which the truck closes at 10 m/s."""
    safe = result(episode.Outcome.SAFE, measures=Measures(4.25))
    pressed = accelerations or [0.0] * len(accounts)
    steps = tuple(
        ExplainedStep(float(n), a, 0.0, account, (0.0, 0.0), 50.0 - n, 10.0)
        for n, (account, a) in enumerate(zip(accounts, pressed, strict=True))
    )
    return tell_story(ExplainedEpisode(ended or safe, steps))


def test_a_plain_drive_is_told_in_one_sentence():
    assert tell([{}] * 3) == ["No collision: smallest distance 4.2 m."]
    assert tell([]) == ["No collision: smallest distance 4.2 m."]


def test_a_loss_is_told_once():
    lost = [{"lost_tracks": float(n)} for n in (0, 0, 1, 1, 2)]
    assert [line[:26] for line in tell(lost)[:-1]] == [
        "At 2.0 s a track was lost.",
        "At 4.0 s a track was lost.",
    ]


def test_a_wrong_belief_is_told_with_the_truth_but_for_the_first_look():
    beliefs = [0.0, 5.0, 9.0, 2.0, 4.0, 8.0]
    accounts = [{"heeds": "lead", "closing_mps": belief} for belief in beliefs]
    told = [line for line in tell(accounts) if "believed" in line]
    assert told == [
        "From 3.0 s to 4.0 s it believed to close in at 3.0 m/s on average; in truth 10.0 m/s."
    ]


def test_a_belief_that_was_never_right_is_told_from_the_start():
    told = tell([{"closing_mps": 1.0}] * 3)
    assert told[0].startswith("From 0.0 s to 2.0 s it believed to close in at 1.0 m/s")


def test_overrides_and_failed_programs_are_told_by_their_times():
    names = ["none", "emergency_brake", "emergency_brake", "qp_fallback"]
    accounts = [{"override": name, "qp_status": "solved"} for name in names]
    accounts[3]["qp_status"] = "infeasible"
    assert tell(accounts)[:-1] == [
        "From 1.0 s to 2.0 s the plan was overridden: emergency brake.",
        "At 3.0 s the plan was overridden: qp fallback.",
        "At 3.0 s the quadratic program was not solved.",
    ]


def test_what_flickers_is_told_in_one_sentence():
    accounts = [{"heeds": "lead" if n % 2 else "nobody"} for n in range(10)]
    flicker = [line for line in tell(accounts) if "its lead" in line]
    assert flicker == [
        "From 1.0 s to 9.0 s, 5 times and 5 steps in all, it took the vehicle ahead for its lead."
    ]


def test_the_hardest_braking_and_a_broken_end_are_told():
    fault = episode.EpisodeFault("planner", "The planner raised KeyError.")
    broken = result(episode.Outcome.ERRORED, fault=fault)
    assert tell([{}] * 3, broken, [-1.0, -4.5, -2.0]) == [
        "At 1.0 s it asked for its hardest braking: 4.50 m/s².",
        "After 10 steps the episode was aborted: The planner raised KeyError.",
    ]
