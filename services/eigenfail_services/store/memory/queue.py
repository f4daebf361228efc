"""The job queue in memory."""

from collections.abc import Callable, Mapping
from uuid import uuid4

from eigenfail.values import Priority
from eigenfail.values.records import Job, JobKind
from eigenfail_services.store.clock import length_ms, steady_ms
from eigenfail_services.store.limits import BURIED, MAX_ATTEMPTS
from eigenfail_services.store.memory.tables import QueuedJob, Tables


class MemoryJobQueue:
    """Claims, leases and burials; attempts count the claims since the work last got further."""

    def __init__(
        self, tables: Tables, undertakers: Mapping[JobKind, Callable[[int, str], object]]
    ) -> None:
        self._tables = tables
        self._undertakers = undertakers

    def claim(self, owner: str, lease_s: float, kind: JobKind | None = None) -> Job | None:
        """The next job (of a kind) that nobody works on, now leased to the owner."""
        with self._tables.lock:
            while (job := self._first(kind)) is not None:
                self._lease(job, owner, lease_s)
                if job.attempts <= MAX_ATTEMPTS:
                    return Job(job.id, job.kind, job.subject, job.token, job.attempts)
                del self._tables.jobs[job.id]
                self._undertakers[job.kind](job.subject, BURIED)
        return None

    def renew(self, job: Job, lease_s: float) -> bool:
        """Hold the job longer, or, with 0, give it back; False if it is no longer ours."""
        with self._tables.lock:
            if (found := self._tables.held(job)) is None:
                return False
            found.lease_until_ms = steady_ms() + length_ms(lease_s)
        return True

    def let_go(self, is_lost: Callable[[str], bool]) -> int:
        """Free at once what is leased to owners that are lost; how many jobs that are."""
        with self._tables.lock:
            leased = [job for job in self._tables.jobs.values() if not free(job)]
            lost = [job for job in leased if is_lost(job.owner)]
            for job in lost:
                job.lease_until_ms = steady_ms()
        return len(lost)

    def finish(self, job: Job) -> bool:
        """The job is done; False if it was no longer ours."""
        with self._tables.lock:
            if self._tables.held(job) is None:
                return False
            del self._tables.jobs[job.id]
        return True

    def waiting(self, kind: JobKind) -> int:
        """How many jobs of a kind wait to be claimed."""
        with self._tables.lock:
            return sum(job.kind is kind and free(job) for job in self._tables.jobs.values())

    def _first(self, kind: JobKind | None) -> QueuedJob | None:
        waiting = [job for job in self._tables.jobs.values() if kind in (None, job.kind)]
        return min(filter(free, waiting), key=self._place, default=None)

    def _place(self, job: QueuedJob) -> tuple[int, int]:
        is_campaign = job.kind is JobKind.CAMPAIGN
        spec = self._tables.campaign(job.subject).spec if is_campaign else None
        priority = spec.priority if spec else Priority.NORMAL
        return job.queued_ms - priority.head_start_ms, job.id

    def _lease(self, job: QueuedJob, owner: str, lease_s: float) -> None:
        progress = self._progress(job)
        job.attempts = 1 if progress > job.progress else job.attempts + 1
        job.progress = progress
        job.owner, job.token = owner, uuid4().hex
        job.lease_until_ms = steady_ms() + length_ms(lease_s)

    def _progress(self, job: QueuedJob) -> int:
        if job.kind is not JobKind.CAMPAIGN:
            return 0
        counts = self._tables.campaign(job.subject).counts
        return counts.completed + counts.failed


def free(job: QueuedJob) -> bool:
    """Whether nobody holds it."""
    return job.lease_until_ms <= steady_ms()
