"""Types the code blocks of a page into a shell, as a reader does.

The shell stands in a copy of what a reader has cloned. A second terminal, in which a page says to
start a service, is a process in the background. What a page writes to a file, by the file's name in
the first line of a block, is written. These things differ from what a reader types:

- the port of a service or bridge
- who starts the one worker: Ray on one page and the test on the others
- `eigenfail` is warm_command.py's, except on pages that activate the environment
- an episode whose line says "a number from the list" is the first that a line before has listed
- budgets, as REPLACED, CHEAPER and SHARE say
"""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import tomllib
from contextlib import contextmanager, suppress
from pathlib import Path
from types import MappingProxyType

import deadlines
import msgspec
from warm_command import find_warm_command

from eigenfail.cli.specs import check_plugins
from eigenfail.hosting.folder import DataFolder
from eigenfail.suites import Suite, replace_references
from eigenfail.values.campaign_spec import CampaignSpec

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FILE_NAME = re.compile(r"(?:# |\{# )([\w./-]+\.\w+)(?: #\})?\n")
EPISODES = re.compile(r"(?<=^episodes = )\d+$", re.MULTILINE)
CHEAPER = (
    ("suite.toml", "episodes = 200", "episodes = 8"),
    ("suite.toml", "[53.0, 58.0, 63.0]", "[53.0]"),
    ("regression.toml", "episodes = 200", "episodes = 8"),
    ("challenges.toml", "episodes = 400", "episodes = 8"),
    ("ast.toml", "episodes = 400", "episodes = 40"),
    ("ast.toml", "[settings]", "[settings]\ngradient_steps = 1"),
    ("difs.toml", "[settings]", "[settings]\nfirst_steps = 30\nsteps = 10"),
)
"""What is replaced in which file of examples/, and by what."""

FROM_LIST = re.compile(r"(\d+)/\d+(?=.*# .*a number from the list)")
END = "@@ended"
READY_WITHIN_S = deadlines.CAMPAIGN_S
COMMAND_WITHIN_S = deadlines.CAMPAIGN_S
GATE_CLOSED = 1
CURL_TIMED_OUT = 28
REPLACED = {
    "--replay 20": "--replay 3",
    "--seeds 5": "--seeds 2",
    "monte_carlo.toml --episodes 400": "monte_carlo.toml --episodes 40",
    "ast.toml --episodes 300": "ast.toml --episodes 150",
}
SHARE = 2
"""A campaign in a file that a page has its reader write runs one episode of so many."""


NO_KINDS = MappingProxyType({})
EXECUTED = {"sh", "python", "toml", "html"}
SHOWN = {"": "a drawing", "text": "output or a drawing", "json": "messages", "yaml": "a fragment"}


def blocks(page):
    """The blocks of a page that are executed, with their languages."""
    text = (ROOT / page).read_text()
    return [(name, body) for name, body in BLOCK.findall(text) if name in EXECUTED]


def reason(command, not_run):
    """Why a command is not run; None of one that is."""
    return next((why for start, why in not_run.items() if command.startswith(start)), None)


def commands(block):
    """The commands of a shell block, continued lines joined."""
    lines = block.replace("\\\n", " ").splitlines()
    return [line for line in lines if line.partition("#")[0].strip()]


def free_port():
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


class Shell:
    """A shell that a page is typed into, in a copy of the repository.

    Attributes:
        output: of all commands so far.
        allowed: exit codes of commands that begin like this; the last entry that fits counts.
        replaced: what is replaced in the commands of a page, and by what.
    """

    def __init__(self, clone, site):
        self.clone, self.output = clone, ""
        self.allowed, self.replaced = {}, dict(REPLACED)
        self._bridge, self._services, self._data = free_port(), [], None
        environment = {
            **{name: value for name, value in os.environ.items() if "EIGENFAIL" not in name},
            # A page that activates the environment, as the quickstart does, has the program itself.
            "PATH": f"{find_warm_command()}:{Path(sys.executable).parent}:{os.environ['PATH']}",
            "PYTHONPATH": str(site),
            "COLUMNS": "200",
        }
        self._shell = subprocess.Popen(
            ["bash", "--noprofile", "--norc"],
            cwd=clone,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        # As a reader types `pip install .`, but beside the environment of the tests.
        options = "--disable-pip-version-check --quiet --no-deps --no-index --no-build-isolation"
        self.type(f'pip() {{ python -m pip "$1" {options} --target {site} "${{@:2}}"; }}')

    def type(self, line, allowed=(0,)):
        """Run a line to its end.

        Returns:
            What it printed.
        """
        self._shell.stdin.write(f"{line}\necho {END} $?\n")
        self._shell.stdin.flush()
        printed, marker, code = [], "", ""
        # The command holds the output, too: it would be waited for if only the shell ended.
        watch = threading.Timer(COMMAND_WITHIN_S, self._kill)
        watch.start()
        for text in self._shell.stdout:
            before, marker, code = text.partition(END)
            printed.append(before)
            if marker:
                break
        watch.cancel()
        self.output += f"$ {line}\n{''.join(printed)}"
        assert marker, f"The shell ended, or a command took too long:\n{self.output}"
        assert int(code) in allowed, f"Exit code {code.strip()}:\n{self.output}"
        return "".join(printed)

    def run(self, line):
        """Run a line of a page, as it stands there but for ports and listed episodes."""
        line = line.replace("127.0.0.1:9000", f"127.0.0.1:{self._bridge}")
        words = line.partition("#")[0].split()
        if words[:2] == ["eigenfail", "up"]:
            self.serve(" ".join(words[2:]))
            return
        for stands, instead in self.replaced.items():
            line = line.replace(stands, instead)
        if found := FROM_LIST.search(line):
            line = FROM_LIST.sub(f"{found[1]}/{self._listed(found[1])}", line, count=1)
        allowed = (0, GATE_CLOSED) if {"gate", "--gate"} & set(words) else (0,)
        for start, codes in self.allowed.items():
            allowed = codes if line.startswith(start) else allowed
        if "--max-time" in words:
            allowed = (0, CURL_TIMED_OUT)
        self.type(line.replace("http://127.0.0.1:8440", self.url), allowed)

    def serve(self, options):
        """`eigenfail up` in a second terminal; this one goes on once it is ready."""
        if self._data is not None:
            return
        folder, default = self.type('pwd; echo "${EIGENFAIL_DATA:-eigenfail-data}"').splitlines()
        named = re.search(r"--data (\S+)", options)
        self._data = DataFolder(Path(folder) / (named[1] if named else default))
        with_ray = "--functions" in options
        launcher = "--workers 1" if with_ray else "--launcher none"
        self._start(f"eigenfail up --port 0 {launcher} {options}", "up.log")
        deadline = time.monotonic() + READY_WITHIN_S
        while (address := self._data.address()) is None:
            assert time.monotonic() < deadline, (self.clone / "up.log").read_text()
            time.sleep(0.1)
        if not with_ray:
            bridge = re.search(r"--bridge \S+", options)
            also = bridge[0] if bridge else ""
            self._start(f"eigenfail worker --connect {address.hub} {also}", "worker.log")

    def _start(self, command, log):
        """Leave a process running in the background."""
        self.type(f"{command} > {self.clone / log} 2>&1 &")
        self._services.append(self.type("echo $!").strip())

    @property
    def url(self):
        """Where the service of the page answers."""
        address = self._data.address() if self._data else None
        return address.url if address else "http://127.0.0.1:8440"

    def join(self, other):
        """Use the service of another shell, which runs on its data folder."""
        self._data = other._data
        self.type(f"export EIGENFAIL_DATA={other._data.path}")
        (self.clone / "eigenfail-data").symlink_to(other._data.path)

    def write(self, name, text):
        """Put a block into the file that its first line names, in the folder of the shell."""
        text = EPISODES.sub(lambda found: str(int(found[0]) // SHARE), text)
        file = Path(self.type("pwd").strip()) / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)

    def python(self, text):
        """Run a block of Python against the service of the page."""
        file = self.clone / "block.py"
        file.write_text(
            "import functools\nimport eigenfail.client as c\n"
            f"c.Client = functools.partial(c.Client, {self.url!r})\n{text}"
        )
        self.type(f"python {file}")

    def close(self):
        """End what was started, and the shell."""
        for service in reversed(self._services):
            with suppress(ProcessLookupError):
                os.kill(int(service), signal.SIGTERM)
            # A shell that was ended by the time limit cannot wait; its services are killed below.
            with suppress(AssertionError, BrokenPipeError):
                self.type(f"wait {service}", allowed=range(256))
        self._kill()
        with suppress(BrokenPipeError):
            self._shell.stdin.close()
        self._shell.stdout.close()
        self._shell.wait()

    def _kill(self):
        """Kill the shell with all that runs in it."""
        with suppress(ProcessLookupError):
            os.killpg(self._shell.pid, signal.SIGKILL)

    def _listed(self, campaign):
        """The number of the first collision of a campaign that a line before has listed."""
        listed = rf"^ *{campaign}/(\d+) +collision "
        found = re.findall(listed, self.output, re.MULTILINE)
        assert found, f"No collision of campaign {campaign} was listed:\n{self.output}"
        return found[0]


@contextmanager
def shell(folder):
    """A shell in a copy of what a clone holds and its pages use."""
    clone, site = folder / "clone", folder / "site"
    shutil.copytree(ROOT / "examples", clone / "examples")
    for name, stands, instead in CHEAPER:
        file = clone / "examples" / name
        text = file.read_text()
        assert stands in text
        file.write_text(text.replace(stands, instead))
    (clone / ".venv").symlink_to(sys.prefix)
    site.mkdir()
    found = Shell(clone, site)
    try:
        yield found
    finally:
        found.close()


@contextmanager
def demo_in(folder, *methods):
    """What `make demo` leaves behind, with all of the noise and fewer episodes."""
    with shell(folder) as here:
        here.run("eigenfail up --data demo-data")
        here.type("export EIGENFAIL_DATA=demo-data")
        for method, episodes in methods:
            here.run(f"eigenfail run examples/{method}.toml --episodes {episodes}")
        yield here


def type_in(page, here, not_run, kinds=NO_KINDS):
    """Type a page into a shell, block by block, without the commands that are not to be run.

    Args:
        page: its path in the repository.
        here: the shell.
        not_run: beginnings of commands that cannot run here, each with its reason.
        kinds: types of TOML blocks that have a field of this name, beside campaigns and suites.
    """
    for language, block in blocks(page):
        name = FILE_NAME.match(block)
        if name:
            here.write(name[1], block)
        elif language == "python" and not is_example(block):
            here.python(block)
        elif language == "toml":
            check(block, kinds)
        elif language == "sh":
            for line in commands(block):
                if reason(line, not_run) is None:
                    here.run(line)


def is_example(block):
    """Whether a block is code that stands in a file of examples/, or its outline."""
    lines = {line.strip() for line in block.splitlines() if line.strip()}
    outline = any(line.endswith("...") for line in lines) or "dt_s: float" in lines
    files = [file.read_text() for file in (ROOT / "examples").glob("*.py")]
    return outline or any(block.strip() in text for text in files)


def check(block, kinds=NO_KINDS):
    """A campaign, a suite, or a part of a campaign: whatever it is, it would be accepted."""
    given = tomllib.loads(block)
    for field, kind in kinds.items():
        if field in given:
            msgspec.convert(given, kind)
            return
    if "base" in given:
        for member in Suite.of("page", **given).members:
            check_plugins(replace_references(member.spec))
        return
    whole = {"name": "page", "method": "monte_carlo", "episodes": 1} | given
    spec = msgspec.convert(whole, CampaignSpec)
    if spec.simulator not in {"bridge", "function"}:
        check_plugins(spec)


def seen(output, patterns):
    for pattern in patterns:
        assert re.search(pattern, output), f"'{pattern}' is not in:\n{output}"
