"""Runs episodes: simulators, scenarios, planners and the worker around them."""

from eigenfail_workers.compilation import use_compiled_modules

use_compiled_modules()
