"""How many workers a service starts: a number that stays, or one that follows the work."""

import os

import msgspec

from eigenfail.errors import InvalidValue

IDLE_S = 60.0
LONGEST_IDLE_S = 86_400.0


class Span(msgspec.Struct, frozen=True):
    """Between which numbers of workers to choose, and how slowly to give them up.

    Attributes:
        least: so many even with nothing to do.
        most: never more.
        idle_s: how long fewer must have been enough before any is let go. [s]
    """

    least: int
    most: int
    idle_s: float = IDLE_S

    def options(self) -> tuple[str, ...]:
        """As the services are told of it."""
        if self.least == self.most:
            return ("--workers", str(self.most))
        bounds = ("--min-workers", str(self.least), "--max-workers", str(self.most))
        return (*bounds, "--idle-s", f"{self.idle_s:g}")


def span_of(workers: int | None, least: int | None, most: int | None, idle_s: float | None) -> Span:
    """Between which numbers to choose: the same one twice, unless there is a highest one.

    Args:
        workers: the number that stays; None is one per core.
        least: of a number that follows the work; None is 0.
        most: of the same; None is none at all: the number stays.
        idle_s: how long fewer must have been enough; None is a minute. [s]

    Raises:
        InvalidValue: they do not go together.
    """
    if most is None:
        _refuse_half(least, idle_s)
        return _make_fixed(workers)
    if workers is not None:
        problem = "is a number that stays, and --max-workers has it follow the work."
        raise InvalidValue("--workers", problem, "Give one of them.")
    return _make_scaled(least or 0, most, IDLE_S if idle_s is None else idle_s)


def _make_fixed(workers: int | None) -> Span:
    """Just so many, or one per core.

    Raises:
        InvalidValue: fewer than none.
    """
    n = _default_workers() if workers is None else workers
    if n < 0:
        raise InvalidValue("--workers", f"{n} is below 0.")
    return Span(n, n)


def _default_workers() -> int:
    """How many workers keep this machine busy."""
    return os.cpu_count() or 1


def _refuse_half(least: int | None, idle_s: float | None) -> None:
    """Raises InvalidValue if a bound of scaling is given, and nothing is to be scaled."""
    for option, given in (("--min-workers", least), ("--idle-s", idle_s)):
        if given is not None:
            remedy = "Add --max-workers; --workers is a number that stays."
            raise InvalidValue(option, "says how to scale, and nothing is scaled.", remedy)


def refuse_scaling(least: int | None, most: int | None, idle_s: float | None) -> None:
    """Raises InvalidValue if workers are to follow the work, and nobody here starts any."""
    for option, given in (("--max-workers", most), ("--min-workers", least), ("--idle-s", idle_s)):
        if given is not None:
            remedy = f"Leave {option} away, or have Ray start workers: --launcher ray."
            raise InvalidValue(option, "scales workers, and --launcher none starts none.", remedy)


def _make_scaled(least: int, most: int, idle_s: float) -> Span:
    """The span that was given.

    Raises:
        InvalidValue: it is none.
    """
    if not 0 <= least <= most:
        problem = f"{least} is not between 0 and --max-workers, which is {most}."
        raise InvalidValue("--min-workers", problem)
    if not 0.0 < idle_s <= LONGEST_IDLE_S:
        problem = f"{idle_s:g} is not above 0 and at most {LONGEST_IDLE_S:g} seconds."
        raise InvalidValue("--idle-s", problem)
    return Span(least, most, idle_s)
