"""A GPU that has no room left, which no test can cause where there is none: torch says it has not.

What is real: the method, its model, and the checkpoint that it goes on from.
"""

import numpy as np
import pytest
import torch
from difs_learners import make_difs, noise_of

from eigenfail.errors import LearnerDiverged
from eigenfail_services.methods.difs.method import DiffusionFailureSampling
from eigenfail_services.methods.tensors import wrap_memory_errors

TOLD = "CUDA out of memory. Tried to allocate 2.00 GiB.\nGPU 0 has a total capacity of 79.1 GiB."
EPISODES, HORIZON = 100, 5


def learner() -> DiffusionFailureSampling:
    return make_difs(EPISODES, HORIZON, initial_share=0.2, round_size=20)


def refuse(*_arguments, **_named) -> None:
    raise torch.OutOfMemoryError(TOLD)


@pytest.fixture
def round_of(episode):
    """What came of a round: failures, each with other noise, from which the network learns."""
    return lambda n: [episode(np.full((HORIZON, 2), 0.1 * i), 0.0) for i in range(n)]


@pytest.mark.fault(
    "GPU without free memory",
    group="processes",
    outcome="The learner starts again once from its checkpoint; the second time the campaign "
    "ends as dead and names the setting to change.",
)
def test_no_room_to_train_is_told_and_the_checkpoint_goes_on(round_of, monkeypatch) -> None:
    lost = learner()
    results = round_of(len(lost.propose(EPISODES).sources))
    checkpoint = lost.state()
    with monkeypatch.context() as patch:
        patch.setattr(torch.nn.functional, "mse_loss", refuse)
        with pytest.raises(LearnerDiverged) as told:
            lost.observe(results)
    assert "ran out of memory on its device: CUDA out of memory. Tried" in told.value.problem
    assert "79.1 GiB" not in told.value.problem
    assert "Set device to cpu" in told.value.remedy
    undisturbed, again = learner(), learner()
    undisturbed.propose(EPISODES)
    again.restore(checkpoint)
    for each in (undisturbed, again):
        each.observe(results)
    np.testing.assert_array_equal(noise_of(undisturbed.propose(20)), noise_of(again.propose(20)))


@pytest.mark.fault("GPU without free memory")
@pytest.mark.parametrize("where", ["randn", "from_numpy"])
def test_so_is_no_room_to_sample(round_of, monkeypatch, where: str) -> None:
    made = learner()
    made.observe(round_of(len(made.propose(EPISODES).sources)))
    monkeypatch.setattr(torch, where, refuse)
    with pytest.raises(LearnerDiverged, match="out of memory on its device"):
        made.propose(20)


@pytest.mark.fault("GPU without free memory")
def test_so_is_no_room_for_the_network(monkeypatch) -> None:
    monkeypatch.setattr(torch.nn.Module, "to", refuse)
    with pytest.raises(LearnerDiverged, match="out of memory on its device"):
        learner()


@pytest.mark.fault("GPU without free memory")
def test_torch_may_say_nothing_at_all() -> None:
    with pytest.raises(LearnerDiverged, match="ran out of memory"), wrap_memory_errors():
        raise torch.OutOfMemoryError
