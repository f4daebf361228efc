"""`eigenfail` without its start: a process that has imported the command line forks for each call.

A page has a dozen commands, and each would import numpy, rich and the HTTP client anew: a second
of the processor. The fork gets the arguments, the folder, the environment, the input and the
outputs of whoever calls, and reads plug-ins anew. Commands that serve are the program itself.
"""

import atexit
import ctypes
import os
import signal
import socket
import subprocess
import sys
from functools import cache
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

PROGRAM = Path(sys.executable).with_name("eigenfail")
SERVING = ("up", "worker")
COMMANDS = ("main", "run", "campaign", "episode", "analyze", "gate", "suite", "doctor")
MODULES = (*(f"eigenfail.cli.{name}" for name in COMMANDS), "typer._adapters", "httpcore2")
"""What most commands import; they leave plug-ins and the environment to be read when they run."""

CALLER = f"""\
#!{sys.executable} -IS
import os, socket, sys
if sys.argv[1:2] and sys.argv[1] in {SERVING}:
    os.execv({str(PROGRAM)!r}, [{str(PROGRAM)!r}, *sys.argv[1:]])
fork = socket.socket(socket.AF_UNIX)
fork.connect(os.path.join(os.path.dirname(__file__), "socket"))
words = [os.getcwd(), str(len(sys.argv)), *sys.argv, *map("=".join, os.environ.items())]
socket.send_fds(fork, [b"fds"], [0, 1, 2])
fork.sendall("\\0".join(words).encode())
fork.shutdown(socket.SHUT_WR)
sys.exit(int(fork.recv(4)))
"""
"""Starts in a hundredth of a second, since it imports next to nothing."""

READY = b"ready\n"
PR_SET_PDEATHSIG = 1


@cache
def find_warm_command():
    """A folder for the PATH whose `eigenfail` imports nothing again, for as long as tests run."""
    folder = TemporaryDirectory(prefix="eigenfail-warm-")
    caller = Path(folder.name, "eigenfail")
    caller.write_text(CALLER)
    caller.chmod(0o755)
    hidden = ("PYTHONPATH", "EIGENFAIL")
    plain = {name: value for name, value in os.environ.items() if not name.startswith(hidden)}
    command = [sys.executable, __file__, caller.with_name("socket")]
    server = subprocess.Popen(command, env=plain, stdout=subprocess.PIPE)
    assert server.stdout.readline() == READY
    atexit.register(folder.cleanup)
    atexit.register(server.kill)
    return folder.name


def serve(address):
    """Fork for everyone who calls."""
    sys.path[0] = str(PROGRAM.parent)  # as of the program, and not the folder of this file
    for module in MODULES:
        import_module(module)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(address)
        listener.listen()
        os.write(1, READY)
        signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # forks tell the caller how they ended
        while True:
            caller, _ = listener.accept()
            if not os.fork():
                ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                answer(caller)
            caller.close()


def answer(caller):
    """Be the command that somebody calls; does not return."""
    _, outputs, *_ = socket.recv_fds(caller, len(b"fds"), 3)
    for number, output in enumerate(outputs):
        os.dup2(output, number)
        os.close(output)
    with caller.makefile("rb") as told:
        folder, count, *words = told.read().decode().split("\0")
    sys.argv = words[: int(count)]
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(word.split("=", 1) for word in words[int(count) :])
    sys.path[1:1] = filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))
    try:
        import_module("eigenfail.cli.main").main()
        code = 0
    except SystemExit as end:
        code = int(end.code or 0)
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    caller.sendall(str(code).encode())
    os._exit(0)


if __name__ == "__main__":
    serve(sys.argv[1])
