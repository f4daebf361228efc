"""The network that DiFS trains: what distinguishes dangerous noise from ordinary noise."""

import torch
from torch import Tensor, nn

FEATURES = 5
"""Four of the diffusion time, and the condition."""


def time_features(angle: Tensor) -> Tensor:
    """Features of the diffusion time, shape (n, 4)."""
    turns = [torch.sin(angle), torch.cos(angle), torch.sin(2 * angle), torch.cos(4 * angle)]
    return torch.stack(turns, dim=1)


class Denoiser(nn.Module):
    """v(x_t, t, r) = -sin(t) · m + trust · correction(x_t, t, r), zero before training.

    For a standard normal v is zero, so the untrained network samples the prior exactly; for a
    normal with its mean moved by m, v = -sin(t) · m exactly. The first term is that mean, given by
    the component of the mixture that a sample was drawn for. The second term learns what the
    mixture does not explain: widths, and how they depend on robustness. It counts as far as it
    holds for trajectories that it was not trained on: of a few dozen with hundreds of numbers it
    would else learn the accidents.

    Args:
        size: how many numbers a trajectory has.
        width: of the hidden layers.
    """

    trust: Tensor

    def __init__(self, size: int, width: int) -> None:
        super().__init__()
        self.register_buffer("trust", torch.zeros(()))
        self.correction = nn.Sequential(
            nn.Linear(size + FEATURES, width),
            nn.SiLU(),
            nn.Linear(width, width),
            nn.SiLU(),
            nn.Linear(width, size),
        )
        for parameter in self.correction[-1].parameters():
            nn.init.zeros_(parameter)

    def forward(self, x: Tensor, angle: Tensor, condition: Tensor, mean: Tensor) -> Tensor:
        """v for x and mean of shape (n, size), angle and condition of shape (n,); (n, size)."""
        corrected = self.correct(x, angle, condition)
        return self.trust * corrected - torch.sin(angle)[:, None] * mean

    def correct(self, x: Tensor, angle: Tensor, condition: Tensor) -> Tensor:
        """The correction alone, shape (n, size)."""
        seen = torch.cat([x, time_features(angle), condition[:, None]], dim=1)
        correction: Tensor = self.correction(seen)
        return correction
