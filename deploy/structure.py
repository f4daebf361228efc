"""Checks of the code's structure.

    make lint

A module is a concept that is read as a whole, a name stands for one thing, and imports have one
direction. Breaches are printed with their places, and the exit code is then 1. pyproject.toml says
under [tool.structure] how many modules and lines of code each package may have, and how many
breaches of each rule are tolerated. These numbers only fall: a change that needs room takes
something out.

Plug-ins are the folders of plugins/. They have no budget. Nothing outside a plug-in's folder may
import it, so that the folder can be deleted; deploy/without_plugins.py tries that.
"""

import ast
import re
import sys
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

from vulture import Vulture

ROOT = Path(__file__).parent.parent
PACKAGES = ("sdk", "api", "services", "workers")
USERS = ("examples", "benchmarks", "deploy", "migrations")
"""Scripts whose uses count. Tests are not among them: code that only tests use is unused."""

PLUGINS = tuple(sorted(file.parent for file in ROOT.glob("plugins/*/pyproject.toml")))

IRREGULAR_PARTICIPLES = """
begun bought brought built caught chosen done drawn found given gone heard held kept known led left
lost made meant met paid proven said seen sent shown spent taken thought told understood wanted
written
"""
NO_PARTICIPLES = frozenset({"seed", "feed", "embed", "speed", "need", "shed", "bleed"})

CALLED_BY_FRAMEWORKS = [
    # FastAPI and Starlette
    "@*.get",
    "@*.post",
    "@*.put",
    "@*.delete",
    "@*.patch",
    "@*.exception_handler",
    "@*.middleware",
    # typer
    "@*.command",
    "@*.callback",
    # SQLAlchemy
    "@*.listens_for",
    "@compiles",
    # functools.singledispatch, hatchling
    "@*.register",
    "@*.hookimpl",
]
PUBLIC = [
    # Of the SDK, for users and for authors of plug-ins.
    "costs_by_method",
    "simulators",
    "from_injected",
    "cumulative",
    "change_mode",
    "change_episode",
    "wait_for_proof",
    "LearnerSuite",
    "SIMULATION_CHECKS",
    "analysis_result",
    "read_disturbance",
    "write_new",
    "recorded_ms",
    "campaign_name",
    "aligned_at_end",
    "bounds_probability",
    "unread",
    "check_output_folder",
    "write_folder",
    "get_bytes",
    "draw_svg",
    "style",
    "pick_mark",
    "hatch",
    # Fields and choices that are only read from JSON, or set from it.
    "mean_log_probability",
    "startup_s",
    "began_ms",
    "size_bytes",
    "left_road_s",
    "spec_sha256",
    "data_from",
    "protocols",
    "LONGITUDINAL",
    "LATERAL",
    "GAUSSIAN_MIXTURE",
    # Read by name: columns of tables, parts of a sum.
    "r_hat",
    "simulation_s",
    # Imported by name, or by position.
    "FastTrainer",
    "SacTrainer",
    "to_html",
    "env",
]
NAMES_FOR_FRAMEWORKS = [
    # pydantic, Python (of modules and functions), enum, IPython, logging
    "model_config",
    "__getattr__",
    "__signature__",
    "_missing_",
    "_repr_html_",
    "handleError",
    "msg",
    # prometheus_client, gymnasium
    "collect",
    "observation_space",
    "action_space",
    # SQLAlchemy, sqlite3, Starlette
    "impl",
    "cache_ok",
    "inherit_cache",
    "load_dialect_impl",
    "process_bind_param",
    "isolation_level",
    "background",
    # Alembic
    "upgrade",
    "downgrade",
    "revision",
    "down_revision",
    "branch_labels",
    "depends_on",
]


def main() -> int:
    """Print the breaches of each rule that has more than are tolerated; 1 if there are any."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    structure = settings["tool"]["structure"]
    trees = {path: ast.parse(path.read_text("utf-8")) for path in _list_modules()}
    breaches = {
        "modules": [*check_budgets(count_modules(trees), structure["modules"], "modules")],
        "code_lines": [*check_budgets(count_lines(trees), structure["code_lines"], "code lines")],
        "circles": [*check_circles(trees)],
        "plugin_imports": [*check_plugin_imports()],
        "repeated_class_names": [*check_class_names(trees)],
        "participles": [*check_function_names(trees)],
        "unused": [*check_unused_code(settings["project"])],
    }
    failed = False
    for rule, found in breaches.items():
        tolerated = structure["tolerated"].get(rule, 0)
        if len(found) > tolerated:
            failed = True
            print(*found, f"{rule}: {len(found)}, of {tolerated} that are tolerated.", sep="\n")
    return 1 if failed else 0


def _list_modules() -> list[Path]:
    folders = [ROOT / package for package in PACKAGES]
    folders += [ROOT / "plugins" / package for package in _find_plugin_packages().values()]
    return sorted(path for folder in folders for path in folder.rglob("*.py"))


def _find_plugin_packages() -> dict[str, Path]:
    """The folder of each package of a plug-in, within plugins/, by the name of the package."""
    found = {}
    for folder in PLUGINS:
        for file in sorted(folder.glob("*/__init__.py")):
            found[file.parent.name] = file.parent.relative_to(ROOT / "plugins")
    return found


def _name_module(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    parts = parts[2 if parts[0] == "plugins" else 1 :]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _name_place(path: Path, node: ast.AST) -> str:
    return f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 1)}"


Trees = Mapping[Path, ast.Module]


def count_modules(trees: Trees) -> Counter[str]:
    """Count the modules of each package."""
    return Counter(path.relative_to(ROOT).parts[0] for path in trees)


def count_lines(trees: Trees) -> Counter[str]:
    """Count the lines of code of each package: docstrings, comments and blank lines are none."""
    counts: Counter[str] = Counter()
    for path, tree in trees.items():
        lines = path.read_text("utf-8").splitlines()
        code = {n for n, line in enumerate(lines, 1) if line.strip() and line.strip()[0] != "#"}
        for node in ast.walk(tree):
            # Attributes are documented by a text behind them, which is no code either.
            match node:
                case ast.Expr(value=ast.Constant(value=str()), end_lineno=int(last)):
                    code -= set(range(node.lineno, last + 1))
        counts[path.relative_to(ROOT).parts[0]] += len(code)
    return counts


def check_budgets(
    counts: Mapping[str, int], budgets: Mapping[str, int], unit: str
) -> Iterator[str]:
    """Compare a count of each package with its budget."""
    for package in PACKAGES:
        if counts[package] > budgets[package]:
            yield (
                f"{package}: {counts[package]:,} {unit}, of a budget of {budgets[package]:,}. Take "
                "something out, or make the feature a plug-in: budgets only fall."
            )


def check_circles(trees: Trees) -> Iterator[str]:
    """Find a circle of imports, those within functions included."""
    modules = {_name_module(path): tree for path, tree in trees.items()}
    graph = {name: _find_imports(tree) & modules.keys() - {name} for name, tree in modules.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        yield f"Circle of imports: {' <- '.join(error.args[1])}."


def _find_imports(tree: ast.Module) -> set[str]:
    found = set()
    for node in _walk_run_time(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found


def _walk_run_time(node: ast.AST) -> Iterator[ast.AST]:
    """Walk all nodes but those that only a type checker reads."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING":
            continue
        yield child
        yield from _walk_run_time(child)


def check_plugin_imports() -> Iterator[str]:
    """Find imports of a plug-in outside its folder, those by type checkers included."""
    packages = _find_plugin_packages()
    folders = ("conftest.py", "tests", "plugins", *PACKAGES, *USERS)
    for folder in folders:
        for path in sorted({*(ROOT / folder).rglob("*.py"), *ROOT.glob(folder)}):
            if path.is_dir():
                continue
            for node in ast.walk(ast.parse(path.read_text("utf-8"))):
                for package in _find_top_packages(node) & packages.keys():
                    if packages[package].parts[0] not in path.parts:
                        yield f"{_name_place(path, node)}: imports {package}, which is a plug-in."


def _find_top_packages(node: ast.AST) -> set[str]:
    if isinstance(node, ast.Import):
        return {alias.name.partition(".")[0] for alias in node.names}
    if isinstance(node, ast.ImportFrom) and node.module and not node.level:
        return {node.module.partition(".")[0]}
    return set()


def check_class_names(trees: Trees) -> Iterator[str]:
    """Find names of public classes that are defined more than once."""
    places = defaultdict(list)
    for path, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(_name_place(path, node))
    for name, where in sorted(places.items()):
        if len(where) > 1:
            yield f"Class {name} is defined {len(where)} times: {', '.join(where)}."


def check_function_names(trees: Trees) -> Iterator[str]:
    """Find functions of modules that are named by a participle."""
    for path, tree in trees.items():
        for node in tree.body:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and _is_participle(
                node.name
            ):
                yield f"{_name_place(path, node)}: {node.name}: name a function by verb and object."


def _is_participle(name: str) -> bool:
    is_regular = re.fullmatch(r"[a-z]+ed", name) is not None
    return name in IRREGULAR_PARTICIPLES.split() or (is_regular and name not in NO_PARTICIPLES)


def check_unused_code(project: Mapping[str, Any]) -> Iterator[str]:
    """Find code that neither the product, its templates and entry points nor its scripts use.

    What only a plug-in uses of the core counts as unused there, since the plug-in can be deleted.
    """
    vulture = Vulture(
        ignore_names=[*PUBLIC, *NAMES_FOR_FRAMEWORKS, *_find_plugin_classes(project)],
        ignore_decorators=CALLED_BY_FRAMEWORKS,
    )
    vulture.scavenge([str(ROOT / folder) for folder in (*PACKAGES, *USERS)])
    yield from _list_unused(vulture, PACKAGES)
    vulture.scavenge(list(map(str, PLUGINS)), exclude=["*/tests/*"])
    yield from _list_unused(vulture, ("plugins",))


def _list_unused(vulture: Vulture, folders: Sequence[str]) -> Iterator[str]:
    in_templates = _find_template_words()
    for item in vulture.get_unused_code():
        path = Path(item.filename).relative_to(ROOT)
        # Frameworks and readers call what stands there.
        is_example = bool({"benchmarks", "examples"} & set(path.parts))
        is_checked = path.parts[0] in folders and not is_example
        if is_checked and item.name not in in_templates:
            yield f"{path}:{item.first_lineno}: {item.message}."


def _find_plugin_classes(project: Mapping[str, Any]) -> set[str]:
    """The names that entry points of the project and of its plug-ins lead to."""
    files = [folder / "pyproject.toml" for folder in PLUGINS]
    projects = [project, *(tomllib.loads(file.read_text("utf-8"))["project"] for file in files)]
    groups = [group for each in projects for group in each["entry-points"].values()]
    return {reference.rpartition(":")[2] for group in groups for reference in group.values()}


def _find_template_words() -> set[str]:
    templates = [*(ROOT / "api").rglob("*.html"), *(ROOT / "plugins").rglob("*.html")]
    return {word for path in templates for word in re.findall(r"\w+", path.read_text("utf-8"))}


if __name__ == "__main__":
    sys.exit(main())
