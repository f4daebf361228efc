"""The dashboard's libraries, anew: fetched by npm at the manifest's versions, and built.

    make vendor

Needs npm, and nothing else does. Of ECharts only what our charts use is kept, as
`echarts.entry.js` says: half of it never runs, and browsers would read it at every visit.
"""

import hashlib
import json
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

VENDOR = Path(__file__).parents[1] / "api/eigenfail_api/dashboard/static/vendor"
ENTRY = "echarts.entry.js"
INSTALL = ("npm", "install", "--no-save", "--prefix")
BUILD = (
    *("npx", "esbuild", ENTRY, "--bundle", "--minify", "--format=iife", "--global-name=echarts"),
    *('--define:process.env.NODE_ENV="production"', "--outfile=echarts.min.js"),
)
COPIED = {
    "htmx.org": {"dist/htmx.min.js": "htmx.min.js", "LICENSE": "htmx.LICENSE.txt"},
    "echarts": {
        "LICENSE": "echarts.LICENSE.txt",
        "NOTICE": "echarts.NOTICE.txt",
        "licenses/LICENSE-d3": "echarts.LICENSE-d3.txt",
    },
}


def main() -> None:
    """Fetch, build, copy, and write down the hashes."""
    manifest = json.loads((VENDOR / "manifest.json").read_text("utf-8"))
    with TemporaryDirectory() as folder:
        fetch(Path(folder), manifest)
        build(Path(folder))
    for library in manifest:
        library["files"] = {name: digest(VENDOR / name) for name in library["files"]}
    (VENDOR / "manifest.json").write_text(json.dumps(manifest, indent=2) + "\n", "utf-8")


def fetch(folder: Path, manifest: list[dict[str, Any]]) -> None:
    """Install the libraries and what builds them; copy what is taken as it is."""
    wanted = [package for library in manifest for package in library["packages"]]
    subprocess.run([*INSTALL, folder, *wanted], check=True)
    for package, files in COPIED.items():
        for source, name in files.items():
            shutil.copy(folder / "node_modules" / package / source, VENDOR / name)


def build(folder: Path) -> None:
    """One file of the parts of ECharts that the entry names."""
    shutil.copy(VENDOR / ENTRY, folder)
    subprocess.run(BUILD, cwd=folder, check=True)
    shutil.copy(folder / "echarts.min.js", VENDOR)


def digest(path: Path) -> str:
    """SHA-256, as the manifest has it."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


if __name__ == "__main__":
    main()
