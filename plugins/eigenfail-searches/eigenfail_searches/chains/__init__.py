"""`chains`: Markov chains that move from failure to failure by p(z | failure)."""
