"""What hands out work."""

from collections.abc import Callable
from typing import Protocol

from eigenfail.values.records import Job, JobKind


class JobQueue(Protocol):
    """Work for supervisors: claimed under a lease, back in the queue when the lease runs out."""

    def claim(self, owner: str, lease_s: float, kind: JobKind | None = None) -> Job | None:
        """The next job (of a kind) that nobody works on, now leased to the owner.

        That is the oldest, where each campaign counts as older by its priority's head start.
        A job that was claimed too often is buried with its reason instead, and its subject fails.
        """

    def renew(self, job: Job, lease_s: float) -> bool:
        """Hold the job longer; False if it is no longer ours."""

    def let_go(self, is_lost: Callable[[str], bool]) -> int:
        """Free at once what is leased to owners that are lost; how many jobs that are."""

    def finish(self, job: Job) -> bool:
        """The job is done; False if it was no longer ours."""

    def waiting(self, kind: JobKind) -> int:
        """How many jobs of a kind wait to be claimed."""
