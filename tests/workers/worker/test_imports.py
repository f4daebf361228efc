"""What a worker's process loads: a fleet pays for each package with every start."""

import json
import subprocess
import sys

from eigenfail_workers.compilation import SHARED

ALLOWED = {
    # the product, and its compiled modules
    *("eigenfail", "eigenfail_workers", SHARED),
    # arrays, messages, the bridge's sockets, memory and processor time
    *("numpy", "msgspec", "zmq", "psutil"),
    # the quadratic program; OSQP generates code with jinja2
    *("osqp", "scipy", "jinja2", "markupsafe"),
    # logs, and its colours where somebody reads them
    *("structlog", "rich"),
}
OPTIONAL = {
    *("attr", "charset_normalizer", "colorama", "cython_runtime", "greenlet", "pygments"),
    "typing_extensions",
}
"""Helpers that those load where they are installed."""

CODE = """
import json, sys
import eigenfail_workers.worker.child_process
from eigenfail import plugins
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeTask, PriorSource
for group in (plugins.SIMULATORS, plugins.SCENARIOS, plugins.PLANNERS):
    for name in filter(lambda name: plugins.is_built_in(group, name), plugins.names(group)):
        plugins.load(group, name)
spec = CampaignSpec(name="imports", method="monte_carlo", episodes=1, seed=1)
engine = plugins.load(plugins.ENGINES, "default")(spec.setup())
list(engine.run([EpisodeTask(0, 1, PriorSource())]))
print(json.dumps(sorted({name.partition(".")[0] for name in sys.modules})))
"""


def test_a_worker_loads_what_its_episodes_need_and_nothing_else() -> None:
    ran = subprocess.run([sys.executable, "-c", CODE], capture_output=True, check=True)
    loaded = {name for name in json.loads(ran.stdout) if not name.startswith("_")}
    assert loaded - sys.stdlib_module_names - OPTIONAL <= ALLOWED
