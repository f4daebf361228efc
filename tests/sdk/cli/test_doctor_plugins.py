"""What `eigenfail doctor` says of plug-ins that are ignored, and who brings absent ones."""

import tomllib
from pathlib import Path

import pytest
from distributions import write_record
from plugin_absence import forget_entry_points

from eigenfail import plugins
from eigenfail.cli.doctor import list_plugins
from eigenfail.errors import UnknownName

PACKAGES = Path(__file__).parents[3] / "plugins"


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Installs a distribution with entry points, whose module raises when it is imported."""

    def write(points):
        write_record(tmp_path, "eigenfail-goats", points)
        (tmp_path / "eigenfail_goats.py").write_text('raise RuntimeError("no grass")\n')
        monkeypatch.syspath_prepend(tmp_path)
        forget_entry_points()

    yield write
    forget_entry_points()


def find_wrong():
    return {each.what: each for each in list_plugins() if each.wrong}


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("eigenfail.method", "eigenfail.methods"),
        ("eigenfail.planer", "eigenfail.planners"),
        ("eigenfail_scenarios", "eigenfail.scenarios"),
    ],
)
def test_a_misspelt_group_is_named_with_the_one_that_was_meant(install, written, meant):
    assert written not in find_wrong()
    install(f"[{written}]\ngrazing = eigenfail_goats:Grazing\n")
    assert meant in find_wrong()[written].remedy


def test_groups_that_are_read_and_those_of_others_are_no_mistake(install):
    before = find_wrong()
    install("[eigenfail.exports]\n[eigenfail_goats.herds]\nx = eigenfail_goats:x\n")
    assert find_wrong() == before


def test_an_extension_that_the_service_leaves_out_is_named(install):
    install("[eigenfail.routes]\ngoats = eigenfail_goats:extension\n")
    assert "no grass" in find_wrong()["eigenfail.routes: goats"].found


def test_a_method_of_a_package_that_is_absent_names_the_package(without_plugins):
    package = plugins.PACKAGES[plugins.METHODS]["annealing"]
    with pytest.raises(UnknownName, match=f"pip install plugins/{package}") as raised:
        plugins.load.__wrapped__(plugins.METHODS, "annealing")
    assert f"{package}, which is not installed" in raised.value.problem
    with pytest.raises(UnknownName, match="'anealing' is not known"):
        plugins.load.__wrapped__(plugins.METHODS, "anealing")


def test_the_packages_bring_the_methods_that_they_are_said_to_bring():
    for group, packages in plugins.PACKAGES.items():
        for package in set(packages.values()):
            file = PACKAGES / package / "pyproject.toml"
            if file.exists():
                points = tomllib.loads(file.read_text())["project"]["entry-points"][group]
                assert set(points) == {name for name, each in packages.items() if each == package}
