"""The network that DiFS trains: what distinguishes dangerous noise from ordinary noise."""

import torch
from torch import Tensor, nn

CONDITION = 2

TIME = 4


def condition_features(condition: Tensor, known: Tensor) -> Tensor:
    """Whether the condition (robustness ÷ its median) is known, and its value, shape (n, 2)."""
    return torch.stack([known, known * condition], dim=1)


def time_features(angle: Tensor) -> Tensor:
    """Features of the diffusion time, shape (n, 4)."""
    turns = [torch.sin(angle), torch.cos(angle), torch.sin(2 * angle), torch.cos(4 * angle)]
    return torch.stack(turns, dim=1)


class Denoiser(nn.Module):
    """v(x_t, t, r) = -sin(t) · (1 - r) · shift + correction(x_t, t, r), zero before training.

    For a standard normal v is zero, so the untrained network samples the prior exactly; for a
    normal with its mean moved by m(r), v = -sin(t) · m(r) exactly. The first term is that mean,
    in proportion to how far robustness lies below its median: one direction, because every
    further freedom learns the accidents of a few dozen trajectories. The second term learns what
    the mean does not explain: widths, several modes.

    Args:
        size: number of components of a trajectory.
        width: of the hidden layers.
    """

    def __init__(self, size: int, width: int) -> None:
        super().__init__()
        self.shift = nn.Linear(1, size, bias=False)
        self.correction = nn.Sequential(
            nn.Linear(size + TIME + CONDITION, width),
            nn.SiLU(),
            nn.Linear(width, width),
            nn.SiLU(),
            nn.Linear(width, size),
        )
        for output in (self.shift, self.correction[-1]):
            for parameter in output.parameters():
                nn.init.zeros_(parameter)

    def forward(self, x: Tensor, angle: Tensor, condition: Tensor, known: Tensor) -> Tensor:
        """v, shape (n, size); `known` is 0 where the condition shall not be looked at, else 1."""
        features = condition_features(condition, known)
        mean: Tensor = self.shift((known * (1.0 - condition))[:, None])
        seen = torch.cat([x, time_features(angle), features], dim=1)
        correction: Tensor = self.correction(seen)
        v: Tensor = correction - torch.sin(angle)[:, None] * mean
        return v
