"""Small networks in numpy: all weights in one vector, so that a step is a few large operations."""

from itertools import pairwise
from math import prod, sqrt

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import Floats
from eigenfail_services.methods.archive import Arrays, take

Layer = tuple[Floats, Floats]

BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-8


class Network:
    """Affine layers with a ReLU between them, and Adam (Kingma and Ba 2015).

    Args:
        widths: of input, hidden layers and output.
        copies: networks of this shape that run side by side, () for a single one.
        random: draws the first weights, uniform within 1 / sqrt(inputs) as torch's.
    """

    def __init__(
        self, widths: tuple[int, ...], copies: tuple[int, ...], random: np.random.Generator
    ) -> None:
        shapes = [
            shape for n, m in pairwise(widths) for shape in ((*copies, m, n), (*copies, 1, m))
        ]
        size = sum(prod(shape) for shape in shapes)
        self.weights = np.zeros(size, np.float32)
        self._gradient = np.zeros(size, np.float32)
        self._mean = np.zeros(size, np.float32)
        self._square = np.zeros(size, np.float32)
        self._steps = 0
        self.layers = _layers(self.weights, shapes)
        self._gradients = _layers(self._gradient, shapes)
        for weight, bias in self.layers:
            bound = 1.0 / sqrt(weight.shape[-1])
            weight[...] = random.uniform(-bound, bound, weight.shape)
            bias[...] = random.uniform(-bound, bound, bias.shape)

    def forward(self, x: Floats) -> list[Floats]:
        """What goes into each layer, and last the output, shape (…, batch, outputs)."""
        course = [x]
        for weight, bias in self.layers[:-1]:
            course.append(np.maximum(course[-1] @ weight.swapaxes(-1, -2) + bias, 0.0))
        weight, bias = self.layers[-1]
        course.append(course[-1] @ weight.swapaxes(-1, -2) + bias)
        return course

    def slope_in_input(self, course: list[Floats], slope: Floats) -> Floats:
        """The slope of the loss in the input, from that in the output; no weight changes.

        Args:
            course: what `forward` returned.
            slope: shape (…, batch, outputs); the answer's is (…, batch, inputs).
        """
        lowest: Floats = self._slopes(course, slope)[-1] @ self.layers[0][0]
        return lowest

    def descend(self, course: list[Floats], slope: Floats, learning_rate: float) -> None:
        """One step of Adam against the slope of the loss in the output.

        Args:
            course: what `forward` returned.
            slope: shape (…, batch, outputs).
            learning_rate: of the step.
        """
        slopes = self._slopes(course, slope)[::-1]
        for inputs, up, (weight, bias) in zip(course, slopes, self._gradients, strict=False):
            np.matmul(up.swapaxes(-1, -2), inputs, out=weight)
            np.sum(up, axis=-2, keepdims=True, out=bias)
        self._adam(learning_rate)

    def follow(self, leader: "Network", share: float) -> None:
        """Move the weights towards another network's by that share of the distance."""
        self.weights += np.float32(share) * (leader.weights - self.weights)

    def arrays(self, prefix: str) -> dict[str, NDArray[np.generic]]:
        """Weights, moments and step count by name."""
        return {
            f"{prefix}.weights": self.weights,
            f"{prefix}.mean": self._mean,
            f"{prefix}.square": self._square,
            f"{prefix}.steps": np.array([self._steps], np.int64),
        }

    def load(self, prefix: str, arrays: Arrays) -> None:
        """Go on from there.

        Raises:
            ValueError: an array is missing or has another shape.
        """
        self._steps = int(take(arrays, f"{prefix}.steps", (1,))[0])
        for name, own in (
            ("weights", self.weights),
            ("mean", self._mean),
            ("square", self._square),
        ):
            own[...] = take(arrays, f"{prefix}.{name}", own.shape)

    def _slopes(self, course: list[Floats], slope: Floats) -> list[Floats]:
        """Slopes in the sums of the layers, last layer first."""
        slopes = [slope]
        for (weight, _), inputs in zip(self.layers[:0:-1], course[-2:0:-1], strict=True):
            slopes.append((slopes[-1] @ weight) * (inputs > 0.0))
        return slopes

    def _adam(self, learning_rate: float) -> None:
        self._steps += 1
        gradient, mean, square = self._gradient, self._mean, self._square
        mean += np.float32(1.0 - BETA1) * (gradient - mean)
        square *= np.float32(BETA2)
        square += np.float32(1.0 - BETA2) * gradient * gradient
        size = np.sqrt(square) / np.float32(sqrt(1.0 - BETA2**self._steps)) + np.float32(EPSILON)
        self.weights -= np.float32(learning_rate / (1.0 - BETA1**self._steps)) * mean / size


def _layers(vector: Floats, shapes: list[tuple[int, ...]]) -> list[Layer]:
    """Views of a vector: weight and bias of each layer."""
    ends = np.cumsum([prod(shape) for shape in shapes])
    parts = [
        vector[end - prod(shape) : end].reshape(shape)
        for end, shape in zip(ends, shapes, strict=True)
    ]
    return list(zip(parts[::2], parts[1::2], strict=True))
