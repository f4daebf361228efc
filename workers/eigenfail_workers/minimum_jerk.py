"""The path of least jerk from rest to rest."""


def minimum_jerk(share: float) -> tuple[float, float]:
    """The quintic from 0 to 1 of least jerk, and its slope, at a share of the way in [0, 1].

    10 s³ − 15 s⁴ + 6 s⁵ (Flash and Hogan, The coordination of arm movements, 1985, eq. 7).
    """
    done = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    return done, 30.0 * (share * (1.0 - share)) ** 2
