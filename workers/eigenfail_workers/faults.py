"""Whose fault it was: an episode's trouble becomes a value, never a raised error."""

from collections.abc import Iterator
from contextlib import contextmanager

from eigenfail.errors import EpisodeError, InputError
from eigenfail.values import EpisodeFault

INPUT = "input"


@contextmanager
def blamed_on(kind: type[EpisodeError], what: str, remedy: str) -> Iterator[None]:
    """Turn what goes wrong inside into an error of that kind, unless its kind is known already."""
    try:
        yield
    except (EpisodeError, InputError):
        raise
    except Exception as error:
        told = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        raise kind(f"{what} raised {told}.", remedy) from error


def fault(error: EpisodeError | InputError) -> EpisodeFault:
    """What is recorded of an error that ended an episode."""
    kind = error.kind if isinstance(error, EpisodeError) else INPUT
    return EpisodeFault(kind, str(error))
