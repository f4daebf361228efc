"""Draw docs/pictures: each scenario from above, a crash by shaped noise, the learning curves.

Also writes docs/reproduction.md and docs/reproduction_drive.md, from the runs that are kept.
"""

import curves
import reproduction
import reproduction_drive
from crash_drawing import crash_view
from figures import ROOT
from top_view import TopView

from eigenfail import plugins

FOLDER = ROOT / "docs" / "pictures"


def main() -> None:
    """Draw all."""
    FOLDER.mkdir(exist_ok=True)
    for scenario in plugins.names(plugins.SCENARIOS):
        (FOLDER / f"{scenario}.svg").write_text(TopView(scenario).picture(), encoding="utf-8")
    (FOLDER / "crash.svg").write_text(crash_view(), encoding="utf-8")
    curves.PICTURE.write_text(curves.picture(curves.read()), encoding="utf-8")
    written = reproduction.illustrate_page(reproduction.read())
    reproduction.PAGE.write_text(written, encoding="utf-8")
    driven = reproduction_drive.format_page(reproduction_drive.read())
    reproduction_drive.PAGE.write_text(driven, encoding="utf-8")
    print("\n".join(sorted(str(path.relative_to(ROOT)) for path in FOLDER.glob("*.svg"))))


if __name__ == "__main__":
    main()
