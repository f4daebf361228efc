"""How long a person or a campaign waits for something to start."""

import subprocess
import time
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import psutil
import zmq
from benchmarks.figures import ROOT, Figure, summarize_runs

from eigenfail import plugins
from eigenfail.hosting.service import Launcher, LocalService, Plan, local_service
from eigenfail.wire.messages import Goodbye, Hello, encode, read_worker_message
from eigenfail_services.campaigns.ray_process import RayCluster, RayWorkers

RUNS = 5

TEN_EPISODES = """
name = "ten"
method = "monte_carlo"
episodes = 10
scenario = "cut_in"
"""


def cli_help() -> Figure:
    """Wall time of `eigenfail --help`."""
    times = []
    for _ in range(RUNS):
        before = time.perf_counter()
        subprocess.run([ROOT / ".venv/bin/eigenfail", "--help"], capture_output=True, check=True)
        times.append(time.perf_counter() - before)
    return summarize_runs(times, "s", "<= 0.5")


def run_cold() -> Figure:
    """Wall time of `eigenfail run` with ten episodes, where no service runs."""
    times = []
    for _ in range(RUNS):
        with TemporaryDirectory() as folder:
            file = Path(folder, "ten.toml")
            file.write_text(TEN_EPISODES)
            command = (ROOT / ".venv/bin/eigenfail", "run", file, "--data", Path(folder, "data"))
            before = time.perf_counter()
            subprocess.run(command, capture_output=True, check=True)
            times.append(time.perf_counter() - before)
    return summarize_runs(times, "s", "<= 4")


def programme_figures() -> dict[str, Figure]:
    """Wall time of the experiments of a paper, where no service runs; a plug-in brings them."""
    if "reproduce" not in plugins.names(plugins.COMMANDS):
        return {}
    with TemporaryDirectory() as folder:
        command = [ROOT / ".venv/bin/eigenfail", "reproduce", "--scale", "full", "--data", folder]
        before = time.perf_counter()
        subprocess.run(command, capture_output=True, check=True)
        wall_s = time.perf_counter() - before
    return {"paper_programme_s": summarize_runs([wall_s], "s", "<= 120")}


def service_figures(launcher: Launcher) -> dict[str, Figure]:
    """From the start of a service with two workers until it serves, and its memory then."""
    times, sizes = [], []
    for _ in range(RUNS):
        with TemporaryDirectory() as folder:
            before = time.perf_counter()
            plan = Plan(Path(folder, "data"), port=0, workers=2, launcher=launcher)
            with local_service(plan) as service:
                times.append(time.perf_counter() - before)
                sizes.append(measure_memory(service))
    return {
        f"ready_{launcher}_s": summarize_runs(times, "s", "<= 5"),
        f"ready_{launcher}_mb": summarize_runs(sizes, "MiB", "<= 500"),
    }


def measure_memory(service: LocalService) -> float:
    """Return the memory of all processes of a service, shared parts counted once. [MiB]"""
    size = 0
    for part in (psutil.Process(part.process.pid) for part in service.parts):
        for each in (part, *part.children(recursive=True)):
            with suppress(psutil.NoSuchProcess):
                size += each.memory_full_info().pss
    return size / 2**20


def worker_ready() -> Figure:
    """From asking Ray for an actor until it said hello: the hub answers that with a lease."""
    router = zmq.Context.instance().socket(zmq.ROUTER)
    port = router.bind_to_random_port("tcp://127.0.0.1")
    cluster, workers = RayCluster(None, most=1), RayWorkers(f"tcp://127.0.0.1:{port}")
    times = []
    for _ in range(RUNS):
        before = time.perf_counter()
        workers.want(["w"])
        times.append(time_of_hello(router) - before)
        workers.dismiss()
    cluster.close()
    router.close(linger=0)
    return summarize_runs(times, "s", "<= 5")


def time_of_hello(router: "zmq.Socket[bytes]") -> float:
    """When the next worker says hello; it is sent home again."""
    while True:
        worker, data = router.recv_multipart()
        if isinstance(read_worker_message(data), Hello):
            said = time.perf_counter()
            router.send_multipart([worker, encode(Goodbye())])
            return said
