"""Starting of workers: how many, where, and what happens to them."""
