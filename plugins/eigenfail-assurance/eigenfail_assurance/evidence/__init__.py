"""Claims about a planner, the outputs that support or refute them, and bundles to hand on."""
