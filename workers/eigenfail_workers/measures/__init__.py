"""What is measured on the way: distances, surrogate safety measures, the record of an episode."""
