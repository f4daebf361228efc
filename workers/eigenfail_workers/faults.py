"""Errors of episodes, and the faults that are recorded for them."""

import signal
from collections.abc import Sequence

from eigenfail import errors
from eigenfail.errors import EpisodeError, InputError, describe_error, read_text
from eigenfail.values.episode import EpisodeFault, EpisodeResult

INPUT = "input"


class wrap_errors:  # noqa: N801 - it is used like a function, as other context managers are
    """Turn exceptions of the block into errors of a kind, unless they have one already.

    SystemExit and similar exceptions are turned into errors, too: a plug-in may not end this
    process. Only KeyboardInterrupt remains, if Ctrl-C can cause it: workers' inner processes ignore
    Ctrl-C.

    This is a class, because a generator would take longer than a step of physics.
    """

    def __init__(self, kind: type[EpisodeError], what: str, remedy: str) -> None:
        self._kind = kind
        self._what = what
        self._remedy = remedy

    def __enter__(self) -> None:
        """Begin the block."""

    def __exit__(self, _kind: object, error: BaseException | None, _traceback: object) -> None:
        """Raise an error of the kind from an exception of the block."""
        if error is None or isinstance(error, EpisodeError | InputError):
            return
        if not isinstance(error, KeyboardInterrupt) or not can_be_interrupted():
            problem = f"{self._what} raised {describe_error(error)}."
            raise self._kind(problem, self._remedy) from error


def can_be_interrupted() -> bool:
    """Return whether Ctrl-C raises KeyboardInterrupt in this process."""
    return signal.getsignal(signal.SIGINT) != signal.SIG_IGN


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
        kind: kind of the error.
        culprit: part that changed the state, such as "the planner 'mine'".
        changes: the changes, as `ProcessState.changes` names them.
        result: result of the episode; its own fault may be a consequence, and is quoted.
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
