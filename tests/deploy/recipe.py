"""A Dockerfile, as far as ours uses the language: its stages, and the steps of each."""

import re
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple


class Step(NamedTuple):
    """One instruction."""

    name: str
    text: str


class Stage(NamedTuple):
    """What follows a FROM. `base` is another stage, or the image that all begin with."""

    name: str
    base: str
    steps: tuple[Step, ...]


def steps(path: Path) -> Iterator[Step]:
    """The instructions in their order, without comments; lines that go on are one."""
    lines = [line for line in path.read_text().splitlines() if not line.lstrip().startswith("#")]
    for line in "\n".join(lines).replace("\\\n", " ").splitlines():
        if line.strip():
            name, _, text = line.strip().partition(" ")
            yield Step(name, text.strip())


def stages(path: Path) -> dict[str, Stage]:
    """The stages by name."""
    found: dict[str, Stage] = {}
    for step in steps(path):
        if step.name == "FROM":
            base, name = step.text.split(" AS ")
            found[name] = Stage(name, base, ())
        elif found:
            last = found[name]
            found[name] = last._replace(steps=(*last.steps, step))
    return found


def assignments(text: str) -> dict[str, str]:
    """Of ENV or ARG: `A=1 B="two words"`."""
    return dict(word.split("=", 1) for word in shlex.split(text) if "=" in word)


def filled(text: str, variables: Mapping[str, str]) -> str:
    """With `$NAME` and `${NAME}` replaced."""
    return re.sub(r"\$\{?(\w+)\}?", lambda match: variables.get(match[1], ""), text)


def mounts(text: str) -> tuple[list[dict[str, str]], str]:
    """The `--mount` options of a RUN, and its command."""
    found = []
    while text.startswith("--mount="):
        option, _, text = text.partition(" ")
        found.append(assignments(option.removeprefix("--mount=").replace(",", " ")))
        text = text.lstrip()
    return found, text


def lets_through(ignored: Path, source: str) -> bool:
    """Whether the context of the build has the file: ours names what it has, and nothing else."""
    kept = {line[1:] for line in ignored.read_text().splitlines() if line.startswith("!")}
    return source in kept
