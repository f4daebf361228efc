"""Standard normal z to injected metres a, and back: the one place where it is done."""

from eigenfail.values.disturbance.shapes import Pair, Shape


class Conversion:
    """Converts the noise of one episode, step by step from its start, in either direction.

    Metres are added to what is perceived as the nearest vehicle's position; should another vehicle
    become the nearest, the noise goes on.
    """

    def __init__(self, shape: Shape) -> None:
        self._shape = shape
        self._before: Pair | None = None

    def to_metres(self, z: Pair, sigma: Pair) -> Pair:
        """a_t = sigma_t · u_t, longitudinal and lateral. [m]"""
        u = self._shape.step(z, self._before)
        self._before = u
        return u[0] * sigma[0], u[1] * sigma[1]

    def to_z(self, a: Pair, sigma: Pair) -> Pair:
        """z_t of the metres injected at that sigma."""
        u = a[0] / sigma[0], a[1] / sigma[1]
        z = self._shape.step_back(u, self._before)
        self._before = u
        return z
