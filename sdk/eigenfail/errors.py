"""Every error that eigenfail raises on purpose.

EigenfailError
├── InputError               a request that cannot be carried out as it was made
│   ├── UnknownName          no plug-in, setting or parameter of that name
│   └── InvalidValue         a value outside its type or bounds
├── Unauthorized             the key is missing or invalid
├── Forbidden                the key does not allow the request
│   └── QuotaExceeded        a quota of the key is exhausted
├── NotFound                 no campaign, episode or analysis of that id
├── Conflict                 the state of the object forbids the request
│   ├── IllegalTransition    a campaign cannot go from its state to the requested state
│   ├── IdempotencyMismatch  one Idempotency-Key, two different requests
│   ├── PreconditionFailed   the object no longer matches `If-Match`
│   └── NoisePruned          the noise of an episode was deleted to free space
├── EpisodeError             one episode cannot be completed; its campaign continues
│   ├── SimulatorError
│   ├── PlannerError
│   ├── SolverError
│   └── BridgeLost           the process that runs the episode is lost
├── ProtocolError            a message that does not follow the wire contract
└── ServiceError             a part of the service is missing or in trouble
    ├── StoreUnavailable
    │   ├── StoreUnwritable  the database is read-only: its disk is full
    │   └── StoreDamaged     the database file was truncated or overwritten
    ├── SchemaMismatch
    ├── PortTaken
    ├── ClaimLost
    ├── ClusterUnavailable
    ├── LearnerFailed
    │   └── LearnerDiverged  a number in the learner is NaN or infinite
    ├── ServiceBusy
    ├── WaitTimeout          the operation continues after the wait
    └── ServiceUnreachable

Each class has its HTTP status and its command-line exit code; only this file defines them.
"""

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any, ClassVar
from unicodedata import category

LONGEST_TEXT = 4_000
"""Characters that are kept of the text of one error; each errored episode stores its own."""


LONGEST_NAME = 200


KEPT = frozenset("\n\t")


UNSAFE = frozenset({"Cc", "Cf", "Cs"})
"""Unicode categories: control characters, invisible format characters, and surrogates."""


JOINERS = frozenset("\u200c\u200d")
"""Format characters that Persian, Indian scripts and emoji need; they reorder and hide nothing."""


def is_unsafe(letter: str) -> bool:
    """Return whether a character could change how the text around it is read or printed.

    Unsafe are control characters, lone surrogates and invisible format characters: characters that
    reverse the direction of text (U+202E lets `gnp.exe` read `exe.png`) or have zero width.
    """
    return category(letter) in UNSAFE and letter not in JOINERS


def find_hidden(text: str) -> str:
    """Return the first invisible format character of a text, as U+202E; empty if it has none."""
    if text.isascii():
        return ""
    found = (letter for letter in text if category(letter) == "Cf" and letter not in JOINERS)
    return next((f"U+{ord(letter):04X}" for letter in found), "")


CUT = " … (cut off)"


def clean_text(text: str, longest: int = LONGEST_TEXT) -> str:
    """Return the text without characters that a message, a log or a database cannot hold.

    Control characters other than newline and tab, invisible format characters and lone surrogates
    become their Python escapes.

    Args:
        text: any text.
        longest: maximum length; a longer text is cut off. [characters]
    """
    plain = "".join((text[: longest + 1],))  # an exact str, also of a subclass
    # Most texts are printable, and need no look at each letter.
    if not plain.isprintable():
        plain = "".join(map(_escape, plain))
    return plain if len(plain) <= longest else f"{plain[: longest - len(CUT)]}{CUT}"


def _escape(letter: str) -> str:
    if letter in KEPT or not is_unsafe(letter):
        return letter
    return letter.encode("unicode_escape").decode("ascii")


def read_text(thing: object, longest: int = LONGEST_TEXT) -> str:
    """Return `str(thing)`, cleaned of unsafe characters, even if `__str__` raises."""
    try:
        return clean_text(str(thing), longest)
    except (Exception, SystemExit):  # noqa: BLE001 - a stranger's `__str__` may raise anything
        return f"<the text of this {_type_name(thing)} cannot be read>"


def describe_error(error: BaseException) -> str:
    """Return the type and the text of an error, as in the last line of a traceback."""
    name, text = _type_name(error), read_text(error)
    return f"{name}: {text}" if text else name


def _type_name(thing: object) -> str:
    kind: Any = type(thing)
    try:
        return clean_text(kind.__name__, LONGEST_NAME)
    except (Exception, SystemExit):  # noqa: BLE001 - so may a metaclass
        return "object of an unnamed type"


LONGEST_SENTENCE = 20_000
"""Characters; longer than any list of known names that a message of ours holds."""


class EigenfailError(Exception):
    """Base of all errors: one sentence on the error and its place, one on the remedy."""

    http_status: ClassVar[int] = 500
    exit_code: ClassVar[int] = 3

    def __init__(self, problem: str, remedy: str = "") -> None:
        # Problems quote what plug-ins raise and users type, and go into messages, JSON and SQL.
        self.problem = read_text(problem, LONGEST_SENTENCE)
        self.remedy = read_text(remedy, LONGEST_SENTENCE)
        super().__init__(f"{self.problem} {self.remedy}".strip())


def suggest_name(name: str, known: Iterable[str]) -> str:
    """Return the most similar known name as a question, and all known names, as text."""
    names = sorted(known)
    if not names:
        return "There are none."
    close = get_close_matches(name, names, n=1)
    hint = f"Did you mean '{close[0]}'? " if close else ""
    return f"{hint}Known: {', '.join(names)}."


class InputError(EigenfailError):
    """A request that cannot be carried out as it was made."""

    http_status = 422
    exit_code = 2

    def __init__(self, field: str, problem: str, remedy: str = "") -> None:
        super().__init__(f"{field}: {problem}" if field else problem, remedy)
        self.field = read_text(field)


class UnknownName(InputError):
    """No plug-in, setting or parameter has that name; the known ones are listed.

    Args:
        field: path of the refused name.
        name: the unknown name.
        known: the known names.
        problem: sentence on the unknown name; default: the name is not known.
    """

    def __init__(self, field: str, name: str, known: Iterable[str], problem: str = "") -> None:
        self.known = sorted(known)
        problem = problem or f"'{name}' is not known."
        super().__init__(field, problem, suggest_name(name, self.known))
        self.name = read_text(name)


class InvalidValue(InputError):
    """A value outside its type or bounds."""


class Unauthorized(EigenfailError):
    """The key is missing or invalid."""

    http_status = 401
    exit_code = 2


class Forbidden(EigenfailError):
    """The key does not allow the request."""

    http_status = 403
    exit_code = 2


class QuotaExceeded(Forbidden):
    """A quota of the key is exhausted; the message names it, with its limit."""


class NotFound(EigenfailError):
    """No campaign, episode or analysis has that id."""

    http_status = 404
    exit_code = 2


class Conflict(EigenfailError):
    """The object exists, but its state forbids the request."""

    http_status = 409
    exit_code = 2


class IllegalTransition(Conflict):
    """A campaign cannot go from its state to the requested state."""


class IdempotencyMismatch(Conflict):
    """One Idempotency-Key was used for two different requests."""


class PreconditionFailed(Conflict):
    """The object does not match, or no longer matches, the request's `If-Match`."""

    http_status = 412


class NoisePruned(Conflict):
    """An episode's row exists, but its noise was deleted to free space."""

    http_status = 410


class EpisodeError(EigenfailError):
    """One episode cannot be completed: it is recorded as errored, and its campaign continues."""

    kind: ClassVar[str] = "simulator"


class SimulatorError(EpisodeError):
    """The simulator raised, or returned a value that is not a scene."""


class PlannerError(EpisodeError):
    """The planner raised, or returned a value that is not a control."""

    kind = "planner"


class SolverError(EpisodeError):
    """A solver inside the planner gave no usable answer, and the planner is without a fallback."""

    kind = "solver"


class BridgeLost(EpisodeError):
    """The bridge is lost, forgot this worker, or is full: the episode is not at fault."""

    http_status = 503
    kind = "infrastructure"


class ProtocolError(EigenfailError):
    """A message does not follow the wire contract."""

    http_status = 400


class ServiceError(EigenfailError):
    """A part of the service is missing or in trouble."""

    http_status = 503


class StoreUnavailable(ServiceError):
    """The database cannot be reached or written."""


class StoreUnwritable(StoreUnavailable):
    """The database can be read but not written: its disk is full or read-only."""


class StoreDamaged(StoreUnavailable):
    """The database's file was truncated or overwritten: it must be restored from a backup."""


class SchemaMismatch(ServiceError):
    """The database's schema does not match this program."""


class PortTaken(ServiceError):
    """Another process listens on the requested address."""


class ClaimLost(ServiceError):
    """Another service has taken over this service's work, so this one must stop writing."""


class ClusterUnavailable(ServiceError):
    """Ray is missing or cannot be started."""


class LearnerFailed(ServiceError):
    """The learner process of a campaign ended before its campaign did."""


class LearnerDiverged(LearnerFailed):
    """A number in the learner became NaN or infinite: it can be restored, but not continue."""


class ServiceBusy(ServiceError):
    """Too many requests wait for the same kind of work; a later request may succeed."""


class WaitTimeout(ServiceError):
    """The work did not end within the caller's time limit, and continues."""


class ServiceUnreachable(ServiceError):
    """No eigenfail service answers at the address."""
