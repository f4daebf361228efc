"""Builds the stages of a Dockerfile without a container engine: layers are folders, by overlayfs.

What is the base image there is this machine's own system here.
"""

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from recipe import Stage, assignments, filled, lets_through, mounts

PIP_CACHE = Path("/root/.cache/pip")
SYSTEM = ("/proc", "/dev")
SEARCHED = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"


def sh(*words: str | Path) -> None:
    """Run a command.

    Raises:
        CalledProcessError: it failed.
    """
    subprocess.run(words, check=True)


class Built(NamedTuple):
    """A stage that was built: its layers, the newest first, and what its steps set."""

    layers: tuple[Path, ...]
    environment: dict[str, str]
    settings: dict[str, str]

    def lower(self) -> str:
        """As overlayfs wants it."""
        return ":".join((*map(str, self.layers), "/"))


def system(folder: Path) -> Built:
    """This machine as base image, with the interpreter that runs here, which anybody may reach."""
    interpreter = Path(sys.base_prefix)
    for part in (*reversed(interpreter.parents[:-1]), interpreter):
        (folder / part.relative_to("/")).mkdir(mode=0o755, parents=True)
    return Built((folder,), {"PATH": f"{interpreter / 'bin'}:{SEARCHED}"}, {})


class Builder:
    """Builds stages, one after the other."""

    def __init__(
        self, folder: Path, context: Path, arguments: Mapping[str, str], tell: Callable[[str], None]
    ) -> None:
        self._folder = folder
        self._tell = tell
        self._context = context
        self._ignored = context / "deploy" / "Dockerfile.dockerignore"
        self._arguments = arguments
        self.built: dict[str, Built] = {}
        self._system = system(folder / "system")

    def build(self, stage: Stage) -> None:
        """Do the steps of a stage, on what it begins with."""
        base = self.built.get(stage.base) or self._system
        layer = self._folder / stage.name / "layer"
        root = self._folder / stage.name / "root"
        for folder in (layer, root, layer.with_name("work")):
            folder.mkdir(parents=True)
        options = f"lowerdir={base.lower()},upperdir={layer},workdir={layer.with_name('work')}"
        sh("mount", "-n", "-t", "overlay", "overlay", "-o", options, root)
        made = Built((layer, *base.layers), dict(base.environment), dict(base.settings))
        self._bind_system(root)
        for step in stage.steps:
            self._tell(f"[{stage.name}] {step.name} {step.text[:80]}")
            getattr(self, f"_{step.name.lower()}", self._set)(root, made, step.text, step.name)
        sh("umount", "-n", "--recursive", root)
        self.built[stage.name] = made

    def _bind_system(self, root: Path) -> None:
        for name in SYSTEM:
            sh("mount", "-n", "--rbind", name, root / name[1:])
        cache = root / PIP_CACHE.relative_to("/")
        PIP_CACHE.mkdir(parents=True, exist_ok=True)
        cache.mkdir(parents=True, exist_ok=True)
        sh("mount", "-n", "--bind", PIP_CACHE, cache)

    def _set(self, _root: Path, made: Built, text: str, name: str) -> None:
        made.settings[name] = text

    def _env(self, _root: Path, made: Built, text: str, _name: str) -> None:
        for name, value in assignments(text).items():
            made.environment[name] = filled(value, made.environment)

    def _arg(self, _root: Path, made: Built, text: str, _name: str) -> None:
        name, _, default = text.partition("=")
        made.environment[name] = self._arguments.get(name, default)

    def _workdir(self, root: Path, made: Built, text: str, _name: str) -> None:
        made.settings["WORKDIR"] = text
        (root / text[1:]).mkdir(parents=True, exist_ok=True)

    def _run(self, root: Path, made: Built, text: str, _name: str) -> None:
        wanted, command = mounts(text)
        for mount in wanted:
            if mount["type"] == "bind":
                source = self._seen(mount["from"]) / mount["source"][1:]
                self._copy_in([source], root / mount["target"][1:])
        inherited = {name: os.environ[name] for name in os.environ if name.startswith("PIP_")}
        environment = inherited | {"HOME": "/root"} | made.environment
        within = (
            f"cd {made.settings['WORKDIR']} && {command}" if "WORKDIR" in made.settings else command
        )
        subprocess.run(["chroot", root, "sh", "-ec", within], env=environment, check=True)
        for mount in wanted:
            if mount["type"] == "bind":
                shutil.rmtree(root / mount["target"][1:])

    def _copy(self, root: Path, made: Built, text: str, _name: str) -> None:
        *words, target = shlex.split(text)
        place = Path(made.settings.get("WORKDIR", "/")) / target
        if words[0].startswith("--from="):
            there = self._seen(words[0].removeprefix("--from="))
            found = [there / word[1:] for word in words[1:]]
        else:
            missing = [word for word in words if not lets_through(self._ignored, word)]
            if missing:
                raise FileNotFoundError(f"not in the context of the build: {missing}")
            found = [self._context / word for word in words]
        self._copy_in(found, root / str(place)[1:], whole=target.endswith("/"))

    def _seen(self, stage: str) -> Path:
        """All layers of a stage as one folder."""
        there = self._folder / stage / "seen"
        if not there.exists():
            there.mkdir()
            options = f"lowerdir={self.built[stage].lower()}"
            sh("mount", "-n", "-t", "overlay", "overlay", "-o", options, there)
        return there

    def _copy_in(self, sources: Sequence[Path], target: Path, *, whole: bool = False) -> None:
        target.parent.mkdir(parents=True, exist_ok=True)
        if whole:
            target.mkdir(exist_ok=True)
        for source in sources:
            contents = f"{source}/." if source.is_dir() else str(source)
            sh("cp", "--archive", contents, target)
