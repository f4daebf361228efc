"""The paper's experiments on this world: programme, printed numbers, and both side by side."""
