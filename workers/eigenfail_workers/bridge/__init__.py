"""Episodes in a process that holds simulator and planner, over ZeroMQ; docs/bridge.md."""
