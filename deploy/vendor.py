"""The dashboard's libraries and axe-core of its tests, fetched by npm at their manifests' versions.

    python deploy/vendor.py

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

ROOT = Path(__file__).parents[1]
VENDOR = ROOT / "api/eigenfail_api/dashboard/static/vendor"
OF_TESTS = ROOT / "tests/browser/vendor"
ENTRY = "echarts.entry.js"
INSTALL = ("npm", "install", "--no-save", "--prefix")
BUILD = (
    *("npx", "esbuild", ENTRY, "--bundle", "--minify", "--format=iife", "--global-name=echarts"),
    *('--define:process.env.NODE_ENV="production"', "--outfile=echarts.min.js"),
    # Browsers that support this comment compile all functions in another thread while the file
    # arrives. Without it each function is compiled when it is first called, while the page waits.
    "--banner:js=//# allFunctionsCalledOnLoad",
)
COPIED = {
    "htmx.org": {"dist/htmx.min.js": "htmx.min.js", "LICENSE": "htmx.LICENSE.txt"},
    "echarts": {
        "LICENSE": "echarts.LICENSE.txt",
        "NOTICE": "echarts.NOTICE.txt",
        "licenses/LICENSE-d3": "echarts.LICENSE-d3.txt",
    },
    "axe-core": {
        "axe.min.js": "axe.min.js",
        "LICENSE": "axe.LICENSE.txt",
        "LICENSE-3RD-PARTY.txt": "axe.LICENSE-3RD-PARTY.txt",
    },
}


def main() -> None:
    """Fetch, build, copy, and write down the hashes."""
    for folder in (VENDOR, OF_TESTS):
        manifest = json.loads((folder / "manifest.json").read_text("utf-8"))
        with TemporaryDirectory() as fetched:
            fetch(Path(fetched), manifest, folder)
            if (folder / ENTRY).exists():
                build(Path(fetched))
        for library in manifest:
            library["files"] = {name: digest(folder / name) for name in library["files"]}
        (folder / "manifest.json").write_text(json.dumps(manifest, indent=2) + "\n", "utf-8")


def fetch(folder: Path, manifest: list[dict[str, Any]], into: Path) -> None:
    """Install the libraries and what builds them; copy into a folder what is taken as it is."""
    wanted = [package for library in manifest for package in library["packages"]]
    subprocess.run([*INSTALL, folder, *wanted], check=True)
    for library in manifest:
        for source, name in COPIED[library["name"]].items():
            shutil.copy(folder / "node_modules" / library["name"] / source, into / name)


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
