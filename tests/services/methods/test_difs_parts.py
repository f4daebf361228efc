"""The diffusion process against closed forms, the shapes of the network, and the memory."""

from math import pi

import numpy as np
import pytest
import torch

from eigenfail.values.episode import Outcome
from eigenfail.values.measures import Measures
from eigenfail_services.methods.difs import model as diffusion
from eigenfail_services.methods.difs.model import shift_in_time
from eigenfail_services.methods.difs.network import ConditionalDenoiser
from eigenfail_services.methods.trials import TrialMemory

HORIZON = 6


def test_velocity_and_noised_data_are_a_rotation():
    x0, eps = torch.randn(2, 5, 3, generator=torch.Generator().manual_seed(0))
    angle = torch.linspace(0.0, pi / 2, 5)
    x, v = diffusion.diffuse(x0, eps, angle), diffusion.compute_velocity(x0, eps, angle)
    torch.testing.assert_close(torch.cos(angle)[:, None] * x - torch.sin(angle)[:, None] * v, x0)
    torch.testing.assert_close(torch.sin(angle)[:, None] * x + torch.cos(angle)[:, None] * v, eps)


def test_a_trajectory_is_shifted_in_time_and_what_moves_in_is_unseen():
    z = torch.arange(1.0, 5.0)[None, :, None].expand(2, 4, 2)
    unseen = torch.tensor([[False, False, False, True]] * 2)
    moved, hidden = shift_in_time(z, unseen, torch.tensor([[1], [-2]]))
    assert moved[0, 1:, 0].tolist() == [1.0, 2.0, 3.0]
    assert hidden[0].tolist() == [True, False, False, False]
    assert moved[1, :2, 0].tolist() == [3.0, 4.0]
    assert hidden[1].tolist() == [False, True, True, True]


def test_steps_behind_an_episodes_end_are_unseen(episode):
    trials = TrialMemory(4, 2, memory=100)
    trials.add([episode(np.ones((2, 2))), episode(np.ones((4, 2)), 3.0)])
    np.testing.assert_array_equal(trials.find_unseen(), [[0, 0, 1, 1], [0, 0, 0, 0]])
    np.testing.assert_array_equal(trials.z[:, :, 0], [[1, 1, 0, 0], [1, 1, 1, 1]])


def test_failed_episodes_are_not_remembered_and_the_safest_make_room(episode):
    trials = TrialMemory(HORIZON, 2, memory=3)
    robustness = [5.0, 1.0, 4.0, 2.0, 3.0]
    trials.add([episode([(i, 0)], r) for i, r in enumerate(robustness)])
    trials.add([episode([(9, 0)], 0.5, outcome=Outcome.ERRORED), episode([], 0.1, measures=None)])
    assert trials.robustness.tolist() == [1.0, 2.0, 3.0]
    assert trials.z[:, 0, 0].tolist() == [1.0, 3.0, 4.0]
    assert trials.quantile(0.5) == 2.0


def test_measures_without_failures_keep_their_robustness(episode):
    trials = TrialMemory(HORIZON, 2, memory=3)
    trials.add([episode([(0, 0)], measures=Measures(7.5), outcome=Outcome.SAFE)])
    assert trials.robustness.tolist() == [7.5]


@pytest.mark.parametrize("channels", [1, 2, 5])
@pytest.mark.parametrize("horizon", [1, 2, 50, 51, 100])
def test_every_shape_has_its_network_and_its_far_steps_depend_on_each_other(horizon, channels):
    network = ConditionalDenoiser(horizon, channels, width=8)
    torch.nn.init.ones_(network.last.weight)
    x = torch.zeros(3, channels * horizon)
    moved = x.clone()
    moved[:, 0] = 5.0
    angle, same = torch.full((3,), 0.7), torch.zeros(3)
    before, after = (network(each, angle, same, same) for each in (x, moved))
    assert before.shape == x.shape
    assert not torch.allclose(before[:, -1], after[:, -1])


def test_an_untrained_network_predicts_the_velocity_of_the_prior():
    network = ConditionalDenoiser(60, 2, width=8)
    x = torch.randn(4, 120, generator=torch.Generator().manual_seed(0))
    assert not network(x, torch.rand(4), torch.rand(4), torch.rand(4)).any()
