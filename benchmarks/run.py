"""Measure everything that is promised about speed, and write benchmarks/latest.json."""

from analysis import analysis_figures
from bridge import bridge_figures
from difs_sampling import difs_sampling_figures
from figures import ROOT, show, write
from handwritten_programs import failure_figures, ledger_figures
from hub import hub_figures
from pages import page_figures
from planner import planner_figures
from recovery import recovery_figures
from sac import sac_figures
from scale import scale_figures
from service import service_figures
from start_up import cli_help, programme_figures, run_cold, worker_ready
from start_up import service_figures as waiting_figures
from waiting import learner_share

from eigenfail.hosting.service import Launcher


def main() -> None:
    """Measure, write, show."""
    hub = hub_figures()
    figures = {
        "cli_help_s": cli_help(),
        "worker_ready_s": worker_ready(),
        "run_cold_s": run_cold(),
        **programme_figures(),
        **waiting_figures(Launcher.RAY),
        **waiting_figures(Launcher.LOCAL),
        **analysis_figures(),
        **page_figures(),
        **planner_figures(),
        **sac_figures(),
        **difs_sampling_figures(),
        **failure_figures(),
        **ledger_figures(),
        "learner_share": learner_share(),
        **service_figures(),
        **bridge_figures(),
        **recovery_figures(),
        **hub,
        **scale_figures(hub),
    }
    write(ROOT / "benchmarks" / "latest.json", figures)
    show(figures)


if __name__ == "__main__":
    main()
