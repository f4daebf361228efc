"""AST learns, trains as stable-baselines3 does, and never sends out a policy of NaN."""

import numpy as np
import pytest
import torch

from eigenfail.errors import InvalidValue, LearnerDiverged, ProtocolError
from eigenfail.settings import read_settings
from eigenfail.testing.learner import Corridor, ToyEngine
from eigenfail.values.episode import PolicySource
from eigenfail.values.learning import LearnerContext
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods.ast.method import AdaptiveStressTesting
from eigenfail_services.methods.ast.settings import AstSettings

CORRIDOR = Corridor()


def ast(seed=0, episodes=1000, channels=2, **settings):
    nothing = np.zeros((0, CORRIDOR.steps, channels), np.float32)
    given = read_settings(AdaptiveStressTesting.Settings, settings, "settings")
    return AdaptiveStressTesting(LearnerContext(seed, episodes, CORRIDOR.steps, nothing), given)


def test_the_untrained_policy_spreads_its_choices_over_the_amplitude():
    learner = ast(amplitude=3.0)
    results = list(run_in_process(Rounds(learner, 0, 20), ToyEngine(CORRIDOR)))
    z = np.concatenate([result.noise.z[::5] for result in results])
    assert np.abs(z).max() <= 3.0
    assert np.all(z.std(axis=0) > 1.5)
    assert np.all(np.abs(z.mean(axis=0)) < 0.8)


def test_trains_only_after_its_warm_up_and_then_with_every_round():
    learner = ast(warm_up=8, round_size=4)
    versions = [
        round_.tasks[0].source
        for rounds in [Rounds(learner, 0, 24)]
        for round_ in _opened(rounds, ToyEngine(CORRIDOR))
    ]
    assert versions == [PolicySource(v) for v in (0, 0, 0, 1, 2, 3)]


def _opened(rounds, engine):
    """Every round once, as it becomes the oldest."""
    while opened := rounds.open():
        yield opened[0]
        engine.add_policy(opened[0].policy)
        rounds.complete(list(engine.run(opened[0].tasks)))


def test_what_was_seen_during_the_warm_up_is_trained_on_at_its_end():
    learner = ast(warm_up=8, round_size=4, gradient_steps=3)
    steps = []
    learner._trainer.train = lambda count, draw: steps.append(count)
    results = list(run_in_process(Rounds(ast(round_size=4), 0, 12), ToyEngine(CORRIDOR)))
    decisions = [-(-result.steps // 10) for result in results]
    for first in (0, 4, 8):
        learner.observe(results[first : first + 4])
    assert steps == [3 * sum(decisions[:8]), 3 * sum(decisions[8:])]


def test_a_short_campaign_warms_up_for_a_quarter_of_it():
    short = ast(episodes=16, warm_up=60, round_size=4)
    short.observe(list(run_in_process(Rounds(ast(round_size=4), 0, 4), ToyEngine(CORRIDOR))))
    assert short.propose(4).sources[0] == PolicySource(1)


@pytest.mark.parametrize(("channels", "most"), [(1, 0.69), (2, 1.39), (5, 3.47)])
def test_no_action_has_more_entropy_than_its_channels_allow(channels, most):
    settings = {} if channels == 1 else {"target_entropy": 1.3}
    ast(channels=channels, **settings)
    with pytest.raises(InvalidValue, match=f"ln 2 for each channel, {most} in all"):
        AstSettings(target_entropy=channels * 0.7).check_entropy(channels)


def test_failed_episodes_never_enter_the_buffer():
    learner = ast(round_size=10, warm_up=0)
    before = {name: array.copy() for name, array in learner._trainer.arrays().items()}
    list(run_in_process(Rounds(learner, 0, 10), ToyEngine(CORRIDOR, faulty=range(10))))
    assert learner.trained_episodes == 0
    for name, array in learner._trainer.arrays().items():
        np.testing.assert_array_equal(array, before[name])


@pytest.mark.parametrize("network", ["actor", "critic"])
def test_a_weight_that_becomes_nan_ends_the_learner_with_a_remedy(network):
    learner = ast(round_size=4, warm_up=0, gradient_steps=1, trainer="sb3")
    results = list(run_in_process(Rounds(ast(round_size=4), 0, 4), ToyEngine(CORRIDOR)))
    learner.observe(results)
    weights = getattr(learner._trainer._model, network).parameters()
    with torch.no_grad():
        next(weights).fill_(float("nan"))
    with pytest.raises(LearnerDiverged, match=r"diverged.*Lower learning_rate"):
        learner.observe(results)


def test_a_state_of_other_networks_is_refused():
    with pytest.raises(ProtocolError, match="should have shape"):
        ast(hidden=[32, 32]).restore(ast(hidden=[64, 64]).state())
