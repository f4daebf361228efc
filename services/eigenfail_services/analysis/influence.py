"""Which moments matter: large entries of components that explain much (paper, PCA)."""

import numpy as np
from numpy.typing import NDArray


def influence(
    components: NDArray[np.float64], explained: NDArray[np.float64]
) -> NDArray[np.float64]:
    """How much each step and axis weighs: sum over k of explained_k · |V_k|.

    Args:
        components: shape (k, steps, 2).
        explained: share of the variance of each, shape (k,).

    Returns:
        Shape (steps, 2), in the alignment of the components; zeros without components.
    """
    return np.tensordot(explained, np.abs(components), axes=1)
