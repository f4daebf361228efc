"""The paper's experiments on this world: what is run, what the paper printed, and both together."""
