"""Faults: the error of an episode becomes a value of its result, which names the culprit."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from eigenfail import errors
from eigenfail.error_text import describe_error, read_text
from eigenfail.errors import EpisodeError, InputError
from eigenfail.values import EpisodeFault, EpisodeResult

INPUT = "input"


@contextmanager
def wrap_errors(kind: type[EpisodeError], what: str, remedy: str) -> Iterator[None]:
    """Turn exceptions of the block into errors of a kind, unless they have one already."""
    try:
        yield
    except (EpisodeError, InputError):
        raise
    except Exception as error:
        raise kind(f"{what} raised {describe_error(error)}.", remedy) from error


def make_fault(error: EpisodeError | InputError) -> EpisodeFault:
    """Return the fault that is recorded for an error which ended an episode."""
    kind = _find_kind(error) if isinstance(error, EpisodeError) else INPUT
    return EpisodeFault(kind, read_text(error))


def _find_kind(error: EpisodeError) -> str:
    """Return the kind of the nearest class in `eigenfail.errors`; plug-ins may claim any kind."""
    classes = (each for each in type(error).__mro__ if each.__module__ == errors.__name__)
    return str(next(classes).kind)  # type: ignore[attr-defined]


def make_state_change_error(
    kind: type[EpisodeError], culprit: str, changes: Sequence[str], result: EpisodeResult
) -> EpisodeError:
    """Return the error of an episode that has changed process-wide state.

    Args:
        kind: of the error.
        culprit: what changed it, such as "the planner 'mine'".
        changes: what was changed, as `ProcessState.changes` names it.
        result: of the episode; its own fault may be a consequence, and is quoted.
    """
    problem = (
        f"{culprit[0].upper()}{culprit[1:]} changed process-wide state during the episode: "
        f"{'; '.join(changes)}."
    )
    if result.fault is not None:
        problem = f"{problem} The episode ended with: {result.fault.message}"
    return kind(
        problem,
        "Restore it before each call returns, or change it when the module is imported.",
    )
