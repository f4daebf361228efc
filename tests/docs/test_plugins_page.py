"""docs/plugins.md names every seam, and shows a plug-in that is as good as those of the house."""

import re
import subprocess
import sys
from types import SimpleNamespace

import pytest

from eigenfail import plugins
from eigenfail.contracts.recording import EgoControl, RecordingFormat


@pytest.fixture(scope="module")
def page(root):
    return (root / "docs" / "plugins.md").read_text()


def test_every_group_of_entry_points_is_named(page):
    groups = {value for value in vars(plugins).values() if str(value).startswith("eigenfail.")}
    groups -= {plugins.__name__}
    assert len(groups) > 8
    assert [group for group in sorted(groups) if f"`{group}`" not in page] == []


def test_the_table_lists_the_folders_of_plugins(page, root):
    listed = set(re.findall(r"^\| \[([\w-]+)\]\(\.\./plugins/", page, re.MULTILINE))
    assert {file.parent.name for file in root.glob("plugins/*/pyproject.toml")} <= listed


@pytest.mark.parametrize("words", [["check"], ["format", "--check"]])
def test_the_example_is_in_the_style_of_the_house(page, root, words, tmp_path):
    code, test, routes, diary = re.findall(
        r"^```python\n(# .*?)^```$", page, re.MULTILINE | re.DOTALL
    )
    assert len([line for line in f"{code}{test}".splitlines() if line.strip()]) < 80
    texts = {"eigenfail_budget": code, "test_budget": test, "routes": routes, "diary": diary}
    for name, text in texts.items():
        (tmp_path / f"{name}.py").write_text(text.partition("\n")[2])
    ignored = ("--ignore", "D103,D100,S101,PLR2004,INP001") if words == ["check"] else ()
    ruff = [sys.executable, "-m", "ruff", *words, "--config", root / "pyproject.toml", *ignored]
    done = subprocess.run(
        [*ruff, "--no-cache", tmp_path], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


def test_the_example_of_a_format_writes_the_times_of_an_episode(page):
    (code,) = re.findall(r'^```python\n(""".*?)^```$', page, re.MULTILINE | re.DOTALL)
    made = {}
    exec(compile(code, "eigenfail_times.py", "exec"), made)
    scene = SimpleNamespace(vehicles=[None] * 3, dt_s=0.1)
    form = made["TIMES"]
    assert isinstance(form, RecordingFormat)
    assert form.write(SimpleNamespace(scene=scene), EgoControl.RECORDED) == b"0\n0.1\n0.2\n"
