"""What all processes of one run of pytest share: the first that needs it makes it."""

import fcntl
import json
import os
from pathlib import Path
from tempfile import mkdtemp


def make_once(tmp_path_factory, name, make):
    """What `make` returns, as JSON tells it again.

    Args:
        name: of the thing, as no other one is called.
        make: makes it. What it leaves in the folder that it gets stays for the others.
    """
    folder = tmp_path_factory.getbasetemp()
    # Each process of pytest-xdist has a folder of its own in that of the run.
    folder = folder.parent if folder.name.startswith("popen-") else folder
    with (folder / f"{name}.json").open("a+") as kept:
        fcntl.flock(kept, fcntl.LOCK_EX)
        if kept.seek(0, os.SEEK_END) == 0:
            kept.write(json.dumps(make(Path(mkdtemp(dir=folder)))))
        kept.seek(0)
        return json.load(kept)
