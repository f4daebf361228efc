"""Nothing that comes as data becomes code: what could do that stands in no source of ours."""

import ast
import json
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PLACES = (
    *("sdk", "api", "services", "workers", "migrations"),
    *("examples", "benchmarks", "deploy"),
)
MODULES = {"pickle", "cPickle", "_pickle", "cloudpickle", "dill", "joblib", "shelve", "marshal"}
BUILT_IN = {"eval", "exec", "compile", "__import__"}
YAML = {"load", "load_all", "full_load", "full_load_all", "unsafe_load", "unsafe_load_all"}
ALLOWED: dict[str, str] = {}
"""Files that may, and why: none."""


def sources() -> Iterator[tuple[str, str]]:
    """Name and text of every program, and of every cell of the notebooks."""
    for place in PLACES:
        for file in sorted((ROOT / place).rglob("*.py")):
            yield str(file.relative_to(ROOT)), file.read_text()
        for file in sorted((ROOT / place).rglob("*.ipynb")):
            for n, cell in enumerate(json.loads(file.read_text())["cells"]):
                if cell["cell_type"] == "code":
                    lines = [line for line in cell["source"] if not line.startswith(("%", "!"))]
                    yield f"{file.relative_to(ROOT)}[{n}]", "".join(lines)


def dangers(text: str) -> list[str]:
    """What in a text could make code of data."""
    return [found for node in ast.walk(ast.parse(text)) for found in danger(node)]


def danger(node: ast.AST) -> Iterator[str]:
    """What a piece of a program names, or calls, that could."""
    named: list[str] = []
    match node:
        case ast.Import(names=names):
            named = [name.name.partition(".")[0] for name in names]
        case ast.ImportFrom(module=module, names=names):
            named = [(module or "").partition(".")[0], *(name.name for name in names)]
        case ast.Attribute(attr=attribute):
            named = [attribute]
        case ast.Constant(value=str(word)):
            named = [word]
        case ast.Call():
            yield from call(node)
    yield from (name for name in named if name in MODULES)


def call(node: ast.Call) -> Iterator[str]:
    """Calls that could."""
    options = {option.arg: ast.unparse(option.value) for option in node.keywords}
    called = ast.unparse(node.func)
    name = called.rpartition(".")[2]
    if called in BUILT_IN or called.startswith("builtins."):
        yield called
    if called.startswith("yaml.") and name in YAML:
        yield called
    if called == "torch.load" and options.get("weights_only") != "True":
        yield called
    if options.get("allow_pickle", "False") != "False":
        yield f"{called} with allow_pickle"


def test_no_source_can_make_code_of_data():
    found = {name: dangers(text) for name, text in sources() if name not in ALLOWED}
    assert {name: each for name, each in found.items() if each} == {}
    assert len(found) > 300


@pytest.mark.parametrize(
    "text",
    [
        "import pickle",
        "import pickle as p",
        "from dill import loads",
        "from ray import cloudpickle",
        "import importlib; importlib.import_module('marshal')",
        "import joblib.memory",
        "import ray; ray.cloudpickle.loads(b'')",
        "eval('1')",
        "exec('1')",
        "torch.load('x')",
        "torch.load('x', weights_only=False)",
        "yaml.load('x', Loader=yaml.Loader)",
        "yaml.unsafe_load('x')",
        "np.load('x', allow_pickle=True)",
        "def f():\n    import shelve",
    ],
)
def test_what_could_is_found(text):
    assert dangers(text)


@pytest.mark.parametrize(
    "text",
    [
        "torch.load('x', weights_only=True)",
        "yaml.safe_load('x')",
        "np.load('x', allow_pickle=False)",
        "model.eval()",
        "re.compile('x')",
        "'no pickle anywhere'",
    ],
)
def test_what_could_not_is_left_alone(text):
    assert not dangers(text)
