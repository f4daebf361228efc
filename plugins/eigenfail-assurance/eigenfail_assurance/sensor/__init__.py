"""What a planner requires of its sensor: the largest errors at which failures stay rare enough."""
