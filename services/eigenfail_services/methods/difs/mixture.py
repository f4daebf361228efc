"""What DiFS knows in closed form: a mixture of normals of unit variance, one for each mode."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import Floats

Array = NDArray[np.float64]
Rows = NDArray[np.intp]


class Mixture(NamedTuple):
    """p(z) = sum_k shares_k · N(z; means_k, I).

    Attributes:
        shares: shape (components,), 1 in sum.
        means: shape (components, size).
    """

    shares: Array
    means: Array

    def among(self, components: Rows) -> "Mixture":
        """Some of the components alone, by their numbers; all of them where none is named."""
        if not len(components):
            return self
        shares = self.shares[components]
        return Mixture(shares / shares.sum(), self.means[components])

    def drawn(self, count: int, random: np.random.Generator) -> Rows:
        """A component for each of so many samples, shape (count,).

        Their numbers are off from the shares by less than one (systematic resampling, Kitagawa
        1996): in small rounds chance would leave a component out.
        """
        at = (np.arange(count) + random.random()) / max(count, 1)
        return np.searchsorted(np.cumsum(self.shares)[:-1], at, side="right")

    def components(self, z: Floats, unseen: NDArray[np.bool_]) -> Rows:
        """Which component each trajectory is most likely of, shape (n,)."""
        if len(self.shares) == 1:
            return np.zeros(len(z), np.intp)
        most: Rows = self.responsibilities(z, unseen).argmax(axis=1)
        return most

    def responsibilities(self, z: Floats, unseen: NDArray[np.bool_]) -> Array:
        """P(component | z where it was seen), shape (n, components).

        Args:
            z: shape (n, horizon, 2). [sigma]
            unseen: which steps have no noise of the trajectory's own, shape (n, horizon).
        """
        seen = np.repeat(~unseen, 2, axis=1).astype(np.float64)
        across = (z.reshape(seen.shape) * seen) @ self.means.T
        exponents = np.log(self.shares) + across - 0.5 * seen @ (self.means**2).T
        density = np.exp(exponents - exponents.max(axis=1, keepdims=True))
        each: Array = density / density.sum(axis=1, keepdims=True)
        return each


def one_normal(size: int) -> Mixture:
    """The prior."""
    return Mixture(np.ones(1), np.zeros((1, size)))
