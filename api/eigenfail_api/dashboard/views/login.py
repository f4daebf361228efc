"""The page on which a browser shows a key."""

from dataclasses import dataclass


@dataclass(frozen=True)
class LoginView:
    """The form, and what was wrong with what was typed.

    Attributes:
        wanted: the address that comes next.
        needs_key: whether there is anything to sign in to.
        problem: of the last attempt.
    """

    wanted: str
    needs_key: bool = True
    problem: str = ""
