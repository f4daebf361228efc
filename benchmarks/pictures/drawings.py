"""Draw docs/pictures: each scenario from above, a crash by shaped noise, the learning curves."""

from functools import partial

from benchmarks.figures import ROOT
from benchmarks.pictures.crash_drawing import crash_view
from benchmarks.pictures.top_view import TopView
from benchmarks.truth import curves

from eigenfail import plugins

FOLDER = ROOT / "docs" / "pictures"


def main() -> None:
    """Draw all."""
    FOLDER.mkdir(exist_ok=True)
    group = plugins.SCENARIOS
    for scenario in filter(partial(plugins.is_built_in, group), plugins.names(group)):
        (FOLDER / f"{scenario}.svg").write_text(TopView(scenario).picture(), encoding="utf-8")
    (FOLDER / "crash.svg").write_text(crash_view(), encoding="utf-8")
    curves.PICTURE.write_text(curves.picture(curves.read()), encoding="utf-8")
    print("\n".join(sorted(str(path.relative_to(ROOT)) for path in FOLDER.glob("*.svg"))))


if __name__ == "__main__":
    main()
