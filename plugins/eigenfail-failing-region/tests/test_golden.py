"""The golden files of the plug-in."""

from golden import find_unused


def test_each_golden_file_is_used_by_a_test(plugin):
    tests = plugin / "tests"
    folder = tests / "golden"
    files = (file.relative_to(folder).with_suffix("").as_posix() for file in folder.rglob("*.*"))
    sources = (file.read_text("utf-8") for file in tests.rglob("test_*.py"))
    assert find_unused(files, sources) == []
