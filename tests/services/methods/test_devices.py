"""Which device learns: with and without CUDA, on machines that have a GPU and that have none.

That torch sees a GPU is pretended, as no test may need one; nothing here touches CUDA.
"""

import time
from contextlib import ExitStack, closing

import deadlines
import numpy as np
import pytest
import torch
from accepted import accept_spec
from difs_learners import make_difs, noise_of

from eigenfail.errors import InvalidValue
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_services.campaigns.analysis_jobs import AnalysisJobs
from eigenfail_services.campaigns.supervisor import Supervisor
from eigenfail_services.hub.server import Hub
from eigenfail_services.methods import tensors
from eigenfail_services.methods.difs.method import DiffusionFailureSampling
from eigenfail_services.store.store import open_store

EPISODES, HORIZON = 100, 5
DEADLINE_S = deadlines.PROCESS_S
QUICK = {"first_steps": 5, "steps": 5, "initial_share": 0.2, "round_size": 20}
NO_GPU = "settings.device: cuda is asked for, and torch finds no GPU where the learner runs."


def learner(device: str) -> DiffusionFailureSampling:
    return make_difs(EPISODES, HORIZON, **QUICK, device=device)


@pytest.mark.parametrize(
    ("there", "asked", "chosen"),
    [
        (False, "auto", "cpu"),
        (False, "cpu", "cpu"),
        (True, "auto", "cuda"),
        (True, "cpu", "cpu"),
        (True, "cuda", "cuda"),
    ],
)
def test_auto_takes_the_gpu_that_torch_sees(monkeypatch, there, asked, chosen) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: there)
    taken = []
    monkeypatch.setattr(torch.nn.Module, "to", lambda module, at: taken.append(at) or module)
    learner(asked)
    assert taken == [torch.device(chosen)]


def test_a_gpu_that_is_not_there_is_told_with_the_way_out(monkeypatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(InvalidValue) as told:
        learner("cuda")
    assert told.value.problem == NO_GPU
    assert "Set device to auto or cpu" in told.value.remedy


@pytest.mark.service
def test_a_campaign_that_asks_for_it_ends_with_the_reason(monkeypatch) -> None:
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")  # the learner's machine has no GPU, then
    store, deadline_s = open_store("memory://"), time.monotonic() + DEADLINE_S
    settings = {**QUICK, "device": "cuda"}
    campaign = store.campaigns.create(
        accept_spec(CampaignSpec(name="t", method="difs", episodes=EPISODES, settings=settings))
    ).id
    with closing(store), ExitStack() as stack:
        hub = Hub(store, "tcp://127.0.0.1:*")
        stack.callback(hub.stop)
        supervisor = Supervisor(store, hub, AnalysisJobs(store, ""))
        hub.start()
        while (found := store.campaigns.get(campaign)).ended_ms is None:
            assert time.monotonic() < deadline_s, "the campaign does not end"
            supervisor.turn()
            time.sleep(0.02)
    assert found.state is CampaignState.DEAD
    assert NO_GPU in found.stopped_because
    assert "Set device to auto or cpu" in found.stopped_because


@pytest.fixture
def trained(episode):
    """A learner's checkpoint, and the noise that it proposes next."""
    made = learner("cpu")
    results = [
        episode(np.full((HORIZON, 2), 0.1 * i), 2.0 + i)
        for i in range(len(made.propose(EPISODES).sources))
    ]
    made.observe(results)
    return made.state(), noise_of(made.propose(20))


def test_a_checkpoint_holds_plain_arrays_and_goes_on_where_there_is_no_gpu(
    trained, monkeypatch
) -> None:
    """What a GPU learnt is read to the memory of the machine, and from there to its device."""
    state, wanted = trained

    def none(*_arguments, **_named) -> None:
        raise AssertionError("CUDA was touched")

    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.cuda, "_lazy_init", none)
    monkeypatch.setattr(torch, "load", none)
    again = learner("auto")
    again.restore(state)
    np.testing.assert_array_equal(noise_of(again.propose(20)), wanted)


def test_what_is_saved_is_brought_to_the_cpu_first(monkeypatch) -> None:
    brought, cpu = [], torch.Tensor.cpu
    monkeypatch.setattr(torch.Tensor, "cpu", lambda each: brought.append(each) or cpu(each))
    saved = tensors.module_arrays("one", torch.nn.Linear(3, 2))
    assert saved.keys() == {"one.weight", "one.bias"}
    assert all(isinstance(array, np.ndarray) for array in saved.values())
    assert len(brought) == len(saved)
