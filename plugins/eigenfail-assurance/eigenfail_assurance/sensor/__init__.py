"""Requirements of a planner on its sensor: the largest errors with rare enough failures."""
