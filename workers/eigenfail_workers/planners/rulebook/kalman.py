"""Kalman filter along one axis, in plain floats: at this size numpy only adds overhead."""


class AxisFilter:
    """Kalman filter of a position and its constant velocity along one axis.

    Attributes:
        position_m: estimate.
        velocity_mps: estimate.
        p00: variance of the position [m²]; p01 covariance [m²/s]; p11 of the velocity [m²/s²].
    """

    __slots__ = ("p00", "p01", "p11", "position_m", "velocity_mps")

    def __init__(
        self, position_m: float, velocity_mps: float, position_sd_m: float, velocity_sd_mps: float
    ) -> None:
        self.position_m = position_m
        self.velocity_mps = velocity_mps
        self.p00 = position_sd_m * position_sd_m
        self.p01 = 0.0
        self.p11 = velocity_sd_mps * velocity_sd_mps

    def predict(self, dt_s: float, acceleration_sd_mps2: float) -> None:
        """One step ahead, under a random acceleration that is constant within the step."""
        self.position_m += self.velocity_mps * dt_s
        noise = acceleration_sd_mps2 * acceleration_sd_mps2 * dt_s * dt_s
        self.p00 += dt_s * (2.0 * self.p01 + dt_s * self.p11) + 0.25 * noise * dt_s * dt_s
        self.p01 += dt_s * self.p11 + 0.5 * noise * dt_s
        self.p11 += noise

    def surprise(self, measured_m: float, variance_m2: float) -> float:
        """The squared innovation over its variance."""
        innovation = measured_m - self.position_m
        return innovation * innovation / (self.p00 + variance_m2)

    def correct(self, measured_m: float, variance_m2: float) -> None:
        """Take a measurement in."""
        total = self.p00 + variance_m2
        gain, velocity_gain = self.p00 / total, self.p01 / total
        innovation = measured_m - self.position_m
        self.position_m += gain * innovation
        self.velocity_mps += velocity_gain * innovation
        self.p11 -= velocity_gain * self.p01
        self.p00 *= 1.0 - gain
        self.p01 *= 1.0 - gain
