"""Episodes in an external process that holds simulator and planner, over ZeroMQ; docs/bridge.md."""
