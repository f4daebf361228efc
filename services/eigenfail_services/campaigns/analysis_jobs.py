"""Analyses run in processes of their own: a heavy one slows nobody, a dying one dies alone."""

import os
import subprocess
import sys
import time

import msgspec

from eigenfail.contracts import Store
from eigenfail.errors import InputError
from eigenfail.processes import ONE_THREAD, as_parent, exit_status, kill_group
from eigenfail.values import Analysis, AnalysisResult
from eigenfail.values.records import Job
from eigenfail_services.bounds import NO_BOUNDS, Bounds
from eigenfail_services.campaigns.analysed import ground, notes, portions
from eigenfail_services.campaigns.mode_probability import with_probabilities
from eigenfail_services.campaigns.mode_words import mode_words
from eigenfail_services.hub.patience import Patience

LEASE_S = 30.0
DATABASE_VARIABLE = "EIGENFAIL_DATABASE"

LOOK = (
    "services.log in the data folder tells how it came to that (in a container: its standard"
    " error). Launch it again."
)

ROOM = (
    "Give the services' machine or container room for more processes and memory, and launch it"
    " again."
)

LONGER = (
    "Analyse fewer campaigns at a time or with a smaller bootstrap, or start the services with a"
    " larger --analysis-limit."
)


class RunningAnalysis(msgspec.Struct):
    """A process, the job that it works on, and when that job's lease is to be renewed."""

    job: Job
    process: "subprocess.Popen[bytes]"
    patience: Patience
    renew_s: float = 0.0


class AnalysisJobs:
    """Starts a process for each claimed analysis, and sees how it ends.

    Args:
        database: URL of the store; handed on in the environment, where no list of processes
            shows its password.
        bounds: of each process.
    """

    def __init__(self, store: Store, database: str, bounds: Bounds = NO_BOUNDS) -> None:
        self._store = store
        self._bounds = bounds
        self._environment = os.environ | ONE_THREAD | as_parent() | {DATABASE_VARIABLE: database}
        self._running: list[RunningAnalysis] = []

    def __len__(self) -> int:
        """How many are running."""
        return len(self._running)

    def open(self, job: Job) -> None:
        """Start on an analysis, unless it is our own lease on it that ran out."""
        for running in self._running:
            if running.job.subject == job.subject:
                running.job = job
                return
        try:
            self._running.append(self._started(job))
        except OSError as error:
            problem = f"The analysis process could not be started: {error.strerror}. {ROOM}"
            self._store.analyses.fail(job.subject, problem)
            self._store.jobs.finish(job)

    def _started(self, job: Job) -> RunningAnalysis:
        command = [sys.executable, "-m", "eigenfail_services", "analyse", str(job.subject)]
        process = subprocess.Popen(command, env=self._environment, process_group=0)
        self._bounds.confine(process.pid)
        return RunningAnalysis(job, process, Patience(self._bounds.time_s))

    def tend(self) -> None:
        """Renew the leases of those that run, conclude those that have ended."""
        self._running = [running for running in self._running if not self._ended(running)]

    def _ended(self, running: RunningAnalysis) -> bool:
        status = exit_status(running.process)
        if status is None and not running.patience.is_over():
            self._renew(running)
            return False
        if status is not None and status < 0:
            # Killed, by nobody of this house: whoever claims the job next starts it anew.
            kill_group(running.process)
            self._store.jobs.renew(running.job, 0.0)
            return True
        if problem := self._problem(status):
            self._store.analyses.fail(running.job.subject, problem)
        kill_group(running.process)
        self._store.jobs.finish(running.job)
        return True

    def _problem(self, status: int | None) -> str:
        """What is told of one that is over, or takes too long; empty if it went well."""
        if status is None:  # it would take as long the next time
            took = f"The analysis took more than {self._bounds.time_s:g} s, and was broken off."
            return f"{took} {LONGER}"
        return f"The analysis process ended with status {status}. {LOOK}" if status else ""

    def _renew(self, running: RunningAnalysis) -> None:
        if time.monotonic() >= running.renew_s:
            running.renew_s = time.monotonic() + LEASE_S / 3
            self._store.jobs.renew(running.job, LEASE_S)

    def stop(self) -> None:
        """End all of them; the next supervisor starts them anew."""
        for running in self._running:
            kill_group(running.process)
            self._store.jobs.renew(running.job, 0.0)


def run_analysis(store: Store, analysis_id: int) -> None:
    """Analyse the failures of a campaign and keep what was found, or why nothing could be."""
    analysis = store.analyses.get(analysis_id)
    store.analyses.start(analysis_id)
    try:
        store.analyses.finish(analysis_id, found(store, analysis))
    except InputError as error:
        store.analyses.fail(analysis_id, str(error))
    except Exception as error:
        problem = f"The analysis broke off with {type(error).__name__}: {error}."
        store.analyses.fail(analysis_id, f"{problem} {LOOK}")
        raise


def found(store: Store, analysis: Analysis) -> AnalysisResult:
    """What an analysis finds in the failures that there are by now.

    Raises:
        InvalidValue: there is no failure, or one that does not fit; or the campaigns do not go
            together.
    """
    # scikit-learn takes a second to load.
    from eigenfail_services.analysis.digest import result_digest
    from eigenfail_services.analysis.gathering import Portion, gather
    from eigenfail_services.analysis.job import analyse_gathered

    begun = ground(store, analysis.campaign, analysis.settings)
    read = (Portion(*each) for each in portions(store, begun.campaigns))
    failures = gather(read, begun.horizon, analysis.settings)
    base = begun.recounted(store)
    result = analyse_gathered(failures, analysis.settings, base.step_s, base.ended)
    whole = msgspec.structs.replace(
        with_probabilities(store, base.campaigns, result),
        sources=base.sources(result.campaigns),
        notes=notes(base),
        words=mode_words(store, analysis, result, base.step_s),
    )
    return msgspec.structs.replace(whole, digest=result_digest(whole))
