"""Fixtures and checks of the core's tests, for tests of plug-ins.

A conftest.py serves only the folder in which it stands. That of a plug-in's tests takes over the
fixtures of the same kind of tests of the core: `globals().update(borrow("sdk/cli"))`.
"""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

TESTS = Path(__file__).parents[1]


def borrow(folder, file="conftest.py"):
    """Return what a file of tests/FOLDER defines, by name."""
    name = f"borrowed_{folder.replace('/', '_')}_{file.removesuffix('.py')}"
    spec = spec_from_file_location(name, TESTS / folder / file)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return {key: value for key, value in vars(module).items() if not key.startswith("_")}
