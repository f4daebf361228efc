"""The adversary's policy in numpy, against closed forms and float64."""

from math import exp, tanh

import msgspec
import numpy as np
import pytest

from eigenfail.errors import InvalidValue
from eigenfail.values.learning import STATE, Layer, Policy
from eigenfail.values.scene import Observation, VehicleState
from eigenfail_workers.noise.policy import (
    PolicyNoise,
    act,
    copy_policy,
    state_vector,
    validate_policy,
)

WIDTH = len(STATE)
EGO = VehicleState(100.0, 1.0, 0.1, 24.0, 16.0, 2.5)
ACTOR = VehicleState(150.0, 3.0, -0.05, 12.0, 5.0, 2.0)


def seen(step: int = 0) -> Observation:
    return Observation(step, EGO, (ACTOR,))


def layer(rng: np.random.Generator, rows: int, columns: int, scale: float = 0.5) -> Layer:
    weight = rng.normal(0.0, scale, (rows, columns)).astype(np.float32)
    return Layer(weight, rng.normal(0.0, 0.1, rows).astype(np.float32))


def make(seed: int = 0, hold: int = 1, amplitude: float = 3.0) -> Policy:
    rng = np.random.default_rng(seed)
    hidden = (layer(rng, 16, WIDTH), layer(rng, 8, 16))
    return Policy(1, hidden, layer(rng, 2, 8), layer(rng, 2, 8), amplitude, hold)


def constant(mean: float, log_std: float, amplitude: float = 2.0) -> Policy:
    """No hidden layer, no weight: the state does not matter."""
    zero = np.zeros((2, WIDTH), np.float32)
    outputs = (Layer(zero, np.full(2, value, np.float32)) for value in (mean, log_std))
    return Policy(1, (), *outputs, amplitude, 1)


def noise(policy: Policy, seed: int = 0) -> PolicyNoise:
    return PolicyNoise(policy, np.random.default_rng(seed), 40)


def test_the_state_has_the_glossarys_order_and_units() -> None:
    state = dict(zip(STATE, state_vector(seen(10), ACTOR, (1.5, -3.0), 40).tolist(), strict=True))
    assert state == pytest.approx(
        {
            "gap_x": 0.5,
            "gap_y": 0.5,
            "ego_speed": 0.8,
            "actor_speed": 0.4,
            "actor_heading": -0.05,
            "noise_x": 0.5,
            "noise_y": -1.0,
            "progress": 0.25,
        }
    )


def test_closed_form_without_hidden_layers() -> None:
    eps = np.array([0.5, -1.0], np.float32)
    z = act(constant(0.3, -0.7), np.zeros(WIDTH, np.float32), eps)
    expected = [2.0 * tanh(0.3 + exp(-0.7) * e) for e in (0.5, -1.0)]
    assert z.tolist() == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("asked", "clamped"), [(9.0, 2.0), (-99.0, -20.0)])
def test_log_std_is_clamped(asked: float, clamped: float) -> None:
    eps = np.array([0.1, -0.1], np.float32)
    state = np.zeros(WIDTH, np.float32)
    z = act(constant(0.1, asked), state, eps)
    assert z.tolist() == act(constant(0.1, clamped), state, eps).tolist()


def test_agrees_with_float64() -> None:
    policy, state = make(), state_vector(seen(3), ACTOR, (0.6, -0.3), 40)
    eps = np.array([1.2, -0.4], np.float32)
    h = state.astype(np.float64)
    for one in policy.hidden:
        h = np.maximum(one.weight.astype(np.float64) @ h + one.bias, 0.0)
    mean = policy.mean.weight.astype(np.float64) @ h + policy.mean.bias
    log_std = policy.log_std.weight.astype(np.float64) @ h + policy.log_std.bias
    expected = 3.0 * np.tanh(mean + np.exp(log_std) * eps)
    z = act(policy, state, eps)
    assert z.dtype == np.float32
    assert z == pytest.approx(expected, rel=1e-5)


def test_an_action_is_held_and_every_state_kept() -> None:
    source = noise(make(hold=3))
    z = [source.draw(seen(step), ACTOR) for step in range(8)]
    assert z[0] == z[1] == z[2]
    assert z[3] == z[4] == z[5]
    assert len({z[0], z[3], z[6]}) == 3
    states = source.states()
    assert states.shape == (8, WIDTH)
    assert states.dtype == np.float32
    assert states[:, -1].tolist() == pytest.approx([step / 40 for step in range(8)])


def test_the_adversary_sees_its_noise_of_the_step_before() -> None:
    source = noise(make(hold=2))
    z = np.array([source.draw(seen(step), ACTOR) for step in range(5)])
    own = source.states()[:, [STATE.index("noise_x"), STATE.index("noise_y")]]
    assert own[0].tolist() == [0.0, 0.0]
    assert own[1:] == pytest.approx(z[:-1] / 3.0, rel=1e-6)


def test_no_action_exceeds_the_amplitude() -> None:
    source = noise(constant(0.0, 2.0, amplitude=1.5))
    z = np.array([source.draw(seen(), ACTOR) for _ in range(500)])
    assert np.abs(z).max() <= 1.5
    assert np.abs(z).max() > 1.49
    assert abs((z > 0).mean() - 0.5) < 0.05


def test_memory_layout_and_later_changes_do_not_matter() -> None:
    policy = make()
    turned = msgspec.structs.replace(
        policy,
        hidden=tuple(Layer(np.asfortranarray(one.weight), one.bias) for one in policy.hidden),
    )
    kept = copy_policy(turned)
    assert all(one.weight.flags.c_contiguous for one in kept.hidden)
    first = noise(copy_policy(policy)).draw(seen(), ACTOR)
    turned.hidden[0].weight[:] = 9.0
    assert noise(kept).draw(seen(), ACTOR) == first


def broken() -> dict[str, Policy]:
    policy, rng = make(), np.random.default_rng(0)
    spoilt = Layer(policy.mean.weight * np.float32(np.nan), policy.mean.bias)
    changes = {
        "input": {"hidden": (layer(rng, 16, 5), policy.hidden[1])},
        "chain": {"hidden": policy.hidden[:1]},
        "output": {"mean": layer(rng, 3, 8)},
        "bias": {"log_std": Layer(policy.log_std.weight, np.zeros(3, np.float32))},
        "nan": {"mean": spoilt},
        "hold": {"hold": 0},
        "amplitude": {"amplitude": -1.0},
    }
    return {name: msgspec.structs.replace(policy, **change) for name, change in changes.items()}


@pytest.mark.parametrize("name", sorted(broken()))
def test_a_policy_that_cannot_act_is_refused(name: str) -> None:
    validate_policy(make())
    with pytest.raises(InvalidValue, match="policy"):
        noise(broken()[name])


def test_a_policy_that_overflows_is_refused() -> None:
    source = noise(constant(20.0, 0.0, amplitude=1e39))
    with np.errstate(over="ignore"), pytest.raises(InvalidValue, match="asks for"):
        source.draw(seen(), ACTOR)
