"""Mean weights of a policy's last versions."""

from collections.abc import Iterator

import numpy as np
from msgspec import structs

from eigenfail.values.arrays import Floats
from eigenfail.values.learning import Layer, Policy
from eigenfail_services.methods.archive import Arrays, take


class PolicyAverage:
    """Running mean of a policy's weights over its trainings.

    The last steps of stochastic training scatter about a solution, and their mean lies nearer to it
    (Polyak and Juditsky 1992, SIAM J. Control Optim. 30; Izmailov et al. 2018, UAI). Up to `length`
    versions, it is the plain mean of all versions. From then on, it is exponential with the rate 1
    / `length`.

    Args:
        length: number of versions; with 1, the mean is the last version.
    """

    def __init__(self, length: int) -> None:
        self._length = length
        self._count = 0
        self._weights: Floats = np.zeros(0, np.float32)

    def add(self, policy: Policy) -> None:
        """Add the next version."""
        # The mean would be the version itself: nothing is kept, and states stay small.
        if self._length == 1:
            return
        weights = np.concatenate([array.ravel() for array in _list_weights(policy)])
        # The size of the networks is known from the first version on.
        if not self._count:
            self._weights = np.zeros_like(weights)
        self._count += 1
        share = np.float32(1.0 / min(self._count, self._length))
        self._weights = self._weights + share * (weights - self._weights)

    def apply(self, policy: Policy) -> Policy:
        """Return the policy with the mean weights; before any training, the policy itself."""
        if not self._count:
            return policy
        parts = iter(_split(self._weights, _list_weights(policy)))
        layers = [Layer(weight, bias) for weight, bias in zip(parts, parts, strict=True)]
        *hidden, mean, log_std = layers
        return structs.replace(policy, hidden=tuple(hidden), mean=mean, log_std=log_std)

    def arrays(self) -> Arrays:
        """Return the mean weights and the number of versions; nothing if `length` is 1."""
        if self._length == 1:
            return {}
        counted = np.array([self._count], np.int64)
        return {"average.weights": self._weights, "average.count": counted}

    def load(self, arrays: Arrays, policy: Policy) -> None:
        """Restore the state; without a mean in it, the mean is the last version.

        Args:
            arrays: result of `arrays`.
            policy: a policy of the same shape.

        Raises:
            ValueError: an array is missing or has another shape.
        """
        if not any(name.startswith("average.") for name in arrays):
            return
        self._count = int(take(arrays, "average.count", (1,))[0])
        size = sum(array.size for array in _list_weights(policy)) if self._count else 0
        self._weights = take(arrays, "average.weights", (size,)).astype(np.float32)


def _list_weights(policy: Policy) -> Iterator[Floats]:
    for layer in (*policy.hidden, policy.mean, policy.log_std):
        yield layer.weight
        yield layer.bias


def _split(vector: Floats, like: Iterator[Floats]) -> Iterator[Floats]:
    """Yield the parts of a vector, in the shapes of some arrays."""
    start = 0
    for array in like:
        yield vector[start : start + array.size].reshape(array.shape)
        start += array.size
