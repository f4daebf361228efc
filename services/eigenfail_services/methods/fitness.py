"""What settings can say of the campaign that they are for, before anything is learnt."""

from typing import Protocol, runtime_checkable


@runtime_checkable
class Budgeted(Protocol):
    """Settings that a budget may be too small for."""

    def check_budget(self, episodes: int) -> None:
        """Raises InvalidValue if the budget is too small."""


@runtime_checkable
class Particular(Protocol):
    """Settings under some of which a method that estimates a probability tells none."""

    def no_estimate(self) -> str:
        """Why there will be none, and what to do; empty where there will be one."""
