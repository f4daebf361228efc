"""Time limits of tests stand in one module, but for those that are themselves tested."""

import ast
from pathlib import Path

import pytest

HERE = Path(__file__).parent
WORDS = ("PATIENCE", "DEADLINE", "WITHIN", "TIMEOUT")
LEAST_S = 5.0
"""A shorter limit is one that a test expects to run out."""

PROGRAMS = ("soak", "fuzz", "machines", "deploy/composed.py", "deploy/image_steps.py")
"""Programs of their own, which people start with limits of their own."""

TESTED = {
    "api/test_main.py": "a service that is told to stop does not wait a minute for work aside",
    "api/test_operations.py": "a probe that hangs for a minute is given up before",
    "services/campaigns/test_proofs.py": "a planner that never answers is not waited for",
    "workers/bridge/conftest.py": "limits that are handed to the bridge",
    "workers/bridge/test_trouble.py": "limits that are handed to the bridge",
}
"""Files with limits that are what a test is about."""


def is_limit(node: ast.expr) -> bool:
    """Whether an expression is a number that may be a time limit."""
    number = isinstance(node, ast.Constant) and type(node.value) in {int, float}
    return number and node.value >= LEAST_S


def find_limits(source: str) -> list[int]:
    """Return the lines that have a time limit as a literal number."""
    return sorted({node.lineno for node in ast.walk(ast.parse(source)) if has_limit(node)})


def has_limit(node: ast.AST) -> bool:
    if isinstance(node, ast.Assign):
        names = [each.id for each in node.targets if isinstance(each, ast.Name)]
        return is_limit(node.value) and any(word in name for name in names for word in WORDS)
    if isinstance(node, ast.BinOp):
        return ast.unparse(node.left).endswith("monotonic()") and is_limit(node.right)
    if not isinstance(node, ast.Call):
        return False
    limits = [each.value for each in node.keywords if each.arg in {"timeout", "timeout_s"}]
    if ast.unparse(node.func).endswith(("mark.timeout", ".set_default_timeout", ".settimeout")):
        limits += node.args
    if ast.unparse(node.func).endswith((".join", ".wait", ".communicate")):
        limits += node.args
    return any(map(is_limit, limits))


@pytest.mark.parametrize(
    "line",
    [
        "PATIENCE_S = 60.0",
        "until_s = time.monotonic() + 60",
        "process.wait(timeout=60)",
        "process.wait(60)",
        "@pytest.mark.timeout(900)\ndef test_it(): ...",
        "client.campaigns.wait(1, timeout_s=60)",
    ],
)
def test_a_limit_is_found(line: str) -> None:
    assert find_limits(line)
    assert find_limits(line.replace("60.0", "0.2").replace("60", "L").replace("900", "L")) == []


def test_limits_stand_in_one_place() -> None:
    found = {}
    for file in sorted(HERE.rglob("*.py")):
        name = file.relative_to(HERE).as_posix()
        lines = find_limits(file.read_text("utf-8"))
        if lines and not name.startswith(PROGRAMS):
            found[name] = lines
    assert found.keys() == TESTED.keys(), "take limits from deadlines, or say why not in TESTED"
