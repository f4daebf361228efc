"""Conversion of torch's modules, optimizers and randomness to arrays and seeds.

Only methods that train import this module, and only when they create a learner.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain

import numpy as np
import torch

from eigenfail.errors import LearnerDiverged
from eigenfail_services.methods.archive import Array, Arrays, take


@contextmanager
def isolate_randomness(seed: int, draw: int) -> Iterator[np.random.Generator]:
    """Seed torch's global generator, and yield a numpy generator, from (seed, draw) only.

    So a state needs only the number of the next draw instead of a generator. The global generator
    is restored afterwards.
    """
    generator = np.random.default_rng([seed, draw])
    # Modules draw their first weights from the global generator; their constructors take no other.
    with torch.random.fork_rng(devices=[]):
        torch.default_generator.manual_seed(int(generator.integers(2**63)))
        yield generator


@contextmanager
def wrap_memory_errors() -> Iterator[None]:
    """Turn out-of-memory errors of a device into LearnerDiverged.

    Raises:
        LearnerDiverged: the device is out of memory.
    """
    try:
        yield
    except torch.OutOfMemoryError as error:
        reason = str(error).partition("\n")[0]
        raise LearnerDiverged(
            f"The learner ran out of memory on its device: {reason}",
            "Set device to cpu, or lower batch_size or width, or end what else uses the GPU; then "
            "launch a copy of the campaign.",
        ) from error


def module_arrays(prefix: str, module: torch.nn.Module) -> dict[str, Array]:
    """Return the weights of a module by name."""
    return {f"{prefix}.{name}": _array(tensor) for name, tensor in module.state_dict().items()}


def load_module(prefix: str, module: torch.nn.Module, arrays: Arrays) -> None:
    """Set a module's weights.

    Raises:
        ValueError: an array is missing or has another shape.
    """
    for name, tensor in module.state_dict().items():
        copy_into(tensor, arrays, f"{prefix}.{name}")


def adam_arrays(prefix: str, optimizer: torch.optim.Adam) -> dict[str, Array]:
    """Return moments and step counts of Adam by name; empty before the first step."""
    return {
        f"{prefix}.{i}.{key}": _array(value)
        for i, parameter in enumerate(_parameters(optimizer))
        for key, value in optimizer.state.get(parameter, {}).items()
    }


def load_adam(prefix: str, optimizer: torch.optim.Adam, arrays: Arrays) -> None:
    """Set Adam's moments and step counts.

    Raises:
        ValueError: an array is missing or has another shape.
    """
    optimizer.state.clear()
    for i, parameter in enumerate(_parameters(optimizer)):
        if f"{prefix}.{i}.step" not in arrays:
            continue
        moments = {key: torch.zeros_like(parameter) for key in ("exp_avg", "exp_avg_sq")}
        # Adam makes its state at its first step. Fused Adam keeps the step count on the device of
        # the parameter, any other on the CPU.
        counter = torch.zeros((), device=parameter.device if _is_fused(optimizer) else "cpu")
        optimizer.state[parameter] = {"step": counter, **moments}
        for key, value in optimizer.state[parameter].items():
            copy_into(value, arrays, f"{prefix}.{i}.{key}")


def copy_into(tensor: torch.Tensor, arrays: Arrays, name: str) -> None:
    """Set a tensor's values.

    Raises:
        ValueError: the array is missing or has another shape.
    """
    with torch.no_grad():
        tensor.copy_(torch.from_numpy(take(arrays, name, tuple(tensor.shape))))


def all_finite(tensors: Iterator[torch.Tensor]) -> bool:
    """Return whether all values are finite."""
    return all(bool(torch.isfinite(tensor).all()) for tensor in tensors)


def _parameters(optimizer: torch.optim.Adam) -> list[torch.Tensor]:
    return list(chain.from_iterable(group["params"] for group in optimizer.param_groups))


def _is_fused(optimizer: torch.optim.Adam) -> bool:
    return any(group.get("fused") for group in optimizer.param_groups)


def _array(tensor: torch.Tensor) -> Array:
    array: Array = tensor.detach().cpu().numpy()
    return array
