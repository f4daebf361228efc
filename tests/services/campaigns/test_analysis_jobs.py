"""Processes of analyses, without what they compute."""

import msgspec

from eigenfail.values.records import Job, JobKind
from eigenfail_services.campaigns import analysis_jobs as module
from eigenfail_services.campaigns.analysis_jobs import AnalysisJobs
from eigenfail_services.store import MemoryStore


class Process:
    """Runs for ever."""

    started = 0

    def __init__(self, *_args, **_named) -> None:
        Process.started += 1

    def poll(self) -> None:
        return


def test_our_own_lease_that_ran_out_starts_no_second_process(monkeypatch) -> None:
    monkeypatch.setattr(module.subprocess, "Popen", Process)
    renewed = []
    store = MemoryStore()
    monkeypatch.setattr(store.jobs, "renew", lambda job, _lease_s: renewed.append(job.token))
    analyses = AnalysisJobs(store, "memory://")
    job = Job(1, JobKind.ANALYSIS, 5, "old", 1)
    analyses.open(job)
    analyses.open(msgspec.structs.replace(job, token="new"))
    assert (len(analyses), Process.started) == (1, 1)
    analyses.tend()
    assert renewed == ["new"]
